"""A ROS bag as a log: its laser scans, each with the odometry at its time, and the laser's place by tf."""

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from m2t_text.errors import LogError, PartError, clean
from m2t_text.logs.frames import planar
from m2t_text.logs.log import Log, LogOptions
from m2t_text.logs.odometry import Track, interpolate
from m2t_text.logs.recording import Recording
from m2t_text.logs.ros import LASER, ODOMETRY, TRANSFORMS, Bag, open_bag
from m2t_text.util.files import shown
from m2t_text.util.names import checked_name, dataset_name
from m2t_text.util.types import Floats, Progress

OUTSIDE = 0.1  # s before the first odometry or after the last at which a scan is taken to be at its pose
TILT = math.radians(20.0)  # of a laser; from there on it does not see the walls level with the floor
LISTED = 12  # topics or frames named in one line


def read_bag(
    path: Path, name: str | None = None, progress: Progress | None = None, options: LogOptions | None = None
) -> Log:
    """Read a ROS bag: LaserScan messages, with the odometry of Odometry messages or else of tf.

    The robot's frame is the one whose odometry it is. The laser may sit in it anywhere, also upside down, as
    long as it scans level with the floor. ``progress`` is told messages read and all. What cannot be used is
    skipped and counted in the log's warnings.

    Raises LogError with one line if the bag cannot be opened, if a topic or a transform is missing, if more
    than half of the scans are damaged or fewer than two are left.
    """
    name = dataset_name(path) if name is None else checked_name(name)
    try:
        with open_bag(path) as bag:
            recording = _record(bag, options or LogOptions(), progress)
        return _log(name, recording, options or LogOptions())
    except PartError as error:
        raise LogError(clean(f"{shown(path)}: {error}")) from error


def _record(bag: Bag, options: LogOptions, progress: Progress | None) -> Recording:
    held = _listed(f"{topic} ({_plain(kind)})" for topic, kind in sorted(bag.topics.items()))
    if len(options.scan) > 1:
        raise PartError("--scan-topic: one laser of a bag is read; name one topic")
    laser = _topic(bag, (LASER,), next(iter(options.scan), None), "--scan-topic")
    if laser is None:
        raise PartError(f"no laser scans ({_plain(LASER)}) in the bag; its topics are {held}")
    odometry = _topic(bag, (ODOMETRY, TRANSFORMS), options.odometry, "--odometry-topic")
    transforms = {topic for topic, kind in bag.topics.items() if kind == TRANSFORMS}
    if odometry is None and not transforms:
        raise PartError(f"no odometry ({_plain(ODOMETRY)}) and no tf in the bag; its topics are {held}")
    recording = Recording(by_tf=odometry is None or odometry in transforms)
    wanted = {laser} | transforms | ({odometry} if odometry else set())
    for message in bag.messages(wanted, recording.damage, progress):
        recording.add(message)
    return recording


def _topic(bag: Bag, kinds: tuple[str, ...], wanted: str | None, option: str) -> str | None:
    """The topic that is wanted, of one of the kinds; else the only one of the first kind, if there is one."""
    if wanted is not None:
        fitting = [topic for topic, kind in sorted(bag.topics.items()) if kind in kinds]
        for topic in fitting:
            if topic.strip("/") == wanted.strip("/"):
                return topic
        raise PartError(
            f"{option}: no topic {wanted!r} of the type {_plain(kinds[0])}; there is {_listed(fitting)}"
        )
    held = [topic for topic, kind in sorted(bag.topics.items()) if kind == kinds[0]]
    if len(held) > 1:
        raise PartError(f"several topics of the type {_plain(kinds[0])}: {_listed(held)}; name one by {option}")
    return held[0] if held else None


def _log(name: str, recording: Recording, options: LogOptions) -> Log:
    damage, skipped, kept = recording.damage, recording.skipped, len(recording.sweeps)
    found = "".join(f" ({line})" for line in damage.report()[:1])
    if skipped > kept:
        raise PartError(f"{skipped} of {skipped + kept} scans are damaged{found}: record or fetch it again")
    if kept == 0:
        raise PartError(f"no scan can be read{found}: record or fetch it again")
    robot, wheels = _odometry(recording, found)
    mounted = None if options.laser_pose else _mounted(recording, robot)
    sweeps = []
    for sweep in sorted(recording.sweeps, key=lambda sweep: sweep.time):
        if wheels.times[0] - OUTSIDE <= sweep.time <= wheels.times[-1] + OUTSIDE:
            sweeps.append(sweep)
        else:
            damage.add("scan before the first odometry or after the last", sweep.number)
    if len(sweeps) < 2:
        raise PartError(
            f"only {len(sweeps)} of {kept + skipped} scans at the times of the odometry, and a log needs 2: "
            "are the stamps of one clock?"
        )
    times = np.array([sweep.time for sweep in sweeps])
    poses, drives, _ = interpolate(Track(times, times, np.empty((0, 3))), wheels)
    upright = not options.upside_down and (mounted is None or mounted[2, 2] > 0)
    return Log(
        name=name,
        scans=tuple(
            replace(sweep.scan(pose, upright), drive=int(drive))
            for sweep, pose, drive in zip(sweeps, poses, drives, strict=True)
        ),
        laser_pose=planar(mounted) if mounted is not None else np.array(options.laser_pose),
        warnings=tuple(clean(line) for line in damage.report()),
    )


def _odometry(recording: Recording, found: str) -> tuple[str, Track]:
    """The robot's frame and its odometry in the order of time."""
    assert recording.laser is not None
    base, _ = recording.frames.base(recording.laser)
    if recording.by_tf:
        track = recording.frames.track(base)
        if track is None:
            raise PartError(
                f"no odometry: no {_plain(ODOMETRY)}, and the frame {base!r} of the laser does not move in tf, "
                f"which knows {_listed(recording.frames.names())}"
            )
        times, poses = track
    elif recording.odometry:
        base = recording.robot or base
        times = np.array([time for time, _ in recording.odometry])
        poses = np.array([pose for _, pose in recording.odometry])
    else:
        raise PartError(f"no odometry can be read{found}: name another topic by --odometry-topic")
    times, order = np.unique(times, return_index=True)
    return base, Track(times, times, poses[order])


def _mounted(recording: Recording, robot: str) -> Floats:
    """The pose (4, 4) of the laser on the robot."""
    assert recording.laser is not None
    mounted = recording.frames.between(robot, recording.laser)
    if mounted is None:
        raise PartError(
            f"no fixed transform from the robot {robot!r} to the laser {recording.laser!r}: record /tf_static, "
            f"too; tf knows {_listed(recording.frames.names())}"
        )
    if abs(mounted[2, 2]) < math.cos(TILT):
        tilt = math.degrees(math.acos(abs(mounted[2, 2])))
        raise PartError(f"the laser {recording.laser!r} is tilted by {tilt:.0f} degrees; 2D maps need it level")
    return mounted


def _plain(kind: str) -> str:
    """A type's name as users of both ROS know it."""
    return kind.replace("/msg/", "/")


def _listed(names: Iterable[str]) -> str:
    every = list(names)
    more = f" and {len(every) - LISTED} more" if len(every) > LISTED else ""
    return ", ".join(every[:LISTED]) + more if every else "none"
