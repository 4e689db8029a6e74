"""GTSAM as an independent reader of g2o files and an independent optimiser."""

from pathlib import Path

import numpy as np


def optimise_g2o(path: Path, held: int = 0) -> np.ndarray:
    """(V, 3) the poses of a g2o file by GTSAM's least squares, one vertex held where it is."""
    import gtsam

    graph, initial = gtsam.readG2o(str(path), False)
    graph.add(gtsam.PriorFactorPose2(held, initial.atPose2(held), gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)))
    poses: np.ndarray = gtsam.utilities.extractPose2(
        gtsam.LevenbergMarquardtOptimizer(graph, initial).optimize()
    )
    return poses
