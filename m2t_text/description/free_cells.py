"""From what beams passed to the free squares of a text."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m2t_text.description.free_squares import CELL_RANGE, MAX_SIDE, MIN_SIDE, CellGrid, FreeSquares
from m2t_text.util.compiling import inlined, inner, kernel
from m2t_text.util.geometry import between, compose
from m2t_text.util.types import Floats

Cells = NDArray[np.int64]
Mask = NDArray[np.bool_]
Squares = tuple[Cells, Cells, Cells]  # x and y of the lower corner, and the side

CLEARANCE = 0.2  # m about what is occupied, in which nothing is free, whatever a beam passed
RIM = 0.4  # m about what is occupied, in which no beam need have passed the cells beside a free one
EDGE = 1e-6  # cells; nearer to the edge of a grid nothing is looked up, as rounding might lead beyond it
MIN_NEW_CELLS = 8  # cells that no other square covers, for which a square is written
TAKEN = -1  # instead of what a square adds
EASING = 0.9  # from one round of choosing squares to the next: what they must add


@dataclass(frozen=True)
class FreeSpace:
    """Cells that beams passed, also those where other beams met something.

    Attributes:
        cells: (W, H) along the x and the y axis of the grid.
        pose: (3,) of the grid's lower corner in the frame of the local map, metres and radians.
        cell: metres, side of a cell.
    """

    cells: Mask
    pose: Floats
    cell: float

    def seen_from(self, viewer: Floats) -> "FreeSpace":
        """The same in the frame of a viewer, whose pose (3,) is given in the frame of now."""
        return replace(self, pose=between(viewer, self.pose))


def free_squares(free: FreeSpace, occupied: Cells, cell: float) -> FreeSquares:
    """Squares that cover what is free, in the frame in which ``free`` lies.

    A beam that passes along a wall that it never hits comes into the cells of the wall itself. So a cell is not
    free beside one that no beam passed, unless what it borders on was hit.

    Args:
        free: what beams passed.
        occupied: (N, 2) cells of that frame.
        cell: metres, side of a cell of the squares; the grid of ``free`` may have another, and be turned.
    """
    grid = _resampled(free, cell)
    walls = np.asarray(occupied - [grid.x, grid.y], dtype=np.int64)
    grid = grid._replace(cells=_clear_of(grid.cells, walls, CLEARANCE / cell, RIM / cell))
    return covering(grid)


def moved_squares(squares: FreeSquares, pose: ArrayLike, occupied: Cells, cell: float) -> FreeSquares:
    """What is free in a frame in which the squares' own frame has the ``pose`` (3,), metres and radians.

    Free are the cells whose middles were, but for the ``occupied`` (N, 2): other squares, which cover nearly
    the same.
    """
    grid = squares.grid
    corner = np.array([grid.x * cell, grid.y * cell, 0.0])
    moved = _resampled(FreeSpace(grid.cells, compose(pose, corner), cell), cell)
    x, y = (occupied - [moved.x, moved.y]).T
    inside = (x >= 0) & (y >= 0) & (x < moved.cells.shape[0]) & (y < moved.cells.shape[1])
    moved.cells[x[inside], y[inside]] = False
    return covering(moved)


def covering(free: CellGrid) -> FreeSquares:
    """Few squares that cover most of the cells: in turn one that adds nearly as much as any, and enough.

    What no square of the least side covers is left out.
    """
    left, low = max(0, CELL_RANGE[0] - free.x), max(0, CELL_RANGE[0] - free.y)
    reached = free.cells[left : max(left, CELL_RANGE.stop - free.x), low : max(low, CELL_RANGE.stop - free.y)]
    x, y, side = _squares(np.ascontiguousarray(reached))
    return FreeSquares.of(x + free.x + left, y + free.y + low, side)


def _resampled(free: FreeSpace, cell: float) -> CellGrid:
    """The cells of an upright grid whose middles are free; those at its border are not."""
    pose, scale = np.asarray(free.pose, dtype=float), free.cell / cell
    left, low, right, high = bounding_box(free.cells)
    begin_x, begin_y, angle = pose.tolist()
    c, s = math.cos(angle) * scale, math.sin(angle) * scale
    corners = [(i, j) for i in (left, right) for j in (low, high)]
    across = [c * i - s * j + begin_x / cell for i, j in corners]
    up = [s * i + c * j + begin_y / cell for i, j in corners]
    x, y = math.floor(min(across)) - 1, math.floor(min(up)) - 1
    found = np.zeros((math.ceil(max(across)) + 1 - x, math.ceil(max(up)) + 1 - y), dtype=np.bool_)
    _look_up(free.cells, pose, free.cell, cell, x, y, found)
    return CellGrid(x, y, found)


@kernel
def _look_up(cells: Mask, pose: Floats, own: float, cell: float, x: int, y: int, found: Mask) -> None:
    """Fills in the cells of an upright grid that begins at (x, y) from those of what is free."""
    height = found.shape[1]
    lowest: Any = np.int64(0)
    c, s = np.cos(pose[2]) * cell / own, np.sin(pose[2]) * cell / own
    for k in range(found.shape[0]):
        dx, dy = x + k + 0.5 - pose[0] / cell, y + 0.5 - pose[1] / cell
        i, j = c * dx + s * dy, c * dy - s * dx  # of the first middle of the row, in the cells looked up
        first, last = _within(i, s, cells.shape[0], lowest, height)
        first, last = _within(j, c, cells.shape[1], first, last)
        row = found[k]
        for m in range(first, last):
            row[m] = cells[math.floor(i + m * s), math.floor(j + m * c)]


def bounding_box(cells: Mask) -> tuple[int, int, int, int]:
    """Least x and y of the marked cells, and those just beyond the greatest; all 0 where there are none."""
    columns, rows = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
    if not len(columns):
        return 0, 0, 0, 0
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


@inner
def _within(begin: float, step: float, length: int, first: int, last: int) -> tuple[int, int]:
    """Of the steps from ``first`` to ``last``, those with which ``begin + j * step`` lies within 0...length."""
    least, most = (EDGE - begin, length - EDGE - begin) if step >= 0 else (begin - length + EDGE, begin - EDGE)
    if abs(step) * last < EDGE:
        return (first, last) if least <= 0 <= most else (first, first)
    return max(first, math.ceil(least / abs(step))), min(last, math.floor(most / abs(step)) + 1)


def _clear_of(passed: Mask, occupied: Cells, clearance: float, rim: float) -> Mask:
    """The cells that were passed, as were all beside them, but for those near the occupied ones (N, 2).

    Distances are in cells, between middles: nothing is free within ``clearance``, and nothing within ``rim``
    need have been passed.
    """
    free, told, clear = passed.copy(), passed.copy(), np.zeros(passed.shape, dtype=np.bool_)
    _mark(free, occupied, clearance, False)
    _mark(told, occupied, rim, True)
    _clear(free, told, np.empty(passed.shape[1], dtype=np.bool_), clear)
    return clear


@kernel
def _clear(free: Mask, told: Mask, told_beside: Mask, clear: Mask) -> None:
    """Marks the free cells that are told of, as are all beside them; ``told_beside`` is room for a row."""
    for i in range(1, free.shape[0] - 1):
        before, here, after, row = told[i - 1], told[i], told[i + 1], free[i]
        for j in range(len(told_beside)):
            told_beside[j] = before[j] & here[j] & after[j]
        for j in range(1, len(told_beside) - 1):
            clear[i, j] = row[j] & told_beside[j - 1] & told_beside[j] & told_beside[j + 1]


@kernel
def _mark(cells: Mask, middles: Cells, radius: float, mark: bool) -> None:
    """Marks all cells whose middles lie within a radius of some cells' (N, 2)."""
    reach = math.floor(radius)
    for a in range(-reach, reach + 1):
        half = math.floor(math.sqrt(radius * radius - a * a))
        for k in range(len(middles)):
            i = middles[k, 0] + a
            if 0 <= i < cells.shape[0]:
                for j in range(max(0, middles[k, 1] - half), min(cells.shape[1], middles[k, 1] + half + 1)):
                    cells[i, j] = mark


