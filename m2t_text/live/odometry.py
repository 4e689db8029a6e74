"""Odometry as it comes: late, twice, with gaps, or leaping; and where the robot was when a scan was taken."""

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from m2t_text.errors import LogError
from m2t_text.logs.leaps import AGAIN, EVER, LEAP, STALLED
from m2t_text.util.geometry import between, wrap
from m2t_text.util.types import Floats

HELD = 10.0  # s of odometry that are kept
MAX_MESSAGES = 20_000  # messages that are kept
GAP = 1.0  # s without odometry over which nothing is interpolated
SLACK = 1.0  # s by which messages come late; if it is more, the clock began again


@dataclass(frozen=True)
class Placed:
    """Where odometry says that the robot was, ``pose`` (3,), and the number of the drive, see `Scan`."""

    pose: Floats
    drive: int


class OdometryBuffer:
    """The last seconds of odometry.

    A message that comes late is put in its place, one that repeats another's time is left out. Where the clock
    begins again or the pose leaps, a new drive begins.

    Examples:
        >>> import m2t_text as m2t
        >>> odometry = m2t.OdometryBuffer()
        >>> for time, x in ((0.0, 1.0), (0.2, 1.1)):
        ...     _ = odometry.add(time, (x, 0.0, 0.0))
        >>> odometry.at(0.1).pose.round(3).tolist(), odometry.at(0.3)
        ([1.05, 0.0, 0.0], None)
    """

    def __init__(self) -> None:
        self._times: list[float] = []
        self._poses: list[Floats] = []
        self._drives: list[int] = []
        self.drive = 0

    @property
    def newest(self) -> float | None:
        """The time of the newest message, seconds; None if there is none."""
        return self._times[-1] if self._times else None

    @property
    def oldest(self) -> float | None:
        """The time of the oldest message that is kept, seconds; None if there is none."""
        return self._times[0] if self._times else None

    def add(self, time: float, pose: ArrayLike) -> bool:
        """Takes a message: seconds, and (3,) metres and radians. Returns whether it tells anything new.

        Raises:
            LogError: if a number is missing or not finite.
        """
        placed = np.asarray(pose, dtype=float)
        if placed.shape != (3,) or not np.isfinite(placed).all() or not np.isfinite(time):
            raise LogError(f"odometry is a time and x, y, theta, all finite, not {time} and {pose!r}")
        if self._times and time < self._times[-1] - SLACK:
            self.cut()
        k = bisect_left(self._times, time)
        if k < len(self._times) and self._times[k] == time:
            return False
        if k < len(self._times):  # late: it is of the drive of the one before
            drive = self._drives[max(k - 1, 0)]
        else:
            self.drive += bool(self._times) and self._leaps(time, placed)
            drive = self.drive
        self._times.insert(k, float(time))
        self._poses.insert(k, placed)
        self._drives.insert(k, drive)
        self._forget()
        return True

    def cut(self) -> None:
        """Forgets all, as the clock or the odometry began again; a new drive begins."""
        self._times, self._poses, self._drives = [], [], []
        self.drive += 1

    def at(self, time: float) -> Placed | None:
        """Where the robot was at a time; None where nothing is known of it, or not yet."""
        k = bisect_left(self._times, time)
        if k < len(self._times) and self._times[k] == time:
            return Placed(self._poses[k], self._drives[k])
        if not 0 < k < len(self._times):
            return None
        before, after = self._times[k - 1], self._times[k]
        if after - before > GAP:
            return None
        if self._drives[k - 1] != self._drives[k]:
            return Placed(self._poses[k - 1], self._drives[k - 1])
        a, b = self._poses[k - 1], self._poses[k]
        share = (time - before) / (after - before)
        turn = wrap(b[2] - a[2])
        return Placed(np.array([*(a + share * (b - a))[:2], wrap(a[2] + share * turn)]), self._drives[k])

    def _leaps(self, time: float, pose: Floats) -> bool:
        """Whether no robot moves so since the newest message, or the odometry begins again at zero."""
        step = between(self._poses[-1], pose)
        far = np.array([np.hypot(*step[:2]), abs(step[2])])
        if (np.abs(pose) < AGAIN).all() and (far > LEAP).any():
            return True
        since = max(time - self._times[-1], STALLED)  # odometry that stood still may catch up in one step
        return bool(((far > LEAP) & (far / since > EVER)).any())

    def _forget(self) -> None:
        begin = bisect_left(self._times, self._times[-1] - HELD)
        begin = max(begin, len(self._times) - MAX_MESSAGES)
        if begin > 0:
            del self._times[:begin], self._poses[:begin], self._drives[:begin]
