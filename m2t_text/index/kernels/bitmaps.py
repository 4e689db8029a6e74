"""A map as windows on a grid, compiled: what lies near eight by eight cells, in eight bytes from any place on.

Rows of the grid run along x, a byte a cell, and eight cells are worked on at once. Bit j of the byte at (x, y)
says whether cell (x, y + j) is taken; so the eight bytes from there on cover eight cells in x and eight in y.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from m2t_text.util.compiling import inner

U = np.uint64
BLANK = 16  # rows before and behind the place of nothing


class BitGrid(NamedTuple):
    """A square grid about the viewpoint.

    Attributes:
        words: of 64 bits in a row.
    """

    words: int

    @property
    def side(self) -> int:
        """Cells, and bytes, of a row."""
        return 8 * self.words

    @property
    def empty(self) -> int:
        """A place of which the windows tell that nothing is near, as of those up to BLANK - 1 rows away."""
        return (self.side + BLANK) * self.side

    def places(self, x: NDArray[np.int64], y: NDArray[np.int64]) -> NDArray[np.int64]:
        """Of cells in the windows of a map."""
        return (y + self.side // 2) * self.side + x + self.side // 2

    @property
    def block(self) -> int:
        """Words that hold the grid, and what is blank."""
        return self.words * (self.side + 2 * BLANK)

    def scratch(self) -> "Scratch":
        """Room for a map."""
        taken, near, windows = (np.zeros(blocks * self.block, np.uint64) for blocks in (KINDS, 1, 1))
        return Scratch(taken, taken.view(np.uint8), near, windows, windows.view(np.uint8))


class Scratch(NamedTuple):
    """What is worked on for one map, zero at first; bytes are a view of the same memory.

    Attributes:
        taken, taken_bytes: cells taken, of each kind of keypoint.
        near: cells near them.
        windows, window_bytes: the windows of the map.
    """

    taken: NDArray[np.uint64]
    taken_bytes: NDArray[np.uint8]
    near: NDArray[np.uint64]
    windows: NDArray[np.uint64]
    window_bytes: NDArray[np.uint8]


KINDS = 4  # of keypoints: in the first column of their coarse cell or not, and in its first row or not
COARSE, FINE = BitGrid(12), BitGrid(38)
STEP = 3  # cells of a map, in x and in y, that lie in one of the coarse grid
ANY, FIRST_X, FIRST_Y = U(1), U(2), U(4)  # bits of a coarse cell: a keypoint, one in its first column, in its
# first row, and FIRST_X * FIRST_Y: one in both
OF_X, OF_Y, OF_BOTH = ANY | FIRST_X, ANY | FIRST_Y, (ANY | FIRST_X) * (ANY | FIRST_Y)
IN_X = U(0x0505050505050505)  # ANY and FIRST_Y of eight cells
ONES = U(0x0101010101010101)
COARSE_WORDS, COARSE_SIDE, FINE_WORDS, FINE_SIDE = COARSE.words, COARSE.side, FINE.words, FINE.side
COARSE_BLOCK, COARSE_MIDDLE = COARSE.block, STEP * COARSE_SIDE // 2


@inner
def _clear(words: Any, begin: Any, end: Any) -> None:
    """Makes the words begin...end zero."""
    for k in range(begin, end):
        words[k] = U(0)


@inner
def _mark_coarse(x: Any, y: Any, size: Any, cells: Any, places: Any) -> Any:
    """Takes the coarse cells of a map's keypoints, each kind in a block of its own; returns their lowest and
    highest row.

    Nothing is read where something was just written, and numbers of 32 bits are computed several at a time.
    """
    three, inner = np.uint32(STEP), np.uint32(COARSE_SIDE - 2)
    block, across = np.uint32(8 * COARSE_BLOCK), np.uint32(COARSE_SIDE)
    low: Any = COARSE_SIDE
    high: Any = 0
    for k in range(U(size)):
        i, j = np.uint32(x[k] + COARSE_MIDDLE), np.uint32(y[k] + COARSE_MIDDLE)
        column, row = np.uint32(i // three), np.uint32(j // three)
        inside = (np.uint32(column - 2) < inner) & (np.uint32(row - 2) < inner)
        low = min(low, np.int64(row) if inside else COARSE_SIDE)
        high = max(high, np.int64(row) if inside else 0)
        kind = np.uint32(i == column * STEP) + np.uint32(2) * np.uint32(j == row * STEP)
        place = np.uint32(kind * block + row * across + column)
        places[k] = place if inside else np.uint32(block - 1)
    for k in range(U(size)):
        cells[places[k]] = 1
    return U(low), U(high)


@inner
def coarse_bitmaps(x: Any, y: Any, size: Any, scratch: Any, places: Any) -> None:
    """Makes the windows of a map in which a group of the query's keypoints in cell g is looked up.

    Cell g covers keypoints in g and g + 1, and in the first third of g + 2, in x and in y alike: where a
    keypoint in g may come to lie under the offsets of a step, and a cell more on each side. The ``places``
    (>= size,) uint32 are room to work in.
    """
    taken, near, windows = scratch.taken, scratch.near, scratch.windows
    width, block = U(COARSE_WORDS), U(COARSE_BLOCK)
    low, high = _mark_coarse(x, y, size, scratch.taken_bytes, places)
    if low > high:
        _clear(windows, U(0), U(len(windows)))
        return
    begin, end = width * (low - U(2)), width * (high + U(1))
    for k in range(begin, end + U(1)):
        in_x, in_y, in_both = taken[k + block], taken[k + U(2) * block], taken[k + U(3) * block]
        taken[k] |= in_x * OF_X | in_y * OF_Y | in_both * OF_BOTH
    for k in range(begin, end):
        next_word = taken[k + U(1)]
        one = taken[k] >> U(8) | next_word << U(56)
        two = taken[k] >> U(16) | next_word << U(48)
        near[k] = (taken[k] | one) & IN_X | two >> U(1) & IN_X
    _clear(near, end, end + U(2) * width)
    for k in range(begin, end):
        near[k] = (near[k] | near[k + width]) & ONES | near[k + U(2) * width] >> U(2) & ONES
    for kind in range(U(KINDS)):
        _clear(taken, kind * block + begin, kind * block + end)
    _stack(near, windows, begin, end, width)


@inner
def fine_bitmaps(x: Any, y: Any, size: Any, scratch: Any) -> None:
    """Makes the windows of a map in which a keypoint of the query is looked up.

    A cell is taken if a keypoint lies in it or next to it.
    """
    taken, near, windows, cells = scratch.taken, scratch.near, scratch.windows, scratch.taken_bytes
    width = U(FINE_WORDS)
    side, last = U(FINE_SIDE), U(FINE_SIDE - 1)
    low, high = side, U(0)
    for k in range(U(size)):
        column, row = U(np.int64(x[k]) + FINE_SIDE // 2), U(np.int64(y[k]) + FINE_SIDE // 2)
        if U(1) <= column < last and U(1) <= row < last:
            low, high = min(low, row), max(high, row)
            cells[row * side + column] = np.uint8(1)
    if low > high:
        _clear(windows, U(0), U(len(windows)))
        return
    begin, end = width * low, width * (high + U(1))
    _clear(windows, begin - width, begin)
    _clear(windows, end, end + width)
    for k in range(begin, end):
        here = taken[k]
        beside = taken[k + U(1)] << U(56) | taken[k - U(1)] >> U(56)
        windows[k] = here | here >> U(8) | here << U(8) | beside
    _clear(taken, begin, end)
    begin, end = begin - width, end + width
    near[begin] = U(0)
    for k in range(begin, end):
        near[k] = windows[k]
    for k in range(begin + width, end):
        near[k] |= windows[k - width]
    for k in range(begin, end - width):
        near[k] |= windows[k + width]
    _stack(near, windows, begin, end, width)


@inner
def _stack(near: Any, windows: Any, begin: Any, end: Any, width: Any) -> None:
    """Windows on the cells (0 or 1) of ``near``, whose rows begin...end are not empty."""
    first = begin - min(begin, U(7) * width)
    _clear(near, first, begin)
    _clear(near, end, end + U(7) * width)
    _clear(windows, U(0), first)
    _clear(windows, end, U(len(windows)))
    for k in range(first, end):
        windows[k] = (
            near[k]
            | near[k + width] << U(1)
            | near[k + U(2) * width] << U(2)
            | near[k + U(3) * width] << U(3)
            | near[k + U(4) * width] << U(4)
            | near[k + U(5) * width] << U(5)
            | near[k + U(6) * width] << U(6)
            | near[k + U(7) * width] << U(7)
        )