def _squares(cells: Mask) -> Squares:
    """The squares of `covering`.

    Each is a greatest one, which no other square of marked cells holds. Those still wanted are gone through in
    rounds, each of which takes what adds at least so many cells: a little less in each round.
    """
    sides = np.zeros((cells.shape[0] + 1, cells.shape[1] + 1), dtype=np.int64)
    squares = np.empty((cells.size, 4), dtype=np.int64)
    squares = squares[: _grow(cells, sides, squares)]
    taken = squares[: _take(cells.copy(), squares)]
    return taken[:, 0], taken[:, 1], taken[:, 2]


@kernel
def _grow(cells: Mask, sides: Cells, squares: Cells) -> int:
    """Writes the greatest squares, by (x, y), and returns their number.

    Args:
        sides: room for the side of the greatest square with each lower corner: 0, one cell wider and higher.
        squares: (N, 4) room for x and y of the lower corner, the side, and how many cells each adds at most.
    """
    for i in range(cells.shape[0] - 1, -1, -1):
        for j in range(cells.shape[1] - 1, -1, -1):
            if cells[i, j]:
                least = min(sides[i + 1, j], sides[i, j + 1])
                least = min(least, sides[i + 1, j + 1])
                sides[i, j] = min(least + 1, MAX_SIDE)
    n = 0
    for i in range(cells.shape[0]):
        for j in range(cells.shape[1]):
            side = sides[i, j]
            if side >= MIN_SIDE and not _held(sides, i, j):
                squares[n, 0], squares[n, 1], squares[n, 2], squares[n, 3] = i, j, side, side * side
                n += 1
    return n


