"""An occupancy grid in memory."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m2t_text.util.geometry import inverse, transform
from m2t_text.util.types import Floats

States = NDArray[np.int8]

FREE, OCCUPIED, UNKNOWN = 0, 1, -1


@dataclass(frozen=True)
class Grid:
    """A plane cut into square cells.

    Attributes:
        states: (rows, columns) int8, FREE, OCCUPIED or UNKNOWN; rows run along the grid's y axis, columns along
            its x axis.
        resolution: metres, side of a cell.
        origin: (3,) pose of the outer corner of cell (0, 0) in the map's frame; the grid's axes are its axes.
    """

    states: States
    resolution: float
    origin: Floats

    def to_cells(self, points: ArrayLike) -> Floats:
        """Points (N, 2) of the map's frame, metres, as (column, row) in units of cells."""
        return transform(inverse(self.origin), points) / self.resolution

    def to_map(self, cells: ArrayLike) -> Floats:
        """What `to_cells` takes, from what it gives."""
        return transform(self.origin, np.asarray(cells, dtype=float) * self.resolution)

    def centres(self, state: int) -> Floats:
        """(N, 2) centres of the cells of a state, in the map's frame, metres."""
        rows, columns = np.nonzero(self.states == state)
        return self.to_map(np.column_stack([columns, rows]) + 0.5)
