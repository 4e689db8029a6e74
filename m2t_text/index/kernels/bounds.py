"""Upper bounds of the agreement, compiled: which maps cannot be among the best, without measuring them.

A map's score is the overlap at one offset of the viewpoints, so the largest overlap over all offsets bounds it.
Offsets are taken together: a 64 bit mask has one bit for each of eight steps in x times eight in y, and
says under which of them a keypoint lies near one of the other map. The masks of all keypoints are added, all 64
sums of four views at once (``sums``). A coarse step stands for three offsets, and near is what is near under
one of them; where the coarse sums let a map through, the fine ones, a step for each offset, look at those
offsets again: branch and bound, as in scan matching (Olson, ICRA 2009; Hess et al., ICRA 2016).
"""

from typing import Any, NamedTuple

import numpy as np

from m2t_text.index.kernels.bit_sums import DIGITS, add_masks, at_least, clear, largest
from m2t_text.index.kernels.bitmaps import FINE_SIDE, Scratch, coarse_bitmaps, fine_bitmaps
from m2t_text.index.kernels.bound_tables import FIRST, STEP, CoarseTables, FineTables
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.simd import LANES, at, every, gathered, put, some
from m2t_text.index.kernels.unpacking import cells_of
from m2t_text.util.compiling import inner, kernel

U = np.uint64
TWO_STEPS = U(0x0303)  # the bits of two by two coarse steps, and
OF_A_BLOCK = U(0x00003F3F3F3F3F3F)  # of the six by six offsets in them
SAMPLED = 8  # every eighth keypoint tells which maps are worth scoring first


@inner
def _flat(x: Any, y: Any, size: Any, dx: Any, dy: Any, half: Any, places: Any) -> Any:
    """Writes where in a table the cells (x - dx, y - dy) lie, filled up to eights, and returns their number."""
    side = U(2 * half)
    for k in range(U(size)):
        column, row = U(np.int64(x[k]) - dx + half), U(np.int64(y[k]) - dy + half)
        inside = (column < side) & (row < side)
        places[k] = column * side + row if inside else side * side
    full = (size + 7) // 8 * 8
    for k in range(U(size), U(full)):
        places[k] = side * side + U(1)
    return full


@inner
def _add_cells(table: Any, places: Any, count: Any, masks: Any, sums: Any) -> None:
    """Adds the table's masks of places."""
    for k in range(U(count)):
        put(masks, k, at(table, U(places[k])))
    add_masks(masks, count, sums, np.int64(0))


@inner
def _add_windows(
    windows: Any, cells: Any, begin: Any, end: Any, move: Any, masks: Any, sums: Any, digit: Any
) -> None:
    """Adds the bitmaps at the query's cells, moved by so many bytes; see `add_masks`."""
    for k in range(U(end - begin)):
        put(masks, k, gathered(windows, cells, U(begin) + k, move))
    add_masks(masks, end - begin, sums, digit)


@inner
def _add_coarse(tables: Any, g: Any, windows: Any, masks: Any, sums: Any) -> None:
    """Adds |Q'|, without the far keypoints, under each coarse step of a group of views."""
    for digit in range(tables.begins.shape[1] - 1):
        begin, end = tables.begins[g, digit], tables.begins[g, digit + 1]
        _add_windows(windows, tables.cells[g], begin, end, np.int64(0), masks, sums, digit)


class Room(NamedTuple):
    """What bounds are worked out in.

    Attributes:
        x, y: (N,) int32 cells of a map.
        places: (N,) uint32 of them in a table.
        masks: (N, LANES) uint64 of them, or of as many of the query's.
        sums: (G, DIGITS, LANES) uint64 of a group of views.
    """

    x: Any
    y: Any
    places: Any
    masks: Any
    sums: Any

    @classmethod
    def of(cls, texts: Texts, documents: Any, query: int, groups: int) -> "Room":
        """Enough for any of the documents, for so many keypoints of the query and groups of its views."""
        largest = max(query, texts.largest(documents)) + 8
        x, y, places = np.empty(largest, np.int32), np.empty(largest, np.int32), np.empty(largest, np.uint32)
        masks, sums = np.empty((largest, LANES), np.uint64), np.empty((groups, DIGITS, LANES), np.uint64)
        return cls(x, y, places, masks, sums)


def sampled_shares(texts: Texts, documents: Any, tables: CoarseTables, shares: Any) -> None:
    """Writes to ``shares`` (K,) how well documents may fit, by the few keypoints that are looked at.

    That is the share of them that lie near the query's under the best coarse step.
    """
    _sampled_shares(texts, documents, tables, Room.of(texts, documents, 0, 1), shares)


