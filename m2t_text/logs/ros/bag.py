"""A ROS bag as a log: its laser scans, each with the odometry at its time, and the laser's place by tf."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from m2t_text.errors import LogError, PartError, clean
from m2t_text.logs.leaps import stands
from m2t_text.logs.log import ALONE, Log, LogOptions, Scan
from m2t_text.logs.ros.clocks import Stream, settled
from m2t_text.logs.ros.frames import mounting, planar
from m2t_text.logs.ros.merging import merged
from m2t_text.logs.ros.messages import POINTS, Bag, open_bag
from m2t_text.logs.ros.placing import Laser, placed, scans_of
from m2t_text.logs.ros.point_scans import BAND, is_cut, scan_of
from m2t_text.logs.ros.recording import Recording, Sweep, stream_of
from m2t_text.logs.ros.topics import Chosen, choose, listed
from m2t_text.util.files import is_folder, shown
from m2t_text.util.names import alike, bag_files, checked_name, dataset_name
from m2t_text.util.types import Floats, Progress

TILT = math.radians(20.0)  # of a laser; from there on it does not see the walls level with the floor
BY_HAND = "say where the laser sits on the robot by --laser-pose X Y DEGREES"


@dataclass(frozen=True)
class Odometry:
    """Poses (N, 3) of the frame ``robot``, and when they were told; no rows where nothing tells."""

    robot: str
    stream: Stream
    poses: Floats


def read_bag(
    path: Path, name: str | None = None, progress: Progress | None = None, options: LogOptions | None = None
) -> Log:
    """Read a ROS bag: scans or clouds of points, with the odometry of Odometry messages or else of tf.

    The robot's frame is the one whose odometry it is. The laser may sit in it anywhere, also upside down; one
    that scans a plane must do so level with the floor. ``progress`` is called with the messages read and all.
    What cannot be used is skipped, where clock or odometry begin again the drive is cut, and each is told in
    the log's warnings.

    Raises LogError with one line if the bag cannot be opened, if a topic or a transform is missing, if more
    than half of the scans cannot be used or fewer than two are left.
    """
    options = options or LogOptions()
    name = dataset_name(path) if name is None else checked_name(name)
    try:
        with open_bag(path) as bag:
            return assembled(name, bag, options, progress)
    except PartError as error:
        raise LogError(clean(f"{shown(path)}: {error}{_parts(path)}")) from error


def assembled(name: str, bag: Bag, options: LogOptions, progress: Progress | None) -> Log:
    """The log that an open bag holds. Raises PartError with what is missing."""
    chosen = choose(bag.topics, options)
    recording, odometry, lasers = _record(bag, chosen, options, progress)
    cut = options.height is None and any(is_cut(sweep.angles) for laser in lasers for sweep in laser.sweeps)
    band = f"clouds are cut to heights of {BAND[0]:g} to {BAND[1]:g} m above the ground; --height names others"
    return _log(name, recording, odometry, lasers, (*bag.warnings, *([band] if cut else [])))


def _parts(path: Path) -> str:
    """What to do if a file is one part of a recording: one alone often lacks what the first one holds."""
    if is_folder(path) or sum(alike(path, one) for one in bag_files(path.absolute().parent)) < 2:
        return ""
    folder = shown(path.parent)
    return (
        f". If it is a part of a recording, name its folder {folder}, or mend it by `ros2 bag reindex {folder}`"
    )


def _record(
    bag: Bag, chosen: Chosen, options: LogOptions, progress: Progress | None
) -> tuple[Recording, Odometry, list[Laser]]:
    """All that is told. Clouds are read once it is known where their lasers sit, as they are cut at once."""
    recording = Recording()
    clouds = {topic for topic in chosen.scans if bag.topics[topic] == POINTS}
    wanted = (
        (set(chosen.scans) - clouds) | chosen.transforms | ({chosen.odometry} if chosen.odometry else set())
    )
    for message in bag.messages(wanted, recording.damage, None if clouds else progress):
        recording.add(message)
    mounts: dict[str, Floats] = {}

    def mount(frame: str) -> Floats:
        if frame not in mounts:
            mounts[frame] = _mount(recording, _robot(recording, chosen, frame), frame, options)
        return mounts[frame]

    if clouds:
        recording.reduce = lambda points, frame: scan_of(points, mount(frame), options.height)
        for message in bag.messages(clouds, recording.damage, progress):
            recording.add(message)
    if len(chosen.scans) > 1 and options.laser_pose is not None:
        raise PartError("--laser-pose says where one laser sits, but there are several: name one --scan-topic")
    lasers, frames = [], []
    for topic in chosen.scans:
        frame, sweeps = _one_laser(recording, topic)
        frames.append(frame)
        pose = mount(frame)
        if topic not in clouds:
            _check_level(frame, pose)
        lasers.append(Laser(topic, sweeps, topic in clouds, pose))
    return recording, _odometry(recording, chosen, frames[0]), lasers


def _one_laser(recording: Recording, topic: str) -> tuple[str, list[Sweep]]:
    """The frame with the most scans of a topic, and these. Raises PartError if most cannot be used."""
    frames = recording.sweeps.get(topic, {})
    skipped, kept = recording.skipped.get(topic, 0), sum(len(sweeps) for sweeps in frames.values())
    found = "".join(f" ({line})" for line in recording.damage.report()[:1])
    if skipped > kept or kept == 0:
        raise PartError(f"{skipped} of {skipped + kept} scans cannot be used{found}")
    best = max(frames, key=lambda frame: len(frames[frame]))
    if len(frames) > 1:
        held = listed(f"{frame!r} ({len(sweeps):,})" for frame, sweeps in frames.items())
        number = min(sweeps[0].number for frame, sweeps in frames.items() if frame != best)
        recording.damage.add(
            f"{topic} has scans of {len(frames)} lasers, {held}: only {best!r} is read", number
        )
    return best, frames[best]


def _robot(recording: Recording, chosen: Chosen, laser: str) -> str:
    """The frame that stands for the robot: that of the odometry, or that which carries the laser."""
    frames = recording.frames
    if chosen.odometry is not None and recording.odometry:
        child = max(recording.odometry, key=lambda pair: len(recording.odometry[pair].poses))[1]
        return child or frames.base(laser)
    drive = frames.drive(laser) if chosen.by_tf or chosen.odometry else None
    return drive or frames.base(laser)


def _mount(recording: Recording, robot: str, laser: str, options: LogOptions) -> Floats:
    """The pose (4, 4) of the laser on the robot."""
    if options.laser_pose is not None:
        return mounting(options.laser_pose, options.upside_down)
    mounted = recording.frames.between(robot, laser)
    base = recording.frames.base(laser)
    if mounted is None and robot not in recording.frames.names() and base != laser:
        if "base" not in base.lower():
            base = robot
        mounted = recording.frames.between(base, laser)
        if mounted is not None:
            recording.damage.add(f"tf does not know {robot!r}, whose odometry it is: taken for {base!r}", 1)
    if mounted is None:
        raise PartError(
            f"no fixed transform from the robot {robot!r} to the laser {laser!r}: record /tf_static, too, or "
            f"{BY_HAND}; tf knows {listed(recording.frames.names())}"
        )
    if options.upside_down and mounted[2, 2] > 0:
        mounted = mounted @ mounting((0.0, 0.0, 0.0), upside_down=True)
    return mounted


def _check_level(frame: str, mount: Floats) -> None:
    if abs(mount[2, 2]) < math.cos(TILT):
        tilt = math.degrees(math.acos(abs(mount[2, 2])))
        raise PartError(
            f"the laser {frame!r} is tilted by {tilt:.0f} degrees; 2D maps need it level, or {BY_HAND}"
        )


def _odometry(recording: Recording, chosen: Chosen, laser: str) -> Odometry:
    """How the robot moved, by messages of their own or by tf."""
    nothing = Stream(np.empty(0), np.empty(0))
    robot = _robot(recording, chosen, laser)
    if chosen.odometry is not None and recording.odometry:
        motions = sorted(recording.odometry.items(), key=lambda item: -len(item[1].poses))
        motion = motions[0][1]
        for (parent, child), other in motions[1:]:
            what = f"{chosen.odometry} also tells how {child!r} moves in {parent!r}, {len(other.poses):,} times"
            recording.damage.add(f"{what}: not read", 1)
        return Odometry(robot, stream_of(motion), np.array(motion.poses))
    joint = recording.frames.joints.get(robot) if chosen.by_tf or chosen.odometry else None
    if joint is None or not joint.drives:
        return Odometry(robot, nothing, np.empty((0, 3)))
    return Odometry(robot, joint.stream, joint.plane)


def _log(
    name: str, recording: Recording, odometry: Odometry, lasers: Sequence[Laser], notes: Sequence[str]
) -> Log:
    damage, main = recording.damage, lasers[0]
    streams = [stream_of(laser.sweeps) for laser in lasers]
    timed, odd = settled([*streams, *([odometry.stream] if len(odometry.poses) else [])])
    wheels = timed[-1] if len(odometry.poses) else None
    places = [placed(times, wheels, odometry.poses) for times in timed[: len(lasers)]]
    recurring: list[str] = []
    scans = []
    for laser, (kept, poses, drives) in zip(lasers, places, strict=True):
        ours, warned = scans_of(laser, timed[lasers.index(laser)].times, kept, poses, drives)
        scans.append(ours)
        recurring += warned
    for number in set(range(len(main.sweeps))) - set(places[0][0].tolist()):
        damage.add("scan before the first odometry or after the last", main.sweeps[number].number)
    found = scans[0]
    if len(found) < 2:
        raise PartError(
            f"only {len(found)} of {len(main.sweeps)} scans at the times of the odometry, and a log needs 2: "
            "are the stamps of one clock?"
        )
    leapt = np.flatnonzero(np.diff([scan.drive for scan in found])) + 1
    set_back = np.unique(timed[0].epochs).size - 1
    if len(leapt) > set_back:
        cut = f"odometry leaps or begins again: the drive is cut, and no map spans it: {_numbers(found, leapt)}"
        odd = [*odd, cut]
    for laser, others in zip(lasers[1:], scans[1:], strict=True):
        found = merged(found, planar(main.mount), others, planar(laser.mount))
    alone = wheels is None or stands(np.array([scan.odometry for scan in found]))
    return Log(
        name=name,
        scans=tuple(found),
        laser_pose=planar(main.mount),
        warnings=tuple(
            clean(line) for line in (*notes, *damage.report(), *odd, *recurring, *([ALONE] * alone))
        ),
        has_odometry=not alone,
    )


def _numbers(scans: Sequence[Scan], cuts: NDArray[np.int64]) -> str:
    first = f"message {scans[cuts[0]].line}"
    return first if len(cuts) == 1 else f"{len(cuts)} times, first at {first}"
