"""Where odometry leaps or begins again: no robot moves so, and nothing is known of the way there."""

import numpy as np
from numpy.typing import NDArray

from m2t_text.errors import PartError
from m2t_text.util.geometry import between, compose, inverse, wrap
from m2t_text.util.types import Floats

# A step is a leap if it is farther than LEAP, and faster than FAST and than MORE times the usual fast step:
LEAP = (0.3, 0.3)  # m and rad
FAST = (3.0, 2 * np.pi)  # m/s and rad/s
MORE = 4.0
EVER = (25.0, 4 * np.pi)  # m/s and rad/s; no robot with a 2D laser is faster, however fast it usually is
USUAL = 95  # percentile of the steps that move
AGAIN = 1e-3  # m and rad; odometry that begins again does so at zero
STALLED = 1.0  # s; odometry that stands so long may catch up in one step
ALONE = (5.0, 2.0)  # m and rad; a step that is farther is a leap where there are no times
TOO_MANY_LEAPS = (10, 0.02)  # leaps, and of all steps, from which on they are not those of one robot


def leaps(poses: Floats, times: Floats) -> NDArray[np.bool_]:
    """(N - 1,) which steps between poses (N, 3) at ``times`` (N,), seconds, no robot makes.

    Raises PartError if they are so many that the poses cannot be of one robot.
    """
    if len(poses) < 2:
        return np.zeros(0, dtype=np.bool_)
    steps = between(poses[:-1], poses[1:])
    far = np.stack([np.hypot(steps[:, 0], steps[:, 1]), np.abs(steps[:, 2])])
    again = (np.abs(poses[1:]) < AGAIN).all(axis=1) & (far > 3 * _usual(far)[:, None]).any(axis=0)
    gaps = np.diff(times)
    if (gaps > 0).any():
        found = (far > np.array(LEAP)[:, None]) & _fast(far, gaps)
    else:
        found = far > np.maximum(np.array(ALONE), MORE * _usual(far))[:, None]
    again &= (far > np.array(LEAP)[:, None] / 3).any(axis=0)
    leapt = np.logical_or(found.any(axis=0), again)
    if leapt.sum() > max(TOO_MANY_LEAPS[0], TOO_MANY_LEAPS[1] * len(leapt)):
        raise PartError(
            f"odometry leaps {leapt.sum():,} times in {len(poses):,} poses, so they are not of one robot; name "
            "another topic, or `none` to go by scan matching alone, with --odometry-topic"
        )
    return leapt


def _fast(far: Floats, gaps: Floats) -> NDArray[np.bool_]:
    """(2, N) which steps are faster than a robot that now and then stalls, or reports late, and catches up."""
    gaps = np.maximum(gaps, 0.5 * np.median(gaps[gaps > 0]))  # messages are written in bursts
    least = np.clip(MORE * _usual(far / gaps), FAST, EVER)
    since = gaps.copy()  # s since the last pose that differs
    for k in np.flatnonzero((far[:, :-1] < 1e-4).all(axis=0)) + 1:
        since[k] = max(gaps[k], min(since[k - 1] + gaps[k], STALLED))
    speeds = far / since
    for other in (np.roll(np.arange(len(gaps)), 1), np.roll(np.arange(len(gaps)), -1)):
        speeds = np.minimum(speeds, (far + far[:, other]) / (gaps + gaps[other]))
    return speeds > least[:, None]


def _usual(values: Floats) -> Floats:
    """(2,) the usual great values of two rows (2, N), of those that are not next to zero."""
    return np.array([np.percentile(row[row > 1e-4], USUAL) if (row > 1e-4).any() else 0.0 for row in values])


def joined(poses: Floats, drives: NDArray[np.int64]) -> Floats:
    """The poses (N, 3) with each drive laid where the one before ends, so that nothing leaps."""
    result = poses.copy()
    for begin in np.flatnonzero(np.diff(drives)) + 1:
        frame = compose(result[begin - 1], inverse(poses[begin]))
        drive = drives == drives[begin]
        result[drive] = compose(frame, poses[drive])
    result[:, 2] = wrap(result[:, 2])
    return result


def drives_of(leapt: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(N,) the number of each pose's drive, by the steps (N - 1,) between which a new one begins."""
    return np.concatenate([[0], np.cumsum(leapt)]).astype(np.int64)


def stands(poses: Floats) -> bool:
    """Whether poses (N, 3) are all one: nothing tells how the robot moved."""
    return bool(np.ptp(poses, axis=0).max(initial=0.0) < 1e-9)
