"""ROS messages as arrays of m2t-text, and back."""

import math
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, PoseWithCovarianceStamped, Quaternion
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

from m2t_text import LogError, Scan
from m2t_text.sources.saved_map import SavedMap

Floats = NDArray[np.float64]
HEIGHT = 0.05  # m above the floor at which markers are drawn


def seconds(stamp: Any) -> float:
    """A builtin_interfaces Time."""
    return float(stamp.sec + stamp.nanosec * 1e-9)


def scan_of(message: Any, upside_down: bool) -> Scan:
    """A LaserScan. Raises LogError if it is none."""
    return Scan.from_ranges(
        np.asarray(message.ranges, dtype=np.float32),
        message.angle_min,
        message.angle_increment,
        range_min=message.range_min,
        range_max=message.range_max,
        timestamp=seconds(message.header.stamp),
        upside_down=upside_down,
    )


def planar(position: Any, turn: Any) -> Floats:
    """(3,) of a place and a quaternion, seen from above. Raises LogError if it is no pose."""
    norm = math.hypot(turn.x, turn.y, turn.z, turn.w)
    values = (position.x, position.y, norm)
    if not (all(map(math.isfinite, values)) and abs(norm - 1.0) < 0.1):
        raise LogError("a pose has a finite place and a quaternion of length 1")
    yaw = math.atan2(
        2 * (turn.w * turn.z + turn.x * turn.y), 1 - 2 * (turn.y * turn.y + turn.z * turn.z) / norm**2
    )
    return np.array([position.x, position.y, yaw])


def saved_map_of(message: Any) -> SavedMap:
    """An OccupancyGrid. Raises MapFileError if it is none."""
    info = message.info
    cells = np.asarray(message.data, dtype=np.int8)
    return SavedMap.of(
        cells.reshape(info.height, info.width) if len(cells) == info.height * info.width else cells,
        info.resolution,
        planar(info.origin.position, info.origin.orientation),
        "map",
    )


def quaternion(yaw: float) -> Quaternion:
    """A turn about z."""
    return Quaternion(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))


def pose_message(header: Header, pose: Floats, covariance: Floats) -> PoseWithCovarianceStamped:
    """A pose (3,) with its covariance (3, 3)."""
    message = PoseWithCovarianceStamped(header=header)
    message.pose.pose.position.x, message.pose.pose.position.y = float(pose[0]), float(pose[1])
    message.pose.pose.orientation = quaternion(float(pose[2]))
    full = np.zeros((6, 6))
    full[np.ix_([0, 1, 5], [0, 1, 5])] = covariance  # x, y and the turn about z
    message.pose.covariance = full.ravel().tolist()
    return message


def arrow(header: Header, pose: Floats, colour: tuple[float, float, float]) -> Marker:
    """Where the robot is."""
    marker = _marker(header, "robot", Marker.ARROW, colour)
    marker.pose.position = Point(x=float(pose[0]), y=float(pose[1]), z=HEIGHT)
    marker.pose.orientation = quaternion(float(pose[2]))
    marker.scale.x, marker.scale.y, marker.scale.z = 0.8, 0.12, 0.12
    return marker


def cloud(header: Header, name: str, points: Floats, size: float, colour: tuple[float, float, float]) -> Marker:
    """Points (N, 2)."""
    marker = _marker(header, name, Marker.POINTS, colour)
    marker.pose.orientation.w = 1.0
    marker.scale.x = marker.scale.y = size
    marker.points = [Point(x=x, y=y, z=HEIGHT) for x, y in points.tolist()]
    return marker


def _marker(header: Header, name: str, kind: int, colour: tuple[float, float, float]) -> Marker:
    red, green, blue = colour
    marker = Marker(header=header, ns=name, id=0, type=kind, action=Marker.ADD)
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=1.0)
    return marker