@kernel
def _sampled_shares(texts: Any, documents: Any, tables: Any, room: Any, shares: Any) -> None:
    x, y, places, masks, sums = room.x, room.y, room.places, room.masks, room.sums[0]
    for k in range(len(documents)):
        size = cells_of(texts, documents[k], x, y)
        few = (size + SAMPLED - 1) // SAMPLED
        for point in range(U(few)):
            x[point], y[point] = x[point * U(SAMPLED)], y[point * U(SAMPLED)]
        count = _flat(x, y, few, np.int64(0), np.int64(0), tables.half, places)
        best = np.int64(0)
        for g in range(len(tables.masks)):
            clear(sums)
            _add_cells(tables.masks[g], places, count, masks, sums)
            best = max(best, largest(sums, ~U(0)))
        shares[k] = best / max(few, np.int64(1))


def coarse_bounds(
    texts: Texts, documents: Any, tables: CoarseTables, needed: Any, scratch: Scratch, bounds: Any
) -> None:
    """What |Q'| + |M'| of `agreement.agree` cannot exceed.

    Args:
        texts: of a segment.
        documents: (K,) int64 their numbers.
        needed: (K,) the least |Q'| + |M'| of interest.
        scratch: of COARSE.
        bounds: (K,) int32 result, 0 where what is needed cannot be reached.
    """
    groups = len(tables.masks)
    room = Room.of(texts, documents, tables.cells.shape[1], groups)
    _coarse_bounds(texts, documents, tables, needed, scratch, room, np.zeros(groups, np.bool_), bounds)


@kernel
def _coarse_bounds(
    texts: Any, documents: Any, tables: Any, needed: Any, scratch: Any, room: Any, promising: Any, bounds: Any
) -> None:
    x, y, places, masks, sums = room.x, room.y, room.places, room.masks, room.sums
    windows = scratch.window_bytes
    for k in range(len(documents)):
        size = cells_of(texts, documents[k], x, y)
        count = _flat(x, y, size, np.int64(0), np.int64(0), tables.half, places)
        hope = False
        for g in range(len(tables.masks)):
            clear(sums[g])
            _add_cells(tables.masks[g], places, count, masks, sums[g])
            # if not even all of the query's keypoints would do, then nothing does
            promising[g] = some(at_least(sums[g], max(np.int64(needed[k]) - tables.size, np.int64(0))))
            hope = hope or promising[g]
        best = -tables.far
        if hope:
            coarse_bitmaps(x, y, size, scratch, places)
            for g in range(len(tables.masks)):
                if promising[g]:
                    _add_coarse(tables, g, windows, masks, sums[g])
                    best = max(best, largest(sums[g], ~U(0)))
        bounds[k] = best + tables.far


def fine_bounds(
    texts: Texts, documents: Any, tables: CoarseTables, fine_tables: FineTables, needed: Any,
    coarse: Scratch, fine: Scratch, bounds: Any,
) -> None:  # fmt: skip
    """The same, tighter, where it matters: only offsets whose coarse bound reaches what is ``needed`` count.

    Args:
        needed: (K,) int32 the least |Q'| + |M'| of interest, 1 or more.
        coarse, fine: scratch of COARSE and of FINE.
        bounds: (K,) int32 result, 0 where no coarse bound reaches it.
    """
    room = Room.of(texts, documents, max(tables.cells.shape[1], fine_tables.cells.shape[1]), 1)
    _fine_bounds(texts, documents, tables, fine_tables, needed, coarse, fine, room, bounds)


@kernel
def _fine_bounds(
    texts: Any, documents: Any, tables: Any, fine_tables: Any, needed: Any, coarse: Any, fine: Any, room: Any,
    bounds: Any,
) -> None:  # fmt: skip
    x, y, places, masks, sums = room.x, room.y, room.places, room.masks, room.sums[0]
    for k in range(len(documents)):
        size = cells_of(texts, documents[k], x, y)
        coarse_bitmaps(x, y, size, coarse, places)
        fine_bitmaps(x, y, size, fine)
        bounds[k] = 0
        for g in range(len(tables.masks)):
            clear(sums)
            count = _flat(x, y, size, np.int64(0), np.int64(0), tables.half, places)
            _add_cells(tables.masks[g], places, count, masks, sums)
            _add_coarse(tables, g, coarse.window_bytes, masks, sums)
            steps = at_least(sums, max(np.int64(needed[k]) - tables.far, np.int64(0)))
            for block in range(16):  # of two by two steps
                i, j = block // 4, block % 4
                if some(steps & every(TWO_STEPS << U(16 * i + 2 * j))):
                    dx, dy = FIRST + 2 * STEP * i, FIRST + 2 * STEP * j
                    clear(sums)
                    count = _flat(x, y, size, dx, dy, tables.half, places)
                    _add_cells(fine_tables.masks[g], places, count, masks, sums)
                    cells, move, zero = fine_tables.cells[g], dy * FINE_SIDE + dx, np.int64(0)
                    _add_windows(fine.window_bytes, cells, zero, len(cells), move, masks, sums, zero)
                    bounds[k] = max(np.int64(bounds[k]), largest(sums, OF_A_BLOCK) + tables.far)
