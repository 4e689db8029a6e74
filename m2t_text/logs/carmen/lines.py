"""The lines of CARMEN logs: scans of several lasers in several forms, odometry, and parameters."""

import math
import re
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from m2t_text.errors import PartError
from m2t_text.logs.beams import beams_in_a_turn, half_circle
from m2t_text.logs.lines import Damage, read_lines
from m2t_text.util.types import Floats, Progress

POSE_LIMIT = 1e6  # m and rad; beyond it a number is damage, and arithmetic on it would overflow
TIME_LIMIT = 1e12  # s
SCANS = re.compile(rb"[FR]LASER|(?:ROBOT|RAW)LASER\d|LASER_LASER\d")
LASER_WORD = re.compile(rb"[A-Z0-9_]*LASER[A-Z0-9_]*")
WITHOUT_NUMBER = (b"#", b"nan", b"inf")  # how "not a number" and "infinite" are written, Windows' 1.#QNAN too


@dataclass
class Laser:
    """The scans of one kind of line, in the order of the file.

    Attributes:
        limits: metres; a reading from there on is no return.
        scans: line, time, first pose, second pose; poses are NaN where the kind of line has none.
        damaged: lines that were skipped.
        short: whether its lines are of an old form that lacks the time; None before the first.
    """

    ranges: list[Floats] = field(default_factory=list)
    angles: list[Floats] = field(default_factory=list)
    limits: list[float] = field(default_factory=list)
    scans: list[tuple[float, ...]] = field(default_factory=list)
    damaged: list[int] = field(default_factory=list)
    short: bool | None = None

    def add(self, scan: tuple[float, ...], ranges: Floats, angles: Floats, limit: float) -> None:
        """Append one scan; nothing is appended of a line that raised before."""
        self.scans.append(scan)
        self.ranges.append(ranges)
        self.angles.append(angles)
        self.limits.append(limit)

    @property
    def lines(self) -> int:
        """How many lines of its kind there are, sound or not."""
        return len(self.scans) + len(self.damaged)


@dataclass
class Messages:
    """All that was read so far, in the order of the file.

    Attributes:
        lasers: by the first word of their lines.
        odometry: line, time, pose.
        others: how many lines there are of each other word that seems to name a laser.
    """

    damage: Damage = field(default_factory=Damage)
    lasers: dict[str, Laser] = field(default_factory=dict)
    odometry: list[tuple[float, ...]] = field(default_factory=list)
    odometry_is_short: bool | None = None
    parameters: dict[bytes, float] = field(default_factory=dict)
    others: Counter[str] = field(default_factory=Counter)


def read_messages(path: Path, progress: Progress | None = None) -> Messages:
    """All that the lines of a log tell; damaged ones are counted. Raises LogError if it cannot be read."""
    messages = Messages()
    for number, text, whole in read_lines(path, messages.damage, progress):
        words = text.split()
        if not words:
            continue
        kind = words[0]
        laser = messages.lasers.setdefault(kind.decode(), Laser()) if SCANS.fullmatch(kind) else None
        try:
            if laser is not None:
                read = _read_flaser if kind in (b"FLASER", b"RLASER") else _read_laser
                read(laser, number, words, whole)
            elif kind == b"ODOM":
                _read_odom(messages, number, words, whole)
            elif kind == b"PARAM":
                _read_param(messages, words)
            elif LASER_WORD.fullmatch(kind):
                messages.others[kind.decode()] += 1
        except PartError as error:
            if laser is not None:
                laser.damaged.append(number)
            wrong = "cut off at the end of the file" if not whole else error
            messages.damage.add(f"{kind.decode()} {wrong}", number)
    return messages


def _read_flaser(laser: Laser, line: int, words: list[bytes], whole: bool) -> None:
    """``FLASER n readings, pose, pose, time, host, logger's time``; the last two may be missing.

    Old logs lack all after the poses, or have one pose, with or without the time. RLASER is the rear laser's.
    """
    end = 2 + _count(words, 1)
    tail = words[end:]
    short = len(tail) in (3, 4, 5, 6)
    if not (whole and short and laser.short is not False):
        if not (7 if whole else 9) <= len(tail) <= 9 or laser.short:
            raise PartError("with a wrong number of values")
        scan = _scan(line, tail[:7])
    elif len(tail) == 6:
        scan = _scan(line, [*tail, b"0"])
    else:
        scan = _scan(line, [*tail[:3], *tail[:3], *(tail[3:4] or [b"0"])])
    ranges = _ranges(words[2:end])
    laser.short = short
    laser.add(scan, ranges, half_circle(len(ranges)), math.inf)


def _read_laser(laser: Laser, line: int, words: list[bytes], whole: bool) -> None:
    """``ROBOTLASER1 type start field step maximum accuracy mode n readings m remissions, poses, ..., time``.

    RAWLASER1 and LASER_LASER1 have no poses: the time follows the remissions.
    """
    end = 9 + _count(words, 8)
    start, field_of_view, step, maximum = _numbers(words[2:6])
    after = end + 1 + _count(words, end, least=0)
    posed = words[0].startswith(b"ROBOT")
    least, most = (12, 14) if posed else (1, 3)
    if not (least if whole else most) <= len(words) - after <= most:
        raise PartError("with a wrong number of values")
    ranges = _ranges(words[9:end])
    step = step or field_of_view / (len(ranges) - 1)
    if not (step > 0 and maximum >= 0):
        raise PartError("with an impossible field of view or maximum range")
    kept = beams_in_a_turn(start, step, len(ranges))
    if posed:
        scan = _scan(line, words[after : after + 6] + words[after + 11 : after + 12])
    else:
        (time,) = _numbers(words[after : after + 1])
        _check_time(time)
        scan = (line, time, *[math.nan] * 6)
    laser.add(scan, ranges[:kept], start + step * np.arange(kept, dtype=np.float64), maximum or math.inf)


def _read_odom(messages: Messages, line: int, words: list[bytes], whole: bool) -> None:
    """``ODOM x y theta tv rv accel time host logger's time``; the last two or three may be missing."""
    short = len(words) in (4, 5, 6, 7)
    if short and whole and messages.odometry_is_short is not False:
        time = 0.0
    elif len(words) < (8 if whole else 10) or messages.odometry_is_short:
        raise PartError("with a wrong number of values")
    else:
        (time,) = _numbers(words[7:8])
    x, y, theta = _numbers(words[1:4])
    _check_poses(x, y, theta)
    _check_time(time)
    messages.odometry_is_short = short
    messages.odometry.append((line, time, x, y, theta))


def _read_param(messages: Messages, words: list[bytes]) -> None:
    """``PARAM name value ...``; only numbers are kept."""
    with suppress(ValueError, PartError):
        (value,) = _numbers(words[2:3])
        if abs(value) < POSE_LIMIT:
            messages.parameters[words[1]] = value


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
        return [float(word) for word in words]
    except ValueError:
        return [_number(word) for word in words]


def _number(word: bytes) -> float:
    """A number that may have a decimal comma, or be one of Windows' words for none."""
    if any(mark in word.lower() for mark in WITHOUT_NUMBER):
        return math.nan
    try:
        return float(word.replace(b",", b"."))
    except ValueError as error:
        raise PartError("with words that are not numbers") from error


def _ranges(words: list[bytes]) -> Floats:
    """The readings, ``inf`` where there is none: where it is not finite, or not positive."""
    ranges = np.array(_numbers(words), dtype=np.float64)
    return np.where(ranges > 0, ranges, np.inf)


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
