"""A drive corrected by its loops: those found by text first, then all that its scans say of each other."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from m2t_text.loops.detection import Walk
from m2t_text.loops.graph import Edge
from m2t_text.loops.uncertainty import Uncertain
from m2t_text.slam.key_scans import KeyScans, key_scans, spread
from m2t_text.slam.neighbours import Neighbours, pairs_nearby
from m2t_text.slam.optimisation import Constraints, optimise, robust_weights
from m2t_text.util.geometry import between, compose
from m2t_text.util.types import Floats, StageProgress

ROUNDS = 6  # of comparing neighbours and optimising, at most
SETTLED = 0.05  # m; once no key scan moves by more, neighbours are compared without a search, for the last time
OUTLIER = 0.2  # share of its weight below which a constraint is one that the others contradict


@dataclass(frozen=True)
class Correction:
    """A corrected drive.

    Attributes:
        trajectory: (S, 3) corrected poses of all scans.
        keys: its key scans.
        constraints: between key scans, by number of key scan: steps, loops and neighbours.
        steps, loops, neighbours: how many of each; the constraints are in this order.
        outliers: how many loops the others contradict, and how many neighbours.
    """

    trajectory: Floats
    keys: KeyScans
    constraints: Constraints
    steps: int
    loops: int
    neighbours: int
    outliers: tuple[int, int]


def correct(walked: Walk, jobs: int = 1, progress: StageProgress | None = None) -> Correction:
    """The drive of a walk, corrected. It looks at the whole drive: what it says of a scan may follow from later
    ones."""
    tell = progress or (lambda stage, done, of: None)
    raw = walked.survey.trajectory
    keys = key_scans(walked.log, raw)
    steps, loops = _steps(walked, keys), _loops(walked, keys)
    compared = Neighbours(keys, jobs)
    behind = compared.behind(raw[keys.numbers], partial(tell, "comparing scans"))
    fixed = steps.joined(loops).joined(behind)
    poses = optimise(raw[keys.numbers], fixed)
    known, graph = loops, fixed
    moved = np.inf
    for turn in range(ROUNDS):
        pairs = pairs_nearby(keys, poses, known)
        last = moved <= SETTLED or turn == ROUNDS - 1
        nearby = compared.nearby(pairs, poses, not last, partial(tell, f"closing loops, round {turn + 1}"))
        graph = fixed.joined(nearby)
        before, poses = poses, optimise(poses, graph)
        moved = float(np.abs(poses - before)[:, :2].max())
        known = loops.joined(_agreeing(nearby, poses))
        if last:
            break
    weights = robust_weights(graph, poses)
    ours = slice(len(steps), len(steps) + len(loops))
    wrong = int((weights[ours] < OUTLIER).sum()), int((weights[ours.stop :] < OUTLIER).sum())
    corrected = spread(raw, keys, poses)
    counts = len(steps), len(loops), len(graph) - len(steps) - len(loops)
    return Correction(corrected, keys, graph, *counts, wrong)


def _agreeing(constraints: Constraints, poses: Floats) -> Constraints:
    return constraints.chosen(robust_weights(constraints, poses) >= OUTLIER)


def _steps(walked: Walk, keys: KeyScans) -> Constraints:
    """From each key scan to the next, as odometry and scan matching have it."""
    drift = walked.drifts[walked.log.name]
    motions = drift.relative(keys.numbers[:-1], keys.numbers[1:])
    count = len(keys) - 1
    pairs = np.column_stack([np.arange(count), np.arange(1, count + 1)])
    information = np.linalg.inv(motions.covariance).astype(float)
    return Constraints(pairs, motions.pose, information, np.zeros(count, dtype=bool))


def _loops(walked: Walk, keys: KeyScans) -> Constraints:
    """The walk's own loops, from the key scan at or before a place to the one at or before a scan."""
    own = [loop for loop in walked.loops if loop.dataset == walked.log.name]
    raw = walked.survey.trajectory
    ends = np.array([(loop.place, loop.scan) for loop in own], dtype=np.int64).reshape(-1, 2)
    pairs = np.searchsorted(keys.numbers, ends, side="right") - 1
    poses, information = [], []
    for loop, (start, end) in zip(own, keys.numbers[pairs], strict=True):
        to_place = between(raw[start], raw[loop.place])
        back = Uncertain(between(raw[loop.scan], raw[end]), np.zeros((3, 3)))
        pose = Uncertain(compose(to_place, loop.pose.pose), loop.pose.covariance).then(back)
        poses.append(pose.pose)
        information.append(np.linalg.inv(pose.covariance))
    return Constraints(
        pairs,
        np.array(poses).reshape(-1, 3),
        np.array(information).reshape(-1, 3, 3),
        np.ones(len(own), dtype=bool),
    )


def constraints_of(edges: list[Edge], robust: bool) -> Constraints:
    """Edges of a pose graph as constraints between its vertices."""
    return Constraints(
        np.array([(edge.start, edge.end) for edge in edges], dtype=np.int64).reshape(-1, 2),
        np.array([edge.pose.pose for edge in edges]).reshape(-1, 3),
        np.linalg.inv(np.array([edge.pose.covariance for edge in edges]).reshape(-1, 3, 3)),
        np.full(len(edges), robust),
    )
