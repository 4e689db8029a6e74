"""How a robot drives along a tour, and how people walk about in its way."""

import numpy as np
from numpy.random import Generator

from m2t_text.logs.simulation.building import box
from m2t_text.util.geometry import travel, wrap
from m2t_text.util.types import Floats

AHEAD = 0.4  # m; the robot steers towards the point of the tour that lies so far ahead
WANDER = 0.2  # m; standard deviation of the drive from the tour, so that no visit repeats another exactly,
TAPER = 4.0  # m; less so within this distance of the tour's corners, as some lie before doors
TURN_PER_SCAN = np.radians([10.0, 15.0])  # most that the robot turns between two scans, by the drive
SHARP = np.radians(30.0)  # from here on the robot turns on the spot
STRETCH = 8.0  # m; people walk up and down straight parts of the tour of at least this length,
ASIDE = 0.75  # m beside it,
POLITE = 0.7  # m; no nearer to the robot,
WALK = (0.9, 1.4)  # m/s, each at a pace between these
PERSON = (0.45, 0.25)  # m; shoulders and chest


def part_of_tour(tour: Floats, start: float, length: float) -> Floats:
    """Corners (K, 2) of the part of a tour that begins after ``start`` metres and is ``length`` m long."""
    place = travel(tour)
    begin, end = np.clip([start, start + length], 0.0, place[-1])
    inner = tour[(place > begin) & (place < end)]
    ends = np.column_stack([np.interp([begin, end], place, column) for column in tour.T])
    return np.vstack([ends[:1], inner, ends[1:]])


def drive(rng: Generator, tour: Floats, step: float) -> Floats:
    """Poses (S, 3) of a robot that follows a tour (K, 2), at most ``step`` m apart, to its end.

    It turns on the spot where it turns sharply.
    """
    place = travel(tour)
    most = rng.uniform(*TURN_PER_SCAN)
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
    while aim < place[-1]:
        x, y, theta = poses[-1]
        while aim < place[-1] and np.hypot(*(target(aim) - [x, y])) < AHEAD:
            aim += 0.05
        wanted = wrap(np.arctan2(*(target(aim) - [x, y])[::-1]) - theta)
        turn = np.clip(wanted, -most, most)
        forward = step if abs(wanted) < SHARP else 0.0
        half = theta + turn / 2
        poses.append(np.array([x + forward * np.cos(half), y + forward * np.sin(half), wrap(theta + turn)]))
    return np.array(poses)


def walks(rng: Generator, tour: Floats, people: int, times: Floats, robot: Floats) -> Floats:
    """(T, 4 * people, 4) the outlines of people who walk up and down parts of a tour at these times (T,).

    They step aside where the ``robot`` (T, 3) comes.
    """
    legs = np.diff(tour, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    long = np.flatnonzero(lengths >= STRETCH)
    walls = np.empty((len(times), 0, 4))
    for _ in range(people if len(long) else 0):
        leg = rng.choice(long)
        along = legs[leg] / lengths[leg]
        gone = rng.uniform(0.0, 2 * lengths[leg]) + rng.uniform(*WALK) * times
        place = np.abs((gone + lengths[leg]) % (2 * lengths[leg]) - lengths[leg])[:, None]  # there and back
        centres = tour[leg] + place * along + rng.choice([-ASIDE, ASIDE]) * np.array([-along[1], along[0]])
        away = centres - robot[:, :2]
        near = np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-6)
        centres = robot[:, :2] + away * np.maximum(1.0, POLITE / near)[:, None]
        body = np.array(box(0.0, 0.0, *PERSON, turn=np.arctan2(along[0], -along[1])))
        walls = np.concatenate([walls, np.tile(centres, 2)[:, None] + body], axis=1)
    return walls
