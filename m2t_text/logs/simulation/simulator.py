"""A robot with a laser that drives through a simulated building, and the CARMEN log of its drive."""

import gzip
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.random import Generator

from m2t_text.errors import LogError
from m2t_text.logs.beams import half_circle
from m2t_text.logs.log import Log, Scan
from m2t_text.logs.odometry import chain
from m2t_text.logs.simulation.building import SHORTEST, Building, build
from m2t_text.logs.simulation.driving import drive, part_of_tour, walks
from m2t_text.logs.simulation.raycast import cast
from m2t_text.util.files import shown, written_whole
from m2t_text.util.geometry import between, compose, travel
from m2t_text.util.types import Floats, Progress

NO_RETURN = 81.9  # m; what a SICK LMS reports for a beam that did not return
SPEED, TURN_RATE = 0.5, 0.6  # m/s, rad/s


@dataclass(frozen=True)
class Simulation:
    """What to simulate.

    The odometry's errors are those of wheel odometry in real logs: some centimetres and degrees in 3 m.
    """

    seed: int = 0  # of the building
    drive: int = 0  # seed of the drive: of the robot's way, all noise, and what changes from day to day
    length: float = 44.0  # m; of the building, which is 22 m wide; at least 24
    start: float = 0.0  # m of the building's tour left out
    travel: float = 180.0  # m of the tour from there on; the drive ends there, or where the tour does
    backwards: bool = False  # whether this part of the tour is driven from its end to its begin
    doors: int = 2  # so many doors stand otherwise than on most days: open ones closed, closed ones open
    people: int = 1  # who walk up and down the robot's way
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


def simulate(parameters: Simulation, progress: Progress | None = None) -> Log:
    """The log of a drive, with ground truth. The same parameters make the same log.

    ``progress`` is called with (scans done, total).

    Raises LogError if the building would be too short, the laser have fewer than 2 beams, or nothing be left
    of the tour.

    Examples:
        >>> import m2t_text as m2t
        >>> log = m2t.simulate(m2t.Simulation(seed=1, length=24.0, travel=8.0))
        >>> log.scans[0].ranges.shape, log.odometry.shape == (len(log.scans), 3)
        ((180,), True)
    """
    if parameters.length < SHORTEST or parameters.beams < 2:
        raise LogError(f"a simulation needs a building of at least {SHORTEST} m and at least 2 beams")
    building = build(np.random.default_rng(parameters.seed), parameters.length)
    tour = part_of_tour(building.tour, parameters.start, parameters.travel)
    if travel(tour)[-1] < parameters.step:
        raise LogError(f"the tour of the building ends after {travel(building.tour)[-1]:.1f} m; start earlier")
    rng = np.random.default_rng([parameters.seed, parameters.drive])
    truth = drive(rng, tour[::-1] if parameters.backwards else tour, parameters.step)
    laser_pose = np.array([parameters.laser_offset, 0.0, 0.0])
    angles = half_circle(parameters.beams)
    steps = between(truth[:-1], truth[1:])
    moved = np.hypot(steps[:, 0], steps[:, 1])
    odometry = _odometry(rng, truth[0], steps, moved, parameters)
    times = np.concatenate([[0.0], np.cumsum(moved / SPEED + np.abs(steps[:, 2]) / TURN_RATE)])
    walls = np.concatenate([building.walls, _doors(rng, building, parameters.doors)])
    people = walks(rng, building.tour, parameters.people, times, truth)
    scans = []
    for i, pose in enumerate(compose(truth, laser_pose)):
        ranges = cast(pose, angles, np.concatenate([walls, people[i]]))
        ranges += rng.normal(0.0, parameters.range_noise, len(angles))
        lost = (ranges >= parameters.range_limit) | (rng.random(len(angles)) < parameters.dropout)
        ranges = np.where(lost, np.inf, np.maximum(ranges, 0.02))
        scans.append(Scan(ranges, angles, odometry[i], float(times[i]), i + 1))
        if progress:
            progress(i + 1, len(truth))
    return Log(f"simulated-{parameters.seed}", tuple(scans), laser_pose, truth)


def _doors(rng: Generator, building: Building, changed: int) -> Floats:
    """(D, 4) the leaves of all doors, some of them as they stand on other days."""
    state = np.zeros(len(building.doors), dtype=int)
    state[rng.permutation(len(state))[:changed]] = 1
    return building.doors[np.arange(len(state)), state]


def _odometry(rng: Generator, start: Floats, steps: Floats, moved: Floats, parameters: Simulation) -> Floats:
    """Wheel odometry (S, 3) of true steps (S - 1, 3) of lengths ``moved``."""
    move = steps[:, :2] * (1 + parameters.scale_error)
    move += rng.normal(0.0, 1.0, move.shape) * parameters.move_noise * np.sqrt(moved)[:, None]
    turn = steps[:, 2] * (1 + parameters.scale_error) + parameters.turn_error * moved
    turn += rng.normal(0.0, parameters.turn_noise, len(turn)) * np.sqrt(moved)
    return chain(start, np.column_stack([move, turn]))


def write_carmen(log: Log, path: str | Path) -> None:
    """Write a log as CARMEN messages, gzipped if the name ends in ``.gz``; the file appears whole or not.

    The form is that of corrected logs: both poses of a scan are the laser's true pose, and lines of raw
    odometry come before it; without ground truth they are the laser's and the robot's odometry. The laser must
    lie on the robot's x axis and sweep 180 degrees, as the form has no place for more. Raises LogError if the
    file cannot be written.
    """
    path = Path(path)
    data = "".join(f"{line}\n" for line in _carmen_lines(log)).encode("ascii")
    if path.name.endswith(".gz"):
        data = gzip.compress(data, mtime=0)
    try:
        with written_whole(path) as temporary:
            temporary.write_bytes(data)
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
