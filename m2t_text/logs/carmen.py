"""CARMEN logs: one message a line, of which the scans, the wheel odometry and the parameters are read."""

import math
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from m2t_text.errors import LogError, PartError
from m2t_text.logs.lines import Damage, read_lines
from m2t_text.logs.log import Log, Scan
from m2t_text.logs.odometry import Track, separate
from m2t_text.util.files import shown
from m2t_text.util.names import checked_name, dataset_name
from m2t_text.util.types import Floats, Progress

SICK_MAXIMUM = 80.0  # m; an LMS reports about 81.9 for a beam that did not return
POSE_LIMIT = 1e6  # m and rad; beyond it a number is damage, and arithmetic on it would overflow
TIME_LIMIT = 1e12  # s
CLIPPED = 20.0  # m; from here on a largest reading that recurs so many times and in such a share
RECURRING, SATURATED = 100, 1e-3  # of all readings is the sensor's maximum, not a wall


@dataclass
class Messages:
    """All that was read so far, in the order of the file."""

    ranges: list[Floats] = field(default_factory=list)
    angles: list[Floats] = field(default_factory=list)
    limits: list[float] = field(default_factory=list)  # m; a reading from here on is no return
    scans: list[tuple[float, ...]] = field(default_factory=list)  # line, time, first pose, second pose
    odometry: list[tuple[float, ...]] = field(default_factory=list)  # line, time, pose
    parameters: dict[bytes, float] = field(default_factory=dict)
    damaged: list[int] = field(default_factory=list)  # lines of the scans that were skipped

    def add_scan(self, scan: tuple[float, ...], ranges: Floats, angles: Floats, limit: float) -> None:
        """Append one scan; nothing is appended of a line that raised before."""
        self.scans.append(scan)
        self.ranges.append(ranges)
        self.angles.append(angles)
        self.limits.append(limit)


def read_carmen(path: Path, name: str | None = None, progress: Progress | None = None) -> Log:
    """Read a CARMEN log, plain or gzipped, line by line.

    ``progress`` is called with the bytes of the file read so far and its size. Damaged lines are skipped and
    counted in the log's warnings. Raises LogError if the file cannot be read, holds fewer than two scans, or
    more than half of its scan lines are damaged.
    """
    path = Path(path)
    name = dataset_name(path) if name is None else checked_name(name)
    damage = Damage()
    messages = _read_messages(path, damage, progress)
    _check(path, messages, damage)
    scans, wheels = np.array(messages.scans), np.array(messages.odometry).reshape(-1, 5)
    poses = separate(
        Track(scans[:, 0], scans[:, 1], scans[:, 2:5]),
        scans[:, 5:8],
        Track(wheels[:, 0], wheels[:, 1], wheels[:, 2:]),
        np.array(messages.damaged, dtype=np.float64),
        messages.parameters.get(b"robot_frontlaser_offset", 0.0),
    )
    for line in poses.backwards:
        damage.add("time runs backwards, so odometry is taken in the order of the lines", int(line))
    return Log(
        name=name,
        scans=tuple(
            Scan(ranges, angles, odometry, time, int(line))
            for ranges, angles, odometry, (line, time) in zip(
                _returns(messages), messages.angles, poses.odometry, scans[:, :2].tolist(), strict=True
            )
        ),
        laser_pose=poses.laser,
        ground_truth=poses.truth,
        warnings=damage.report(),
    )


def _read_messages(path: Path, damage: Damage, progress: Progress | None) -> Messages:
    messages = Messages()
    for number, text, whole in read_lines(path, damage, progress):
        words = text.split()
        if not words or words[0] not in READERS:
            continue
        kind = words[0]
        try:
            READERS[kind](messages, number, words, whole)
        except PartError as error:
            if kind in (b"FLASER", b"ROBOTLASER1"):
                messages.damaged.append(number)
            damage.add(f"{kind.decode()} {'cut off at the end of the file' if not whole else error}", number)
    return messages


def _check(path: Path, messages: Messages, damage: Damage) -> None:
    count, damaged = len(messages.scans), len(messages.damaged)
    report = sorted(damage.report(), key=lambda line: line.startswith("ODOM"))
    found = f" ({report[0]})" if report else ""
    if count + damaged == 0:
        raise LogError(
            f"{shown(path)}: no FLASER or ROBOTLASER1 line{found}: name a CARMEN log with laser scans"
        )
    if damaged > count:
        raise LogError(
            f"{shown(path)}: {damaged} of {count + damaged} scan lines are damaged{found}: fetch the log again"
        )
    if count < 2:
        raise LogError(f"{shown(path)}: only {count} scan{found}: a log needs at least 2, fetch a longer one")


