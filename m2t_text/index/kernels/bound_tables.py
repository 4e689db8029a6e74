"""What is made of a query once, so that its agreement with any map can be bounded; see `bounds`."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from m2t_text.index.kernels.bitmaps import COARSE, FINE
from m2t_text.index.kernels.simd import LANES
from m2t_text.index.kernels.views import Views
from m2t_text.util.compiling import kernel

U = np.uint64
STEP = 3  # offsets, in x and in y, that a coarse step takes together: eight steps span 24
WINDOW = 10  # cells; the largest offset that can be bounded
FIRST = -WINDOW - 1  # the least offset: the best view is moved by a cell in the end
LIMIT = 126  # cells; keypoints of the query beyond count as matched: the coarse grid must hold their partners
MARGIN = 14  # cells about the query in which a mask is not empty
BORDER = 24  # cells about those of the fine masks: by fewer do blocks of offsets move a cell
MOVED = 18  # cells from the first block to the last


class Masks(NamedTuple):
    """What a map's keypoint in each cell lies near, under eight by eight steps; see `_masks`.

    Four bytes, one for each view of a group, stand for eight steps in y; those of the steps in x follow each
    other. A mask is the 32 bytes from a place on. It is read some hundred times for each map, and so small that
    a core has it at hand.

    Attributes:
        half: cells from the middle to the border.
        rows: (G, R, LANES) uint8. The last sixteen are of what lies outside, and of nothing.
        step: cells in a step. Cells that lie so many apart follow each other, from the greatest x on.
        length: places of those.
        across: places from one y to the next.
    """

    half: int
    rows: NDArray[np.uint8]
    step: int
    length: int
    across: int


class CoarseTables(NamedTuple):
    """A query made ready for coarse bounds; its V views lie in the lanes of G groups.

    Attributes:
        masks: of coarse steps.
        size: number of the query's keypoints.
        far: of those beyond LIMIT.
        cells: (G, P, LANES) uint32 places in the coarse windows of the query's keypoints, one for each coarse
            cell.
        begins: (G, B + 1) where those begin that stand for 1, 2, 4, ... keypoints; filled up to eights.
    """

    masks: Masks
    size: int
    far: int
    cells: NDArray[np.uint32]
    begins: NDArray[np.int64]

    @classmethod
    def of(cls, seen: Views) -> "CoarseTables":
        """Of a query with keypoints."""
        near = _near(seen)
        x, y = seen.wx[:, near], seen.wy[:, near]
        far = int((~near).sum())
        reach = max(int(np.abs(x).max(initial=0)), int(np.abs(y).max(initial=0)))
        half = LIMIT - MARGIN if far else reach + MARGIN
        return cls(_masks(seen, half, far, FIRST, STEP), len(near), far, *_grouped(x, y))


class FineTables(NamedTuple):
    """What a query needs for fine bounds beside.

    Attributes:
        half: cells from the middle to the border's end.
        across: places from one y to the next.
        rows: (V, R) uint8 as those of coarse `Masks`, of fine steps and of each view by itself. Behind those of
            the cells follow as many of nothing as a block of offsets moves a place.
        cells: (V, P, LANES) uint32 places in the fine windows of the query's keypoints, LANES in each row,
            filled up to eight rows.
    """

    half: int
    across: int
    rows: NDArray[np.uint8]
    cells: NDArray[np.uint32]

    @classmethod
    def of(cls, seen: Views, coarse: CoarseTables) -> "FineTables":
        """Of a query with keypoints."""
        near = _near(seen)
        places = FINE.places(seen.wx[:, near], seen.wy[:, near])
        room = -(-places.shape[1] // (8 * LANES)) * 8 * LANES
        cells = np.full((len(places), room), FINE.empty, np.uint32)
        cells[:, : places.shape[1]] = places
        half = coarse.masks.half + BORDER
        length = 2 * half + MARGIN + 9
        table = _rows_by_group(seen, half, 0, 1, length).reshape(-1, 2 * half, length, LANES)
        if coarse.far:  # what lies beyond may match
            table[:, :BORDER] = table[:, -BORDER:] = 255
            table[:, :, :BORDER] = table[:, :, 2 * half - BORDER :] = 255
        of_views = table.reshape(-1, 2 * half * length, LANES).transpose(0, 2, 1)
        rows = np.zeros((len(places), 2 * half * length + MOVED * (length + 1) + 9), np.uint8)
        rows[:, : 2 * half * length] = of_views.reshape(-1, 2 * half * length)[: len(places)]
        return cls(half, length, rows, cells.reshape(len(places), -1, LANES))


def _near(seen: Views) -> NDArray[np.bool_]:
    near: NDArray[np.bool_] = np.maximum(np.abs(seen.wx), np.abs(seen.wy)).max(axis=0) <= LIMIT
    return near


def _masks(seen: Views, half: int, far: int, first: int, step: int) -> Masks:
    """Of each cell c: bit 8 i + j says whether a keypoint q is near it under steps i, j.

    That is, if c - q lies in [s - 1, s + step] with s = first + step i in x, and the same of j in y.
    """
    outside = 255 if far else 0
    length = (2 * half + MARGIN - first) // step + 9
    rows = _rows_by_group(seen, half, first, step, length)
    ends = np.repeat(np.array([outside, 0], np.uint8), 8 * LANES).reshape(1, 16, LANES)
    with_ends = np.concatenate([rows, np.repeat(ends, len(rows), axis=0)], axis=1)
    return Masks(half, with_ends, step, length, step * length)


def _rows_by_group(seen: Views, half: int, first: int, step: int, length: int) -> NDArray[np.uint8]:
    """(G, 2 half · step · length, LANES) the rows of all groups of views."""
    groups = range(0, len(seen.wx), LANES)
    return np.stack(
        [_rows(seen.wx[g : g + LANES], seen.wy[g : g + LANES], half, first, step, length) for g in groups]
    )


def _rows(
    x: NDArray[np.int64], y: NDArray[np.int64], half: int, first: int, step: int, length: int
) -> NDArray[np.uint8]:
    """(2 half · step · length, LANES) the `Masks.rows` of a group of views (V, Q), but for the last sixteen."""
    side, wide = 2 * half, 2 * (half + MARGIN)
    near, bits = np.zeros((wide, wide * LANES), np.uint8), np.zeros((wide, side * LANES), np.uint8)
    _fill_bits(np.ascontiguousarray(x), np.ascontiguousarray(y), half, first, step, near, bits)
    rows = np.zeros((length * step, side), np.uint32)  # the bytes of all lanes move together
    last = side - 1 + MARGIN - first  # where the first step in x takes the greatest x
    rows[: last + 1] = bits.view(np.uint32)[last::-1]
    ordered = np.ascontiguousarray(rows.reshape(length, step, side).transpose(2, 1, 0))
    return ordered.view(np.uint8).reshape(-1, LANES)


def _grouped(x: NDArray[np.int64], y: NDArray[np.int64]) -> tuple[NDArray[np.uint32], NDArray[np.int64]]:
    """The coarse cells of a `CoarseTables`, and where their parts begin."""
    steps = (WINDOW + 2) // STEP
    counted = [
        np.unique(row, return_counts=True) for row in COARSE.places(x // STEP - steps, y // STEP - steps)
    ]
    digits = max(int(count.max(initial=1)).bit_length() for _, count in counted)
    groups, begins = [], []
    for g in range(0, len(counted), LANES):
        views = counted[g : g + LANES]
        parts = [
            _in_lanes([place[count >> digit & 1 == 1] for place, count in views], COARSE.empty)
            for digit in range(digits)
        ]
        groups.append(np.concatenate(parts))
        begins.append(np.append(0, np.cumsum([len(part) for part in parts])))
    room = max(map(len, groups))
    return np.stack([_filled(group, room, COARSE.empty) for group in groups]), np.array(begins)


def _in_lanes(rows: list[NDArray[np.int64]], nothing: int) -> NDArray[np.uint32]:
    """(P, LANES) up to four rows side by side, filled up to eights with the place of nothing."""
    room = -(-max(map(len, rows)) // 8) * 8
    rows = [*rows, *[np.zeros(0, dtype=np.int64)] * (LANES - len(rows))]
    return np.stack([_filled(row, room, nothing) for row in rows], axis=1).astype(np.uint32)


def _filled(rows: NDArray[Any], room: int, nothing: int) -> NDArray[Any]:
    return np.concatenate([rows, np.full((room - len(rows), *rows.shape[1:]), nothing, rows.dtype)])


@kernel
def _fill_bits(x: Any, y: Any, half: Any, first: Any, step: Any, near: Any, bits: Any) -> None:
    """Fills ``bits``: bit j of (column, row) says what a mask does of a step in y; ``near`` is room to work in.

    Both are 0 at first; their columns begin MARGIN cells before the masks'.
    """
    side, wide = 2 * half, 2 * (half + MARGIN)
    middle = half + MARGIN
    for v in range(len(x)):
        for k in range(x.shape[1]):
            for column in range(max(x[v, k] + middle - 1, 0), min(x[v, k] + middle + step + 1, wide)):
                for row in range(max(y[v, k] + middle - 1, 0), min(y[v, k] + middle + step + 1, wide)):
                    near[column, row * LANES + v] = 1
    across = U(side * LANES)
    for column in range(U(wide)):
        for j in range(8):
            begin = U((MARGIN - first - step * j) * LANES)
            for k in range(across):
                bits[column, k] |= near[column, begin + k] << U(j)
