"""The node's parameters, declared, described and checked in one place."""

from dataclasses import dataclass
from typing import Any, Literal, get_args

from rcl_interfaces.msg import ParameterDescriptor

from m2t_text import M2TError

InitialPose = Literal["on_request", "on_match", "never"]

DESCRIBED: dict[str, tuple[Any, str]] = {
    "index": ("", "Folder of the index to localise in; empty: the map of map_topic."),
    "scan_topic": ("scan", "LaserScan."),
    "odom_topic": ("odom", "Odometry; empty: tf, from odom_frame to base_frame."),
    "map_topic": ("", "OccupancyGrid to localise in, instead of an index; map, for slam_toolbox and Nav2."),
    "laser_pose": ([0.0, 0.0, 0.0], "Where the laser sits on the robot: x, y (m), yaw (rad)."),
    "upside_down": (False, "The laser hangs upside down."),
    "loops": (False, "Publish on ~/loops when the robot comes back to where it was before on its drive."),
    "append": (False, "Add the drive to the index, as a dataset; its loops lead to other drives, too."),
    "keep_per_place": (0, "With append: so many maps of a place at most; 0: all."),
    "diagnostics_period": (1.0, "Seconds from one message on /diagnostics to the next."),
    "every": (2.0, "Metres of travel from one answer to the next; 0: only on request."),
    "initialpose": ("on_request", "When /initialpose is published: on_request, on_match or never."),
    "map_frame": ("map", "Frame of the poses that are published."),
    "odom_frame": ("odom", "Frame of the odometry, where it is tf's."),
    "base_frame": ("base_link", "Frame of the robot."),
}


@dataclass(frozen=True)
class Settings:
    """See DESCRIBED."""

    index: str
    scan_topic: str
    odom_topic: str
    map_topic: str
    laser_pose: tuple[float, float, float]
    upside_down: bool
    loops: bool
    append: bool
    keep_per_place: int
    diagnostics_period: float
    every: float
    initialpose: InitialPose
    map_frame: str
    odom_frame: str
    base_frame: str


def declare(node: Any) -> None:
    """Tells ROS which parameters there are."""
    for name, (default, text) in DESCRIBED.items():
        node.declare_parameter(name, default, ParameterDescriptor(description=text))


def read(node: Any) -> Settings:
    """The parameters as they are set now.

    Raises:
        M2TError: naming one that cannot be meant.
    """
    values = {name: node.get_parameter(name).value for name in DESCRIBED}
    if len(values["laser_pose"]) != 3:
        raise M2TError(f"laser_pose is x, y (m) and yaw (rad), not {list(values['laser_pose'])}")
    if values["initialpose"] not in get_args(InitialPose):
        raise M2TError(
            f"initialpose is one of {', '.join(get_args(InitialPose))}, not {values['initialpose']!r}"
        )
    if not 0.0 <= values["every"] < 1e6:
        raise M2TError(f"every is metres of travel, 0 for on request alone, not {values['every']}")
    if values["append"] and not values["index"]:
        raise M2TError("append takes index, the folder of the index that grows")
    if values["keep_per_place"] < 0 or (values["keep_per_place"] and not values["append"]):
        raise M2TError("keep_per_place is the number of maps kept of a place, for append; 0 for all")
    if not 0.01 <= values["diagnostics_period"] < 1e6:
        raise M2TError(f"diagnostics_period is 0.01 s or more, not {values['diagnostics_period']}")
    if bool(values["index"]) == bool(values["map_topic"]):
        raise M2TError("set either index, the folder of an index, or map_topic, a map to localise in")
    for name in ("scan_topic", "map_frame"):
        if not values[name]:
            raise M2TError(f"{name} is empty")
    return Settings(**(values | {"laser_pose": tuple(values["laser_pose"])}))
