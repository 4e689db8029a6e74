"""A drive corrected by its loops: those found by text first, then all that its scans say of each other."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from m2t_text.loops.detection import LoopDetection
from m2t_text.loops.graph import Edge
from m2t_text.loops.uncertainty import PoseWithCovariance
from m2t_text.mapping.trajectory import without_wheels
from m2t_text.slam.closings import closings
from m2t_text.slam.frames import frames
from m2t_text.slam.key_scans import KeyScans, key_scans, spread
from m2t_text.slam.neighbours import Neighbours, pairs_nearby
from m2t_text.slam.optimisation import Constraints, optimise, optimise_gradually, robust_weights
from m2t_text.slam.reach import step_variances
from m2t_text.slam.wheels import wheel_steps
from m2t_text.util.geometry import between, compose, inverse
from m2t_text.util.types import Floats, Ints, StageProgress

ROUNDS = 6  # of comparing neighbours and optimising, at most
SETTLED = 0.05  # m; once no key scan moves by more, neighbours are compared for the last time, without a search
SAID_ALREADY = 0.01  # share of its weight that a step keeps where wheels and scans are constraints of their own
OUTLIER = 0.2  # share of its weight below which a constraint is one that the others contradict


@dataclass(frozen=True)
class Correction:
    """A corrected drive, or several that loops join.

    Attributes:
        trajectory: (S, 3) corrected poses of all scans.
        keys: its key scans.
        constraints: between key scans, by number of key scan; what the others contradict is not among them.
        kinds: (E,) "step", "loop" or "neighbour".
        dropped: how many loops and how many neighbours the others contradict.
        joined: (D,) whether each drive is tied to the most scans, directly or by way of others; where one that
            is not lies is unknown.
    """

    trajectory: Floats
    keys: KeyScans
    constraints: Constraints
    kinds: NDArray[np.str_]
    dropped: tuple[int, int]
    joined: NDArray[np.bool_]

    def count(self, kind: str) -> int:
        """How many constraints are of a kind."""
        return int((self.kinds == kind).sum())


@dataclass(frozen=True)
class _Drives:
    """Drives that loops join, before they are corrected.

    Attributes:
        keys: their key scans.
        wheels, poses: (K, 3) of the key scans, by odometry and as they were matched.
        steps, loops: constraints between key scans, by odometry and scan matching, and by text.
    """

    keys: KeyScans
    wheels: Floats
    poses: Floats
    steps: Constraints
    loops: Constraints

    def chosen(self, own: NDArray[np.bool_]) -> "_Drives":
        """Those whose key scans are the ``own`` ones (K,)."""
        steps, loops = self.steps.between(own), self.loops.between(own)
        return _Drives(self.keys.chosen(own), self.wheels[own], self.poses[own], steps, loops)


@dataclass(frozen=True)
class _Corrected:
    poses: Floats
    constraints: Constraints
    kinds: NDArray[np.str_]
    dropped: tuple[int, int]


def correct(detection: LoopDetection, jobs: int = 1, progress: StageProgress | None = None) -> Correction:
    """The drives, corrected. It looks at all of them at once: a scan may be moved by what a later one saw.

    What no loop joins is corrected by itself, so that a drive elsewhere changes nothing.
    """
    tell = progress or (lambda stage, done, of: None)
    raw = detection.survey.trajectory
    keys = key_scans(detection.log, raw)
    wheels = detection.log.odometry[keys.numbers]
    loops = _loops(detection, keys)
    whole = _Drives(keys, wheels, raw[keys.numbers], _steps(detection, keys), loops)
    frame = frames(keys, loops)
    poses, graph, kinds, dropped = whole.poses.copy(), loops.chosen([]), [], np.zeros(2, dtype=np.int64)
    for number in np.unique(frame):
        own = frame == number
        part = _corrected(whole.chosen(own[keys.drives]), jobs, tell)
        numbers = np.flatnonzero(own[keys.drives])
        poses[numbers] = part.poses
        graph = graph.joined(replace(part.constraints, pairs=numbers[part.constraints.pairs]))
        kinds.append(part.kinds)
        dropped += part.dropped
    joined = _joined(keys, graph)
    trajectory = spread(raw, keys, poses)
    return Correction(
        trajectory, keys, graph, np.concatenate(kinds), (int(dropped[0]), int(dropped[1])), joined
    )


def _corrected(drives: _Drives, jobs: int, tell: StageProgress) -> _Corrected:
    keys, loops = drives.keys, drives.loops
    compared = Neighbours(keys, jobs)
    poses = _in_one_frame(drives.poses, keys, loops)
    behind = compared.behind(poses, partial(tell, "comparing scans"))
    held = step_variances(keys, behind)

    def graph_at(poses: Floats, nearby: Constraints) -> Constraints:
        steps = drives.steps.joined(wheel_steps(drives.wheels, poses, keys, held))
        return steps.joined(loops).joined(behind).joined(nearby)

    seeds = loops.chosen([])
    poses = optimise_gradually(poses, graph_at(poses, seeds))
    known, moved = loops, np.inf
    for turn in range(ROUNDS):
        sure = step_variances(keys, graph_at(poses, seeds))
        new = closings(keys, poses, sure, known, jobs, partial(tell, f"coming back, round {turn + 1}"))
        if len(new):
            seeds, known = seeds.joined(new), known.joined(new)
            poses = optimise_gradually(poses, graph_at(poses, seeds))
        last = (moved <= SETTLED and not len(new)) or turn == ROUNDS - 1
        pairs = pairs_nearby(keys, poses, sure, known)
        nearby = compared.nearby(pairs, poses, not last, partial(tell, f"closing loops, round {turn + 1}"))
        nearby = seeds.joined(nearby)
        graph = graph_at(poses, nearby)
        before, poses = poses, optimise(poses, graph)
        moved = float(np.abs(poses - before)[:, :2].max())
        known = loops.joined(nearby.chosen(robust_weights(nearby, poses) >= OUTLIER))
        if last:
            break
    after = len(loops), len(behind) + len(nearby)
    kinds = np.repeat(["step", "loop", "neighbour"], [len(graph) - sum(after), *after])
    right = robust_weights(graph, poses) >= OUTLIER
    poses = optimise(poses, graph.chosen(right))
    dropped = int((kinds[~right] == "loop").sum()), int((kinds[~right] == "neighbour").sum())
    return _Corrected(poses, graph.chosen(right), kinds[right], dropped)


def _in_one_frame(poses: Floats, keys: KeyScans, loops: Constraints) -> Floats:
    """The key scans' poses (K, 3), each drive laid where a loop with a drive laid before puts it."""
    laid, poses = {int(keys.drives[0])}, poses.copy()
    ends = keys.drives[loops.pairs]
    for _ in range(int(keys.drives[-1])):
        new = [k for k, (a, b) in enumerate(ends.tolist()) if (a in laid) != (b in laid)]
        if not new:
            break
        start, end = loops.pairs[new[0]]
        pose = loops.poses[new[0]]
        if int(keys.drives[start]) not in laid:
            start, end, pose = end, start, inverse(pose)
        drive = keys.drives == keys.drives[end]
        frame = compose(compose(poses[start], pose), inverse(poses[end]))
        poses[drive] = compose(frame, poses[drive])
        laid.add(int(keys.drives[end]))
    return poses


