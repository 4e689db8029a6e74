"""Upper bounds of the agreement, compiled: which maps cannot be among the best, without measuring them.

A map's score is the overlap at one offset of the viewpoints, so the largest overlap over all offsets bounds it.
Offsets are taken together: a 64 bit mask has one bit for each of eight steps in x times eight in y, and
says under which of them a keypoint lies near one of the other map. The masks of all keypoints are added, all 64
sums of four views at once (``sums``); where few views are left, those of four parts of one. A coarse step
stands for three offsets, and near is what is near under one of them; a fine step is one offset. This is branch
and bound, as in scan matching (Olson, ICRA 2009; Hess et al., ICRA 2016), in three stages:

- the coarse sums of both maps' keypoints;
- of two by two coarse steps of a view that may still reach what is needed, a block, the fine sums of the map's
  keypoints and the coarse ones of the query's: only the query's tables are looked at, and most blocks fall;
- the fine sums of both, for which the map is drawn on a fine grid.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from m2t_text.index.kernels.bit_sums import INNER, add_masks, add_sums, at_least, clear, fold, largest
from m2t_text.index.kernels.bitmaps import FINE_SIDE, Scratch, draw
from m2t_text.index.kernels.bound_tables import FIRST, MOVED, STEP, CoarseTables, FineTables
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.simd import LANES, at, by_lane, every, full, put, some
from m2t_text.index.kernels.unpacking import cells_of, some_cells_of
from m2t_text.util.compiling import inner, kernel

U = np.uint64
TWO_STEPS = U(0x0303)  # the bits of two by two coarse steps, and
OF_A_BLOCK = U(0x00003F3F3F3F3F3F)  # of the six by six offsets in them,
OF_A_STEP = U(0x0000000000070707)  # and of the three by three in the first of these
SAMPLED = 8  # every eighth keypoint tells which maps are worth scoring first
AT_ONCE = 8 * LANES  # keypoints that are added at a time where lanes share those of a view
FEW = 6  # blocks of a group of views up to which they are looked at as soon as they are found


@inner
def _places(x: Any, y: Any, size: Any, masks: Any, places: Any) -> Any:
    """Writes where the coarse masks of cells (x, y) are, filled up to eights, and returns their number."""
    # all numbers are of 32 bits, and nothing is looked up, so that several are computed at a time
    side, across, length = np.uint32(2 * masks.half), np.uint32(masks.across), np.uint32(masks.length)
    step, inverse = np.uint32(masks.step), np.uint32((1 << 16) // masks.step + 1)
    outside = np.uint32(masks.rows.shape[1] - 16)
    half = np.int32(masks.half)
    for k in range(U(size)):
        i, j = np.uint32(x[k] + half), np.uint32(y[k] + half)
        inside = (i < side) & (j < side)
        back = np.uint32(side - np.uint32(1) - i)
        quotient = np.uint32(np.uint32(back * inverse) >> np.uint32(16))
        remainder = np.uint32(back - quotient * step)
        place = np.uint32(j * across + remainder * length + quotient)
        places[k] = place if inside else outside
    full = (size + 7) // 8 * 8
    for k in range(U(size), U(full)):
        places[k] = outside + np.uint32(8)
    return full


@inner
def _fine_places(x: Any, y: Any, size: Any, fine_tables: Any, places: Any) -> Any:
    """Writes where the fine masks of cells (x - dx, y - dy) are, in full passes, and returns their number.

    The offsets dx and dy are the least in x and the greatest in y that blocks begin at: any other moves all
    places by a number that is not negative. What lies outside is taken to the border, beyond which no block
    moves it.
    """
    across, last = np.uint32(fine_tables.across), np.int32(2 * fine_tables.half - 1)
    right, up = np.int32(fine_tables.half - FIRST), np.int32(fine_tables.half - FIRST - MOVED)
    for k in range(U(size)):
        i = min(max(np.int32(x[k] + right), np.int32(MOVED)), last)
        j = min(max(np.int32(y[k] + up), np.int32(0)), np.int32(last - MOVED))
        places[k] = np.uint32(np.uint32(j) * across + np.uint32(last - i))
    full = -(-size // AT_ONCE) * AT_ONCE
    for k in range(U(size), U(full)):
        places[k] = np.uint32(last + 1) * across
    return full


@inner
def _add_cells(rows: Any, places: Any, count: Any, sums: Any) -> None:
    """Makes ``sums`` those of the masks at places."""
    clear(sums)
    add_masks(rows, places, np.int64(0), count, sums, np.int64(0))
    for digit in range(U(len(sums))):
        put(sums, digit, by_lane(at(sums, digit)))


@inner
def _add_coarse(tables: Any, g: Any, windows: Any, sums: Any) -> None:
    """Adds |Q'|, without the far keypoints, under each coarse step of a group of views."""
    for digit in range(tables.begins.shape[1] - 1):
        begin, end = tables.begins[g, digit], tables.begins[g, digit + 1]
        add_masks((windows, np.int64(0)), tables.cells[g], begin, end, sums, digit)


