"""A robot with a laser that drives through a simulated building, and the CARMEN log of its drive."""

import gzip
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from m2t_text.errors import LogError
from m2t_text.geometry import between, compose, inverse, transform, wrap
from m2t_text.logs.building import SHORTEST, build
from m2t_text.logs.carmen import half_circle
from m2t_text.logs.lines import shown
from m2t_text.logs.log import Log, Scan
from m2t_text.logs.odometry import chain

Floats = NDArray[np.float64]

NO_RETURN = 81.9  # m; what a SICK LMS reports for a beam that did not return
AHEAD = 0.4  # m; the robot steers towards the point of the tour that lies so far ahead
WANDER = 0.2  # m; standard deviation of the drive from the tour, so that no visit repeats another exactly,
TAPER = 4.0  # m; less so within this distance of the tour's corners, as some lie before doors
TURN = np.radians(15.0)  # most that the robot turns between two scans
SHARP = np.radians(30.0)  # from here on the robot turns on the spot
SPEED, TURN_RATE = 0.5, 0.6  # m/s, rad/s
ROUNDING = 1e-9  # rad; a beam at a wall's end meets it


@dataclass(frozen=True)
class Simulation:
    """What to simulate.

    The odometry's errors are those of wheel odometry in real logs: some centimetres and degrees in 3 m.
    """

    seed: int = 0
    length: float = 44.0  # m; of the building, which is 22 m wide; at least 24
    travel: float = 180.0  # m; the drive ends here, or where the tour of the building does
    step: float = 0.2  # m; between two scans
    beams: int = 180  # over 180 degrees: 180 and 360 make steps of 1 and 0.5 degrees
    laser_offset: float = 0.1  # m; of the laser in front of the robot's centre
    range_noise: float = 0.015  # m; standard deviation
    dropout: float = 0.01  # probability that a beam does not return
    range_limit: float = 80.0  # m; no return from farther away
    scale_error: float = 0.02  # m per m, systematic
    turn_error: float = 0.005  # rad per m, systematic
    move_noise: float = 0.02  # m per square root of m
    turn_noise: float = 0.02  # rad per square root of m


def simulate(parameters: Simulation) -> Log:
    """The log of a drive, with ground truth. The same parameters make the same log.

    Raises LogError if the building would be too short or the laser have fewer than 2 beams.
    """
    if parameters.length < SHORTEST or parameters.beams < 2:
        raise LogError(f"a simulation needs a building of at least {SHORTEST} m and at least 2 beams")
    rng = np.random.default_rng(parameters.seed)
    building = build(rng, parameters.length)
    truth = _drive(rng, building.tour, parameters)
    laser_pose = np.array([parameters.laser_offset, 0.0, 0.0])
    angles = half_circle(parameters.beams)
    steps = between(truth[:-1], truth[1:])
    moved = np.hypot(steps[:, 0], steps[:, 1])
    odometry = _odometry(rng, truth[0], steps, moved, parameters)
    times = np.concatenate([[0.0], np.cumsum(moved / SPEED + np.abs(steps[:, 2]) / TURN_RATE)])
    scans = []
    for line, (pose, time) in enumerate(zip(compose(truth, laser_pose), times, strict=True), start=1):
        ranges = cast(pose, angles, building.walls) + rng.normal(0.0, parameters.range_noise, len(angles))
        lost = (ranges >= parameters.range_limit) | (rng.random(len(angles)) < parameters.dropout)
        ranges = np.where(lost, np.inf, np.maximum(ranges, 0.02))
        scans.append(Scan(ranges, angles, odometry[line - 1], float(time), line))
    return Log(f"simulated-{parameters.seed}", tuple(scans), laser_pose, truth)


def cast(pose: Floats, angles: Floats, walls: Floats) -> Floats:
    """Distances (B,) from a pose (3,) to the nearest of walls (W, 4); ``inf`` where a beam meets none.

    The angles (B,) in the pose's frame must rise and lie within 90 degrees of straight ahead.
    """
    seen_from = inverse(pose)
    start, end = transform(seen_from, walls[:, :2]), transform(seen_from, walls[:, 2:])
    ahead = (start[:, 0] > 0) | (end[:, 0] > 0)
    start, end = start[ahead], end[ahead]
    start, end = _cut(start, end), _cut(end, start)
    bearings = np.sort(np.arctan2([start[:, 1], end[:, 1]], [start[:, 0], end[:, 0]]), axis=0)
    first = np.searchsorted(angles, bearings[0] - ROUNDING)
    count = np.searchsorted(angles, bearings[1] + ROUNDING, side="right") - first
    wall = np.repeat(np.arange(len(start)), count)
    beam = np.arange(count.sum()) + np.repeat(first - np.cumsum(count) + count, count)
    start, along, c, s = start[wall], (end - start)[wall], np.cos(angles[beam]), np.sin(angles[beam])
    with np.errstate(divide="ignore", invalid="ignore"):  # of a beam along a wall
        distance = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / (c * along[:, 1] - s * along[:, 0])
    ranges = np.full(len(angles), np.inf)
    np.minimum.at(ranges, beam, np.where(distance > 0, distance, np.inf))
    return ranges


