"""Rays through an occupancy grid, cell by cell.

The traversal is that of Amanatides and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", 1987.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from m2t_text.saved_maps.grid import OCCUPIED, UNKNOWN, States
from m2t_text.util.compiling import allocating_kernel, inner
from m2t_text.util.types import Floats


class Axis(NamedTuple):
    """Where a ray is along one axis: its cell, the step to the next, the way to its border, and between two."""

    cell: int
    step: int
    border: float
    between: float


@inner
def _begin(place: float, direction: float) -> Axis:
    cell = int(math.floor(place))
    if direction > 0:
        return Axis(cell, 1, (cell + 1 - place) / direction, 1 / direction)
    if direction < 0:
        return Axis(cell, -1, (cell - place) / direction, -1 / direction)
    return Axis(cell, 0, math.inf, math.inf)


@inner
def _next(x: Axis, y: Axis) -> tuple[Axis, Axis]:
    """The same in the next cell of the ray."""
    if x.border <= y.border:
        return Axis(x.cell + x.step, x.step, x.border + x.between, x.between), y
    return x, Axis(y.cell + y.step, y.step, y.border + y.between, y.between)


@inner
def cast(states: States, x: float, y: float, angle: float, reach: float, veil: float) -> float:
    """How far a ray goes until the middle of its way through an occupied cell; ``inf`` if it meets none.

    All lengths are in units of cells.

    Args:
        states: (rows, columns) of a `Grid`.
        x, y: column and row where the ray begins.
        angle: radians in the grid's frame.
        reach: length of the ray.
        veil: how much unknown space it passes; nothing is said of what lies behind more of it.
    """
    rows, columns = states.shape
    across, down = _begin(x, math.cos(angle)), _begin(y, math.sin(angle))
    gone, dark = 0.0, 0.0
    while gone <= reach and dark <= veil and 0 <= across.cell < columns and 0 <= down.cell < rows:
        leave = min(across.border, down.border)
        state = states[down.cell, across.cell]
        if state == OCCUPIED:
            middle = (gone + leave) / 2
            return middle if middle <= reach else math.inf
        if state == UNKNOWN:
            dark += leave - gone
        gone = leave
        across, down = _next(across, down)
    return math.inf


class Beams(NamedTuple):
    """The beams of a scan: ``angles`` (A,) in the grid's frame, and ``reach`` and ``veil`` as in `cast`."""

    angles: Floats
    reach: float
    veil: float


@allocating_kernel
def seen(
    states: States, allowed: NDArray[np.bool_], pose: Floats, beams: Beams, steps: int, step: float
) -> tuple[Floats, int]:
    """Column and row (N, 2) of all that is met on a run straight ahead, and the number of its scans.

    Args:
        states: (rows, columns) of a `Grid`.
        allowed: (rows, columns) where the robot can be; the run ends before it leaves that.
        pose: (3,) column, row and heading at the run's begin.
        beams: of each scan.
        steps: how many scans there are after the first one, at most.
        step: between two of them, in units of cells.
    """
    rows, columns = states.shape
    found = np.empty(((steps + 1) * len(beams.angles), 2))
    n = 0
    for k in range(steps + 1):
        x, y = pose[0] + k * step * math.cos(pose[2]), pose[1] + k * step * math.sin(pose[2])
        i, j = int(math.floor(x)), int(math.floor(y))
        if not (0 <= i < columns and 0 <= j < rows and allowed[j, i]):
            return found[:n], k
        for angle in beams.angles:
            distance = cast(states, x, y, angle, beams.reach, beams.veil)
            if distance < math.inf:
                found[n, 0], found[n, 1] = x + distance * math.cos(angle), y + distance * math.sin(angle)
                n += 1
    return found[:n], steps + 1


@allocating_kernel
def passed_free(states: States, places: Floats, beams: Beams) -> tuple[NDArray[np.bool_], int, int]:
    """The free cells that the beams of scans pass before they meet something.

    Args:
        states: (rows, columns) of a `Grid`.
        places: (S, 2) column and row of each scan, S >= 1.
        beams: of each scan.

    Returns:
        The cells, along columns and then along rows, and the column and the row of the first.
    """
    rows, columns = states.shape
    left = max(0, int(places[:, 0].min() - beams.reach))
    low = max(0, int(places[:, 1].min() - beams.reach))
    width = min(columns, int(places[:, 0].max() + beams.reach) + 1) - left
    height = min(rows, int(places[:, 1].max() + beams.reach) + 1) - low
    passed = np.zeros((width, height), dtype=np.bool_)
    for k in range(len(places)):
        for angle in beams.angles:
            across, down = _begin(places[k, 0], math.cos(angle)), _begin(places[k, 1], math.sin(angle))
            gone, dark = 0.0, 0.0
            while gone <= beams.reach and dark <= beams.veil:
                i, j = across.cell - left, down.cell - low
                if not (0 <= i < width and 0 <= j < height) or states[down.cell, across.cell] == OCCUPIED:
                    break
                leave = min(across.border, down.border)
                if states[down.cell, across.cell] == UNKNOWN:
                    dark += leave - gone
                else:
                    passed[i, j] = True
                gone = leave
                across, down = _next(across, down)
    return passed, left, low


@allocating_kernel
def nearest_open(allowed: NDArray[np.bool_], side: int) -> Floats:
    """(N, 2) columns and rows: of each square of ``side`` x ``side`` cells its place, if any cell is allowed.

    That is the middle of the allowed cell nearest to the square's middle, the first of equals.
    """
    rows, columns = allowed.shape
    across, down = (columns + side - 1) // side, (rows + side - 1) // side
    places = np.empty((across * down, 2))
    n = 0
    for square in range(across * down):
        left, low = (square % across) * side, (square // across) * side
        least = math.inf
        for j in range(low, min(low + side, rows)):
            for i in range(left, min(left + side, columns)):
                away = (2 * (i - left) + 1 - side) ** 2 + (2 * (j - low) + 1 - side) ** 2
                if allowed[j, i] and away < least:
                    least = away
                    places[n, 0], places[n, 1] = i + 0.5, j + 0.5
        n += least < math.inf
    return places[:n]


@inner
def add_along(
    sums: NDArray[np.float32], stamps: NDArray[np.int32], stamp: int, begin: Floats, end: Floats, value: float
) -> None:
    """Adds a value to each cell that a segment from ``begin`` (2,) to ``end`` (2,) passes, but to its last one.

    Cells that bear the stamp already are left out, the others get it. All in units of cells; ``sums`` and
    ``stamps`` are (rows, columns), and what lies outside is left out.
    """
    rows, columns = sums.shape
    across = _begin(begin[0], end[0] - begin[0])
    down = _begin(begin[1], end[1] - begin[1])
    column, row = int(math.floor(end[0])), int(math.floor(end[1]))
    while min(across.border, down.border) <= 1.0 and not (across.cell == column and down.cell == row):
        inside = 0 <= across.cell < columns and 0 <= down.cell < rows
        if inside and stamps[down.cell, across.cell] != stamp:
            stamps[down.cell, across.cell] = stamp
            sums[down.cell, across.cell] += value
        across, down = _next(across, down)
