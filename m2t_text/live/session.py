"""A robot's messages in, answers out, whatever carries them: the whole of `m2t-text live` but for the pipe."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from m2t_text.config import Parameters
from m2t_text.errors import M2TError
from m2t_text.live.localizer import Localizer
from m2t_text.live.looping import Left
from m2t_text.live.messages import Locate, Message, Odometry, Reset, Robot, Swept
from m2t_text.live.odometry import GAP, SLACK, OdometryBuffer
from m2t_text.live.survey import LiveSurvey
from m2t_text.logs.log import Scan
from m2t_text.mapping.local_map import LocalMap

Answer = dict[str, Any]  # one JSON object a line
WAITING = 1000  # scans that wait for odometry, at most
LATEST = 0.2  # m of travel; what was seen last must fit an answer
SHORTEST = 2.0  # m of travel that are looked up where a drive has just begun


class Session:
    """One drive: takes messages in the order in which they come, and answers.

    A scan without odometry of its own waits until odometry as new as itself has come.
    """

    def __init__(
        self,
        parameters: Parameters,
        localizer: Localizer | None = None,
        every: float | None = None,
        poses: bool = True,
        laser_pose: ArrayLike | None = None,
        left: Callable[[Left], Iterable[Answer]] | None = None,
    ) -> None:
        """
        Args:
            parameters: those of the localizer's index, if there is one.
            localizer: finds the robot in an index.
            every: metres of travel from one answer of where the robot is to the next; None: only when asked.
            poses: whether each scan is answered.
            laser_pose: (3,) counts more than what a robot says.
            left: called with what each scan leaves behind; what it returns is answered.
        """
        self._parameters = parameters
        self.localizer = localizer
        self._every = every
        self._poses = poses
        self._laser_pose = laser_pose
        self._left = left
        self._robot = Robot("live", np.zeros(3), True, frozenset())
        self._begin()

    def _begin(self) -> None:
        robot = self._robot
        mounted = robot.laser_pose if self._laser_pose is None else self._laser_pose
        still = robot.without_wheels if robot.has_odometry else True
        self.survey = LiveSurvey(self._parameters, mounted, without_wheels=still)
        self._odometry = OdometryBuffer()
        self._waiting: deque[Scan] = deque()
        self._last: float | None = None  # s; time of the last scan
        self._drives = 0  # begun as the clock of the scans began again
        self._asked = 0.0  # m of travel at the last answer of where the robot is
        self._drive: int | None = None
        if self.localizer is not None:
            self.localizer.reset()

    @property
    def drive(self) -> int:
        """The number of the drive that the last scan belongs to."""
        return self._drive or 0

    def take(self, message: Message) -> Iterator[Answer]:
        """The answers to a message.

        Raises:
            M2TError: saying what is wrong with it; nothing was done then.
        """
        if isinstance(message, Robot):
            self._introduce(message)
        elif isinstance(message, Odometry):
            self._odometry.add(message.time, message.pose)
            yield from self._drain()
        elif isinstance(message, Swept):
            yield from self._swept(message)
        elif isinstance(message, Locate):
            yield from self.locate(message.run)
        elif isinstance(message, Reset):
            self._begin()

    def end(self) -> Iterator[Answer]:
        """What is left to say when no message comes any more."""
        if self._waiting:
            yield _warning(f"the last {len(self._waiting)} scans have no odometry, and are left out")

    def _introduce(self, robot: Robot) -> None:
        if self.survey.scans:
            raise M2TError("robot: it is told before the first scan, or after a reset")
        before, self._robot = self._robot, robot
        try:
            self._begin()
        except M2TError:
            self._robot = before
            raise

    def _swept(self, message: Swept) -> Iterator[Answer]:
        scan = message.scan
        if message.placed:  # whoever knows where it was taken knows its drive
            yield from self._add(scan)
            return
        last = self._last
        if last is not None and last - SLACK <= scan.timestamp <= last:
            raise M2TError(f"scan: the one of {scan.timestamp:g} s comes after that of {last:g} s")
        if last is not None and scan.timestamp < last:
            self._drives += 1
            self._waiting.clear()
            if self._odometry.newest is not None and self._odometry.newest > scan.timestamp + SLACK:
                self._odometry.cut()  # it is of the clock before; that of the scan is still to come
        self._last = scan.timestamp
        if not self._robot.has_odometry:
            yield from self._add(replace(scan, drive=self._drives))
            return
        self._waiting.append(scan)
        yield from self._drain()

    def _drain(self) -> Iterator[Answer]:
        """Adds the scans whose odometry is known by now."""
        while self._waiting:
            scan, newest = self._waiting[0], self._odometry.newest
            known = newest is not None and newest >= scan.timestamp
            late = self._waiting[-1].timestamp - scan.timestamp > GAP or len(self._waiting) > WAITING
            if not known and not late:
                return
            self._waiting.popleft()
            placed = self._odometry.at(scan.timestamp)
            if placed is None:
                yield _warning(f"the scan of {scan.timestamp:g} s has no odometry near it, and is left out")
            else:
                drive = placed.drive + self._drives
                yield from self._add(replace(scan, odometry=placed.pose, drive=drive))

    def _add(self, scan: Scan) -> Iterator[Answer]:
        carried = self.survey.continuity.carried
        pose = self.survey.add(scan)
        begins = self._drive not in (None, scan.drive)
        if begins and self.localizer is not None:
            self.localizer.reset()
        self._drive = scan.drive
        if self._poses:
            yield {
                "type": "pose",
                "scan": self.survey.scans - 1,
                "time": scan.timestamp,
                "pose": pose.tolist(),
                "travel": self.survey.travel,
            }
        if self.localizer is not None and self.survey.continuity.carried > carried:
            yield _warning("the robot sees other walls than it should here: it may have been carried elsewhere")
        if self._left is not None:
            survey, runs = self.survey, tuple(self.survey.new_runs())
            yield from self._left(Left(self._robot.name, survey.scans - 1, pose, survey.travel, begins, runs))
        if self._every is not None and self.survey.travel >= self._asked + self._every:
            yield from self.locate()

    def locate(self, run: float | None = None) -> Iterator[Answer]:
        """Where the robot is in the maps of the index.

        Raises:
            M2TError: if there is no index, or so much of the drive is not kept.
        """
        if self.localizer is None:
            raise M2TError("locate: there is no index to look the place up in; name one with --index")
        seen = self.last_run(run)
        if seen is None:
            if self._every is None:
                text = "the drive has just begun, or the robot was carried elsewhere"
                yield _warning(f"{text}: it takes {SHORTEST:g} m to know where it is")
            return
        self._asked = self.survey.travel
        survey = self.survey
        place = self.localizer.locate(
            seen, survey.pose, self.shorter_runs(seen), self.latest(), survey.continuity
        )
        yield {
            "type": "place",
            "scan": self.survey.scans - 1,
            "travel": self.survey.travel,
            "drive_pose": self.survey.pose.tolist(),
            **place.to_json(),
        }

    def last_run(self, run: float | None = None) -> LocalMap | None:
        """What the robot saw on its last run.

        Where its drive has just begun, or it was carried elsewhere, on all that it drove since, if that is
        SHORTEST.
        """
        wanted = self._parameters.mapping.run_length if run is None else run
        seen = self.survey.last_run(wanted)
        if seen is None and run is None:
            least = min(SHORTEST, wanted)
            if self.survey.driven >= least:
                seen = self.survey.last_run(self.survey.driven)
        return seen

    def shorter_runs(self, seen: LocalMap) -> Iterator[LocalMap]:
        """What the robot saw on the last half of a run, unless that is too little; made when asked for."""
        half = float(seen.travel[1] - seen.travel[0]) / 2
        if half >= SHORTEST:
            run = self.survey.last_run(half)
            if run is not None:
                yield run

    def latest(self) -> LocalMap | None:
        """What the robot saw on its last scans."""
        return self.survey.last_run(LATEST)


def _warning(text: str) -> Answer:
    return {"type": "warning", "text": text}
