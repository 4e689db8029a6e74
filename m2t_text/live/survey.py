"""A drive that is not finished: scans are matched as they come, and local maps made of the last metres."""

import sys
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m2t_text.config import Parameters
from m2t_text.errors import LogError, M2TError
from m2t_text.live.continuity import DOUBTFUL, Continuity, goes_on
from m2t_text.logs.log import ARM, Scan
from m2t_text.mapping.free_space import Beams, clear_lengths, longest_reading
from m2t_text.mapping.local_map import LEAP, LocalMap, Odometer, Survey, local_maps
from m2t_text.mapping.scan_cloud import scan_points
from m2t_text.mapping.scan_matcher import ScanMatcher
from m2t_text.util.types import Floats

SPACING = 0.5  # m of travel between the local maps that a drive leaves behind; nearer ones show the same
MAX_SCANS = 4_000  # scans that are kept; only a robot that turns on the spot for very long comes to so many


@dataclass(frozen=True)
class _Kept:
    """One scan.

    Attributes:
        number: of the scan, from 0.
        points: (N, 2) hits in the robot's frame.
        bearings, lengths: (B,) of the beams, as in `Beams`.
        pose: (3,) of the robot.
        way: metres of travel up to it.
        moved: whether the robot moved since the last scan on which it did.
    """

    number: int
    points: Floats
    bearings: Floats
    lengths: Floats
    pose: Floats
    way: float
    moved: bool


def _survey_of(kept: Sequence[_Kept], laser: Floats) -> Survey:
    """The last scans of a drive as a survey. Their travel was counted from the begin of the drive."""
    starts = np.cumsum([0, *(len(one.points) for one in kept)]).astype(np.int64)
    beams = Beams.joined([one.bearings for one in kept], [one.lengths for one in kept], laser)
    points = np.concatenate([np.empty((0, 2)), *(one.points for one in kept)])
    survey = Survey(points, starts, np.array([one.pose for one in kept]).reshape(-1, 3), beams=beams)
    moved = np.array([one.moved for one in kept], dtype=np.bool_)
    return survey.counted(np.array([one.way for one in kept]), moved)


