"""The indexes that a server offers: of each the latest committed state, and what was made of that state."""

import threading
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import TypeVar
from zlib import crc32

import numpy as np

from m2t_text.errors import MapIndexError, QueryError
from m2t_text.index.map_index import MapIndex
from m2t_text.index.merging import indexes_in
from m2t_text.index.results import IndexInfo, Overview
from m2t_text.index.writing.folder import no_index, revision
from m2t_text.saved_maps.grid import Grid
from m2t_text.web.packing import Bytes, pack_places
from m2t_text.web.walls import walls_of, walls_of_image

Made = TypeVar("Made")


class Committed:
    """One committed state of an index. What is made of it is made once, and kept as long as it is the latest.

    Attributes:
        index: pinned to the state.
        revision: a different string for each state.
        images: of saved maps, by the dataset that was made of them.
    """

    def __init__(self, index: MapIndex, revision: str, images: Mapping[str, Grid] | None = None) -> None:
        self.index = index
        self.revision = revision
        self.images = images or {}
        self._made: dict[str, object] = {}
        self._lock = threading.RLock()

    @cached_property
    def info(self) -> IndexInfo:
        return self.index.info()

    @cached_property
    def overview(self) -> Overview:
        return self.index.overview()

    def slice_of(self, dataset: str) -> slice:
        """Where a dataset's maps lie in the overview. Raises QueryError if there is none of this name."""
        names = self.overview.names
        if dataset not in names:
            raise QueryError(self.index.lacking(dataset))
        code = names.index(dataset)
        begin, end = np.searchsorted(self.overview.codes, [code, code + 1]).tolist()
        return slice(begin, end)

    @property
    def places(self) -> Bytes:
        """Where all maps begin; see `pack_places`."""
        return self._once("places", lambda: pack_places(self.overview))

    def walls(self, dataset: str) -> Bytes:
        """What a dataset's maps saw, or its image, in the frame of its trajectory; see `walls_of`."""
        part = self.slice_of(dataset)
        if dataset in self.images:
            return self._once(f"walls {dataset}", lambda: walls_of_image(self.images[dataset]))
        return self._once(f"walls {dataset}", lambda: walls_of(self.index, self.overview, part))

    def _once(self, name: str, make: Callable[[], Made]) -> Made:
        with self._lock:
            if name not in self._made:
                self._made[name] = make()
            return self._made[name]  # type: ignore[return-value]


class Library:
    """The index of a folder and, if asked for, those that lie beside it. May be used by several threads.

    Attributes:
        path: of the index that is shown first; there need not be one yet.
        images: of saved maps, by the names of their datasets.
    """

    def __init__(self, path: Path, with_others: bool = False, images: Mapping[str, Grid] | None = None) -> None:
        self.path = path
        self.images = dict(images or {})
        self._with_others = with_others
        self._imaged = "".join(f" {crc32(grid.states.tobytes()):08x}" for grid in self.images.values())
        self._states: dict[str, Committed] = {}
        self._lock = threading.Lock()

    @property
    def others(self) -> list[Path]:
        """The folders of all indexes that may be named, but for the first."""
        if not self._with_others:
            return []
        beside = (Path(one.path) for one in indexes_in(self.path.parent))
        return [path for path in beside if path.name != self.path.name]

    def folder(self, name: str | None) -> Path:
        """The folder of an index by its name. Raises QueryError if there is none that may be named."""
        if name is None or name == self.path.name:
            return self.path
        for path in self.others:
            if path.name == name:
                return path
        raise QueryError(f"no index {name!r}; there is {self.path.name!r}")

    def latest(self, name: str | None = None) -> Committed:
        """The latest committed state of an index. Raises MapIndexError if there is none or it is damaged."""
        path = self.folder(name)
        current = revision(path)
        with self._lock:
            known = self._states.get(path.name)
            if current is None:
                self._states.pop(path.name, None)
                raise NoIndexError(str(no_index(path)))
            current += self._imaged  # what a browser has kept of other images is not shown
            if known is None or known.revision != current:
                known = Committed(MapIndex.open(path).pinned(), current, self.images)
                self._states[path.name] = known
            return known


class NoIndexError(MapIndexError):
    """A folder in which no index was made yet."""
