"""A saved map as a source of local maps."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from m2t_text.config import Parameters
from m2t_text.description.source import Described
from m2t_text.errors import MapFileError
from m2t_text.pipeline import describe_all
from m2t_text.saved_maps.grid import FREE, OCCUPIED, UNKNOWN, Grid
from m2t_text.saved_maps.reading import CELLS, read_map
from m2t_text.saved_maps.sampling import CHUNK, CLEARANCE, Sampler, distinct_views
from m2t_text.util.names import checked_name, dataset_name
from m2t_text.util.types import StageProgress

FREE_UP_TO, OCCUPIED_FROM = 25, 65  # of 100; map_server's thresholds


@dataclass(frozen=True)
class SavedMap:
    """A saved map: one local map for each of the views that are sampled over its free space.

    The number in a map's id counts the views. There is no drive: no scans, and all travel is 0.
    """

    name: str
    grid: Grid
    warnings: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        cells: ArrayLike,
        resolution: float,
        origin: ArrayLike = (0.0, 0.0, 0.0),
        name: str = "map",
    ) -> "SavedMap":
        """The map of cells in memory, as ROS's OccupancyGrid has them.

        Args:
            cells: (rows, columns) from 0, free, to 100, occupied; -1 where unknown. Rows run along y.
            resolution: metres, side of a cell.
            origin: (3,) pose of the outer corner of cell (0, 0) in the map's frame.
            name: of the dataset.

        Raises:
            MapFileError: if it is no map.

        Examples:
            >>> import m2t_text as m2t
            >>> m2t.SavedMap.of([[0, 100], [-1, 0]], 0.05).grid.states.tolist()
            [[0, 1], [-1, 0]]
        """
        values, pose = np.asarray(cells), np.asarray(origin, dtype=float)
        if values.ndim != 2 or not values.size or values.size > CELLS or values.dtype.kind not in "iu":
            raise MapFileError(f"a map has rows of whole numbers, up to {CELLS:,} in all")
        if not 0.001 <= resolution <= 10.0 or pose.shape != (3,) or not np.isfinite(pose).all():
            raise MapFileError("a map has a resolution of 0.001 to 10 m, and an origin x, y, theta")
        states = np.full(values.shape, UNKNOWN, dtype=np.int8)
        states[(values >= 0) & (values <= FREE_UP_TO)] = FREE
        states[(values >= OCCUPIED_FROM) & (values <= 100)] = OCCUPIED
        return cls(checked_name(name), Grid(states, float(resolution), pose))

    @classmethod
    def read(cls, path: Path, name: str | None = None) -> "SavedMap":
        """The map of a YAML file. Raises MapFileError with one line."""
        checked = dataset_name(path) if name is None else checked_name(name)
        grid, warnings = read_map(path)
        return cls(checked, grid, warnings)

    def describe(self, parameters: Parameters, jobs: int, tell: StageProgress) -> Described:
        """Its maps, at least one. Raises MapFileError if nothing is to be seen from its free space."""
        sampler = Sampler.of(self.grid, parameters.mapping)
        views = distinct_views(sampler, jobs, partial(tell, "views"))
        if not len(views):
            raise MapFileError(
                f"{self.name}: no wall is to be seen from any free cell that is {CLEARANCE:g} m away from all "
                "occupied ones; are resolution, thresholds and negate right?"
            )
        maps = partial(sampler.local_maps, views)
        chunks = np.split(np.arange(len(views)), range(CHUNK, len(views), CHUNK))
        return Described(describe_all(maps, chunks, self.name, parameters, jobs, tell), (0, 0.0))