class Room(NamedTuple):
    """What bounds are worked out in.

    Attributes:
        x, y: (N,) int32 cells of a map.
        places, fine_places: (N,) uint32 of them in the tables; fine_rows: (N / LANES, LANES) the same again.
        sums: (G, D, LANES) uint64 of the map's keypoints, for each group of views.
        promising: (G,) bool whether a group of views may reach what is needed.
        drawn: (1,) bool whether the map is drawn on the fine grid.
        steps: (1, LANES) uint64 those of a block that may reach what is needed.
        here, total: (D, LANES) uint64 of the query's keypoints, and of both.
        spread: of the query's under a block's offsets.
        block: of a view under a block's offsets, each lane of a part of the keypoints.
        nothing: no sums.
    """

    x: Any
    y: Any
    places: Any
    fine_places: Any
    fine_rows: Any
    sums: Any
    promising: Any
    drawn: Any
    steps: Any
    here: Any
    total: Any
    spread: Any
    block: Any
    nothing: Any

    @classmethod
    def of(cls, texts: Texts, documents: Any, tables: CoarseTables) -> "Room":
        """Enough for any of the documents and the query."""
        groups, most = len(tables.cells), -(-texts.largest(documents) // AT_ONCE) * AT_ONCE + AT_ONCE
        digits = max((most + tables.size).bit_length(), INNER + tables.begins.shape[1])
        x, y = np.empty((2, most), np.int32)
        places, fine_places = np.empty((2, most), np.uint32)
        sums, flags = np.empty((groups, digits, LANES), np.uint64), np.zeros(groups + 1, np.bool_)
        here, total, spread, block, nothing = np.zeros((5, digits, LANES), np.uint64)
        rows, steps, drawn = fine_places.reshape(-1, LANES), np.empty((1, LANES), np.uint64), flags[:1]
        of_keypoints = x, y, places, fine_places, rows, sums, flags[1:], drawn
        return cls(*of_keypoints, steps, here, total, spread, block, nothing)


@inner
def _of_block(steps: Any, row: Any, column: Any) -> Any:
    """The bits of steps that belong to a block, in their places."""
    return steps & every(TWO_STEPS << U(16 * row + 2 * column))


@inner
def _blocks(steps: Any) -> Any:
    """How many blocks have one of the steps in any lane."""
    count = np.int64(0)
    for block in range(16):
        if some(_of_block(steps, block // 4, block % 4)):
            count += 1
    return count


@inner
def _spread(sums: Any, row: Any, column: Any, result: Any) -> None:
    """Writes the coarse sums of a block's steps to ``result``, each for all of its offsets."""
    first = U(16 * row + 2 * column)
    for digit in range(U(len(sums))):
        plane, spread = at(sums, digit), every(U(0))
        for step in range(U(4)):
            i, j = step >> U(1), step & U(1)
            of_step = full(plane & every(U(1) << (first + U(8) * i + j)))
            spread = spread | of_step & every(OF_A_STEP << (U(24) * i + U(3) * j))
        put(result, digit, spread)


class Look(NamedTuple):
    """How closely maps are looked at, and room for one of them.

    Attributes:
        coarse, fine: scratch of COARSE and of FINE.
        sampled: whether few of the map's keypoints count, and none of the query's.
        few: blocks of a group of views up to which the second stage follows.
        tight: whether the third stage follows.
    """

    coarse: Scratch
    fine: Scratch
    sampled: bool = False
    few: int = FEW
    tight: bool = False


def estimates(
    texts: Texts, documents: Any, tables: CoarseTables, fine_tables: FineTables, look: Look
) -> NDArray[np.float64]:
    """(K,) how well documents may fit, by the few keypoints that are looked at.

    The share of them that lie near the query's under the best coarse step is taken for that of all, and as many
    of the query's are taken to match.
    """
    sizes, nothing = texts.starts[documents + 1] - texts.starts[documents], np.zeros(len(documents), np.int32)
    best = coarse_bounds(texts, documents, tables, fine_tables, nothing, look._replace(sampled=True))
    near = best / np.maximum(-(-sizes // SAMPLED), 1) * sizes
    return (near + np.minimum(near, tables.size)) / (tables.size + sizes)


def coarse_bounds(
    texts: Texts, documents: Any, tables: CoarseTables, fine_tables: FineTables, needed: Any, look: Look
) -> NDArray[np.int32]:
    """(K,) what |Q'| + |M'| of `agreement.agree` cannot exceed, 0 where what is needed cannot be reached.

    Args:
        texts: of a segment.
        documents: (K,) int64 their numbers.
        needed: (K,) int32 the least |Q'| + |M'| of interest.
        look: how closely.
    """
    room, bounds = Room.of(texts, documents, tables), np.zeros(len(documents), np.int32)
    _bounds(texts, documents, tables, fine_tables, needed, look, room, bounds)
    return bounds


def fine_bounds(
    texts: Texts, documents: Any, tables: CoarseTables, fine_tables: FineTables, needed: Any, look: Look
) -> NDArray[np.int32]:
    """The same, tighter: all stages are taken of all blocks that may reach what is needed."""
    closer = look._replace(few=16, tight=True)
    return coarse_bounds(texts, documents, tables, fine_tables, needed, closer)


@kernel
def _bounds(
    texts: Any, documents: Any, tables: Any, fine_tables: Any, needed: Any, look: Any, room: Any, bounds: Any
) -> None:
    x, y, places, sums = room.x, room.y, room.places, room.sums
    for k in range(len(documents)):
        if look.sampled:
            size = some_cells_of(texts, documents[k], SAMPLED, x, y)
        else:
            size = cells_of(texts, documents[k], x, y)
        count = _places(x, y, size, tables.masks, places)
        best, hope = np.int64(0), False
        for g in range(len(tables.cells)):
            _add_cells(tables.masks.rows[g], places, count, sums[g])
            if look.sampled:
                best = max(best, largest(sums[g], ~U(0)))
            else:  # if not even all of the query's keypoints would do, then nothing does
                others = max(np.int64(needed[k]) - tables.size, np.int64(0))
                room.promising[g] = some(at_least(sums[g], others))
                hope = hope or room.promising[g]
        if hope:
            draw(x, y, size, look.coarse, places)
            room.drawn[0] = False
            count = _fine_places(x, y, size, fine_tables, room.fine_places)
            for g in range(len(tables.cells)):
                if room.promising[g]:
                    best = max(
                        best, _most(tables, fine_tables, g, size, count, needed[k], look, room) + tables.far
                    )
        bounds[k] = best if best >= needed[k] else 0


@inner
def _most(
    tables: Any, fine_tables: Any, g: Any, size: Any, count: Any, needed: Any, look: Any, room: Any
) -> Any:
    """The largest sum of both, without the query's far keypoints, that a group of views may reach; the map is
    drawn on the coarse grid."""
    steps, best = _add_both(tables, g, needed, look.coarse, room.sums[g], room), np.int64(0)
    if _blocks(steps) > look.few:
        return largest(room.total, ~U(0))
    for block in range(16):
        row, column = block // 4, block % 4
        of_block = _of_block(steps, row, column)
        if some(of_block):
            put(room.steps, U(0), of_block)
            _spread(room.here, row, column, room.spread)
            for lane in range(LANES):
                view = g * LANES + lane
                if room.steps[0, lane] != 0 and view < len(fine_tables.rows):
                    least = np.int64(needed) - tables.far
                    most = _most_of_view(fine_tables, view, row, column, size, count, least, look, room)
                    best = max(best, most)
    return best


@inner
def _most_of_view(
    fine_tables: Any, view: Any, row: Any, column: Any, size: Any, count: Any, needed: Any, look: Any, room: Any
) -> Any:
    """The largest sum of both that a view may reach in a block, for whose offsets ``room.spread`` is there; 0
    if it is less than what is needed. The ``count`` fine places are there, too."""
    zero, lane = np.int64(0), U(view % LANES)
    move = 2 * STEP * row + (MOVED - 2 * STEP * column) * fine_tables.across
    clear(room.block)
    add_masks((fine_tables.rows[view], move), room.fine_rows, zero, count // LANES, room.block, zero)
    reached = fold(room.block, room.spread, lane, max(needed, zero), room.total)
    if not some(reached & every(OF_A_BLOCK)):
        return zero
    if look.tight:
        if not room.drawn[0]:
            draw(room.x, room.y, size, look.fine, room.places)
            room.drawn[0] = True
        cells = fine_tables.cells[view]
        move = (FIRST + 2 * STEP * column) * FINE_SIDE + FIRST + 2 * STEP * row
        add_masks((look.fine.windows, move), cells, zero, len(cells), room.block, zero)
        fold(room.block, room.nothing, lane, zero, room.total)
    return largest(room.total, OF_A_BLOCK)


@inner
def _add_both(tables: Any, g: Any, needed: Any, scratch: Any, there: Any, room: Any) -> Any:
    """Makes ``room.here`` the coarse sums of the query's keypoints and ``room.total`` those of both, the map
    being drawn and ``there`` those of its own; returns the steps that reach what is needed."""
    clear(room.here)
    _add_coarse(tables, g, scratch.windows, room.here)
    add_sums(there, room.here, room.total)
    return at_least(room.total, max(np.int64(needed) - tables.far, np.int64(0)))