class LiveSurvey:
    """Takes the scans of a robot as they come; what is further back than it needs is forgotten.

    Poses and local maps are those of `survey` and `local_maps` for the same scans, to the bit.

    Args:
        parameters: of the index in which places will be looked up.
        laser_pose: (3,) of the laser in the robot's frame, metres and radians.
        longest_run: metres of travel up to which `last_run` can look back; None for twice a map's.
        without_wheels: the drives whose scans come without odometry, see `Scan`; True for all.

    Attributes:
        pose: (3,) of the robot at the last scan, in the frame of the first.
        travel: metres up to there.
        scans: how many there were.
        continuity: when the robot was last carried elsewhere, as far as its scans tell. `last_run` looks no
            farther back. What the drive leaves behind is the same as if nothing had been noticed.

    Raises:
        LogError: if the laser sits nowhere on a robot.

    Examples:
        >>> import m2t_text as m2t
        >>> log = m2t.read_log("drive.log")
        >>> survey = m2t.LiveSurvey(m2t.PROFILES["default"], log.laser_pose)
        >>> poses = [survey.add(scan) for scan in log.scans]
        >>> document = m2t.describe(survey.last_run(5.0), "now", survey.parameters)
        >>> document.last_scan < len(log.scans), bool(document.travel[1] - document.travel[0] >= 5.0)
        (True, True)
    """

    def __init__(
        self,
        parameters: Parameters,
        laser_pose: ArrayLike = (0.0, 0.0, 0.0),
        longest_run: float | None = None,
        without_wheels: Container[int] | bool = False,
    ) -> None:
        self.parameters = parameters
        self.laser_pose = np.asarray(laser_pose, dtype=float)
        if self.laser_pose.shape != (3,) or not (np.abs(self.laser_pose) <= ARM).all():  # nor is a NaN
            raise LogError(
                f"the laser's pose is x, y, theta, within {ARM:g} m of the robot, not {laser_pose!r}"
            )
        every: Container[int] = range(sys.maxsize) if without_wheels else ()
        self._without_wheels = every if isinstance(without_wheels, bool) else without_wheels
        self._run = parameters.mapping.run_length
        self._longest_run = max(self._run, 2 * self._run if longest_run is None else longest_run)
        self.reset()

    def reset(self) -> None:
        """Forgets all: the next scan is the first one, at the pose zero."""
        self._matcher = ScanMatcher(self.laser_pose, self._without_wheels)
        self._odometer = Odometer()
        self._longest = 0.0  # m; reading so far
        self._kept: list[_Kept] = []
        self._drive: int | None = None
        self._whole_from = 0  # number of the first scan since the robot was last carried elsewhere
        self._begin = 0  # number of the first kept scan that has not yet had its run completed
        self._after = 0.0  # m of travel from which on the next local map may begin
        self.scans = 0
        self.pose = np.zeros(3)
        self.travel = 0.0
        self.continuity = Continuity()

    def add(self, scan: Scan) -> Floats:
        """The robot's pose (3,) at the next scan, in the frame of the first scan.

        A scan of another drive than the last one's begins anew: no local map spans both.
        """
        self._forget()
        limit = self.parameters.mapping.range_limit
        pose = self._matcher.add(scan)
        away = np.hypot(*(pose - self.pose)[:2]) > LEAP
        if self._kept and (scan.drive != self._drive or away):
            self._kept.clear()
        self._longest = max(self._longest, longest_reading(scan))
        way, moved = self._odometer.add(pose)
        points = scan_points(scan, self.laser_pose, limit)
        lengths = clear_lengths(scan.ranges, self._longest, limit)
        self._kept.append(_Kept(self.scans, points, scan.angles, lengths, pose, way, moved))
        self._drive, self.pose, self.travel = scan.drive, pose, way
        self.scans += 1
        if self._matcher.inliers < DOUBTFUL:
            if self._carried():
                self._whole_from = self.scans - 1
                self.continuity = replace(self.continuity, carried=way)
            self.continuity = replace(self.continuity, doubtful=way)
        return pose

    def _carried(self) -> bool:
        """Whether the last scan was taken elsewhere than those before it lead."""
        *earlier, newest = self._kept[self._first :]
        earlier = [one for one in earlier if self.travel - one.way <= self._run]
        if not earlier:
            return False
        before, now = self._local_map(earlier, np.inf), self._local_map([newest], np.inf)
        return not goes_on(before, now, self.parameters)

    @property
    def _first(self) -> int:
        """Which of the kept scans is the first that hangs together with the last one."""
        return next(k for k, one in enumerate(self._kept) if one.number >= self._whole_from)

    def _forget(self) -> None:
        """Drops what no run that is still to come, and none that `last_run` may be asked for, needs."""
        kept = self._kept
        if len(kept) >= 3 and kept[-3].way == kept[-2].way == kept[-1].way and not kept[-2].moved:
            del kept[-2]  # the robot stands: the latest scan of those shows the same
        begin = 0
        while begin + 1 < len(kept) and self.travel - kept[begin + 1].way >= self._longest_run:
            begin += 1
        del kept[: max(begin, len(kept) - MAX_SCANS)]

    @property
    def driven(self) -> float:
        """Metres of travel that are kept of this drive, and hang together."""
        return self.travel - self._kept[self._first].way if self._kept else 0.0

    def last_run(self, metres: float | None = None) -> LocalMap | None:
        """What was seen on the last ``metres`` of travel, those of a map if None, in the frame of their begin.

        The run is the last one that is complete: where the robot stands, it may have ended some scans ago. None
        where the robot has not travelled so far since its drive began, or since it was carried elsewhere.

        Raises:
            M2TError: if so much is not kept.
        """
        metres = self._run if metres is None else metres
        if not 0 < metres <= self._longest_run:
            raise M2TError(f"a run of {metres:g} m is not kept, which are {self._longest_run:g} m at most")
        kept = self._kept[self._first :] if self._kept else []
        begin = next((k for k in reversed(range(len(kept))) if self.travel - kept[k].way >= metres), None)
        return None if begin is None else self._local_map(kept[begin:], metres)

    def new_runs(self) -> Iterator[LocalMap]:
        """The local maps whose runs the last scan completed, in their order, at least SPACING apart.

        All that a drive leaves behind, if it is asked after every scan: those of `describe_survey`.
        """
        for k, one in enumerate(self._kept):
            if one.number < self._begin:
                continue
            if self.travel - one.way < self._run:
                break
            self._begin = one.number + 1
            if one.way >= self._after:
                self._after = one.way + SPACING
                yield self._local_map(self._kept[k:], self._run)

    def _local_map(self, kept: Sequence[_Kept], metres: float) -> LocalMap:
        """What was seen from the first of some scans on, for so many metres or up to the last of them."""
        mapping = self.parameters.mapping
        window = _survey_of(kept, self.laser_pose)
        starts: NDArray[np.int64] = np.zeros(1, dtype=np.int64)
        (found,) = local_maps(window, replace(mapping, run_length=metres), starts)
        return replace(found, first_scan=kept[found.first_scan].number, last_scan=kept[found.last_scan].number)
