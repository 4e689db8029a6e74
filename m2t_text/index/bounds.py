"""Upper bounds of the agreement, compiled: which maps cannot be among the best, without measuring them.

A map's score is the overlap at one offset of the viewpoints, so the largest overlap over all offsets bounds it.
Offsets are taken together: a 64 bit mask has one bit for each of eight steps in x times eight in y, and
says under which of them a keypoint lies near one of the other map. The masks of all keypoints are added, all 64
sums at once (``planes``). A coarse step stands for three offsets, and near is what is near under one of them;
where the coarse sums let a map through, the fine ones, a step for each offset, look at those offsets again:
branch and bound, as in scan matching (Olson, ICRA 2009; Hess et al., ICRA 2016).
"""

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from m2t_text.index.planes import DIGITS, add_masks, at_least, eight_bytes, largest
from m2t_text.index.texts import Texts
from m2t_text.index.unpacking import cells_of
from m2t_text.index.views import Views
from m2t_text.index.windows import COARSE, FINE, FINE_SIDE, Scratch, coarse_windows, fine_windows

U = np.uint64
STEP = 3  # offsets, in x and in y, that a coarse step takes together: eight steps span 24
WINDOW = 10  # cells; the largest offset that can be bounded
FIRST = -WINDOW - 1  # the least offset: the best view is moved by a cell in the end
TWO_STEPS = U(0x0303)  # the bits of two by two coarse steps, and
OF_A_BLOCK = U(0x00003F3F3F3F3F3F)  # of the six by six offsets in them
LIMIT = 126  # cells; keypoints of the query beyond count as matched: the coarse grid must hold their partners
MARGIN = 14  # cells about the query in which a mask is not empty
EMPTY = FINE.empty  # the place of nothing in the fine windows


