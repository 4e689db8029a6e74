"""A building to simulate: two long corridors joined by three short ones, rooms along both, and a tour of it.

All lengths in metres. x runs along the corridors; the corridors lie at y = 5..7 and y = 15..17.
"""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from m2t_text.util.types import Floats

Segment = tuple[float, float, float, float]
Segments = list[Segment]

SHORTEST = 24.0  # building that has room for all of it
SOUTH, NORTH = 6.0, 16.0  # centre lines of the long corridors
HALF = 1.0  # half the width of a corridor
OUTER, INNER = 5.0, 4.0  # depth of the rooms outside and between the long corridors
WALL = 0.08  # half the thickness of a wall
DOOR = 1.0  # width of a door
LANE = 0.65  # kept free of furniture to both sides of a door's centre
OFFICE = 3.4  # width of the rooms that repeat


@dataclass(frozen=True)
class Building:
    """Segments are ``x1 y1 x2 y2``.

    Attributes:
        walls: (W, 4) all that never changes, furniture too.
        doors: (D, 2, 4) doors, each as it stands on most days and as it stands on others: open or closed.
        tour: (K, 2) corners of a tour that hits none of these.
    """

    walls: Floats
    doors: Floats
    tour: Floats


@dataclass(frozen=True)
class Door:
    """A door whose centre lies at ``u``: is it open on most days, and its leaf on those and on others."""

    u: float
    is_open: bool
    usual: Segment
    other: Segment


@dataclass(frozen=True)
class Room:
    """A room in its own frame: u along the corridor, v into the room, (0, 0) a corner at the corridor."""

    width: float
    walls: Segments
    door: Door | None


def build(rng: Generator, length: float) -> Building:
    """A building of the given outer length, at least SHORTEST."""
    middle = round(length / 2 + rng.uniform(-2.0, 2.0), 2)
    office = _room(rng, OFFICE, INNER, is_open=True)
    west, east = (2 * HALF, middle - HALF), (middle + HALF, length - 2 * HALF)
    walls: Segments = []
    doors: dict[str, list[Door]] = {}
    for name, span, front, side, depth in (
        ("south", (0.0, length), SOUTH - HALF, -1.0, OUTER),
        ("north", (0.0, length), NORTH + HALF, 1.0, OUTER),
        ("south west", west, SOUTH + HALF, 1.0, INNER),
        ("south east", east, SOUTH + HALF, 1.0, INNER),
        ("north west", west, NORTH - HALF, -1.0, INNER),
        ("north east", east, NORTH - HALF, -1.0, INNER),
    ):
        row, doors[name] = _row(rng, span, front, side, depth, office)
        walls += row
    for x in (0.0, *west, *east, length):
        ends = (SOUTH - HALF, NORTH + HALF) if x in (0.0, length) else (SOUTH + HALF, NORTH - HALF)
        walls.append((x, ends[0], x, ends[1]))
        if rng.random() < 0.7:  # a cupboard, radiator or column in the short corridor
            inside = 1.0 if x in (0.0, west[1], east[1]) else -1.0
            y, deep, long = rng.uniform(8.5, 12.5), rng.uniform(0.15, 0.4), rng.uniform(0.3, 1.5)
            walls += box(x + inside * deep / 2, y, deep, long)
    tour = _tour(doors, middle, length)
    every = [door for row in doors.values() for door in row]
    passed = [door for door in every if np.abs(tour[:, 0] - door.u).min() < DOOR]
    walls += [door.usual for door in passed]
    free = [(door.usual, door.other) for door in every if door not in passed]
    return Building(np.array(walls), np.array(free).reshape(-1, 2, 4), tour)


def _row(
    rng: Generator, span: tuple[float, float], front: float, side: float, depth: float, office: Room
) -> tuple[Segments, list[Door]]:
    """Rooms along one side of a corridor: their walls and their doors."""
    walls: Segments = []
    doors: list[Door] = []
    x, end = span
    while end - x > 0.5:
        left = end - x
        if left > 2 * OFFICE and rng.random() < 0.4 and depth == INNER:
            room = office
        elif left > 6.0 and rng.random() < 0.2:
            room = _alcove(rng)
        else:
            width = left if left < 6.5 else rng.uniform(2.8, min(6.5, left - 3.0))
            room = _room(rng, width, depth, is_open=rng.random() < 0.75)

        def placed(segment: Segment, x: float = x) -> Segment:
            a, b, c, d = segment
            return (x + a, front + side * b, x + c, front + side * d)

        walls += map(placed, room.walls)
        if room.door is not None:
            door = room.door
            doors.append(Door(x + door.u, door.is_open, placed(door.usual), placed(door.other)))
        x += room.width
    return walls, doors