def _cut(start: Floats, end: Floats) -> Floats:
    """The starts (W, 2) of segments, moved along them to x = 0 where they lie behind it."""
    behind = start[:, 0] < 0
    place = np.where(behind, start[:, 0] / np.where(behind, start[:, 0] - end[:, 0], 1.0), 0.0)
    return start + place[:, None] * (end - start)


def _drive(rng: Generator, tour: Floats, parameters: Simulation) -> Floats:
    """Poses (S, 3) of a robot that follows the tour, turning on the spot where it turns sharply."""
    legs = np.hypot(*np.diff(tour, axis=0).T)
    place = np.concatenate([[0.0], np.cumsum(legs)])
    knots = np.arange(0.0, place[-1] + 4.0, 2.0)
    lateral = rng.normal(0.0, WANDER, (len(knots), 2)).clip(-1.5 * WANDER, 1.5 * WANDER)

    def target(at: float) -> Floats:
        ease = min(1.0, float(np.abs(at - place).min()) / TAPER)
        return np.array(
            [np.interp(at, place, tour[:, k]) + ease * np.interp(at, knots, lateral[:, k]) for k in (0, 1)]
        )

    aim = 0.0
    first = target(0.0)
    poses = [np.array([*first, np.arctan2(*(target(AHEAD) - first)[::-1])])]
    driven = 0.0
    while driven < parameters.travel and aim < place[-1]:
        x, y, theta = poses[-1]
        while aim < place[-1] and np.hypot(*(target(aim) - [x, y])) < AHEAD:
            aim += 0.05
        wanted = wrap(np.arctan2(*(target(aim) - [x, y])[::-1]) - theta)
        turn = np.clip(wanted, -TURN, TURN)
        forward = parameters.step if abs(wanted) < SHARP else 0.0
        half = theta + turn / 2
        poses.append(np.array([x + forward * np.cos(half), y + forward * np.sin(half), wrap(theta + turn)]))
        driven += forward
    return np.array(poses)


def _odometry(rng: Generator, start: Floats, steps: Floats, moved: Floats, parameters: Simulation) -> Floats:
    """Wheel odometry (S, 3) of true steps (S - 1, 3) of lengths ``moved``."""
    move = steps[:, :2] * (1 + parameters.scale_error)
    move += rng.normal(0.0, 1.0, move.shape) * parameters.move_noise * np.sqrt(moved)[:, None]
    turn = steps[:, 2] * (1 + parameters.scale_error) + parameters.turn_error * moved
    turn += rng.normal(0.0, parameters.turn_noise, len(turn)) * np.sqrt(moved)
    return chain(start, np.column_stack([move, turn]))


def write_carmen(log: Log, path: Path) -> None:
    """Write a log as CARMEN messages, gzipped if the name ends in ``.gz``; the file appears whole or not.

    The form is that of corrected logs: both poses of a scan are the laser's true pose, and lines of raw
    odometry come before it; without ground truth they are the laser's and the robot's odometry. The laser must
    lie on the robot's x axis and sweep 180 degrees, as the form has no place for more. Raises LogError if the
    file cannot be written.
    """
    data = "".join(f"{line}\n" for line in _carmen_lines(log)).encode("ascii")
    if path.name.endswith(".gz"):
        data = gzip.compress(data, mtime=0)
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".write-")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
            Path(temporary).chmod(0o644)
            Path(temporary).replace(path)
        finally:
            Path(temporary).unlink(missing_ok=True)
    except OSError as error:
        raise LogError(f"{shown(path)} cannot be written: {error.strerror}") from error


def _carmen_lines(log: Log) -> Iterator[str]:
    yield "# message formats defined: PARAM SYNC ODOM FLASER RLASER"
    yield f"PARAM robot_frontlaser_offset {log.laser_pose[0]:.6f} nohost 0"
    yield "PARAM robot_front_laser_max 80.99 nohost 0"
    robots = log.odometry if log.ground_truth is None else log.ground_truth
    lasers = compose(robots, log.laser_pose)
    if log.ground_truth is not None:
        robots = lasers
    for scan, laser, robot in zip(log.scans, lasers, robots, strict=True):
        ranges = np.where(np.isfinite(scan.ranges), scan.ranges, NO_RETURN)
        readings = " ".join(f"{reading:.2f}" for reading in ranges.tolist())
        odometry, first, second = (" ".join(f"{v:.6f}" for v in pose) for pose in (scan.odometry, laser, robot))
        stamp = f"{scan.timestamp:.6f} nohost {scan.timestamp:.6f}"
        yield f"ODOM {odometry} 0 0 0 {stamp}"
        yield f"FLASER {len(ranges)} {readings} {first} {second} {stamp}"
