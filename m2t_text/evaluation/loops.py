"""How far loops correct a trajectory (needs GTSAM).

Each log is walked, its graph written as g2o, read back and optimised by GTSAM, by least squares and without any
robust kernel, so that one wrong loop would bend it all. The ground truth judges what comes out.
"""

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from m2t_text.errors import LogError, M2TError
from m2t_text.loops.detection import Walk
from m2t_text.loops.export import to_g2o, write
from m2t_text.loops.graph import pose_graph
from m2t_text.util.geometry import between, transform
from m2t_text.util.types import Floats

HELD = 1e-6  # m and rad; standard deviation of the first pose, which holds the graph in place
WRONG = 1.0  # m by which a loop's relative pose errs that is no closure at all


@dataclass(frozen=True)
class Assessment:
    """What loops do to one log.

    Attributes:
        name: of the dataset.
        loops: number of loops in the graph.
        wrong: of them, those off by more than WRONG.
        odometry, matched, optimised: absolute trajectory error (m) of the raw odometry, of the trajectory from
            odometry and scan matching, and of the optimised graph.
    """

    name: str
    loops: int
    wrong: int
    odometry: float
    matched: float
    optimised: float


def assess(walked: Walk) -> Assessment:
    """Optimises and judges one walk. Raises LogError if its log has no ground truth."""
    log, truth = walked.log, walked.log.ground_truth
    if truth is None:
        raise LogError(f"{log.name} has no ground truth to judge by: name a log with corrected poses")
    graph = pose_graph(walked)
    with TemporaryDirectory(prefix="m2t-text-") as folder:
        path = Path(folder) / "graph.g2o"
        write(path, to_g2o(graph))
        corrected = optimise(path)
    errors = [between(between(truth[e.start], truth[e.end]), e.pose.pose) for e in graph.loops]
    return Assessment(
        log.name,
        len(graph.loops),
        sum(bool(np.hypot(*error[:2]) > WRONG) for error in errors),
        *(trajectory_error(poses, truth) for poses in (log.odometry, graph.vertices, corrected)),
    )


def optimise(path: Path) -> Floats:
    """(V, 3) the poses of a g2o file as GTSAM optimises them, the first one held where it is."""
    try:
        import gtsam
    except ImportError as error:
        raise M2TError("GTSAM is missing: pip install gtsam") from error

    graph, initial = gtsam.readG2o(str(path), False)
    first = gtsam.noiseModel.Isotropic.Sigma(3, HELD)
    graph.add(gtsam.PriorFactorPose2(0, initial.atPose2(0), first))
    result = gtsam.LevenbergMarquardtOptimizer(graph, initial).optimize()
    poses: Floats = gtsam.utilities.extractPose2(result)
    return poses


def trajectory_error(poses: Floats, truth: Floats) -> float:
    """The absolute trajectory error: RMS metres between the places of poses and truth (S, 3), rigidly aligned.

    By Umeyama, "Least-squares estimation of transformation parameters" (1991), without scale.
    """
    a, b = poses[:, :2] - poses[:, :2].mean(axis=0), truth[:, :2] - truth[:, :2].mean(axis=0)
    cross, dot = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()
    laid = transform(np.array([0.0, 0.0, np.arctan2(cross, dot)]), a)
    return float(np.sqrt(((laid - b) ** 2).sum(axis=1).mean()))
