"""CARMEN logs: one message a line, of which the scans, the wheel odometry and the parameters are read."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from m2t_text.errors import LogError, PartError, clean
from m2t_text.logs.beams import upside_down
from m2t_text.logs.carmen.lines import Laser, Messages, read_messages
from m2t_text.logs.leaps import stands
from m2t_text.logs.log import ALONE, Log, LogOptions, Scan
from m2t_text.logs.odometry import Poses, Track, from_wheels, separate
from m2t_text.logs.returns import no_returns, told, without
from m2t_text.util.files import shown
from m2t_text.util.names import LOGS, PACKED, checked_name, dataset_name, known_endings
from m2t_text.util.types import Floats, Progress

SICK_MAXIMUM = 80.0  # m; an LMS reports about 81.9 for a beam that did not return
# The kinds of lines that hold the scans of one laser, the best first: with its geometry, with poses, bare.
FRONT = ("ROBOTLASER1", "FLASER", "RAWLASER1", "LASER_LASER1")
REAR = ("ROBOTLASER2", "RLASER", "RAWLASER2")


def read_carmen(
    path: Path, name: str | None = None, progress: Progress | None = None, options: LogOptions | None = None
) -> Log:
    """Read a CARMEN log, plain or compressed, line by line.

    Of several lasers the front one is read, or the one whose kind of line (``RLASER``) the options name.
    ``progress`` is called with the bytes of the file read so far and its size. Damaged lines are skipped and
    counted in the log's warnings. Raises LogError if the file cannot be read, holds fewer than two scans, or
    more than half of its scan lines cannot be used.
    """
    path, options = Path(path), options or LogOptions()
    name = dataset_name(path) if name is None else checked_name(name)
    messages = read_messages(path, progress)
    try:
        kind, others = _chosen(path, messages, options)
        return _log(name, messages, kind, others, options)
    except PartError as error:
        raise LogError(clean(f"{shown(path)}: {error}")) from error


def _log(name: str, messages: Messages, kind: str, others: list[str], options: LogOptions) -> Log:
    laser, damage = messages.lasers[kind], messages.damage
    poses = _poses(kind, laser, messages, options)
    for line in poses.backwards:
        damage.add("time runs backwards, so odometry is taken in the order of the lines", int(line))
    for cut in np.flatnonzero(np.diff(poses.drives)) + 1:
        line = int(laser.scans[cut][0])
        damage.add("odometry leaps or begins again: the drive is cut, and no map spans it", line)
    ranges, recurring = _returns(laser, messages)
    scans = []
    for number, (line, time, *_) in enumerate(laser.scans):
        beams = (ranges[number], laser.angles[number])
        readings, angles = upside_down(*beams) if options.upside_down else beams
        drive = int(poses.drives[number])
        scans.append(Scan(readings, angles, poses.odometry[number], float(time), int(line), drive))
    alone = stands(poses.odometry)
    return Log(
        name=name,
        scans=tuple(scans),
        laser_pose=poses.laser if options.laser_pose is None else np.array(options.laser_pose),
        ground_truth=poses.truth,
        warnings=(*damage.report(), *recurring, *others, *([ALONE] if alone else [])),
        has_odometry=not alone,
    )


def _chosen(path: Path, messages: Messages, options: LogOptions) -> tuple[str, list[str]]:
    """The kind of line that is read, and a warning where there are others. Raises PartError if none can be."""
    held = {kind: laser for kind, laser in messages.lasers.items() if laser.lines}
    report = sorted(messages.damage.report(), key=lambda line: line.startswith("ODOM"))
    found = f" ({report[0]})" if report else ""
    if not held:
        raise PartError(_no_scans(path, messages, found))
    named = [one for one in options.scan if one.upper() in held]
    if len(named) > 1:
        raise PartError("--scan-topic: the lasers of a CARMEN log are read one at a time; name one of them")
    most = max(len(laser.scans) for laser in held.values())
    order = [one for one in dict.fromkeys((*FRONT, *REAR, *sorted(held))) if one in held]
    kind = named[0].upper() if named else next(one for one in order if len(held[one].scans) >= most / 2)
    laser = held[kind]
    count, damaged = len(laser.scans), len(laser.damaged)
    if damaged > count:
        raise PartError(
            f"{damaged} of {count + damaged} {kind} lines cannot be used{found}: fetch the log again if it was "
            "cut or damaged; else they are written in another way than CARMEN's"
        )
    if count < 2:
        raise PartError(f"only {count} scan{found}: a log needs at least 2, fetch a longer one")
    left = [f"{len(held[one].scans):,} {one}" for one in order if one != kind and held[one].scans]
    others = f"{' and '.join(left)} lines are not read, but {kind}: --scan-topic names another"
    return kind, [others] if left else []


def _no_scans(path: Path, messages: Messages, found: str) -> str:
    """What a file holds instead of scans, and what to do."""
    if messages.others:
        held = ", ".join(f"{count:,} {kind}" for kind, count in messages.others.most_common(3))
        return f"it holds {held} lines, but no FLASER, ROBOTLASER1 or RAWLASER1, which are read{found}"
    ending = path.suffix.lower()
    unknown = (
        "" if ending in (*LOGS, *PACKED) else f" The ending {ending!r} is unknown; known are {known_endings()}."
    )
    return (
        f"no FLASER, ROBOTLASER1 or RAWLASER1 line{found}, as a CARMEN log with laser scans has: name another "
        f"file.{unknown}"
    )


def _poses(kind: str, laser: Laser, messages: Messages, options: LogOptions) -> Poses:
    """Of the scans, and the laser's place. Raises PartError if the odometry cannot be that of one robot."""
    scans, wheels = np.array(laser.scans), np.array(messages.odometry).reshape(-1, 5)
    track = Track(scans[:, 0], scans[:, 1], scans[:, 2:5])
    wheel_track = Track(wheels[:, 0], wheels[:, 1], wheels[:, 2:])
    rear = kind in REAR
    which = b"rear" if rear else b"front"
    offset = messages.parameters.get(b"robot_%slaser_offset" % which, 0.0)
    if np.isnan(scans[:, 2:]).any():
        poses = from_wheels(track, wheel_track, -abs(offset) if rear else offset)
    else:
        damaged = np.array(laser.damaged, dtype=np.float64)
        poses = separate(track, scans[:, 5:8], wheel_track, damaged, -abs(offset) if rear else offset)
    if rear and not poses.laser[2]:  # only ROBOTLASER2 tells where it looks
        poses = replace(poses, laser=np.array([*poses.laser[:2], np.pi]))
    if options.odometry == "none":
        poses = replace(poses, odometry=np.zeros((len(scans), 3)), drives=np.zeros_like(poses.drives))
    return poses


def _returns(laser: Laser, messages: Messages) -> tuple[list[Floats], list[str]]:
    """The readings with ``inf`` where the beam did not return, and a warning for numbers that mean so."""
    claimed = messages.parameters.get(b"robot_front_laser_max", 0.0)
    sick = min(claimed, SICK_MAXIMUM) if claimed > 0 else SICK_MAXIMUM
    limits = [min(limit, sick) if limit == math.inf else limit for limit in laser.limits]
    ranges = [
        np.where(ranges < limit, ranges, np.inf) for ranges, limit in zip(laser.ranges, limits, strict=True)
    ]
    recurring = no_returns(ranges, laser.angles)
    total = sum(one.size for one in ranges)
    return [without(one, recurring) for one in ranges], list(told(recurring, total))
