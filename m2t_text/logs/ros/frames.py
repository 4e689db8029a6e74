"""The frames of a robot as its tf messages tell them: where the laser sits, and how the robot moved.

Above the laser there is a chain of frames (ROS REP 105): ``map`` -> ``odom`` -> ``base_footprint`` ->
``base_link`` -> ``laser``. One step of it is the drive: above it a localisation corrects, below it robots tilt.
"""

import math
from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from m2t_text.errors import PartError
from m2t_text.logs.ros.clocks import Stream
from m2t_text.util.types import Floats

STEADY = (
    0.05,
    0.05,
)  # m and rad in the plane; a frame that moves by less in its parent only trembles, or tilts
MAX_COORDINATE = 1e6  # m; beyond it a number is damage, and arithmetic on it would overflow
ODOMETRY = "odom"  # in the name of the frame in which the robot drives
MAP = ("map", "world", "earth")  # in which a localisation puts that frame


def rigid(translation: Sequence[float], quaternion: Sequence[float]) -> Floats:
    """(4, 4) of a translation x, y, z and a quaternion x, y, z, w of any length but zero.

    Raises PartError if they are no pose.
    """
    x, y, z, w = quaternion
    norm = float(np.hypot(np.hypot(x, y), np.hypot(z, w)))
    if not 1e-3 < norm < 1e3 or not all(
        abs(metres) < MAX_COORDINATE for metres in translation
    ):  # false for NaN, too
        raise PartError("with a pose that is none")
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), translation[0]],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), translation[1]],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), translation[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def planar(pose: Floats) -> Floats:
    """The pose [x, y, theta] (3,) of a frame (4, 4) in the plane: where it is, and where its x axis points."""
    return np.array([pose[0, 3], pose[1, 3], np.arctan2(pose[1, 0], pose[0, 0])])


def mounting(pose: Sequence[float], upside_down: bool) -> Floats:
    """The pose (4, 4) of a level laser at [x, y, theta], which may hang upside down."""
    half = math.pi / 2 if upside_down else 0.0
    turn = pose[2] / 2
    about = (math.sin(half) * math.cos(turn), math.sin(half) * math.sin(turn))
    return rigid(
        (pose[0], pose[1], 0.0), (*about, math.cos(half) * math.sin(turn), math.cos(half) * math.cos(turn))
    )


@dataclass
class Joint:
    """How one frame sits in its parent: the mean pose of all, and the pose in the plane at all times."""

    parent: str
    total: Floats = field(default_factory=lambda: np.zeros((4, 4)))
    first: Floats = field(default_factory=lambda: np.eye(4))
    stamps: "array[float]" = field(default_factory=lambda: array("d"))
    recorded: "array[float]" = field(default_factory=lambda: array("d"))
    poses: "array[float]" = field(default_factory=lambda: array("d"))

    @property
    def plane(self) -> Floats:
        """(N, 3) poses in the plane."""
        return np.array(self.poses).reshape(-1, 3)

    @property
    def stream(self) -> Stream:
        """When its messages were sent and recorded."""
        return Stream(np.array(self.stamps), np.array(self.recorded))

    @property
    def drives(self) -> bool:
        """Whether it moves in the plane, by more than it trembles."""
        poses = self.plane
        turned = np.unwrap(poses[:, 2])
        return bool(max(np.ptp(poses[:, :2], axis=0)) > STEADY[0] or np.ptp(turned) > STEADY[1])

    @property
    def pose(self) -> Floats:
        """(4, 4) the mean pose; the first one where it never moves."""
        mean = self.total / len(self.stamps)
        if np.abs(mean - self.first).max() < 1e-6:
            return self.first
        u, _, v = np.linalg.svd(mean[:3, :3])
        mean[:3, :3] = u @ v
        return mean


@dataclass
class Frames:
    """All frames that were told, each by its place in its parent."""

    joints: dict[str, Joint] = field(default_factory=dict)

    def add(self, parent: str, child: str, times: tuple[float, float], pose: Floats) -> None:
        """The pose (4, 4) of a frame in its parent at some time, stamped and recorded, seconds.

        Raises PartError if it had another parent before: each frame has one.
        """
        joint = self.joints.setdefault(child, Joint(parent, first=pose))
        if joint.parent != parent:
            raise PartError(f"that puts {child!r} into {parent!r}, which is in {joint.parent!r}")
        joint.total += pose
        joint.stamps.append(times[0])
        joint.recorded.append(times[1])
        joint.poses.extend(planar(pose))

    def above(self, frame: str) -> Iterator[str]:
        """A frame, its parent, and so on up to the outermost."""
        passed = set()
        while frame not in passed:  # no tree: a bag may say anything
            yield frame
            passed.add(frame)
            if frame not in self.joints:
                return
            frame = self.joints[frame].parent

    def drive(self, frame: str) -> str | None:
        """The frame above this one whose motion in its parent is the robot's drive; None if nothing moves."""
        moving = [one for one in self.above(frame) if one in self.joints and self.joints[one].drives]
        parents = [_plain(self.joints[one].parent) for one in moving]
        for one, parent in zip(moving, parents, strict=True):
            if ODOMETRY in parent:
                return one
        told = [one for one, parent in zip(moving, parents, strict=True) if parent not in MAP] or moving
        return told[-1] if told else None  # what moves below turns or tilts on the robot

    def base(self, frame: str) -> str:
        """The outermost frame in which a frame stays where it is in the plane."""
        *_, last = self._steady(frame)
        return last

    def _steady(self, frame: str) -> Iterator[str]:
        for one in self.above(frame):
            yield one
            if one in self.joints and self.joints[one].drives:
                return

    def between(self, outer: str, inner: str) -> Floats | None:
        """The pose (4, 4) of one frame in another; None if no transforms lead from one to the other.

        Raises PartError naming the joint between them that moves in the plane.
        """
        ours, theirs = list(self.above(outer)), list(self.above(inner))
        common = next((one for one in theirs if one in ours), None)
        if common is None:
            return None
        poses = []
        for chain in (ours, theirs):
            pose = np.eye(4)
            for one in chain[: chain.index(common)]:
                joint = self.joints[one]
                if joint.drives:
                    raise PartError(
                        f"the frame {one!r} moves in {joint.parent!r}, between the robot {outer!r} and the "
                        f"laser {inner!r}, which must be fixed: say where it sits by --laser-pose X Y DEGREES"
                    )
                pose = joint.pose @ pose
            poses.append(pose)
        return np.linalg.inv(poses[0]) @ poses[1]

    def names(self) -> Iterable[str]:
        """All frames, in alphabetical order."""
        return sorted({*self.joints, *(joint.parent for joint in self.joints.values())})


def _plain(frame: str) -> str:
    """A frame's name without the robot's before it."""
    return frame.rpartition("/")[2].lower()
