"""Local maps: for every scan, what the robot saw on the next 3 m of its way (paper, IV-A)."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from m2t_text.config import MappingParameters
from m2t_text.geometry import between, travel, wrap

Floats = NDArray[np.float64]

STILL = (0.05, np.radians(2.0))  # a scan that moved less, in metres and radians, adds nothing to a map


@dataclass(frozen=True)
class LocalMap:
    """What was seen on one run, in the robot frame of the run's first scan.

    Attributes:
        points: (N, 2) metres; one point for each occupied cell: the mean of the hits in it, which keeps the
            walls sharp when the map is turned to another frame.
        trajectory: (K, 3) robot poses of the run: the viewpoints.
        first_scan, last_scan: indices into the log.
        travel: (2,) metres of travel at the begin and the end of the run.
        pose: (3,) robot pose of the first scan in the frame of the whole trajectory.
    """

    points: Floats
    trajectory: Floats
    first_scan: int
    last_scan: int
    travel: Floats
    pose: Floats


@dataclass(frozen=True)
class Survey:
    """A log made ready for cutting local maps out of it.

    Attributes:
        points: (P, 2) hits of all scans within the range limit, robot frame, metres.
        starts: (S + 1,) the hits of scan i are ``points[starts[i]:starts[i + 1]]``.
        trajectory: (S, 3) robot poses in one frame, from odometry and scan matching.
    """

    points: Floats
    starts: NDArray[np.int64]
    trajectory: Floats


def run_starts(survey: Survey, run_length: float) -> NDArray[np.int64]:
    """Indices of the scans after which the robot travelled at least ``run_length`` metres."""
    way = travel(survey.trajectory)
    return np.flatnonzero(way[-1] - way >= run_length)


def local_maps(
    survey: Survey, parameters: MappingParameters, starts: NDArray[np.int64] | None = None
) -> Iterator[LocalMap]:
    """The local maps that begin at the scans ``starts``; without it, one for every complete run."""
    way = travel(survey.trajectory)
    moved = _moved(survey.trajectory)
    for first in run_starts(survey, parameters.run_length) if starts is None else starts:
        last = int(np.searchsorted(way, way[first] + parameters.run_length, side="right")) - 1
        run = first + np.flatnonzero(moved[first : last + 1])
        if not len(run) or run[0] != first:
            run = np.concatenate([[first], run])
        poses = between(survey.trajectory[first], survey.trajectory[run])
        yield LocalMap(
            points=occupied(survey.points, survey.starts, run, poses, parameters.cell),
            trajectory=poses,
            first_scan=int(first),
            last_scan=last,
            travel=way[[first, last]],
            pose=survey.trajectory[first],
        )


def _moved(trajectory: Floats) -> NDArray[np.bool_]:
    """Which scans moved since the last one that did, so that standing still costs nothing."""
    moved = np.zeros(len(trajectory), dtype=bool)
    last = None
    for i, pose in enumerate(trajectory):
        if last is None or np.hypot(*(pose - last)[:2]) >= STILL[0] or abs(wrap(pose[2] - last[2])) >= STILL[1]:
            moved[i], last = True, pose
    return moved


@njit(cache=True, nogil=True)
def occupied(
    points: Floats, starts: NDArray[np.int64], scans: NDArray[np.int64], poses: Floats, cell: float
) -> Floats:
    """Mean hit of every occupied cell, (N, 2), ordered by cell, of the ``scans`` placed at ``poses`` (K, 3)."""
    total = 0
    for scan in scans:
        total += starts[scan + 1] - starts[scan]
    placed = np.empty((total, 2))
    n = 0
    for k in range(len(scans)):
        c, s = np.cos(poses[k, 2]), np.sin(poses[k, 2])
        for i in range(starts[scans[k]], starts[scans[k] + 1]):
            placed[n, 0] = poses[k, 0] + c * points[i, 0] - s * points[i, 1]
            placed[n, 1] = poses[k, 1] + s * points[i, 0] + c * points[i, 1]
            n += 1
    if total == 0:
        return placed
    low_x, low_y = np.floor(placed[:, 0].min() / cell), np.floor(placed[:, 1].min() / cell)
    width = int(np.floor(placed[:, 0].max() / cell) - low_x) + 1
    height = int(np.floor(placed[:, 1].max() / cell) - low_y) + 1
    sums = np.zeros((width * height, 3))
    for i in range(total):
        slot = int(np.floor(placed[i, 0] / cell) - low_x) * height + int(np.floor(placed[i, 1] / cell) - low_y)
        sums[slot, 0] += placed[i, 0]
        sums[slot, 1] += placed[i, 1]
        sums[slot, 2] += 1
    slots = np.flatnonzero(sums[:, 2])
    means = np.empty((len(slots), 2))
    for i in range(len(slots)):
        means[i, 0] = sums[slots[i], 0] / sums[slots[i], 2]
        means[i, 1] = sums[slots[i], 1] / sums[slots[i], 2]
    return means
