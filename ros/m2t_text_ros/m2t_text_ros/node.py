"""The node: a robot with a 2D laser finds itself in a saved map, without an initial pose."""

import ctypes
import json
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header, String
from std_srvs.srv import Empty, Trigger
from visualization_msgs.msg import MarkerArray

from m2t_text import M2TError, MapIndex, open_index
from m2t_text.live.messages import Odometry, Swept
from m2t_text_ros import conversion, settings
from m2t_text_ros.engine import Engine, Located
from m2t_text_ros.transforms import Transforms

LATCHED = QoSProfile(
    depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE
)
# As ROS's profile of sensor data, which takes reliable publishers, too, but with more room:
SENSORS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
LOOK = 0.1  # s between two looks whether an answer is due
SILENT = 2.0  # s without a scan from which on the diagnostics warn
M_ARENA_MAX = -8  # mallopt's name for the number of heaps
SEEN, SHOWN, ROBOT = (0.1, 0.8, 0.2), (0.9, 0.3, 0.1), (0.1, 0.3, 0.9)  # colours of the markers


def guarded(callback: Callable[..., Any]) -> Callable[..., Any]:
    """A callback that no exception leaves: one would end the node. What went wrong is told, and counted."""

    @wraps(callback)
    def safe(self: "LocalizerNode", *arguments: Any) -> Any:
        try:
            return callback(self, *arguments)
        except M2TError as error:
            self.told(str(error))
        except Exception as error:  # noqa: BLE001, the node has to go on
            self.told(f"{callback.__name__}: {type(error).__name__}: {error}")
        return arguments[-1] if callback.__name__.startswith("_serve") else None

    return safe


