"""Free tokens ``x<int>_y<int>_f<int>``: squares of cells that were seen to be free, and what they cover."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m2t_text.errors import TextError

Cells = NDArray[np.int64]
Mask = NDArray[np.bool_]

MIN_SIDE, MAX_SIDE = 4, 1023  # cells; side of a square: smaller ones would make a text long and say little
CELL_RANGE = range(-2048, 2048)  # of squares, which are rasterised: a text must not claim the world


class CellGrid(NamedTuple):
    """Cells of the plane that have some property.

    Attributes:
        x, y: the cell of ``cells[0, 0]``.
        cells: (W, H) along x and y; what lies outside does not have it.
    """

    x: int
    y: int
    cells: Mask

    def holds(self, positions: ArrayLike) -> Mask:
        """(N,) which positions (N, 2), in units of cells, lie in such a cell."""
        x, y = np.floor(np.asarray(positions, dtype=float)).astype(np.int64).T - [[self.x], [self.y]]
        inside = (x >= 0) & (y >= 0) & (x < self.cells.shape[0]) & (y < self.cells.shape[1])
        inside[inside] = self.cells[x[inside], y[inside]]
        return inside


@dataclass(frozen=True)
class FreeSquares:
    """Squares of free cells, ordered by (size, wx, wy). They may overlap.

    Attributes:
        wx, wy: (F,) int16, the cell of the lower corner: the square holds those from wx to wx + size - 1, and
            from wy to wy + size - 1.
        size: (F,) int16, side in cells, at least 4.
    """

    wx: NDArray[np.int16]
    wy: NDArray[np.int16]
    size: NDArray[np.int16]

    @classmethod
    def of(cls, wx: ArrayLike, wy: ArrayLike, size: ArrayLike) -> "FreeSquares":
        """Squares in the fixed order. One too small, too large or too far away is a TextError."""
        x, y, side = (np.atleast_1d(np.asarray(values, dtype=np.int64)) for values in (wx, wy, size))
        if side.size and not (side.min() >= MIN_SIDE and side.max() <= MAX_SIDE):
            raise TextError(f"a free square's side is not within {MIN_SIDE}…{MAX_SIDE} cells")
        if side.size and not (
            min(x.min(), y.min()) >= CELL_RANGE[0]
            and max((x + side).max(), (y + side).max()) <= CELL_RANGE.stop
        ):
            raise TextError(f"a free square is not within {CELL_RANGE[0]}…{CELL_RANGE[-1]} cells")
        order = np.lexsort((y, x, side))
        return cls(*(values[order].astype(np.int16) for values in (x, y, side)))

    def __len__(self) -> int:
        return len(self.size)

    def __str__(self) -> str:
        return " ".join(f"x{x}_y{y}_f{f}" for x, y, f in zip(self.wx, self.wy, self.size, strict=True))

    @cached_property
    def grid(self) -> CellGrid:
        """The cells that the squares cover."""
        if not len(self):
            return CellGrid(0, 0, np.zeros((0, 0), dtype=np.bool_))
        x, y, end_x, end_y = self._bounds()
        low_x, low_y = int(x.min()), int(y.min())
        cells = np.zeros((int(end_x.max()) - low_x, int(end_y.max()) - low_y), dtype=np.bool_)
        corners = np.stack([x - low_x, y - low_y, end_x - low_x, end_y - low_y], axis=1)
        for left, low, right, high in corners.tolist():
            cells[left:right, low:high] = True
        return CellGrid(low_x, low_y, cells)

    @property
    def valid(self) -> bool:
        """Whether the arrays are what `of` makes; those of a damaged index may not be."""
        arrays = (self.wx, self.wy, self.size)
        if not all(array.dtype == np.int16 and array.shape == (len(self.size),) for array in arrays):
            return False
        x, y, side = (values.astype(np.int64) for values in (self.wx, self.wy, self.size))
        within = (np.minimum(x, y) >= CELL_RANGE[0]) & (np.maximum(x, y) + side <= CELL_RANGE.stop)
        return bool((within & (side >= MIN_SIDE) & (side <= MAX_SIDE)).all() and (np.diff(side) >= 0).all())

    def covers(self, positions: ArrayLike) -> Mask:
        """(N,) which positions (N, 2), in units of cells in the map's own frame, lie in a square."""
        return self.grid.holds(positions)

    def turned(self, quarters: int) -> "FreeSquares":
        """The squares turned counter-clockwise about the origin by so many quarter turns. Exact."""
        x, y, side = (values.astype(np.int64) for values in (self.wx, self.wy, self.size))
        for _ in range(quarters % 4):
            x, y = -y - side, x
        return FreeSquares.of(x, y, side)

    def _bounds(self) -> tuple[Cells, Cells, Cells, Cells]:
        """Least x and y, and those just beyond the greatest, of each square (F,)."""
        x, y, side = (values.astype(np.int64) for values in (self.wx, self.wy, self.size))
        return x, y, x + side, y + side


NO_SQUARES = FreeSquares.of([], [], [])
