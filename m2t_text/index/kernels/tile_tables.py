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
    """

    size: int
    missed: NDArray[np.uint64]
    counts: NDArray[np.uint64]
    beyond: NDArray[np.int64]
    low: NDArray[np.int64]

    @classmethod
    def of(cls, seen: Views) -> "TileTables":
        """Of a query with keypoints."""
        groups = -(-len(seen.wx) // VIEWS)
        missed = np.full((groups, SIDE * SIDE), ~U(0))
        counts = np.zeros((groups, LANES * DIGITS, WORDS), dtype=np.uint64)
        beyond, low = np.zeros((2, groups, LANES), dtype=np.int64)
        room = np.zeros((2, PADDED, PADDED), dtype=np.int64)
        _fill(seen.wx, seen.wy, room, missed, counts, beyond, low)
        return cls(len(seen.wa), missed, counts, beyond, low)


@kernel
def _fill(
    wx: NDArray[np.int64],
    wy: NDArray[np.int64],
    room: NDArray[np.int64],
    missed: NDArray[np.uint64],
    counts: NDArray[np.uint64],
    beyond: NDArray[np.int64],
    low: NDArray[np.int64],
) -> None:
    """Fills in the tables of views (V, Q): all is 0 at first, but for ``missed``, which has all bits.

    Args:
        room: (2, PADDED, PADDED) of the tiles from which every group takes some into the grid: whether one of
            the query's keypoints comes near a cell, and how many lie there, as many as the digits count. The
            first and the last row and column are of what lies outside.
    """
    near, keypoints = room[0], room[1]
    for v in range(len(wx)):
        for i in range(PADDED):
            for j in range(PADDED):
                near[i, j], keypoints[i, j] = 0, 0
        for k in range(wx.shape[1]):
            x, y = wx[v, k], wy[v, k]
            i, j = _place(x // TILE), _place(y // TILE)
            keypoints[i, j] = min(keypoints[i, j] + 1, MOST)
            for a in range(_place(-((5 - x) // TILE)), _place((x + 7) // TILE) + 1):
                for b in range(_place(-((5 - y) // TILE)), _place((y + 7) // TILE) + 1):
                    near[a, b] = 1
        group, first = v // VIEWS, v % VIEWS * GROUPS * GROUPS
        for lane in range(first, first + GROUPS * GROUPS):
            beyond[group, lane], low[group, lane] = wx.shape[1], wx.shape[1]
        for i in range(1, PADDED - 1):
            for j in range(1, PADDED - 1):
                if near[i, j]:
                    _take(i, j, keypoints[i, j], group, first, missed, counts, beyond, low)


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