def _room(rng: Generator, width: float, depth: float, is_open: bool) -> Room:
    low, high = WALL, width - WALL
    door = rng.uniform(0.9, width - 0.9) if width > 2.0 else width / 2
    a, b = door - DOOR / 2, door + DOOR / 2
    walls = [
        *[(low, 2 * WALL, low, depth - WALL), (high, 2 * WALL, high, depth - WALL)],
        (low, depth - WALL, high, depth - WALL),
        *[
            (0.0, 0.0, a, 0.0),
            (b, 0.0, width, 0.0),
            (low, 2 * WALL, a, 2 * WALL),
            (b, 2 * WALL, high, 2 * WALL),
        ],
        *[(a, 0.0, a, 2 * WALL), (b, 0.0, b, 2 * WALL)],
    ]
    opened, closed = (a, 2 * WALL, a, 2 * WALL + 0.9), (a, 1.5 * WALL, b, 1.5 * WALL)
    if is_open:
        hinge, out = (a, -1.0) if rng.random() < 0.5 else (b, 1.0)
        swing = rng.uniform(0.0, 0.25)
        opened = (hinge, 2 * WALL, hinge + 0.9 * out * np.sin(swing), 2 * WALL + 0.9 * np.cos(swing))
    walls += _furniture(rng, width, depth, door)
    if rng.random() < 0.35 and a > 1.6:  # a locker, bin or column stands in front of the room
        deep, long = rng.uniform(0.15, 0.4), rng.uniform(0.3, 1.2)
        walls += box(rng.uniform(long / 2, a - long / 2), -deep / 2, long, deep)
    usual, other = (opened, closed) if is_open else (closed, opened)
    return Room(width, walls, Door(door, is_open, usual, other))


def _furniture(rng: Generator, width: float, depth: float, door: float) -> Segments:
    """Desks and cupboards along the walls, a table in the wider rooms; the way in from the door stays free."""
    walls: Segments = []
    for wall, free, sign in ((WALL, door - LANE, 1.0), (width - WALL, width - door - LANE, -1.0)):
        v = 0.3 + rng.uniform(0.0, 1.0)
        while v < depth - 1.2:
            long, deep = rng.uniform(0.5, 1.7), rng.uniform(0.3, 0.8)
            if deep < free and v + long < depth - 0.6:
                walls += box(wall + sign * deep / 2, v + long / 2, deep, long)
            v += long + rng.uniform(0.2, 1.5)
    u = rng.uniform(0.9, 1.5)
    while u < width - 1.5:
        long = min(rng.uniform(0.6, 1.8), width - 0.9 - u)
        deep = rng.uniform(0.3, 0.5)
        walls += box(u + long / 2, depth - WALL - deep / 2, long, deep)
        u += long + rng.uniform(0.3, 2.0)
    for free, middle in ((door - LANE, door - LANE - 0.8), (width - door - LANE, door + LANE + 0.8)):
        if free > 2.4:
            walls += box(
                middle,
                rng.uniform(1.8, depth - 1.8),
                rng.uniform(0.6, 1.0),
                rng.uniform(0.6, 1.2),
                rng.uniform(0, 1.5),
            )
    return walls


def _alcove(rng: Generator) -> Room:
    width, depth = rng.uniform(1.2, 2.4), rng.uniform(0.5, 1.6)
    return Room(width, [(0.0, 0.0, 0.0, depth), (0.0, depth, width, depth), (width, depth, width, 0.0)], None)


def box(u: float, v: float, width: float, depth: float, turn: float = 0.0) -> Segments:
    """The four sides of a rectangle about (u, v)."""
    c, s = float(np.cos(turn)), float(np.sin(turn))
    corners = [
        (u + c * a - s * b, v + s * a + c * b)
        for a, b in (
            (-width / 2, -depth / 2),
            (width / 2, -depth / 2),
            (width / 2, depth / 2),
            (-width / 2, depth / 2),
        )
    ]
    return [(*corners[k - 1], *corners[k]) for k in range(4)]


def _tour(doors: dict[str, list[Door]], middle: float, length: float) -> Floats:
    """Round the building once, back through the middle, then round the other way; into rooms on the way."""

    def visit(row: str, nearest: float, y: float, depth: float) -> list[tuple[float, float]]:
        centres = [door.u for door in doors[row] if door.is_open]
        if not centres:
            return []
        x = min(centres, key=lambda u: abs(u - nearest))
        return [(x, y), (x, y + depth), (x, y)]

    deep, shallow = HALF + 2.8, HALF + 1.8
    first = visit("south", length * 0.3, SOUTH, -deep)
    second = visit("north", length * 0.65, NORTH, deep)
    loop = [
        *[(2.5, SOUTH), *first, *visit("south east", length * 0.75, SOUTH, shallow)],
        *[(length - HALF, SOUTH), (length - HALF, NORTH), *second, (middle, NORTH), (middle, SOUTH)],
        *[*first, (HALF, SOUTH), (HALF, NORTH), *visit("north west", length * 0.2, NORTH, -shallow)],
        *[*second, (length - HALF, NORTH), (length - HALF, SOUTH), (HALF, SOUTH)],
    ]
    return np.array(loop)
