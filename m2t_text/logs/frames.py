"""The frames of a robot as its tf messages tell them: where the laser sits, and how the robot moved."""

from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from m2t_text.errors import PartError
from m2t_text.util.types import Floats

STILL = 1e-4  # m, and about rad; a transform that never changes by more is a joint that does not move
LIMIT = 1e6  # m; beyond it a number is damage, and arithmetic on it would overflow


def rigid(translation: Sequence[float], quaternion: Sequence[float]) -> Floats:
    """(4, 4) of a translation x, y, z and a quaternion x, y, z, w of any length but zero.

    Raises PartError if they are no pose.
    """
    x, y, z, w = quaternion
    norm = float(np.hypot(np.hypot(x, y), np.hypot(z, w)))
    if not 1e-3 < norm < 1e3 or not all(abs(metres) < LIMIT for metres in translation):  # false for NaN, too
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


@dataclass
class _Joint:
    """How one frame sits in its parent: at first, and at all times."""

    parent: str
    first: Floats
    moves: bool = False
    times: "array[float]" = field(default_factory=lambda: array("d"))
    poses: "array[float]" = field(default_factory=lambda: array("d"))


@dataclass
class Frames:
    """All frames that were told, each by its place in its parent."""

    joints: dict[str, _Joint] = field(default_factory=dict)

    def add(self, parent: str, child: str, time: float, pose: Floats) -> None:
        """The pose (4, 4) of a frame in its parent at some time, seconds.

        Raises PartError if it had another parent before: each frame has one.
        """
        joint = self.joints.setdefault(child, _Joint(parent, pose))
        if joint.parent != parent:
            raise PartError(f"that puts {child!r} into {parent!r}, which is in {joint.parent!r}")
        joint.moves = joint.moves or bool(np.abs(pose - joint.first).max() > STILL)
        joint.times.append(time)
        joint.poses.extend(planar(pose))

    def base(self, frame: str) -> tuple[str, Floats]:
        """The outermost frame in which a frame is fixed, and its pose (4, 4) there."""
        pose, passed = np.eye(4), {frame}
        while frame in self.joints and not self.joints[frame].moves:
            joint = self.joints[frame]
            if joint.parent in passed:  # no tree: a bag may say anything
                break
            frame, pose = joint.parent, joint.first @ pose
            passed.add(frame)
        return frame, pose

    def between(self, outer: str, inner: str) -> Floats | None:
        """The pose (4, 4) of one frame in another; None where they are not fixed to each other."""
        (one, outer_pose), (other, inner_pose) = self.base(outer), self.base(inner)
        return np.linalg.inv(outer_pose) @ inner_pose if one == other else None

    def track(self, frame: str) -> tuple[Floats, Floats] | None:
        """Times (N,) and poses (N, 3) of a moving frame in its parent; None if it does not move."""
        joint = self.joints.get(frame)
        if joint is None or not joint.moves:
            return None
        return np.array(joint.times), np.array(joint.poses).reshape(-1, 3)

    def names(self) -> Iterable[str]:
        """All frames, in alphabetical order."""
        return sorted({*self.joints, *(joint.parent for joint in self.joints.values())})
