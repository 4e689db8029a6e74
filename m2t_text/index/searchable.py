"""What finding a place needs of an index, whether it lies in one folder or on many machines."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray
from whoosh.query import Query

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.index.results import DatasetSummary, Hit, IndexInfo

if TYPE_CHECKING:  # the compiled kernels are slow to import
    from m2t_text.index.search.weighting import MapWeighting, Method


class Searchable(Protocol):
    """The maps of any number of datasets, as `MapIndex` has them; its methods say more."""

    @property
    def path(self) -> Path | str:
        """What to call it in messages."""

    @property
    def parameters(self) -> Parameters:
        """With which all maps were described."""

    @property
    def missing_maps(self) -> int:
        """How many maps could not be searched."""

    def __len__(self) -> int: ...

    def pinned(self) -> "Searchable":
        """The same index at its latest state, which it keeps."""

    def search(
        self,
        text: Text,
        top: int = 10,
        exclude: tuple[str, float, float] | None = None,
        method: "Method" = "m2t",
        filter: Query | str | None = None,
        texts: bool = False,
        least: float = 0.0,
        wanted: Callable[[Hit], bool] | None = None,
    ) -> list[Hit]:
        """The best maps for a query's text, ordered by score, then by map id."""

    def find_document(self, map_id: str) -> Document | None:
        """The map of this id with its text; None if there is none."""

    def document(self, map_id: str) -> Document:
        """The map of this id. Raises QueryError if there is none."""

    def runs(self, dataset: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """(M,) the first scans of a dataset's maps, ascending, and (M,) the travel at which they begin."""

    def datasets(self) -> list[DatasetSummary]:
        """The datasets ordered by name."""

    def remove(self, *names: str) -> None:
        """Removes datasets with all their maps, all or none. Raises MapIndexError."""

    def lacking(self, dataset: str) -> str:
        """What to tell who names a dataset that the index does not hold."""

    def info(self) -> IndexInfo:
        """What the index holds and takes."""

    def parse(self, string: str) -> Query:
        """The Whoosh query of a string. Raises QueryError."""

    def model(self, method: "Method" = "m2t") -> "MapWeighting":
        """The weighting of the profile."""
