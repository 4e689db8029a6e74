"""Upper bounds of the agreement, compiled: which maps cannot be among the best, without measuring them.

A map's score is the overlap at one offset of the viewpoints, so the largest overlap over all offsets bounds it.
Offsets are taken together: a 64 bit mask has one bit for each of eight steps in x times eight in y, and
says under which of them a keypoint lies near one of the other map. The masks of all keypoints are added, all 64
sums of four views at once (``sums``). A coarse step stands for three offsets, and near is what is near under
one of them; where the coarse sums let a map through, the fine ones, a step for each offset, look at those
offsets again: branch and bound, as in scan matching (Olson, ICRA 2009; Hess et al., ICRA 2016).
"""

from typing import Any

import numba
import numpy as np

from m2t_text.index.kernels.bit_sums import DIGITS, add_masks, at_least, largest
from m2t_text.index.kernels.bitmaps import FINE_SIDE, Scratch, coarse_bitmaps, fine_bitmaps
from m2t_text.index.kernels.bound_tables import FIRST, STEP, CoarseTables, FineTables
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.simd import LANES, at, every, gathered, put, some
from m2t_text.index.kernels.unpacking import cells_of

U = np.uint64
TWO_STEPS = U(0x0303)  # the bits of two by two coarse steps, and
OF_A_BLOCK = U(0x00003F3F3F3F3F3F)  # of the six by six offsets in them
SAMPLED = 8  # every eighth keypoint tells which maps are worth scoring first


@numba.njit(cache=True, nogil=True)
def _flat(x: Any, y: Any, size: Any, dx: Any, dy: Any, half: Any, places: Any) -> Any:
    """Writes where in a table the cells (x - dx, y - dy) lie, filled up to eights, and returns their number."""
    side = U(2 * half)
    for k in range(U(size)):
        column, row = U(np.int64(x[k]) - dx + half), U(np.int64(y[k]) - dy + half)
        inside = (column < side) & (row < side)
        places[k] = column * side + row if inside else side * side
    full = (size + 7) // 8 * 8
    places[size:full] = side * side + U(1)
    return full


@numba.njit(cache=True, nogil=True)
def _add_cells(table: Any, places: Any, count: Any, masks: Any, sums: Any) -> None:
    """Adds the table's masks of places."""
    for k in range(U(count)):
        put(masks, k, at(table, U(places[k])))
    add_masks(masks, count, sums, 0)


@numba.njit(cache=True, nogil=True)
def _add_windows(
    windows: Any, cells: Any, begin: Any, end: Any, move: Any, masks: Any, sums: Any, digit: Any
) -> None:
    """Adds what the windows tell of the query's cells, moved by so many bytes; see `add_masks`."""
    for k in range(U(end - begin)):
        put(masks, k, gathered(windows, cells, U(begin) + k, move))
    add_masks(masks, end - begin, sums, digit)


@numba.njit(cache=True, nogil=True)
def _add_coarse(tables: Any, g: Any, windows: Any, masks: Any, sums: Any) -> None:
    """Adds |Q'|, without the far keypoints, under each coarse step of a group of views."""
    for digit in range(tables.begins.shape[1] - 1):
        begin, end = tables.begins[g, digit], tables.begins[g, digit + 1]
        _add_windows(windows, tables.cells[g], begin, end, 0, masks, sums, digit)


@numba.njit(cache=True, nogil=True)
def _room(texts: Any, documents: Any, query: Any) -> Any:
    """Enough for the masks of any of the documents and of so many of the query."""
    room = query
    for document in documents:
        room = max(room, texts.starts[document + 1] - texts.starts[document])
    return room + 8


@numba.njit(cache=True, nogil=True)
def sampled_shares(texts: Texts, documents: Any, tables: CoarseTables, shares: Any) -> None:
    """Writes to ``shares`` (K,) how well documents may fit, by the few keypoints that are looked at.

    That is the share of them that lie near the query's under the best coarse step.
    """
    room = _room(texts, documents, 0)
    x, y, places = np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room, np.uint32)
    masks, sums = np.empty((room, LANES), np.uint64), np.empty((DIGITS, LANES), np.uint64)
    for k in range(len(documents)):
        size = cells_of(texts, documents[k], x, y)
        few = (size + SAMPLED - 1) // SAMPLED
        for point in range(U(few)):
            x[point], y[point] = x[point * U(SAMPLED)], y[point * U(SAMPLED)]
        count = _flat(x, y, few, 0, 0, tables.half, places)
        best = 0
        for g in range(len(tables.masks)):
            sums[:] = U(0)
            _add_cells(tables.masks[g], places, count, masks, sums)
            best = max(best, largest(sums, ~U(0)))
        shares[k] = best / max(few, 1)


@numba.njit(cache=True, nogil=True)
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
    room, groups = _room(texts, documents, tables.cells.shape[1]), len(tables.masks)
    x, y, places = np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room, np.uint32)
    masks, sums = np.empty((room, LANES), np.uint64), np.empty((groups, DIGITS, LANES), np.uint64)
    promising = np.zeros(groups, np.bool_)
    for k in range(len(documents)):
        size = cells_of(texts, documents[k], x, y)
        count = _flat(x, y, size, 0, 0, tables.half, places)
        sums[:] = U(0)
        for g in range(groups):
            _add_cells(tables.masks[g], places, count, masks, sums[g])
            # if not even all of the query's keypoints would do, then nothing does
            promising[g] = some(at_least(sums[g], max(needed[k] - tables.size, 0)))
        best = -tables.far
        if promising.any():
            windows = coarse_bitmaps(x, y, size, scratch, places)
            for g in range(groups):
                if promising[g]:
                    _add_coarse(tables, g, windows, masks, sums[g])
                    best = max(best, largest(sums[g], ~U(0)))
        bounds[k] = best + tables.far


@numba.njit(cache=True, nogil=True)
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
    room = _room(texts, documents, max(tables.cells.shape[1], fine_tables.cells.shape[1]))
    x, y, places = np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room, np.uint32)
    masks, sums = np.empty((room, LANES), np.uint64), np.empty((DIGITS, LANES), np.uint64)
    for k in range(len(documents)):
        size = cells_of(texts, documents[k], x, y)
        coarse_view, fine_view = coarse_bitmaps(x, y, size, coarse, places), fine_bitmaps(x, y, size, fine)
        bounds[k] = 0
        for g in range(len(tables.masks)):
            sums[:] = U(0)
            count = _flat(x, y, size, 0, 0, tables.half, places)
            _add_cells(tables.masks[g], places, count, masks, sums)
            _add_coarse(tables, g, coarse_view, masks, sums)
            steps = at_least(sums, max(needed[k] - tables.far, 0))
            for block in range(16):  # of two by two steps
                i, j = block // 4, block % 4
                if some(steps & every(TWO_STEPS << U(16 * i + 2 * j))):
                    dx, dy = FIRST + 2 * STEP * i, FIRST + 2 * STEP * j
                    sums[:] = U(0)
                    count = _flat(x, y, size, dx, dy, tables.half, places)
                    _add_cells(fine_tables.masks[g], places, count, masks, sums)
                    cells = fine_tables.cells[g]
                    _add_windows(fine_view, cells, 0, len(cells), dy * FINE_SIDE + dx, masks, sums, 0)
                    bounds[k] = max(bounds[k], largest(sums, OF_A_BLOCK) + tables.far)
