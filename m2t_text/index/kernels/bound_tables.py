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


class CoarseTables(NamedTuple):
    """A query made ready for coarse bounds; its V views lie in the lanes of G groups.

    Attributes:
        half: cells from the middle of a table to its border.
        masks: (G, 4 half² + 2, LANES) uint64 of a map's keypoint in each cell; see `_masks`. The last two
            are of what lies outside, and of nothing.
        size: number of the query's keypoints.
        far: of those beyond LIMIT.
        cells: (G, P, LANES) int64 places in the coarse windows of the query's keypoints, one for each coarse
            cell.
        begins: (G, B + 1) where those begin that stand for 1, 2, 4, ... keypoints; filled up to eights.
    """

    half: int
    masks: NDArray[np.uint64]
    size: int
    far: int
    cells: NDArray[np.int64]
    begins: NDArray[np.int64]

    @classmethod
    def of(cls, seen: Views) -> "CoarseTables":
        """Of a query with keypoints."""
        near = _near(seen)
        x, y = seen.wx[:, near], seen.wy[:, near]
        far = int((~near).sum())
        reach = max(int(np.abs(x).max(initial=0)), int(np.abs(y).max(initial=0)))
        half = LIMIT - MARGIN if far else reach + MARGIN
        return cls(half, _tables(seen, half, far, FIRST, STEP), len(near), far, *_grouped(x, y))


class FineTables(NamedTuple):
    """What a query needs for fine bounds beside.

    Attributes:
        masks: (G, 4 half² + 2, LANES) uint64, as those of the `CoarseTables`.
        cells: (G, P, LANES) int64 places in the fine windows of the query's keypoints, filled up to eights.
    """

    masks: NDArray[np.uint64]
    cells: NDArray[np.int64]

    @classmethod
    def of(cls, seen: Views, coarse: CoarseTables) -> "FineTables":
        """Of a query with keypoints."""
        near = _near(seen)
        places = FINE.places(seen.wx[:, near], seen.wy[:, near])
        cells = [_in_lanes(list(places[g : g + LANES]), FINE.empty) for g in range(0, len(places), LANES)]
        return cls(_tables(seen, coarse.half, coarse.far, 0, 1), np.stack(cells))


def _near(seen: Views) -> NDArray[np.bool_]:
    near: NDArray[np.bool_] = np.maximum(np.abs(seen.wx), np.abs(seen.wy)).max(axis=0) <= LIMIT
    return near


def _tables(seen: Views, half: int, far: int, first: int, step: int) -> NDArray[np.uint64]:
    """The masks of a bounder."""
    parts = [(seen.wx[g : g + LANES], seen.wy[g : g + LANES]) for g in range(0, len(seen.wx), LANES)]
    tables = np.stack([_masks(*part, half, first, step) for part in parts])
    tables[:, -2] = ~U(0) if far else U(0)
    return tables


def _grouped(x: NDArray[np.int64], y: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
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


def _in_lanes(rows: list[NDArray[np.int64]], nothing: int) -> NDArray[np.int64]:
    """(P, LANES) up to four rows side by side, filled up to eights with the place of nothing."""
    room = -(-max(map(len, rows)) // 8) * 8
    rows = [*rows, *[np.zeros(0, dtype=np.int64)] * (LANES - len(rows))]
    return np.stack([_filled(row, room, nothing) for row in rows], axis=1)


def _filled(rows: NDArray[np.int64], room: int, nothing: int) -> NDArray[np.int64]:
    return np.concatenate([rows, np.full((room - len(rows), *rows.shape[1:]), nothing)])


def _masks(x: NDArray[np.int64], y: NDArray[np.int64], half: int, first: int, step: int) -> NDArray[np.uint64]:
    """(4 half² + 2, LANES) for each cell c: bit 8 i + j says whether a keypoint q is near it under steps i, j.

    That is, if c - q lies in [s - 1, s + step] with s = first + step i in x, and the same of j in y. Lanes are
    of up to four views (V, Q).
    """
    side, wide = 2 * half, 2 * (half + MARGIN)
    near, bits = np.zeros((wide, wide * LANES), np.uint8), np.zeros((wide, side * LANES), np.uint8)
    masks = np.zeros((side * side + 2) * LANES, np.uint64)
    _fill_masks(np.ascontiguousarray(x), np.ascontiguousarray(y), half, first, step, near, bits, masks)
    return masks.reshape((side * side + 2, LANES))


@kernel
def _fill_masks(x: Any, y: Any, half: Any, first: Any, step: Any, near: Any, bits: Any, masks: Any) -> None:
    """Fills the ``masks``; ``near`` and ``bits`` are room to work in. All three are 0 at first."""
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
    for column in range(U(side)):
        begin = column * across
        for i in range(8):
            other = column + U(MARGIN - first - step * i)
            for k in range(across):
                masks[begin + k] |= U(bits[other, k]) << U(8 * i)
