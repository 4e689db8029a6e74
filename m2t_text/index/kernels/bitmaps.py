"""A map as windows on a grid, compiled: what lies near eight by eight cells, in eight bytes from any place on.

Rows of the grid run along x, a byte a cell, and a strip of 32 cells is worked on at once. Bit j of the byte at
(x, y) says whether cell (x, y + j) is taken; so the eight bytes from there on cover eight cells in x and eight
in y. Only strips and rows near a map's keypoints are worked on; the others stay zero.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from m2t_text.index.kernels.simd import every, put_strip, strip_at
from m2t_text.util.compiling import inner

U = np.uint64
STRIP = 32  # cells
BLANK = 16  # rows before and behind the place of nothing
REACHED = 9  # rows below a keypoint's in which windows show it: two by what lies near, seven as they are high
ANY, FIRST_Y, FIRST_X = np.uint32(1), np.uint32(2), np.uint32(4)  # bits of a cell: a keypoint, one in its first
# row, in its first column, and FIRST_X * FIRST_Y: one in both
KIND = np.uint32(4)  # bits in all
FRACTION = 17  # bits of the reciprocal by which numbers are divided
ONES, TWOS = U(0x0101010101010101), U(0x0303030303030303)  # the lowest bit and the lowest two of eight bytes,
ROWS_ABOVE = U(0xFEFEFEFEFEFEFEFE)  # and all but the lowest


class BitGrid(NamedTuple):
    """A square grid about the viewpoint.

    Attributes:
        strips: in a row.
        step: cells of a map, in x and in y, that lie in one of the grid.
        ahead: cells by which keypoints are moved on in x and in y.
    """

    strips: int
    step: int
    ahead: int

    @property
    def side(self) -> int:
        """Cells, and bytes, of a row."""
        return STRIP * self.strips

    @property
    def empty(self) -> int:
        """A place of which the windows tell that nothing is near, as of those up to BLANK - 1 rows away."""
        return (self.side + BLANK) * self.side

    def places(self, x: NDArray[np.int64], y: NDArray[np.int64]) -> NDArray[np.int64]:
        """Of cells in the windows of a map."""
        return (y + self.side // 2) * self.side + x + self.side // 2

    def scratch(self) -> "Scratch":
        """Room for a map."""
        taken = np.zeros(self.side**2 + 2 * STRIP, np.uint8)  # strips are read up to two cells on
        windows = np.zeros(self.side * (self.side + 2 * BLANK), np.uint8)
        return Scratch(*self, taken, windows, np.zeros(4, np.int64))


class Scratch(NamedTuple):
    """What is worked on for one map.

    Attributes:
        strips, step, ahead: of the grid.
        taken: what lies in each cell, 0 between two maps.
        windows: of the map, 0 where it is not drawn.
        drawn: the first row in which it is, the one behind the last, and the same of strips.
    """

    strips: int
    step: int
    ahead: int
    taken: NDArray[np.uint8]
    windows: NDArray[np.uint8]
    drawn: NDArray[np.int64]


COARSE, FINE = BitGrid(strips=4, step=3, ahead=0), BitGrid(strips=10, step=1, ahead=1)
FINE_SIDE = FINE.side


@inner
def _clear(scratch: Any, side: Any) -> None:
    """Clears the windows of the last map; column by column, which spares a call for every short row."""
    drawn = scratch.drawn
    for strip in range(U(drawn[2]), U(drawn[3])):
        for row in range(U(drawn[0]), U(drawn[1])):
            put_strip(scratch.windows, row * U(side) + U(STRIP) * strip, every(U(0)))


@inner
def _mark(x: Any, y: Any, size: Any, scratch: Any, places: Any) -> None:
    """Takes the cells of a map's keypoints, and writes to ``drawn`` where the map is to be drawn.

    All numbers are of 32 bits, so that many are computed at a time.
    """
    side, step, fraction = np.uint32(STRIP * scratch.strips), np.uint32(scratch.step), np.uint32(FRACTION)
    _clear(scratch, side)
    middle = np.int32(STRIP * scratch.strips * scratch.step // 2 + scratch.ahead)
    inverse = np.uint32((1 << FRACTION) // scratch.step + 1)
    border, across = np.uint32(2 * step), np.uint32((side - np.uint32(2)) * step)
    nothing, nowhere = np.uint32(0), np.uint32(np.uint32(len(scratch.taken) - 1) << KIND)
    low, high, left, right = side, nothing, side, nothing
    for k in range(U(size)):
        i, j = np.uint32(x[k] + middle), np.uint32(y[k] + middle)
        inside = (np.uint32(i - border) < across) & (np.uint32(j - border) < across)
        column = np.uint32(np.uint32(i * inverse) >> fraction)
        row = np.uint32(np.uint32(j * inverse) >> fraction)
        low, high = min(low, row if inside else side), max(high, row if inside else nothing)
        left, right = min(left, column if inside else side), max(right, column if inside else nothing)
        first_x = FIRST_X if i == np.uint32(column * step) else nothing
        first_y = np.uint32(FIRST_Y + first_x * FIRST_Y) if j == np.uint32(row * step) else nothing
        place = np.uint32(np.uint32(row * side) + column)
        places[k] = np.uint32(place << KIND | ANY | first_x | first_y) if inside else nowhere
    for k in range(U(size)):
        place = places[k]
        scratch.taken[place >> KIND] |= np.uint8(place & np.uint32(15))
    drawn = scratch.drawn
    drawn[0], drawn[1] = max(np.int64(low) - REACHED, 0), np.int64(high) + 1
    drawn[2], drawn[3] = (np.int64(left) - 2) // STRIP, np.int64(right) // STRIP + 1


@inner
def draw(x: Any, y: Any, size: Any, scratch: Any, places: Any) -> None:
    """Makes the windows of a map in which the query's keypoints in a cell g of the grid are looked up.

    Cell g covers keypoints in g and g + 1, and in the first column or row of g + 2, in x and in y alike. On the
    coarse grid that is where a keypoint in g may come to lie under the offsets of a step, and a cell more on
    each side. On the fine one, whose cells are single ones of a map, it is all of the three cells, and as
    keypoints are moved on by a cell, those in g or next to it. The ``places`` (>= size,) uint32 are room to
    work in.
    """
    _mark(x, y, size, scratch, places)
    taken, drawn, nothing, side = scratch.taken, scratch.drawn, every(U(0)), U(STRIP * scratch.strips)
    for strip in range(U(drawn[2]), U(drawn[3])):
        window, above, second_above = nothing, nothing, nothing
        for k in range(U(drawn[1] - drawn[0])):  # from the last row on
            place = (U(drawn[1]) - U(1) - k) * side + U(STRIP) * strip
            two, third = strip_at(taken, place) | strip_at(taken, place + U(1)), strip_at(taken, place + U(2))
            row = (two | third >> every(U(2))) & every(TWOS)
            near = (row | above | second_above >> every(U(1))) & every(ONES)
            window = (window + window) & every(ROWS_ABOVE) | near
            put_strip(scratch.windows, place, window)
            put_strip(taken, place, nothing)
            above, second_above = row, above
