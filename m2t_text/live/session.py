"""A robot's messages in, answers out, whatever carries them: the whole of `m2t-text live` but for the pipe."""

from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from m2t_text.config import Parameters
from m2t_text.errors import M2TError
from m2t_text.live.messages import Locate, Message, Odometry, Reset, Robot, Swept
from m2t_text.live.odometry import GAP, SLACK, OdometryBuffer
from m2t_text.live.survey import LiveSurvey
from m2t_text.logs.log import Scan

Answer = dict[str, Any]  # one JSON object a line
WAITING = 1000  # scans that wait for odometry, at most


class Session:
    """One drive: takes messages in the order in which they come, and answers.

    A scan without odometry of its own waits until odometry as new as itself has come.
    """

    def __init__(self, parameters: Parameters, poses: bool = True, laser_pose: Any = None) -> None:
        """``poses``: whether each scan is answered; ``laser_pose`` (3,) counts more than what a robot says."""
        self._parameters = parameters
        self._poses = poses
        self._laser_pose = laser_pose
        self._has_odometry = True
        self.name = "live"
        self._begin()

    def _begin(self, laser_pose: Any = (0.0, 0.0, 0.0)) -> None:
        self.survey = LiveSurvey(self._parameters, laser_pose if self._laser_pose is None else self._laser_pose)
        self._odometry = OdometryBuffer()
        self._waiting: deque[Scan] = deque()
        self._last: float | None = None  # s; time of the last scan
        self._drives = 0  # begun as the clock of the scans began again

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
            self._begin(self.survey.laser_pose)

    def end(self) -> Iterator[Answer]:
        """What is left to say when no message comes any more."""
        if self._waiting:
            yield _warning(f"the last {len(self._waiting)} scans have no odometry, and are left out")

    def _introduce(self, robot: Robot) -> None:
        if self.survey.scans:
            raise M2TError("robot: it is told before the first scan, or after a reset")
        self._begin(robot.laser_pose)
        self.name, self._has_odometry = robot.name, robot.has_odometry

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
        self._last = scan.timestamp
        if not self._has_odometry:
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
        pose = self.survey.add(scan)
        if self._poses:
            yield {
                "type": "pose",
                "scan": self.survey.scans - 1,
                "time": scan.timestamp,
                "pose": pose.tolist(),
                "travel": self.survey.travel,
            }

    def locate(self, run: float | None = None) -> Iterator[Answer]:
        """Where the robot is in the maps of the index."""
        raise M2TError("locate: there is no index to look the place up in; name one with --index")


def _warning(text: str) -> Answer:
    return {"type": "warning", "text": text}
