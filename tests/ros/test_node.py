"""The node as a process of its own, and a simulated robot beside it that talks to it through ROS.

`make ros-test` runs these, in an environment of its own with wheels of rclpy, and without a network.
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="no wheels of rclpy are installed here: `make ros-test` brings them")

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String
from std_srvs.srv import Empty, Trigger
from visualization_msgs.msg import MarkerArray

from m2t_text import Log, MapIndex, Simulation, open_index, simulate
from m2t_text.logs.simulation.building import build
from m2t_text.sources.opening import LogSource
from m2t_text.util.geometry import between, compose, inverse

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of what the wheels import
ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "ros" / "m2t_text_ros"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
NUMBERS = count()
SCANS = int(os.environ.get("ROS_TEST_SCANS", "10000"))
PATIENCE = 600.0  # s; it tells what hangs from what a busy machine takes to compile
LOST = 20.0  # s after which an answer may be lost
LEADS_TO = {
    Transition.TRANSITION_CONFIGURE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_ACTIVATE: State.PRIMARY_STATE_ACTIVE,
    Transition.TRANSITION_DEACTIVATE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_CLEANUP: State.PRIMARY_STATE_UNCONFIGURED,
}
AHEAD = 30  # scans that the robot may be ahead of the node, which has room for 100


class Robot:
    """A simulated robot and all that listens to the node. Each has a namespace of its own: of a node that was
    killed, others hear for a while."""

    def __init__(self, context: Any) -> None:
        self.namespace = f"/test{next(NUMBERS)}"
        self.node = rclpy.create_node("robot", context=context, namespace=self.namespace)
        self.executor = rclpy.executors.SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.scans = self.node.create_publisher(LaserScan, "scan", qos_profile_sensor_data)
        self.odometry = self.node.create_publisher(Odometry, "odom", 100)
        self.heard: dict[str, list[Any]] = {}
        for topic, kind, qos in (
            ("initialpose", PoseWithCovarianceStamped, 10),
            ("m2t_localizer/pose", PoseWithCovarianceStamped, 10),
            ("m2t_localizer/verdict", String, 10),
            ("m2t_localizer/markers", MarkerArray, LATCHED),
            ("m2t_localizer/loops", String, 100),
            ("/diagnostics", DiagnosticArray, 10),
        ):
            self.heard[topic] = []
            self.node.create_subscription(kind, topic, self.heard[topic].append, qos)
        self.time = 0.0

    def until(self, done: Callable[[], Any], patience: float = PATIENCE) -> None:
        assert self.spin(done, patience), "the node does not answer"

    def spin(self, done: Callable[[], Any], seconds: float) -> bool:
        """Whether it is done within so many seconds."""
        end = time.monotonic() + seconds
        while not done() and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.05)
        return bool(done())

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """The answer; it is asked for again where it may be lost, as those to a robot are that the node has not
        heard of yet."""
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready)
        asked: list[Any] = []
        end = time.monotonic() + PATIENCE
        while not any(future.done() for future in asked):
            assert time.monotonic() < end, "the node does not answer"
            asked.append(client.call_async(request))
            self.spin(asked[-1].done, LOST)
        self.node.destroy_client(client)
        return next(future.result() for future in asked if future.done())

    def change(self, transition: int) -> bool:
        """Whether the node is in the state to which a transition leads, once it was asked for."""
        request = ChangeState.Request(transition=Transition(id=transition))
        self.call(ChangeState, "m2t_localizer/change_state", request)
        state = self.call(GetState, "m2t_localizer/get_state", GetState.Request()).current_state
        return bool(state.id == LEADS_TO[transition])

    def start(self) -> None:
        assert self.change(Transition.TRANSITION_CONFIGURE)
        assert self.change(Transition.TRANSITION_ACTIVATE)
        self.until(lambda: self.scans.get_subscription_count() and self.odometry.get_subscription_count())

    def status(self) -> dict[str, str]:
        """The values of the next diagnostics."""
        self.heard["/diagnostics"].clear()
        self.until(lambda: self.heard["/diagnostics"])
        status = self.heard["/diagnostics"][-1].status[0]
        return {one.key: one.value for one in status.values} | {"message": status.message}

    def taken(self) -> int:
        """The scans that the node has taken, by the next diagnostics."""
        return int(self.status()["scans"])

    def drive(self, log: Log) -> None:
        """Sends a log's scans and odometry; each scan after the odometry of its time.

        Sensor data that there is no room for is lost, so the robot waits for the node wherever it is AHEAD:
        every scan arrives, however busy the machine is.
        """
        before = self.taken()
        for sent, scan in enumerate(log.scans):
            if sent % AHEAD == 0:
                self.until(lambda sent=sent: self.taken() >= before + sent)
            self.time += 0.1
            self.odometry.publish(odometry_message(self.time, scan.odometry))
            self.scans.publish(scan_message(self.time, scan))
        self.until(lambda: self.taken() >= before + len(log.scans))

    def localize(self) -> tuple[bool, dict[str, Any]]:
        response = self.call(Trigger, "m2t_localizer/localize", Trigger.Request())
        return bool(response.success), json.loads(response.message)


def stamped(message: Any, moment: float, frame: str) -> Any:
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(round(moment * 1e9), 10**9)
    return message


def scan_message(moment: float, scan: Any, frame: str = "laser") -> LaserScan:
    message = stamped(LaserScan(), moment, frame)
    message.angle_min, message.angle_max = float(scan.angles[0]), float(scan.angles[-1])
    message.angle_increment = float(scan.angles[1] - scan.angles[0])
    message.range_min, message.range_max = 0.02, 80.0
    message.ranges = scan.ranges.astype(np.float32).tolist()
    return message


def odometry_message(moment: float, pose: Any) -> Odometry:
    message = stamped(Odometry(), moment, "odom")
    message.pose.pose.position.x, message.pose.pose.position.y = float(pose[0]), float(pose[1])
    message.pose.pose.orientation.z = float(np.sin(pose[2] / 2))
    message.pose.pose.orientation.w = float(np.cos(pose[2] / 2))
    return message


def pose_of(message: PoseWithCovarianceStamped) -> np.ndarray:
    turn = message.pose.pose.orientation
    place = message.pose.pose.position
    return np.array([place.x, place.y, 2 * np.arctan2(turn.z, turn.w)])


@pytest.fixture(scope="module")
def logs() -> tuple[Log, Log]:
    """Two drives through one building: one that is indexed, and one of another day."""
    base = Simulation(seed=3, length=24.0, travel=24.0, beams=120)
    return simulate(base), simulate(replace(base, drive=1))


@pytest.fixture(scope="module")
def index(logs: tuple[Log, Log], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("index") / "office"
    open_index(path).add(LogSource(logs[0]))
    assert len(MapIndex.open(path)) > 50
    return path


@pytest.fixture(scope="module")
def context() -> Iterator[Any]:
    context = rclpy.Context()
    rclpy.init(context=context)
    yield context
    rclpy.shutdown(context=context)


@pytest.fixture
def robot(context: Any) -> Iterator[Robot]:
    robot = Robot(context)
    yield robot
    robot.node.destroy_node()


@pytest.fixture
def start(robot: Robot, tmp_path: Path) -> Iterator[Callable[..., "subprocess.Popen[bytes]"]]:
    """Starts a node with parameters, for a robot; it is ended when the test is."""
    started: list[subprocess.Popen[bytes]] = []

    def start(near: Robot = robot, **parameters: Any) -> "subprocess.Popen[bytes]":
        parameters = {"diagnostics_period": 0.05} | parameters
        named = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
        namespace = ["-r", f"__ns:={near.namespace}"]
        command = [sys.executable, "-m", "m2t_text_ros.node", "--ros-args", *namespace, *named]
        paths = os.pathsep.join([str(PACKAGE), str(ROOT)])
        environment = os.environ | {"PYTHONPATH": paths, "ROS_LOG_DIR": str(tmp_path)}
        process = subprocess.Popen(command, env=environment)
        started.append(process)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            end(process, signal.SIGKILL)


def end(process: "subprocess.Popen[bytes]", number: int) -> int:
    process.send_signal(number)
    return process.wait(timeout=30)


def right(place: dict[str, Any], logs: tuple[Log, Log], scan: int) -> bool:
    """Whether a pose is within 0.5 m and 10° of the true one; both drives begin somewhere else."""
    first, second = logs
    assert first.ground_truth is not None and second.ground_truth is not None
    true = between(first.ground_truth[0], second.ground_truth[scan])
    error = compose(inverse(true), np.array(place["pose"]))
    return bool(np.hypot(*error[:2]) < 0.5 and abs(error[2]) < np.radians(10))


def test_a_robot_finds_itself(robot: Robot, start: Any, logs: tuple[Log, Log], index: Path) -> None:
    process = start(index=index, every=2.0, initialpose="on_match")
    robot.start()
    done, answer = robot.localize()
    assert not done and answer["verdict"] == "none" and "just begun" in answer["reason"]["text"]
    drive = logs[1]
    robot.drive(drive)
    done, place = robot.localize()
    assert done and place["verdict"] == "match" and right(place, logs, len(drive.scans) - 1)
    assert np.linalg.eigvalsh(place["covariance"]).min() > 0
    robot.until(lambda: robot.heard["initialpose"] and robot.heard["m2t_localizer/markers"])
    verdicts = [json.loads(one.data) for one in robot.heard["m2t_localizer/verdict"]]
    assert len(verdicts) >= 3 and {one["verdict"] for one in verdicts} <= {"match", "ambiguous", "none"}
    told = robot.heard["m2t_localizer/pose"][-1]
    assert told.header.frame_id == "map" and np.allclose(pose_of(told), place["pose"], atol=1e-6)
    assert np.reshape(told.pose.covariance, (6, 6))[5, 5] == pytest.approx(place["covariance"][2][2])
    assert len(robot.heard["initialpose"]) < len(verdicts)
    names = {marker.ns for marker in robot.heard["m2t_localizer/markers"][-1].markers}
    assert names == {"map", "seen", "robot"}
    status = robot.status()
    assert status["state"] == "tracked" and int(status["maps"]) == len(MapIndex.open(index))
    robot.call(Empty, "reinitialize_global_localization", Empty.Request())
    robot.heard["initialpose"].clear()
    robot.until(lambda: robot.heard["initialpose"])
    assert robot.change(Transition.TRANSITION_DEACTIVATE)
    assert robot.change(Transition.TRANSITION_CLEANUP)
    assert robot.change(Transition.TRANSITION_CONFIGURE)
    assert robot.change(Transition.TRANSITION_ACTIVATE)
    assert end(process, signal.SIGINT) in (0, -signal.SIGINT)


def test_bad_messages_change_nothing(robot: Robot, start: Any, logs: tuple[Log, Log], index: Path) -> None:
    process = start(index=index)
    robot.start()
    drive = logs[1]
    half = len(drive.scans) // 2
    robot.drive(replace(drive, scans=drive.scans[:half]))
    sound = drive.scans[0]
    for ranges in ([], [1.0], [float("nan")] * 5):
        message = scan_message(robot.time, sound)
        message.ranges = ranges
        if len(ranges) == 5:
            message.angle_increment = float("nan")
        robot.scans.publish(message)
    robot.scans.publish(scan_message(robot.time, sound, "camera"))
    robot.odometry.publish(odometry_message(robot.time, (float("nan"), 0.0, 0.0)))
    robot.until(lambda: int(robot.status()["left out"]) >= 3)
    robot.drive(replace(drive, scans=drive.scans[half:]))
    done, place = robot.localize()
    assert done and right(place, logs, len(drive.scans) - 1)
    robot.time = 1.0  # the clock begins again: another drive, of which nothing is known yet
    robot.drive(replace(drive, scans=drive.scans[:9]))
    assert robot.localize()[1]["verdict"] == "none"
    assert process.poll() is None


def test_killed_and_started_again(
    robot: Robot, context: Any, start: Any, logs: tuple[Log, Log], index: Path
) -> None:
    first = start(index=index)
    robot.start()
    robot.drive(replace(logs[1], scans=logs[1].scans[:40]))
    assert end(first, signal.SIGKILL) == -signal.SIGKILL
    again = Robot(context)
    start(again, index=index)
    again.start()
    again.drive(logs[1])
    done, place = again.localize()
    assert done and right(place, logs, len(logs[1].scans) - 1)
    again.node.destroy_node()


def test_the_map_that_runs_now(robot: Robot, start: Any, logs: tuple[Log, Log]) -> None:
    """Localised in an OccupancyGrid, drawn here from the walls of the simulated building."""
    start(map_topic="map")
    publisher = robot.node.create_publisher(OccupancyGrid, "map", LATCHED)
    robot.start()
    assert "no map" in robot.localize()[1]["reason"]["text"]
    grid, resolution = drawn(3, 24.0)
    message = stamped(OccupancyGrid(), 0.0, "map")
    message.info.resolution, message.info.height, message.info.width = resolution, *grid.shape
    message.info.origin.position.x = message.info.origin.position.y = -1.0
    message.info.origin.orientation.w = 1.0
    message.data = grid.ravel().tolist()
    publisher.publish(message)
    robot.until(lambda: int(robot.status()["maps"]) > 10)
    drive = logs[1]
    robot.drive(drive)
    _, place = robot.localize()
    assert drive.ground_truth is not None and place["verdict"] in ("match", "ambiguous")
    error = between(drive.ground_truth[-1], np.array(place["pose"]))
    assert np.hypot(*error[:2]) < 0.5 and abs(error[2]) < np.radians(10)
    robot.node.destroy_publisher(publisher)


def drawn(seed: int, length: float, resolution: float = 0.05) -> tuple[np.ndarray, float]:
    """An occupancy grid of a simulated building; its outer corner is at (-1, -1) m."""
    building = build(np.random.default_rng(seed), length)
    walls = np.concatenate([building.walls, building.doors[:, 0]])
    grid = np.zeros((int(24.0 / resolution), int((length + 2.0) / resolution)), dtype=np.int8)
    for x0, y0, x1, y1 in walls:
        count = int(np.hypot(x1 - x0, y1 - y0) / resolution * 2) + 2
        columns = ((np.linspace(x0, x1, count) + 1.0) / resolution).astype(int)
        rows = ((np.linspace(y0, y1, count) + 1.0) / resolution).astype(int)
        inside = (rows >= 0) & (rows < grid.shape[0]) & (columns >= 0) & (columns < grid.shape[1])
        grid[rows[inside], columns[inside]] = 100
    return grid, resolution


@pytest.mark.parametrize(
    "parameters",
    [
        {"index": "/nowhere"},
        {},
        {"index": "a", "map_topic": "map"},
        {"map_topic": "map", "laser_pose": "[0.0, 1.0]"},
        {"map_topic": "map", "laser_pose": "[50.0, 0.0, 0.0]"},
        {"map_topic": "map", "initialpose": "sometimes"},
        {"map_topic": "map", "every": -1.0},
        {"map_topic": "map", "append": True},
        {"map_topic": "map", "keep_per_place": 3},
        {"map_topic": "map", "diagnostics_period": 0.0},
    ],
)
def test_parameters_that_cannot_be_meant(robot: Robot, start: Any, parameters: dict[str, Any]) -> None:
    process = start(**parameters)
    assert not robot.change(Transition.TRANSITION_CONFIGURE)
    assert process.poll() is None  # they may be set right, and the node configured again


def test_loops_are_told_and_the_drive_is_added(
    robot: Robot, start: Any, logs: tuple[Log, Log], tmp_path: Path
) -> None:
    """There and back: what was driven is in the index once the node has ended."""
    path = tmp_path / "days"
    process = start(index=path, loops=True, append=True, every=0.0)
    robot.start()
    there = logs[1].scans
    robot.drive(replace(logs[1], scans=(*there, *there[::-1], *there)))
    told = [json.loads(one.data) for one in robot.heard["m2t_localizer/loops"]]
    assert told and int(robot.status()["loops"]) == len(told)
    assert all(one["type"] == "loop" and one["from"] < one["to"] for one in told)
    assert end(process, signal.SIGINT) in (0, -signal.SIGINT)
    (dataset,) = MapIndex.open(path).datasets()
    assert dataset.name == "live" and told[-1]["known"] < dataset.scans <= 3 * len(there)
    assert dataset.travel > 3 * 24.0 - 5.0


def resident(process: "subprocess.Popen[bytes]") -> int:
    """kB of memory that a process holds."""
    status = Path(f"/proc/{process.pid}/status").read_text(encoding="ascii")
    return int(next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1])


def test_ten_thousand_scans_without_growth(
    robot: Robot, start: Any, logs: tuple[Log, Log], index: Path
) -> None:
    process = start(index=index, every=0.0)
    robot.start()
    there = logs[1].scans
    around = replace(logs[1], scans=(*there, *there[::-1]))
    taken, early = 0, 0
    while taken < SCANS:
        robot.drive(around)
        taken = robot.taken()
        early = early or (resident(process) if taken > SCANS // 10 else 0)
    assert resident(process) < 1.05 * early
