"""What goes through the pipe: one JSON object a line, checked before anything is done with it."""

import json
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from m2t_text.errors import LogError, M2TError, clean
from m2t_text.logs.log import Log, Scan
from m2t_text.mapping.trajectory import without_wheels
from m2t_text.util.names import checked_name
from m2t_text.util.types import Floats

LONGEST = 1 << 24  # characters of a line


@dataclass(frozen=True)
class Robot:
    """What is told before the first scan: the log's name, where the laser sits, whether there is odometry, and
    the numbers of the drives of which it tells nothing."""

    name: str
    laser_pose: Floats
    has_odometry: bool
    without_wheels: frozenset[int]


@dataclass(frozen=True)
class Odometry:
    """Where the wheels say that the robot is: seconds, and a pose (3,)."""

    time: float
    pose: Floats


@dataclass(frozen=True)
class Swept:
    """A scan; ``placed`` if the message says where odometry puts it, so that it need not be looked up."""

    scan: Scan
    placed: bool


@dataclass(frozen=True)
class Locate:
    """Where am I? Looked up is the last run of so many metres; None for as many as in a map of the index."""

    run: float | None


@dataclass(frozen=True)
class Reset:
    """Forget the drive."""


Message = Robot | Odometry | Swept | Locate | Reset


def parse(line: str) -> Message:
    """The message of a line.

    Raises:
        M2TError: saying what is wrong with it.
    """
    if len(line) > LONGEST:
        raise M2TError(f"a line of more than {LONGEST >> 20} million characters is no message")
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise M2TError(f"no JSON: {clean(str(error))}") from error
    kind = fields.get("type") if isinstance(fields, dict) else None
    reader = _READERS.get(kind) if isinstance(kind, str) else None
    if reader is None:
        raise M2TError(f'a message is an object whose "type" is one of {", ".join(_READERS)}')
    try:
        return reader(fields)
    except KeyError as error:
        raise M2TError(f"{kind}: {error.args[0]!r} is missing") from error
    except (TypeError, ValueError, OverflowError) as error:
        raise M2TError(f"{kind}: {clean(str(error))}") from error


def _robot(fields: dict[str, Any]) -> Robot:
    laser = np.asarray(fields.get("laser_pose", [0.0, 0.0, 0.0]), dtype=float)
    still = frozenset(int(drive) for drive in fields.get("without_wheels", ()))
    name = checked_name(str(fields.get("name", "live")))
    return Robot(name, laser, bool(fields.get("has_odometry", True)), still)


def _odometry(fields: dict[str, Any]) -> Odometry:
    return Odometry(float(fields["time"]), np.asarray(fields["pose"], dtype=float))


def _scan(fields: dict[str, Any]) -> Swept:
    ranges = np.array([inf if value is None else value for value in fields["ranges"]], dtype=float)
    odometry, time, drive = fields.get("odometry"), float(fields["time"]), int(fields.get("drive", 0))
    if "angles" in fields:
        angles = np.asarray(fields["angles"], dtype=float)
        if angles.shape != ranges.shape or len(angles) < 2 or not np.isfinite(angles).all():
            raise ValueError('"angles" has a finite number for each of "ranges", which are two at least')
        whole = np.where(ranges > 0, ranges, inf)
        pose = np.asarray([0.0, 0.0, 0.0] if odometry is None else odometry, dtype=float)
        if pose.shape != (3,) or not np.isfinite([*pose, time]).all():
            raise ValueError('"odometry" is x, y, theta, and "time" seconds, all finite')
        return Swept(Scan(whole, angles, pose, time, 0, drive), odometry is not None)
    scan = Scan.from_ranges(
        ranges,
        float(fields["angle_min"]),
        float(fields["angle_increment"]),
        range_min=float(fields.get("range_min") or 0.0),
        range_max=float(fields.get("range_max") or 0.0),
        odometry=(0.0, 0.0, 0.0) if odometry is None else odometry,
        timestamp=time,
        drive=drive,
        upside_down=bool(fields.get("upside_down", False)),
    )
    return Swept(scan, odometry is not None)


def _locate(fields: dict[str, Any]) -> Locate:
    return Locate(None if fields.get("run") is None else float(fields["run"]))


_READERS: dict[str, Any] = {
    "robot": _robot,
    "odometry": _odometry,
    "scan": _scan,
    "locate": _locate,
    "reset": lambda fields: Reset(),
}


def robot_line(log: Log) -> str:
    """The message that a replayed log begins with."""
    still = sorted(without_wheels(log))
    return _line(type="robot", name=log.name, laser_pose=log.laser_pose.tolist(), without_wheels=still)


def scan_line(scan: Scan, time: float) -> str:
    """The message of a log's scan, from which `parse` makes the same scan, to the bit."""
    ranges = [value if np.isfinite(value) else None for value in scan.ranges.tolist()]
    place = {"odometry": scan.odometry.tolist(), "drive": scan.drive}
    begin, step = float(scan.angles[0]), float(scan.angles[1] - scan.angles[0])
    try:
        even = Scan.from_ranges(scan.ranges, begin, step)
        same = np.array_equal(even.angles, scan.angles) and np.array_equal(even.ranges, scan.ranges)
    except LogError:  # beams that are not one turn, as those of several lasers
        same = False
    if same:
        return _line(type="scan", time=time, angle_min=begin, angle_increment=step, **place, ranges=ranges)
    return _line(type="scan", time=time, angles=scan.angles.tolist(), **place, ranges=ranges)


def _line(**fields: Any) -> str:
    return json.dumps(fields, allow_nan=False, separators=(",", ":"))
