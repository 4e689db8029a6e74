"""How far loops correct a trajectory: judged by a log's corrected poses, or by relations that people measured.

Four trajectories of one drive are compared: that of its odometry, that of scan matching, the latter optimised
with the loops alone, by plain least squares, so that one wrong loop would bend it all; and that of `correct`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from m2t_text.errors import LogError
from m2t_text.evaluation.cells import CellAgreement, cell_agreement
from m2t_text.evaluation.relations import RelationErrors, Relations, published, relation_errors
from m2t_text.loops.detection import LoopDetection
from m2t_text.loops.graph import pose_graph
from m2t_text.slam.correction import constraints_of, correct
from m2t_text.slam.optimisation import optimise
from m2t_text.util.geometry import between, compose
from m2t_text.util.types import Floats, StageProgress

WRONG = 1.0  # m by which a loop's relative pose errs that is no closure at all
STAGES = ("odometry", "scan_matching", "loops", "map")


@dataclass(frozen=True)
class Assessment:
    """What loops do to one log.

    Attributes:
        name: of the dataset.
        loops: number of loops in the graph.
        wrong: of them, those off by more than WRONG; None without corrected poses.
        trajectories: by stage, (S, 3) each.
        absolute: by stage, the absolute trajectory error in metres; empty without corrected poses.
        relative: by stage, the errors by relations; empty without relations.
        cells: of the last stage's map, its occupied cells against those at the corrected poses; None without.
    """

    name: str
    loops: int
    wrong: int | None
    trajectories: dict[str, Floats]
    absolute: dict[str, float]
    relative: dict[str, RelationErrors]
    cells: CellAgreement | None = None

    def to_json(self) -> dict[str, Any]:
        """The document of ``evaluate-loops --json`` for this log."""
        return {
            "dataset": self.name,
            "scans": len(self.trajectories["odometry"]),
            "loops": self.loops,
            "wrong": self.wrong,
            "absolute_trajectory_error": self.absolute,
            "occupied_cells": self.cells and self.cells.to_json(),
            "relations": {stage: errors.to_json() for stage, errors in self.relative.items()},
            "published": {who: list(figures) for who, figures in published(self.name).items()},
        }


def assess(
    detection: LoopDetection,
    relations: Relations | None = None,
    jobs: int = 1,
    progress: StageProgress | None = None,
) -> Assessment:
    """Corrects and judges one detection.

    Raises LogError if there is nothing to judge by: its log has no corrected poses, and there are no relations.
    """
    log, truth = detection.log, detection.log.ground_truth
    if truth is None and relations is None:
        raise LogError(
            f"{log.name} has no ground truth to judge by: name a log with corrected poses, or --relations"
        )
    graph = pose_graph(detection)
    edges = constraints_of([*graph.steps, *graph.loops], robust=False)
    looped = optimise(graph.vertices, edges)[: graph.scans]
    corrected = correct(detection, jobs, progress).trajectory
    poses = (log.odometry, graph.vertices[: graph.scans], looped, corrected)
    trajectories = dict(zip(STAGES, poses, strict=True))
    absolute, relative, wrong, cells = {}, {}, None, None
    if truth is not None:
        cells = cell_agreement(log, detection.survey, aligned(corrected, truth), truth)
        absolute = {stage: trajectory_error(one, truth) for stage, one in trajectories.items()}
        errors = [between(between(truth[e.start], truth[e.end]), e.pose.pose) for e in graph.loops]
        wrong = sum(bool(np.hypot(*error[:2]) > WRONG) for error in errors)
    if relations is not None:
        relative = {stage: relation_errors(log, one, relations) for stage, one in trajectories.items()}
    return Assessment(log.name, len(graph.loops), wrong, trajectories, absolute, relative, cells)


def trajectory_error(poses: Floats, truth: Floats) -> float:
    """The absolute trajectory error: RMS metres between places of poses and truth (S, 3), rigidly aligned."""
    return float(np.sqrt(((aligned(poses, truth) - truth)[:, :2] ** 2).sum(axis=1).mean()))


def aligned(poses: Floats, truth: Floats) -> Floats:
    """The poses (S, 3), moved rigidly so that their places fit those of the truth (S, 3) best.

    By Umeyama, "Least-squares estimation of transformation parameters" (1991), without scale.
    """
    middle, true_middle = poses[:, :2].mean(axis=0), truth[:, :2].mean(axis=0)
    a, b = poses[:, :2] - middle, truth[:, :2] - true_middle
    cross, dot = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()
    back = np.array([*-middle, 0.0])
    turn = np.array([*true_middle, np.arctan2(cross, dot)])
    return compose(turn, back + poses)