def _joined(keys: KeyScans, constraints: Constraints) -> NDArray[np.bool_]:
    frame = frames(keys, constraints)
    scans = np.bincount(frame[keys.drives])
    return np.asarray(frame == np.argmax(scans))


def _steps(detection: LoopDetection, keys: KeyScans) -> Constraints:
    """From each key scan to the next of its drive, as odometry and scan matching have it.

    Where there are no wheels, scan matching may lose its way, so that a step may be wrong.
    """
    first = np.flatnonzero(np.diff(keys.drives) == 0)
    motions = detection.drifts[detection.log.name].relative(keys.numbers[first], keys.numbers[first + 1])
    information = np.linalg.inv(motions.covariance).astype(float)
    pairs = np.column_stack([first, first + 1])
    alone = np.isin(keys.drives[first], list(without_wheels(detection.log)))
    information[~alone] *= SAID_ALREADY
    return Constraints(pairs, motions.pose, information, alone)


def _loops(detection: LoopDetection, keys: KeyScans) -> Constraints:
    """The detection's own loops, from the key scan at or before a place to the one at or before a scan."""
    own = [loop for loop in detection.loops if loop.dataset == detection.log.name]
    raw = detection.survey.trajectory
    ends = np.array([(loop.place, loop.scan) for loop in own], dtype=np.int64).reshape(-1, 2)
    pairs: Ints = np.searchsorted(keys.numbers, ends, side="right") - 1
    edges = []
    for loop, (start, end), (first, last) in zip(own, keys.numbers[pairs], pairs.tolist(), strict=True):
        to_place = between(raw[start], raw[loop.place])
        back = PoseWithCovariance(between(raw[loop.scan], raw[end]), np.zeros((3, 3)))
        pose = PoseWithCovariance(compose(to_place, loop.pose.pose), loop.pose.covariance).compose(back)
        edges.append(Edge(first, last, pose))
    return constraints_of(edges, robust=True)


def constraints_of(edges: list[Edge], robust: bool) -> Constraints:
    """Edges of a pose graph as constraints between its vertices."""
    return Constraints(
        np.array([(edge.start, edge.end) for edge in edges], dtype=np.int64).reshape(-1, 2),
        np.array([edge.pose.pose for edge in edges]).reshape(-1, 3),
        np.linalg.inv(np.array([edge.pose.covariance for edge in edges]).reshape(-1, 3, 3)),
        np.full(len(edges), robust),
    )
