"""What the messages of a bag tell, collected: sweeps of one laser, poses of the robot, and frames."""

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from m2t_text.errors import PartError
from m2t_text.logs.frames import LIMIT, Frames, planar, rigid
from m2t_text.logs.lines import Damage
from m2t_text.logs.log import Scan
from m2t_text.logs.ros import LASER, ODOMETRY, TRANSFORMS, Message
from m2t_text.util.types import Floats

DECIMALS = 4  # of readings in metres and of angles in degrees; lasers tell no more


@dataclass(frozen=True)
class Sweep:
    """One scan as its message tells it: ``ranges`` and ``angles`` (B,) as in `Scan`, in the laser's frame."""

    time: float
    number: int
    ranges: Floats
    angles: Floats

    def scan(self, odometry: Floats, upright: bool) -> Scan:
        """The scan at a pose (3,) of the robot, its beams counter-clockwise as seen from above."""
        ranges, angles = self.ranges, self.angles if upright else -self.angles
        if angles[0] > angles[-1]:
            ranges, angles = ranges[::-1], angles[::-1]
        return Scan(ranges, angles, odometry, self.time, self.number)


@dataclass
class Recording:
    """What the messages told so far.

    Attributes:
        by_tf: whether the odometry is tf's.
        sweeps: in the order of the bag, all in the frame ``laser``.
        skipped: number of scans that could not be used.
        odometry: times and poses (3,) of the frame ``robot``.
        frames: of tf.
    """

    by_tf: bool
    damage: Damage = field(default_factory=lambda: Damage("message"))
    sweeps: list[Sweep] = field(default_factory=list)
    laser: str | None = None
    skipped: int = 0
    odometry: list[tuple[float, Floats]] = field(default_factory=list)
    robot: str = ""
    frames: Frames = field(default_factory=Frames)

    def add(self, message: Message) -> None:
        """Keeps what a message tells; what cannot be used is counted as damage."""
        adders = {LASER: self._add_scan, ODOMETRY: self._add_odometry, TRANSFORMS: self._add_frames}
        try:
            adders[message.kind](message)
        except PartError as error:
            self.skipped += message.kind == LASER
            self.damage.add(f"{message.topic} {error}", message.number)

    def _add_scan(self, message: Message) -> None:
        frame = _frame(message.body.header.frame_id)
        if self.laser not in (None, frame):
            raise PartError(f"of another laser than {self.laser!r}")
        self.sweeps.append(_sweep(message))
        self.laser = frame

    def _add_odometry(self, message: Message) -> None:
        pose = _rigid(message.body.pose.pose.position, message.body.pose.pose.orientation)
        self.odometry.append((_time(message.body.header, message), planar(pose)))
        self.robot = _frame(message.body.child_frame_id)

    def _add_frames(self, message: Message) -> None:
        for one in message.body.transforms:
            pose = _rigid(one.transform.translation, one.transform.rotation)
            parent, child = _frame(one.header.frame_id), _frame(one.child_frame_id)
            self.frames.add(parent, child, _time(one.header, message), pose)


def _sweep(message: Message) -> Sweep:
    body = message.body
    start, step, count = body.angle_min, body.angle_increment, len(body.ranges)
    if not (count >= 2 and abs(start) <= 2.01 * math.pi and 0 < abs(step) * (count - 1) <= 2.01 * math.pi):
        raise PartError("with an impossible field of view")
    finite = np.nan_to_num(body.ranges, nan=0.0, posinf=0.0, neginf=0.0)
    # Stage, Gazebo and older drivers report their maximum for a beam that did not return. A limit of 0 is none.
    limit = body.range_max if 0 < body.range_max < LIMIT else LIMIT
    hit = (finite > 0) & ~(finite < body.range_min) & (finite < limit)
    ranges = _exact(np.where(hit, finite, np.float32(np.inf)))
    return Sweep(_time(body.header, message), message.number, ranges, _angles(start, step, count))


def _exact(ranges: NDArray[np.float32]) -> Floats:
    """The decimal numbers that were rounded to 32 bits; where there are none, the numbers themselves."""
    wide = ranges.astype(np.float64)
    short = np.round(wide, DECIMALS)
    return np.where(short.astype(np.float32) == ranges, short, wide)


@lru_cache(maxsize=8)
def _angles(start: float, step: float, count: int) -> Floats:
    """(count,) of the beams; shared by the scans, which are many."""
    return _exact_angle(start) + _exact_angle(step) * np.arange(count, dtype=np.float64)


def _exact_angle(angle: float) -> float:
    """The decimal number of degrees that was rounded to 32 bits, if there is one; else the angle itself."""
    short = math.radians(round(math.degrees(angle), DECIMALS))
    return short if np.float32(short) == np.float32(angle) else angle


def _rigid(translation: Any, rotation: Any) -> Floats:
    """(4, 4) of a ROS Point or Vector3 and a Quaternion."""
    place = (translation.x, translation.y, translation.z)
    return rigid(place, (rotation.x, rotation.y, rotation.z, rotation.w))


def _time(header: Any, message: Message) -> float:
    """Seconds: by the stamp, or where there is none when the message was recorded."""
    stamp = header.stamp.sec * 10**9 + header.stamp.nanosec
    return float(stamp / 1e9 if stamp else message.recorded)


def _frame(name: str) -> str:
    """A frame's name as tf2 writes it; tf wrote a slash before it."""
    return name.lstrip("/")