@inlined
def _held(sides: Cells, i: int, j: int) -> bool:
    """Whether a larger square holds the greatest one with this lower corner."""
    return (
        (i > 0 and sides[i - 1, j] > sides[i, j])
        or (j > 0 and sides[i, j - 1] > sides[i, j])
        or (i > 0 and j > 0 and sides[i - 1, j - 1] > sides[i, j])
    )


@kernel
def _take(left: Mask, squares: Cells) -> int:
    """Moves the squares that are taken to the front of ``squares`` (N, 4), by (x, y), and returns their number.

    Those of `_grow` are given; the cells of ``left`` are unmarked that a square covers that is taken.
    """
    most = 0
    for k in range(len(squares)):
        most = max(most, squares[k, 3])
    wanted = float(most)
    while wanted >= MIN_NEW_CELLS:
        wanted *= EASING
        least = max(math.ceil(wanted), MIN_NEW_CELLS)
        for k in range(len(squares)):
            if squares[k, 3] >= least:
                x, y, side = squares[k, 0], squares[k, 1], squares[k, 2]
                squares[k, 3] = _marked(left, x, y, side)
                if squares[k, 3] >= least:
                    squares[k, 3] = TAKEN
                    for i in range(x, x + side):
                        for j in range(y, y + side):
                            left[i, j] = False
    n = 0
    for k in range(len(squares)):
        if squares[k, 3] == TAKEN:
            squares[n, 0], squares[n, 1], squares[n, 2] = squares[k, 0], squares[k, 1], squares[k, 2]
            n += 1
    return n


@inlined
def _marked(cells: Mask, x: int, y: int, side: int) -> int:
    """How many cells of a square are marked."""
    count = 0
    for i in range(x, x + side):
        row = cells[i, y : y + side]
        for j in range(side):
            count += row[j]
    return count
