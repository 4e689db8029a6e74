"""What is made of a query once, so that `tiles` can say which maps it may agree with."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from m2t_text.index.kernels.views import Views
from m2t_text.index.kernels.wide import LANES, WORDS
from m2t_text.util.compiling import inner, kernel

U = np.uint64
TILE = 6  # cells, and offsets in a group
SIDE, MIDDLE = 32, 16  # tiles of the grid about the viewpoint
GROUPS = 4  # of offsets in x, and in y
BEFORE = 2  # tiles from where a keypoint of the query lies to where the first group begins to take it
VIEWS = LANES // (GROUPS * GROUPS)
PADDED = SIDE + GROUPS + 1  # tiles that any group moves into the grid, and one on each side
DIGITS = 4  # binary, of the number of the query's keypoints in a tile; those beyond count as matched
MOST = (1 << DIGITS) - 1
LOW = 3  # the last two of these digits
TRIED = 64  # tiles of the query whose keypoints are likely to be missed: those are counted first
QUADS = LANES // 4  # of four lanes of a view whose groups of offsets lie in a square
OUTSIDE = SIDE * SIDE  # stands for squares of tiles that do not lie in the grid


class TileTables(NamedTuple):
    """A query on tiles; its views lie in the lanes of G groups.

    Attributes:
        size: number of the query's keypoints.
        missed: (G, SIDE²) uint64, a bit for each lane: whether a map's keypoints in a tile lie near none of the
            query's.
        counts: (G, LANES · DIGITS, WORDS) uint64 keypoints of the query that lie near one of the map's if the
            bit of a tile is set: one bit of each number after the other, the highest first.
        beyond: (G, LANES) int64 those for which no bit is kept.
        low: (G, LANES) int64 those, and all that the last two bits count.
        places: (G, QUADS, TRIED) uint16 where a quad moves tiles that are tried first: the first tile of a
            square, of which a map has to cover some.
        weights: (G, VIEWS, TRIED) uint8 keypoints in those tiles; 1 where there are none.
    """

    size: int
    missed: NDArray[np.uint64]
    counts: NDArray[np.uint64]
    beyond: NDArray[np.int64]
    low: NDArray[np.int64]
    places: NDArray[np.uint16]
    weights: NDArray[np.uint8]

    @classmethod
    def of(cls, seen: Views) -> "TileTables":
        """Of a query with keypoints."""
        groups = -(-len(seen.wx) // VIEWS)
        missed = np.full((groups, SIDE * SIDE), ~U(0))
        counts = np.zeros((groups, LANES * DIGITS, WORDS), dtype=np.uint64)
        beyond, low = np.zeros((2, groups, LANES), dtype=np.int64)
        places = np.full((groups, QUADS, TRIED), OUTSIDE, dtype=np.uint16)
        weights = np.ones((groups, VIEWS, TRIED), dtype=np.uint8)
        room, best = np.zeros((2, PADDED, PADDED), dtype=np.int64), np.zeros((2, TRIED), dtype=np.int64)
        _fill(seen.wx, seen.wy, room, best, missed, counts, beyond, low, places, weights)
        return cls(len(seen.wa), missed, counts, beyond, low, places, weights)


@kernel
def _fill(
    wx: NDArray[np.int64],
    wy: NDArray[np.int64],
    room: NDArray[np.int64],
    best: NDArray[np.int64],
    missed: NDArray[np.uint64],
    counts: NDArray[np.uint64],
    beyond: NDArray[np.int64],
    low: NDArray[np.int64],
    places: NDArray[np.uint16],
    weights: NDArray[np.uint8],
) -> None:
    """Fills in the tables of views (V, Q), which are those of a query without keypoints at first.

    Args:
        room: (2, PADDED, PADDED) of the tiles from which every group takes some into the grid: whether one of
            the query's keypoints comes near a cell, and how many lie there, as many as the digits count. The
            first and the last row and column are of what lies outside.
        best: (2, TRIED) room for the tiles that are tried first, and what they are worth.
    """
    near, keypoints = room[0], room[1]
    for v in range(len(wx)):
        _draw(wx[v], wy[v], near, keypoints)
        group, first = v // VIEWS, v % VIEWS * GROUPS * GROUPS
        for lane in range(first, first + GROUPS * GROUPS):
            beyond[group, lane], low[group, lane] = wx.shape[1], wx.shape[1]
        for n in range(TRIED):
            best[1, n] = 0
        for i in range(1, PADDED - 1):
            for j in range(1, PADDED - 1):
                if near[i, j]:
                    _take(i, j, keypoints[i, j], group, first, missed, counts, beyond, low)
                    _keep(i, j, keypoints[i, j], best)
        _try(best, keypoints, weights[group, v % VIEWS], places[group], v % VIEWS * QUADS // VIEWS)


@inner
def _draw(
    wx: NDArray[np.int64], wy: NDArray[np.int64], near: NDArray[np.int64], keypoints: NDArray[np.int64]
) -> None:
    """Enters the keypoints of a view."""
    for i in range(PADDED):
        for j in range(PADDED):
            near[i, j], keypoints[i, j] = 0, 0
    for k in range(len(wx)):
        x, y = wx[k], wy[k]
        i, j = _place(x // TILE), _place(y // TILE)
        keypoints[i, j] = min(keypoints[i, j] + 1, MOST)
        for a in range(_place(-((5 - x) // TILE)), _place((x + 7) // TILE) + 1):
            for b in range(_place(-((5 - y) // TILE)), _place((y + 7) // TILE) + 1):
                near[a, b] = 1


@inner
def _keep(i: int, j: int, keypoints: int, best: NDArray[np.int64]) -> None:
    """Enters a tile among the best, if it is. What is farther from the viewpoint is missed more often, about in
    proportion, so a tile is worth its keypoints times its distance; the square of that is kept."""
    x, y = 2 * (i - MIDDLE - GROUPS + BEFORE) + 1, 2 * (j - MIDDLE - GROUPS + BEFORE) + 1
    worth, n = keypoints * keypoints * (x * x + y * y), TRIED
    while n > 0 and worth > best[1, n - 1]:
        n -= 1
        if n + 1 < TRIED:
            best[0, n + 1], best[1, n + 1] = best[0, n], best[1, n]
        best[0, n], best[1, n] = PADDED * i + j, worth


@inner
def _try(
    best: NDArray[np.int64],
    keypoints: NDArray[np.int64],
    weights: NDArray[np.uint8],
    places: NDArray[np.uint16],
    first: int,
) -> None:
    """Enters the best tiles in the quads of a view, the first of which is given."""
    for n in range(TRIED):
        if best[1, n]:
            i, j = best[0, n] // PADDED, best[0, n] % PADDED
            weights[n] = keypoints[i, j]
            for a in range(GROUPS // 2):
                for b in range(GROUPS // 2):
                    x, y = i - GROUPS + 2 * a, j - GROUPS + 2 * b
                    if 0 <= x < SIDE - 1 and 0 <= y < SIDE - 1:
                        places[first + GROUPS // 2 * a + b, n] = SIDE * x + y


@inner
def _place(tile: int) -> int:
    """Of a tile in the room of `_fill`."""
    return min(max(tile + MIDDLE + GROUPS - BEFORE, 0), PADDED - 1)


@inner
def _take(
    i: int,
    j: int,
    keypoints: int,
    group: int,
    first: int,
    missed: NDArray[np.uint64],
    counts: NDArray[np.uint64],
    beyond: NDArray[np.int64],
    low: NDArray[np.int64],
) -> None:
    """Enters a tile of `_fill` in the lanes of a view, the first of which is given, where its groups of offsets
    move it to."""
    for a in range(GROUPS):
        for b in range(GROUPS):
            x, y, lane = i - GROUPS + a, j - GROUPS + b, first + GROUPS * a + b
            if 0 <= x < SIDE and 0 <= y < SIDE:
                tile = U(SIDE * x + y)
                missed[group, tile] &= ~(U(1) << U(lane))
                beyond[group, lane] -= keypoints
                low[group, lane] -= keypoints & ~LOW
                for digit in range(DIGITS):
                    bit = U(keypoints >> (DIGITS - 1 - digit) & 1)
                    counts[group, DIGITS * lane + digit, tile >> U(6)] |= bit << (tile & U(63))
