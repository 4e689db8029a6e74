"""ROS bags for the tests, written by the package that reads them."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from m2t_text.logs import Log
from m2t_text.logs.simulation.simulator import Simulation, simulate

LASER, ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
ECHOES, POINTS = "sensor_msgs/msg/MultiEchoLaserScan", "sensor_msgs/msg/PointCloud2"
TRANSFORMS, OLDER = "tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"
LEVEL = (0.0, 0.0, 0.0, 1.0)  # a quaternion x, y, z, w
PLUGINS = {".db3": StoragePlugin.SQLITE3, ".mcap": StoragePlugin.MCAP}
MOUNTED = ("base_link", "laser")


@dataclass(frozen=True)
class Sent:
    """One message of a bag: when (s), where, and what."""

    time: float
    topic: str
    message: Any


class Messages:
    """Makes messages of one version of ROS."""

    def __init__(self, version: int) -> None:
        self.version = version
        self.store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
        if version == 1:
            for kind in (TRANSFORMS, OLDER):
                self.store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", kind))

    def make(self, kind: str, *values: Any) -> Any:
        return self.store.types[kind](*values)

    def header(self, time: float, frame: str) -> Any:
        nanoseconds = round(time * 1e9)
        stamp = self.make("builtin_interfaces/msg/Time", nanoseconds // 10**9, nanoseconds % 10**9)
        sequence = (0,) if self.version == 1 else ()
        return self.make("std_msgs/msg/Header", *sequence, stamp, frame)

    def scan(
        self,
        time: float,
        ranges: Sequence[float],
        angles: tuple[float, float] = (-np.pi / 2, np.pi / 360),
        frame: str = "laser",
        limits: tuple[float, float] = (0.0, 81.0),
    ) -> Any:
        """``angles`` are that of the first beam and the step to the next."""
        readings = np.array(ranges, dtype=np.float32)
        end = angles[0] + angles[1] * (len(readings) - 1)
        nothing = np.zeros(0, dtype=np.float32)
        header = self.header(time, frame)
        return self.make(LASER, header, angles[0], end, angles[1], 0.0, 0.0, *limits, readings, nothing)

    def echoes(self, time: float, ranges: Sequence[Sequence[float]], angles: tuple[float, float]) -> Any:
        """A scan of which each beam has any number of echoes."""
        made = [self.make("sensor_msgs/msg/LaserEcho", np.array(one, dtype=np.float32)) for one in ranges]
        end = angles[0] + angles[1] * (len(made) - 1)
        return self.make(
            ECHOES, self.header(time, "laser"), angles[0], end, angles[1], 0.0, 0.0, 0.0, 81.0, made, []
        )

    def points(self, time: float, points: np.ndarray, frame: str = "laser", code: str = "<f4") -> Any:
        """A cloud of points (N, 3), each with an intensity before it."""
        data = np.zeros(len(points), dtype=[("intensity", "u1"), *((axis, code) for axis in "xyz")])
        for axis, column in zip("xyz", points.T, strict=True):
            data[axis] = column
        kind = 8 if code.endswith("8") else 7
        size = data.dtype.itemsize
        fields = [self.make("sensor_msgs/msg/PointField", "intensity", 0, 2, 1)]
        for k, axis in enumerate("xyz"):
            fields.append(self.make("sensor_msgs/msg/PointField", axis, 1 + k * (size - 1) // 3, kind, 1))
        raw = np.frombuffer(data.tobytes(), np.uint8)
        header, big = self.header(time, frame), code.startswith(">")
        return self.make(POINTS, header, 1, len(points), fields, big, size, size * len(points), raw, False)

    def odometry(
        self, time: float, pose: Sequence[float], child: str = "base_link", parent: str = "odom"
    ) -> Any:
        point = self.make("geometry_msgs/msg/Point", pose[0], pose[1], 0.0)
        placed = self.make("geometry_msgs/msg/Pose", point, self.quaternion(turned(pose[2])))
        zero = self.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        twist = self.make("geometry_msgs/msg/Twist", zero, zero)
        with_pose = self.make("geometry_msgs/msg/PoseWithCovariance", placed, np.zeros(36))
        with_twist = self.make("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36))
        return self.make(ODOMETRY, self.header(time, parent), child, with_pose, with_twist)

    def transforms(self, time: float, *edges: tuple[str, str, Sequence[float], Sequence[float]]) -> Any:
        """Each of ``edges`` is a parent, a child, x, y, z and a quaternion x, y, z, w."""
        made = []
        for parent, child, place, quaternion in edges:
            pose = self.make(
                "geometry_msgs/msg/Transform",
                self.make("geometry_msgs/msg/Vector3", *place),
                self.quaternion(quaternion),
            )
            made.append(self.make("geometry_msgs/msg/TransformStamped", self.header(time, parent), child, pose))
        return self.make(TRANSFORMS, made)

    def quaternion(self, values: Sequence[float]) -> Any:
        return self.make("geometry_msgs/msg/Quaternion", *values)

    def write(self, path: Path, sent: Iterable[Sent], *, compressed: bool = False) -> Path:
        """Writes a ``.bag``, or the folder of a ROS 2 bag whose storage has the ending of ``path``."""
        if self.version == 1:
            writer: Any = rosbag1.Writer(path)
            if compressed:
                writer.set_compression(rosbag1.Writer.CompressionFormat.LZ4)
            encode = self.store.serialize_ros1
        else:
            writer = rosbag2.Writer(path, version=9, storage_plugin=PLUGINS[path.suffix])
            if compressed:
                modes, formats = rosbag2.CompressionMode, rosbag2.CompressionFormat
                writer.set_compression(modes.MESSAGE, formats.ZSTD)
            encode = self.store.serialize_cdr
        topics: dict[str, Any] = {}
        with writer:
            for one in sent:
                kind = one.message.__msgtype__
                if one.topic not in topics:
                    topics[one.topic] = writer.add_connection(one.topic, kind, typestore=self.store)
                writer.write(topics[one.topic], round(one.time * 1e9), encode(one.message, kind))
        return path

    def log(self, log: Log, *, by_tf: bool = False) -> Iterator[Sent]:
        """All scans of a log with its odometry, by messages of its own or by tf, and the laser's place."""
        begin = log.scans[0].timestamp
        x, y, theta = log.laser_pose
        mounted = (*MOUNTED, (x, y, 0.3), turned(theta))
        yield Sent(begin, "/tf_static", self.transforms(begin, mounted))
        for scan in log.scans:
            time = scan.timestamp
            if by_tf:
                edge = ("odom", "base_link", (*scan.odometry[:2], 0.0), turned(scan.odometry[2]))
                yield Sent(time, "/tf", self.transforms(time, edge))
            else:
                yield Sent(time, "/odom", self.odometry(time, scan.odometry))
            angles = (float(scan.angles[0]), float(scan.angles[1] - scan.angles[0]))
            yield Sent(time, "/scan", self.scan(time, scan.ranges.tolist(), angles))


def turned(theta: float) -> tuple[float, float, float, float]:
    """The quaternion of a turn about z."""
    return (0.0, 0.0, float(np.sin(theta / 2)), float(np.cos(theta / 2)))


def small_bags(folder: Path) -> dict[str, bytes]:
    """The bytes of sound bags of a few scans, by their endings."""
    log = simulate(Simulation(travel=3.0, beams=20))
    log = replace(log, scans=log.scans[:12])
    ros1, ros2 = Messages(1), Messages(2)
    bags = {".bag": ros1.write(folder / "a.bag", ros1.log(log)).read_bytes()}
    for ending in PLUGINS:
        (file,) = ros2.write(folder / f"b{ending}", ros2.log(log)).glob(f"*{ending}")
        bags[ending] = file.read_bytes()
    return bags
