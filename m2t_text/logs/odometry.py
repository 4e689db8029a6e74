"""Which poses of a log are raw wheel odometry and which are ground truth, told from the data alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m2t_text.logs.leaps import drives_of, joined, leaps
from m2t_text.util.geometry import between, compose, inverse, wrap
from m2t_text.util.types import Floats

CLOCK_SLACK = 1.0  # s; messages of several programs reach a logger out of order by less
ON_POLYLINE = 0.02  # m; a pose taken from the wheels lies as near to the polyline of the odometry lines
RIGID = (0.05, 0.05)  # m, rad; two poses of one body keep their offset within this
LINES_AROUND = 3  # odometry lines before and after a scan between which its pose may lie


@dataclass(frozen=True)
class Track:
    """Poses of one kind in the order of the file: ``lines`` (N,), ``times`` (N,), ``poses`` (N, 3)."""

    lines: Floats
    times: Floats
    poses: Floats


@dataclass(frozen=True)
class Poses:
    """The poses of the scans.

    Attributes:
        odometry: (S, 3) of the robot, from the wheels alone.
        drives: (S,) the number of each scan's drive; odometry leaps from one to the next.
        truth: (S, 3) corrected robot poses, or None.
        laser: (3,) pose of the laser in the robot's frame.
        backwards: lines at which time ran backwards.
    """

    odometry: Floats
    drives: NDArray[np.int64]
    truth: Floats | None
    laser: Floats
    backwards: Floats


def separate(lasers: Track, robots: Floats, wheels: Track, damaged: Floats, offset: float) -> Poses:
    """Tell odometry from ground truth.

    ``lasers`` and ``robots`` (S, 3) are the two poses written with each scan, ``wheels`` the odometry lines,
    ``damaged`` the numbers of the scan lines that were skipped and ``offset`` the laser's place in front of the
    robot's centre as the parameters claim it, metres.

    Four kinds of logs are told apart: corrected and restarted (see ``restarts``); corrected, with odometry
    lines that the scans' poses leave; corrected without odometry lines, the first pose of a scan leaving the
    second; and not corrected.

    Raises PartError if the odometry cannot be that of one robot.
    """
    laser, rigid = _laser_pose(lasers.poses, robots, offset)
    same = bool(np.array_equal(lasers.poses, robots))
    # Where both poses are one, it is the laser's: the maps of logs with an offset are sharp only so.
    corrected = compose(lasers.poses, inverse(laser)) if same or not rigid else _wrapped(robots)
    backwards = np.empty(0)
    if len(wheels.lines) >= 2:
        restart = restarts(lasers, wheels, damaged)
        if same and restart is not None:
            steps = between(wheels.poses[:-1], wheels.poses[1:])
            chained = chain(wheels.poses[0], np.where(restart[1:, None], 0.0, steps))
            times = wheels.times.copy()
            times[1:][restart[1:]] = wheels.times[:-1][restart[1:]]
            odometry, drives, backwards = interpolate(lasers, Track(wheels.lines, times, chained))
            return Poses(compose(odometry, inverse(laser)), drives, corrected, laser, backwards)
        odometry, drives, backwards = interpolate(lasers, wheels)
        if not _on_track(robots, lasers.lines, wheels):
            return Poses(odometry, drives, corrected, laser, backwards)
    drives = drives_of(leaps(robots, lasers.times))
    return Poses(joined(robots, drives), drives, None if rigid else corrected, laser, backwards)


def from_wheels(scans: Track, wheels: Track, offset: float) -> Poses:
    """The poses of scans that are written without any, by the odometry lines; `separate` handles the rest."""
    laser = np.array([offset, 0.0, 0.0])
    if len(wheels.lines) < 2:
        count = len(scans.lines)
        return Poses(np.zeros((count, 3)), np.zeros(count, dtype=np.int64), None, laser, np.empty(0))
    odometry, drives, backwards = interpolate(scans, wheels)
    return Poses(odometry, drives, None, laser, backwards)


def restarts(scans: Track, wheels: Track, damaged: Floats) -> NDArray[np.bool_] | None:
    """Which odometry lines (N,) restart at the corrected pose; None if the log is not written so.

    GMapping writes a corrected log so: after each scan comes an odometry line that repeats the corrected pose,
    older than the scan, and the lines up to the next scan continue from there. Such a line is no motion.
    """
    scan = np.searchsorted(scans.lines, wheels.lines) - 1
    first = np.diff(scan, prepend=-1) > 0
    repeats = first & (wheels.poses == scans.poses[scan]).all(axis=1)
    timeless = not scans.times.any()
    repeats &= timeless | (wheels.times < scans.times[scan])
    followed = np.count_nonzero(first)
    continued = np.count_nonzero(np.bincount(scan[scan >= 0]) >= 2)
    if repeats.sum() < max(1, followed / 2) or continued < followed / 2:
        return None
    return repeats | np.isin(wheels.lines, damaged + 1)


def chain(start: Floats, steps: Floats) -> Floats:
    """The poses (N + 1, 3) that steps (N, 3) lead to from ``start``; a step is seen from the pose before it."""
    theta = start[2] + np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    c, s = np.cos(theta[:-1]), np.sin(theta[:-1])
    moves = np.stack([c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]], axis=1)
    xy = start[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
    return np.column_stack([xy, wrap(theta)])


def interpolate(scans: Track, wheels: Track) -> tuple[Floats, NDArray[np.int64], Floats]:
    """Wheel poses (S, 3) at the scans, their drives (S,), and the lines at which time runs backwards.

    Interpolated by time; by line where the times are missing, too coarse or run backwards. Each drive is laid
    where the one before ends.
    """
    lines = np.concatenate([scans.lines, wheels.lines])
    order = np.argsort(lines, kind="stable")
    times = np.concatenate([scans.times, wheels.times])[order]
    late = np.maximum.accumulate(times) - times > CLOCK_SLACK
    for track in (scans, wheels):
        late[np.isin(lines[order], track.lines[1:][np.diff(track.times) < 0])] = True
    timed = np.unique(scans.times).size > scans.times.size / 2
    usable = timed and not late.any()
    keys, at = (wheels.times, scans.times) if usable else (wheels.lines, scans.lines)
    drives = drives_of(leaps(wheels.poses, wheels.times if timed else np.zeros(len(wheels.times))))
    tracked = joined(wheels.poses, drives) if drives[-1] else wheels.poses
    columns = (*tracked[:, :2].T, np.unwrap(tracked[:, 2]))
    poses = np.column_stack([np.interp(at, keys, column) for column in columns])
    driven = drives[np.maximum(np.searchsorted(keys, at, side="right") - 1, 0)]
    return _wrapped(poses), driven, lines[order][late] if timed else np.empty(0)


def _wrapped(poses: Floats) -> Floats:
    return np.column_stack([poses[:, :2], wrap(poses[:, 2])])


def _laser_pose(lasers: Floats, robots: Floats, offset: float) -> tuple[Floats, bool]:
    """The laser's pose on the robot, and whether the two poses of the scans are those of one body."""
    offsets = between(robots, lasers)
    middle = np.median(offsets, axis=0)
    middle[2] = wrap(np.median(wrap(offsets[:, 2] - offsets[0, 2])) + offsets[0, 2])
    away = between(np.broadcast_to(middle, offsets.shape), offsets)
    off = (np.hypot(away[:, 0], away[:, 1]) > RIGID[0]) | (np.abs(away[:, 2]) > RIGID[1])
    rigid = bool(off.mean() < 0.1)
    measured = rigid and not np.allclose(middle, 0.0, atol=1e-4)
    return middle if measured else np.array([offset, 0.0, 0.0]), rigid


def _on_track(poses: Floats, lines: Floats, wheels: Track) -> bool:
    """Whether the poses (S, 3) are read off the wheels, that is lie on the polyline of the odometry lines."""
    at = np.searchsorted(wheels.lines, lines)
    nearest = np.full(len(poses), np.inf)
    for shift in range(-LINES_AROUND, LINES_AROUND):
        a = wheels.poses[np.clip(at + shift, 0, len(wheels.lines) - 1), :2]
        b = wheels.poses[np.clip(at + shift + 1, 0, len(wheels.lines) - 1), :2]
        along = ((poses[:, :2] - a) * (b - a)).sum(axis=1) / np.maximum(((b - a) ** 2).sum(axis=1), 1e-12)
        foot = a + np.clip(along, 0.0, 1.0)[:, None] * (b - a)
        nearest = np.minimum(nearest, np.hypot(*(poses[:, :2] - foot).T))
    return bool((nearest > ON_POLYLINE).mean() < 1 / 3)
