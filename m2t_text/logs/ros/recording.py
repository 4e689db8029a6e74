"""What the messages of a bag tell, collected: sweeps of lasers, poses of the robot, and frames."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from m2t_text.errors import PartError
from m2t_text.logs.beams import beams_in_a_turn
from m2t_text.logs.lines import Damage
from m2t_text.logs.readings import bearings, returned
from m2t_text.logs.ros.clocks import Stream
from m2t_text.logs.ros.frames import Frames, planar, rigid
from m2t_text.logs.ros.messages import ECHOES, LASER, ODOMETRY, POINTS, TRANSFORMS, Message
from m2t_text.logs.ros.point_scans import cloud_points
from m2t_text.util.types import Floats

Reduce = Callable[[Floats, str], tuple[Floats, Floats]]  # points and their frame to ranges and angles


@dataclass(frozen=True)
class Sweep:
    """One scan as its message tells it: ``ranges`` and ``angles`` (B,) as in `Scan`, in the laser's frame."""

    stamp: float
    recorded: float
    number: int
    ranges: Floats
    angles: Floats


@dataclass
class Motion:
    """Poses (3,) of one frame in another, when they were stamped (NaN: not) and recorded, s."""

    stamps: list[float] = field(default_factory=list)
    recorded: list[float] = field(default_factory=list)
    poses: list[Floats] = field(default_factory=list)


@dataclass
class Recording:
    """What the messages told so far.

    Attributes:
        sweeps: of each topic and frame, in the order of the bag.
        skipped: of each topic, the number of scans that could not be used.
        odometry: by the frames, the robot's last.
        frames: of tf.
        reduce: makes a scan of a cloud of points; None until it is known where lasers sit.
    """

    damage: Damage = field(default_factory=lambda: Damage("message"))
    sweeps: dict[str, dict[str, list[Sweep]]] = field(default_factory=dict)
    skipped: dict[str, int] = field(default_factory=dict)
    odometry: dict[tuple[str, str], Motion] = field(default_factory=dict)
    frames: Frames = field(default_factory=Frames)
    reduce: Reduce | None = None

    def add(self, message: Message) -> None:
        """Keeps what a message tells; what cannot be used is counted as damage."""
        adders = {ODOMETRY: self._add_odometry, TRANSFORMS: self._add_frames}
        adder = adders.get(message.kind, self._add_scan)
        try:
            adder(message)
        except PartError as error:
            if message.kind in (LASER, ECHOES, POINTS):
                self.skipped[message.topic] = self.skipped.get(message.topic, 0) + 1
            self.damage.add(f"{message.topic} {error}", message.number)

    def _add_scan(self, message: Message) -> None:
        body, frame = message.body, _frame(message.body.header.frame_id)
        if message.kind == POINTS:
            assert self.reduce is not None
            ranges, angles = self.reduce(cloud_points(body), frame)
        else:
            readings = body.ranges if message.kind == LASER else _first_echoes(body.ranges)
            ranges, angles = self._beams(message, readings)
        sweep = Sweep(*_times(body.header, message), message.number, ranges, angles)
        self.sweeps.setdefault(message.topic, {}).setdefault(frame, []).append(sweep)

    def _beams(self, message: Message, readings: NDArray[np.float32]) -> tuple[Floats, Floats]:
        body, count = message.body, len(readings)
        start, step = float(body.angle_min), float(body.angle_increment)
        if step == 0.0 and count > 1:
            step = (float(body.angle_max) - start) / (count - 1)  # some drivers leave it to us
        kept = beams_in_a_turn(start, step, count)
        if kept < count:
            self.damage.add(
                f"{message.topic} with more than a turn of beams, the rest is left out", message.number
            )
        return returned(readings[:kept], body.range_min, body.range_max), bearings(start, step, kept)

    def _add_odometry(self, message: Message) -> None:
        body = message.body
        pose = planar(_rigid(body.pose.pose.position, body.pose.pose.orientation))
        motion = self.odometry.setdefault((_frame(body.header.frame_id), _frame(body.child_frame_id)), Motion())
        stamp, recorded = _times(body.header, message)
        motion.stamps.append(stamp)
        motion.recorded.append(recorded)
        motion.poses.append(pose)

    def _add_frames(self, message: Message) -> None:
        for one in message.body.transforms:
            pose = _rigid(one.transform.translation, one.transform.rotation)
            parent, child = _frame(one.header.frame_id), _frame(one.child_frame_id)
            self.frames.add(parent, child, _times(one.header, message), pose)


def stream_of(messages: "list[Sweep] | Motion") -> Stream:
    """When scans, or poses, were stamped and recorded."""
    if isinstance(messages, Motion):
        return Stream(np.array(messages.stamps), np.array(messages.recorded))
    return Stream(np.array([one.stamp for one in messages]), np.array([one.recorded for one in messages]))


def _first_echoes(ranges: list[Any]) -> NDArray[np.float32]:
    """Of each beam the first echo; what comes after it shines through glass, rain or an edge."""
    first = [one.echoes[0] if len(one.echoes) else np.inf for one in ranges]
    return np.array(first, dtype=np.float32)


def _rigid(translation: Any, rotation: Any) -> Floats:
    """(4, 4) of a ROS Point or Vector3 and a Quaternion."""
    place = (translation.x, translation.y, translation.z)
    return rigid(place, (rotation.x, rotation.y, rotation.z, rotation.w))


def _times(header: Any, message: Message) -> tuple[float, float]:
    """Seconds: the stamp, NaN where there is none, and when the message was recorded."""
    stamp = header.stamp.sec * 10**9 + header.stamp.nanosec
    return (stamp / 1e9 if stamp else math.nan), message.recorded


def _frame(name: str) -> str:
    """A frame's name as tf2 writes it; tf wrote a slash before it."""
    return name.lstrip("/")
