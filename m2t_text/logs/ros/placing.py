"""The scans of a bag's lasers, each at the pose that the odometry gives at its time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m2t_text.logs.beams import upside_down
from m2t_text.logs.leaps import joined
from m2t_text.logs.log import Scan
from m2t_text.logs.odometry import Track, interpolate
from m2t_text.logs.returns import no_returns, told, without
from m2t_text.logs.ros.clocks import Timed
from m2t_text.logs.ros.recording import Sweep
from m2t_text.util.types import Floats

OUTSIDE = 0.1  # s before the first odometry or after the last at which a scan is taken to be at its pose


@dataclass(frozen=True)
class Laser:
    """One laser: its sweeps, whether they are as seen from above, and its pose (4, 4) on the robot."""

    topic: str
    sweeps: list[Sweep]
    level: bool
    mount: Floats


def placed(
    scans: Timed, wheels: Timed | None, poses: Floats
) -> tuple[NDArray[np.int64], Floats, NDArray[np.int64]]:
    """The sweeps (K,) whose poses are told, in the order of time; their poses (K, 3) and drives (K,)."""
    order = np.lexsort((scans.times, scans.epochs))
    if wheels is None:
        return order, np.zeros((len(order), 3)), scans.epochs[order]
    kept: list[NDArray[np.int64]] = []
    found: list[Floats] = []
    drives: list[NDArray[np.int64]] = []
    for epoch in np.unique(scans.epochs):
        ours = order[scans.epochs[order] == epoch]
        theirs = np.flatnonzero(wheels.epochs == epoch)
        if not len(theirs):
            continue
        times, first = np.unique(wheels.times[theirs], return_index=True)
        ours = ours[(scans.times[ours] >= times[0] - OUTSIDE) & (scans.times[ours] <= times[-1] + OUTSIDE)]
        if not len(ours):
            continue
        at = scans.times[ours]
        track = Track(times, times, poses[theirs][first])
        placed, driven, _ = interpolate(Track(at, at, np.empty((0, 3))), track)
        kept.append(ours)
        found.append(placed)
        drives.append(driven + (drives[-1].max() + 1 if drives else 0))
    if not kept:
        return np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty(0, dtype=np.int64)
    numbers = np.concatenate(drives)
    whole = np.concatenate(found)
    return np.concatenate(kept), joined(whole, numbers) if len(found) > 1 else whole, numbers


def scans_of(
    laser: Laser, times: Floats, kept: NDArray[np.int64], poses: Floats, drives: NDArray[np.int64]
) -> tuple[list[Scan], list[str]]:
    """The scans of a laser, beams counter-clockwise as seen from above, and a warning for odd readings."""
    sweeps = [laser.sweeps[k] for k in kept]
    recurring = no_returns([one.ranges for one in sweeps], [one.angles for one in sweeps])
    scans = []
    for sweep, time, pose, drive in zip(sweeps, times[kept], poses, drives, strict=True):
        ranges, angles = without(sweep.ranges, recurring), sweep.angles
        if not laser.level and laser.mount[2, 2] < 0:
            ranges, angles = upside_down(ranges, angles)
        if angles[0] > angles[-1]:
            ranges, angles = ranges[::-1], angles[::-1]
        scans.append(Scan(ranges, angles, pose, float(time), sweep.number, int(drive)))
    total = sum(one.ranges.size for one in sweeps)
    return scans, list(told(recurring, total))