class Bounder(NamedTuple):
    """A query made ready for bounds, in V views.

    Attributes:
        half: cells from the middle of a table to its border.
        coarse, fine: (V, 4 half² + 2) uint64 masks of a map's keypoint in each cell; see `_masks`. The last two
            are of what lies outside, and of nothing.
        far: number of the query's keypoints beyond LIMIT.
        groups: (V, G) int64 places in the coarse windows of the query's keypoints, one for each coarse cell.
        begins: (V, B + 1) where those begin that stand for 1, 2, 4, ... keypoints; filled up to eights.
        cells: (V, F) int64 places in the fine windows of the query's keypoints, filled up to eights.
    """

    half: int
    coarse: NDArray[np.uint64]
    fine: NDArray[np.uint64]
    far: int
    groups: NDArray[np.int64]
    begins: NDArray[np.int64]
    cells: NDArray[np.int64]

    @classmethod
    def of(cls, seen: Views) -> "Bounder":
        """Of a query with keypoints."""
        near = np.maximum(np.abs(seen.wx), np.abs(seen.wy)).max(axis=0) <= LIMIT
        x, y = seen.wx[:, near], seen.wy[:, near]
        far = int((~near).sum())
        reach = max(int(np.abs(x).max(initial=0)), int(np.abs(y).max(initial=0)))
        half = LIMIT - MARGIN if far else reach + MARGIN
        pairs = [
            (_masks(*cells, half, FIRST, STEP), _masks(*cells, half, 0, 1))
            for cells in zip(seen.wx, seen.wy, strict=True)
        ]
        coarse, fine = (np.stack(part) for part in zip(*pairs, strict=True))
        coarse[:, -2] = fine[:, -2] = ~U(0) if far else U(0)  # of what lies outside the table
        groups, begins = _grouped(x, y)
        places = FINE.places(x, y)
        filled = np.full((len(x), -(-places.shape[1] // 8) * 8), FINE.empty)
        filled[:, : places.shape[1]] = places
        return cls(half, coarse, fine, far, groups, begins, filled)


def _grouped(x: NDArray[np.int64], y: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The groups of a `Bounder`, and where their parts begin."""
    steps = (WINDOW + 2) // STEP
    counted = [
        np.unique(row, return_counts=True) for row in COARSE.places(x // STEP - steps, y // STEP - steps)
    ]
    digits = max(int(count.max(initial=1)).bit_length() for _, count in counted)
    rows, begins = [], []
    for place, count in counted:
        parts = [place[count >> digit & 1 == 1] for digit in range(digits)]
        parts = [np.append(part, np.full(-len(part) % 8, COARSE.empty)) for part in parts]
        rows.append(np.concatenate(parts))
        begins.append(np.append(0, np.cumsum([len(part) for part in parts])))
    table = np.full((len(rows), max(map(len, rows))), COARSE.empty)
    for row, places in zip(table, rows, strict=True):
        row[: len(places)] = places
    return table, np.array(begins)


@numba.njit(cache=True, nogil=True)
def _masks(x: Any, y: Any, half: Any, first: Any, step: Any) -> Any:
    """(4 half² + 2,) for each cell c: bit 8 i + j says whether a keypoint q is near it under steps i and j.

    That is, if c - q lies in [s - 1, s + step] with s = first + step i in x, and the same of j in y.
    """
    side, wide = 2 * half, 2 * (half + MARGIN)
    near = np.zeros((wide, wide), np.uint8)
    middle = half + MARGIN
    for k in range(len(x)):
        for column in range(max(x[k] + middle - 1, 0), min(x[k] + middle + step + 1, wide)):
            for row in range(max(y[k] + middle - 1, 0), min(y[k] + middle + step + 1, wide)):
                near[column, row] = 1
    bits = np.zeros((wide, side), np.uint8)
    for j in range(8):
        first_row = MARGIN - first - step * j
        for column in range(wide):
            for row in range(side):
                bits[column, row] |= near[column, row + first_row] << j
    masks = np.zeros(side * side + 2, np.uint64)
    for i in range(8):
        first_column = MARGIN - first - step * i
        for column in range(side):
            for row in range(side):
                masks[column * side + row] |= U(bits[column + first_column, row]) << U(8 * i)
    return masks


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
def _add_cells(table: Any, places: Any, count: Any, masks: Any, planes: Any) -> None:
    """Adds the table's masks of places."""
    for k in range(U(count)):
        masks[k] = table[places[k]]
    add_masks(masks, count, planes, 0)


@numba.njit(cache=True, nogil=True)
def _coarse_sums(bounder: Any, v: Any, places: Any, count: Any, windows: Any, masks: Any, planes: Any) -> None:
    """|Q'| + |M'| at most, without the far keypoints, under each coarse step of a view."""
    planes[:] = U(0)
    _add_cells(bounder.coarse[v], places, count, masks, planes)
    for digit in range(bounder.begins.shape[1] - 1):
        begin, end = bounder.begins[v, digit], bounder.begins[v, digit + 1]
        for k in range(end - begin):
            masks[U(k)] = eight_bytes(windows, bounder.groups[v, begin + k])
        add_masks(masks, end - begin, planes, digit)


@numba.njit(cache=True, nogil=True)
def _fine_sums(
    bounder: Any, v: Any, dx: Any, dy: Any, places: Any, count: Any, windows: Any, masks: Any, planes: Any
) -> None:
    """|Q'| + |M'|, without the far keypoints, under each of 8 x 8 offsets from (dx, dy) on of a view."""
    planes[:] = U(0)
    _add_cells(bounder.fine[v], places, count, masks, planes)
    count = bounder.cells.shape[1]
    move = dy * FINE_SIDE + dx
    for k in range(count):
        place = bounder.cells[v, k]
        masks[U(k)] = eight_bytes(windows, place if place == EMPTY else place + move)
    add_masks(masks, count, planes, 0)


@numba.njit(cache=True, nogil=True)
def _room(texts: Any, documents: Any, bounder: Any) -> Any:
    """Enough for the masks of any of the documents and of the query."""
    room = max(bounder.groups.shape[1], bounder.cells.shape[1])
    for document in documents:
        room = max(room, texts.starts[document + 1] - texts.starts[document])
    return room + 8


@numba.njit(cache=True, nogil=True)
def coarse_bounds(texts: Texts, documents: Any, bounder: Bounder, scratch: Scratch, bounds: Any) -> None:
    """What |Q'| + |M'| of `agreement.agree` cannot exceed.

    Args:
        texts: of a segment.
        documents: (K,) int64 their numbers.
        scratch: of COARSE.
        bounds: (K,) int32 result.
    """
    room = _room(texts, documents, bounder)
    x, y, places = np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room, np.uint32)
    masks, planes = np.empty(room, np.uint64), np.empty(DIGITS, np.uint64)
    for k in range(len(documents)):
        size = cells_of(texts, documents[k], x, y)
        windows = coarse_windows(x, y, size, scratch)
        count = _flat(x, y, size, 0, 0, bounder.half, places)
        best = 0
        for v in range(len(bounder.coarse)):
            _coarse_sums(bounder, v, places, count, windows, masks, planes)
            best = max(best, largest(planes, ~U(0)))
        bounds[k] = best + bounder.far


@numba.njit(cache=True, nogil=True)
def fine_bounds(
    texts: Texts, documents: Any, bounder: Bounder, needed: Any, coarse: Scratch, fine: Scratch, bounds: Any
) -> None:
    """The same, tighter, where it matters: only offsets whose coarse bound reaches what is ``needed`` count.

    Args:
        needed: (K,) int32 the least |Q'| + |M'| of interest, 1 or more.
        coarse, fine: scratch of COARSE and of FINE.
        bounds: (K,) int32 result, 0 where no coarse bound reaches it.
    """
    room = _room(texts, documents, bounder)
    x, y, places = np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room, np.uint32)
    masks, planes = np.empty(room, np.uint64), np.empty(DIGITS, np.uint64)
    for k in range(len(documents)):
        size = cells_of(texts, documents[k], x, y)
        coarse_view, fine_view = coarse_windows(x, y, size, coarse), fine_windows(x, y, size, fine)
        bounds[k] = 0
        for v in range(len(bounder.coarse)):
            count = _flat(x, y, size, 0, 0, bounder.half, places)
            _coarse_sums(bounder, v, places, count, coarse_view, masks, planes)
            steps = at_least(planes, max(needed[k] - bounder.far, 0))
            for block in range(16):  # of two by two steps
                i, j = block // 4, block % 4
                if steps >> U(16 * i + 2 * j) & TWO_STEPS:
                    dx, dy = FIRST + 2 * STEP * i, FIRST + 2 * STEP * j
                    count = _flat(x, y, size, dx, dy, bounder.half, places)
                    _fine_sums(bounder, v, dx, dy, places, count, fine_view, masks, planes)
                    bounds[k] = max(bounds[k], largest(planes, OF_A_BLOCK) + bounder.far)