class LocalizerNode(LifecycleNode):
    """Takes scans and odometry, and says where the robot is: on request, and every so many metres."""

    def __init__(self) -> None:
        super().__init__("m2t_localizer")
        settings.declare(self)
        self._engine: Engine | None = None
        self._active: list[tuple[Callable[..., Any], Any]] = []  # what is destroyed on deactivation
        self._errors, self._last_error = 0, ""

    def told(self, text: str) -> None:
        """Notes what went wrong, for the log and for the diagnostics."""
        self._errors, self._last_error = self._errors + 1, text
        self.get_logger().warning(text, throttle_duration_sec=5.0)

    # Lifecycle

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Reads the parameters, opens the index, and compiles, so that the first answer is as quick as any."""
        try:
            self._set = settings.read(self)
            index = self._index()
            if index is not None and not self._set.append and not len(index):
                raise M2TError(f"the index {self._set.index} is empty")
            grown = (self._set.loops, self._set.append, self._set.keep_per_place or None)
            self._engine = Engine(np.array(self._set.laser_pose), index, *grown)
            self._tf = None if self._set.odom_topic else Transforms(self)
            self._engine.warm_up()
        except M2TError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self._laser_frame, self._heard, self._asked, self._wanted = "", None, 0.0, False
        self._last: Located | None = None
        self._count = 0  # loops so far
        self._stamp: Any = None
        self._pose = self.create_publisher(PoseWithCovarianceStamped, "~/pose", 10)
        self._verdict = self.create_publisher(String, "~/verdict", 10)
        self._initial = self.create_publisher(PoseWithCovarianceStamped, "initialpose", 10)
        self._found = self.create_publisher(String, "~/loops", 100)
        self._markers = self.create_publisher(MarkerArray, "~/markers", LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        return TransitionCallbackReturn.SUCCESS

    def _index(self) -> MapIndex | None:
        """The index that the parameters name; it may be new where it is to grow."""
        if not self._set.index:
            return None
        return (open_index if self._set.append else MapIndex.open)(self._set.index)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        inputs, requests = MutuallyExclusiveCallbackGroup(), MutuallyExclusiveCallbackGroup()
        chosen = self._set
        self._subscribe(LaserScan, chosen.scan_topic, self._take_scan, SENSORS, inputs)
        if chosen.odom_topic:
            self._subscribe(OdometryMessage, chosen.odom_topic, self._take_odometry, SENSORS, inputs)
        if chosen.map_topic:
            self._subscribe(OccupancyGrid, chosen.map_topic, self._take_map, LATCHED, requests)
        localize = self.create_service(Trigger, "~/localize", self._serve_localize, callback_group=requests)
        anew = self.create_service(
            Empty, "reinitialize_global_localization", self._serve_anew, callback_group=requests
        )
        self._active += [(self.destroy_service, localize), (self.destroy_service, anew)]
        for period, callback in ((LOOK, self._look), (chosen.diagnostics_period, self._diagnose)):
            timer = self.create_timer(period, callback, callback_group=requests)
            self._active.append((self.destroy_timer, timer))
        return super().on_activate(state)

    def _subscribe(self, kind: Any, topic: str, callback: Any, qos: Any, group: Any) -> None:
        made = self.create_subscription(kind, topic, callback, qos, callback_group=group)
        self._active.append((self.destroy_subscription, made))

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._let_go()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        publishers = (self._pose, self._verdict, self._initial, self._found, self._markers, self._diagnostics)
        for publisher in publishers:
            self.destroy_publisher(publisher)
        self._let_go()
        self.close()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._let_go()
        self.close()
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._let_go()
        return TransitionCallbackReturn.SUCCESS

    def close(self) -> None:
        """Commits what waits to be added to the index."""
        if self._engine is not None:
            self._engine.close()

    def _let_go(self) -> None:
        for destroy, made in self._active:
            destroy(made)
        self._active.clear()

    # What comes in

    @guarded
    def _take_scan(self, message: LaserScan) -> None:
        assert self._engine is not None
        frame = message.header.frame_id
        self._laser_frame = self._laser_frame or frame
        if frame != self._laser_frame:
            raise M2TError(f"a scan of the frame {frame!r} is left out: the laser is {self._laser_frame!r}")
        scan = conversion.scan_of(message, self._set.upside_down)
        self._heard, self._stamp = self.get_clock().now(), message.header.stamp
        if self._tf is not None:
            pose = self._tf.pose(self._set.odom_frame, self._set.base_frame, message.header.stamp)
            if pose is None:
                raise M2TError(f"tf knows no way from {self._set.odom_frame} to {self._set.base_frame} then")
            self._engine.take(Odometry(scan.timestamp, pose))
        self._engine.take(Swept(scan, False))

    @guarded
    def _take_odometry(self, message: OdometryMessage) -> None:
        assert self._engine is not None
        pose = conversion.planar(message.pose.pose.position, message.pose.pose.orientation)
        self._engine.take(Odometry(conversion.seconds(message.header.stamp), pose))

    @guarded
    def _take_map(self, message: OccupancyGrid) -> None:
        assert self._engine is not None
        self._engine.replace_map(conversion.saved_map_of(message))
        self.get_logger().info(f"localising in a map of {message.info.width} x {message.info.height} cells")

    # What is asked

    @guarded
    def _serve_localize(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        located = self._locate()
        if located is None:
            response.success, response.message = (
                False,
                json.dumps({"verdict": "none", "reason": self._why_not()}),
            )
            return response
        response.success = located.place.verdict == "match"
        response.message = json.dumps(located.place.to_json())
        self._publish(located, self._set.initialpose == "on_request")
        return response

    @guarded
    def _serve_anew(self, request: Empty.Request, response: Empty.Response) -> Empty.Response:
        """Nav2 asks so for the pose to be found without any guess: it is published once it is sure."""
        assert self._engine is not None
        self._engine.forget()
        self._wanted = True
        self._asked = float("-inf")
        return response

    @guarded
    def _look(self) -> None:
        """Tells of loops, and answers where it is time to."""
        assert self._engine is not None
        for loop in self._engine.loops():
            self._found.publish(String(data=json.dumps(loop)))
            self._count += 1
        every = self._set.every or (2.0 if self._wanted else 0.0)
        if not every or self._engine.travel < self._asked + every:
            return
        located = self._locate()
        if located is None:
            return
        self._publish(located, self._wanted)
        self._last = located

    def _locate(self) -> Located | None:
        assert self._engine is not None
        located = self._engine.locate()
        if located is not None:
            self._asked = self._engine.travel
        return located

    def _why_not(self) -> dict[str, str]:
        assert self._engine is not None
        what = "no map has come yet" if self._engine.index is None else "the drive has just begun"
        return {"code": "nothing", "text": what}

    def _publish(self, located: Located, initial: bool) -> None:
        place, header = located.place, Header(frame_id=self._set.map_frame)
        if self._stamp is not None:
            header.stamp = self._stamp
        self._verdict.publish(String(data=json.dumps(place.to_json())))
        if place.pose is None or place.covariance is None or place.verdict == "none":
            return
        message = conversion.pose_message(header, place.pose, place.covariance)
        self._pose.publish(message)
        self._markers.publish(
            MarkerArray(
                markers=[
                    conversion.cloud(header, "map", located.shown, 0.1, SHOWN),
                    conversion.cloud(header, "seen", located.seen, 0.06, SEEN),
                    conversion.arrow(header, place.pose, ROBOT),
                ]
            )
        )
        initial = initial or (self._set.initialpose == "on_match" and place.first)
        if place.verdict == "match" and initial and self._set.initialpose != "never":
            self._initial.publish(message)
            self._wanted = False

    @guarded
    def _diagnose(self) -> None:
        assert self._engine is not None
        now = self.get_clock().now()
        since = None if self._heard is None else (now - self._heard).nanoseconds / 1e9
        status = DiagnosticStatus(name="m2t_localizer", hardware_id=self._laser_frame, message="scans come in")
        if since is None or since > SILENT:
            status.level, status.message = DiagnosticStatus.WARN, f"no scan on {self._set.scan_topic}"
        elif self._engine.index is None:
            status.level, status.message = DiagnosticStatus.WARN, f"no map on {self._set.map_topic}"
        place = None if self._last is None else self._last.place
        values = {
            "scans": self._engine.scans,
            "travel": f"{self._engine.travel:.1f} m",
            "maps": self._engine.maps,
            "verdict": None if place is None else place.verdict,
            "state": None if place is None else place.state,
            "loops": self._count,
            "seconds": None if place is None else f"{place.seconds:.3f}",
            "left out": self._errors + self._engine.warnings,
            "last left out": self._last_error or self._engine.last_warning,
        }
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        self._diagnostics.publish(DiagnosticArray(header=Header(stamp=now.to_msg()), status=[status]))


def share_heap() -> None:
    """Lets all threads share one heap, where the C library is GNU's: callbacks go from thread to thread, and
    where each has a heap of its own, memory grows by up to 12 MB whenever one matches its first scan."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL("libc.so.6").mallopt(M_ARENA_MAX, 1)


def main() -> None:
    """Runs the node until it is told to end."""
    share_heap()
    rclpy.init(args=sys.argv)
    node = LocalizerNode()
    executor = MultiThreadedExecutor(num_threads=3)
    executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.close()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
