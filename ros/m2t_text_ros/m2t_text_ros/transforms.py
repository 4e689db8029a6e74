"""What tf tells, where tf2_ros is there: odometry that is sent as transforms alone."""

from typing import Any

from m2t_text import M2TError
from m2t_text_ros.conversion import Floats, planar

PATIENCE = 0.1  # s that a scan waits for its transform


class Transforms:
    """A tf buffer that listens. Raises M2TError where there is no tf2_ros."""

    def __init__(self, node: Any) -> None:
        try:
            import tf2_ros
        except ImportError as error:
            raise M2TError("tf2_ros is not installed: set odom_topic, and laser_pose, instead") from error
        from rclpy.duration import Duration
        from rclpy.time import Time

        self._errors = tf2_ros.TransformException
        self._patience, self._latest = Duration(seconds=PATIENCE), Time()
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer, node)

    def pose(self, parent: str, child: str, stamp: Any = None) -> Floats | None:
        """(3,) of one frame in another, at a time or whenever it was told last; None if it is not known."""
        when = self._latest if stamp is None else stamp
        try:
            told = self._buffer.lookup_transform(parent, child, when, self._patience).transform
        except self._errors:
            return None
        return planar(told.translation, told.rotation)