def _read_flaser(messages: Messages, line: int, words: list[bytes], whole: bool) -> None:
    """``FLASER n readings, pose, pose, time, host, logger's time``; the last two may be missing."""
    end = 2 + _count(words, 1)
    tail = len(words) - end
    if not (7 if whole else 9) <= tail <= 9:
        raise PartError("with a wrong number of values")
    ranges, scan = _ranges(words[2:end]), _scan(line, words[end : end + 7])
    messages.add_scan(scan, ranges, half_circle(len(ranges)), math.inf)


def _read_robotlaser(messages: Messages, line: int, words: list[bytes], whole: bool) -> None:
    """``ROBOTLASER1 type start field step maximum accuracy mode n readings m remissions, poses, ..., time``."""
    end = 9 + _count(words, 8)
    start, field_of_view, step, maximum = _numbers(words[2:6])
    after = end + 1 + _count(words, end, least=0)
    tail = len(words) - after
    if not (12 if whole else 14) <= tail <= 14:
        raise PartError("with a wrong number of values")
    ranges = _ranges(words[9:end])
    step = step or field_of_view / (len(ranges) - 1)
    if not (abs(start) <= 2 * math.pi and 0 < step * (len(ranges) - 1) <= 2.01 * math.pi and maximum > 0):
        raise PartError("with an impossible field of view or maximum range")
    scan = _scan(line, words[after : after + 6] + words[after + 11 : after + 12])
    messages.add_scan(scan, ranges, start + step * np.arange(len(ranges), dtype=np.float64), maximum)


def _read_odom(messages: Messages, line: int, words: list[bytes], whole: bool) -> None:
    """``ODOM x y theta tv rv accel time host logger's time``; the last two may be missing."""
    if len(words) < (8 if whole else 10):
        raise PartError("with a wrong number of values")
    x, y, theta, time = _numbers([*words[1:4], words[7]])
    _check_poses(x, y, theta)
    _check_time(time)
    messages.odometry.append((line, time, x, y, theta))


def _read_param(messages: Messages, line: int, words: list[bytes], whole: bool) -> None:
    """``PARAM name value ...``; only numbers are kept."""
    with suppress(IndexError, ValueError):
        value = float(words[2])
        if abs(value) < POSE_LIMIT:
            messages.parameters[words[1]] = value


READERS = {
    b"FLASER": _read_flaser,
    b"ROBOTLASER1": _read_robotlaser,
    b"ODOM": _read_odom,
    b"PARAM": _read_param,
}


def _count(words: list[bytes], at: int, least: int = 2) -> int:
    """How many values the line claims to hold; never more than it has words."""
    try:
        count = int(words[at])
    except (IndexError, ValueError) as error:
        raise PartError("with a wrong number of values") from error
    if not least <= count < len(words):
        raise PartError("with a wrong number of values")
    return count


def _numbers(words: list[bytes]) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError as error:
        raise PartError("with words that are not numbers") from error
    return numbers


def _ranges(words: list[bytes]) -> Floats:
    ranges = np.array(_numbers(words), dtype=np.float64)
    if not (ranges >= 0).all():  # false for NaN, too
        raise PartError("with a NaN or negative reading")
    return ranges


def _scan(line: int, words: list[bytes]) -> tuple[float, ...]:
    *poses, time = _numbers(words)
    _check_poses(*poses)
    _check_time(time)
    return (line, time, *poses)


def _check_poses(*values: float) -> None:
    if not all(abs(value) < POSE_LIMIT for value in values):
        raise PartError("with a pose that is not finite")


def _check_time(time: float) -> None:
    if not abs(time) < TIME_LIMIT:
        raise PartError("with a time that is not finite")


@cache
def half_circle(count: int) -> Floats:
    """Angles of a scan over 180 degrees; an odd count includes both ends, an even one has as many steps."""
    return -np.pi / 2 + np.arange(count, dtype=np.float64) * (np.pi / (count - count % 2))


def _returns(messages: Messages) -> list[Floats]:
    """The readings with ``inf`` where the beam did not return."""
    claimed = messages.parameters.get(b"robot_front_laser_max", 0.0)
    sick = min(claimed, SICK_MAXIMUM) if claimed > 0 else SICK_MAXIMUM
    limits = [min(limit, sick) if limit == math.inf else limit for limit in messages.limits]
    largest = max(
        ranges.max(initial=0.0, where=ranges < limit)
        for ranges, limit in zip(messages.ranges, limits, strict=True)
    )
    # Some logs clip far readings at a round maximum that no PARAM tells (50 m in aces).
    readings = sum(ranges.size for ranges in messages.ranges)
    clipped = sum(np.count_nonzero(ranges == largest) for ranges in messages.ranges)
    if largest >= CLIPPED and clipped >= max(RECURRING, SATURATED * readings):
        limits = [min(limit, largest) for limit in limits]
    return [
        np.where((ranges > 0) & (ranges < limit), ranges, np.inf)
        for ranges, limit in zip(messages.ranges, limits, strict=True)
    ]
