"""A saved map as a source of local maps."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from m2t_text.config import Parameters
from m2t_text.description.source import Described
from m2t_text.errors import MapFileError
from m2t_text.pipeline import describe_all
from m2t_text.saved_maps.grid import Grid
from m2t_text.saved_maps.reading import read_map
from m2t_text.saved_maps.sampling import CLEARANCE, Sampler, distinct_views
from m2t_text.util.names import checked_name, dataset_name
from m2t_text.util.types import StageProgress


@dataclass(frozen=True)
class SavedMap:
    """A saved map: one local map for each of the views that are sampled over its free space.

    The number in a map's id counts the views. Nobody drove: there are no scans, and all travel is 0.
    """

    name: str
    grid: Grid
    warnings: tuple[str, ...] = ()

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
        return Described(describe_all(maps, np.arange(len(views)), self.name, parameters, jobs, tell), (0, 0.0))
