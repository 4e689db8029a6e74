"""An index on disk: opening, committing, reading back and searching."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from whoosh import index as whoosh_index
from whoosh.qparser import QueryParser
from whoosh.qparser.common import QueryParserError
from whoosh.query import NullQuery, Query

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.errors import MapIndexError, QueryError
from m2t_text.index.folder import create_whoosh, open_whoosh, sweep
from m2t_text.index.mapped import MapCodec
from m2t_text.index.results import DatasetSummary, Hit, IndexInfo
from m2t_text.index.state import State
from m2t_text.index.writing import MapWriter, refused

if TYPE_CHECKING:  # the compiled kernel is slow to import, and only searching needs it
    from m2t_text.index.weighting import MapWeighting, Method, Scores

LOCK_SECONDS = 2.0  # to wait for another writer


class MapIndex:
    """The maps of any number of datasets, described with the same parameters, in one folder.

    Every call sees one committed state, the latest. Use `create` or `open`.
    """

    def __init__(self, path: Path, whoosh: Any, parameters: Parameters) -> None:
        self.path = path
        self.parameters = parameters
        self.whoosh = whoosh
        self._state: State | None = None

    @classmethod
    def create(cls, path: str | Path, parameters: Parameters) -> "MapIndex":
        """A new, empty index in a folder that is made, is empty, or was left half made.

        Raises:
            MapIndexError: if the folder holds an index or anything else, or cannot be written.
        """
        create_whoosh(Path(path), parameters)
        return cls.open(path)

    @classmethod
    def open(cls, path: str | Path, parameters: Parameters | None = None) -> "MapIndex":
        """The index in a folder.

        Raises:
            MapIndexError: if there is none, or it is of another kind, version, or other parameters.
        """
        folder = Path(path)
        whoosh, stored = open_whoosh(folder)
        if parameters is not None and parameters != stored:
            raise MapIndexError(
                f"the index in {folder} was made with other parameters (profile {stored.profile!r}, asked for "
                f"{parameters.profile!r}); choose another folder or profile"
            )
        return cls(folder, whoosh, stored)

    @contextmanager
    def writer(self) -> Iterator[MapWriter]:
        """Changes that are committed together when the block ends, or not at all if it raises.

        Raises:
            MapIndexError: if another process keeps writing, or the disk refuses.
        """
        try:
            whoosh = self.whoosh.writer(timeout=LOCK_SECONDS, codec=MapCodec())
            sweep(self.path)
        except whoosh_index.LockError as error:
            raise MapIndexError(f"{self.path} is being written by another process; try again later") from error
        except OSError as error:
            raise refused(self.path, error) from error
        try:
            writer = MapWriter(whoosh, self.path)
            yield writer
            writer.commit()
        finally:
            if not whoosh.is_closed:
                whoosh.cancel()

    def replace(self, name: str, documents: Iterable[Document], drive: tuple[int, float] | None = None) -> None:
        """These documents instead of all that the dataset had, in one commit; see `MapWriter.replace`."""
        with self.writer() as writer:
            writer.replace(name, documents, drive)

    def optimize(self) -> None:
        """Merges all segments into one."""
        with self.writer() as writer:
            writer.optimize = True

    def __len__(self) -> int:
        return len(self._current())

    @property
    def ids(self) -> list[str]:
        """The ids of all maps, sorted."""
        return self._current().ids

    def document(self, map_id: str) -> Document:
        """The map of this id, exactly as it was indexed. An id that the index lacks is a QueryError."""
        document = self._current().document(map_id)
        if document is None:
            raise QueryError(f"no map {map_id!r} in {self.path}")
        return document

    def documents(self, dataset: str | None = None) -> Iterator[Document]:
        """The maps of a dataset, or all, ordered by id."""
        for place in self._current().places():
            if dataset is None or place.dataset == dataset:
                yield place.document(text=True)

    def datasets(self) -> list[DatasetSummary]:
        """The datasets ordered by name."""
        state = self._current()
        drives = state.searcher.schema["text"].drives
        return [DatasetSummary(name, maps, *drives[name]) for name, maps in state.maps().items()]

    def info(self) -> IndexInfo:
        """What the index holds and takes."""
        state = self._current()
        size = sum(file.stat().st_size for file in self.path.iterdir() if file.is_file())
        return IndexInfo(self.path, self.parameters, len(state), state.keypoints, size, self.datasets())

    def search(
        self,
        text: Text,
        top: int = 10,
        exclude: tuple[str, float, float] | None = None,
        method: "Method" = "m2t",
        filter: Query | str | None = None,
    ) -> list[Hit]:
        """The best maps for a query's text; equal scores are ordered by map id.

        Args:
            text: of the query map.
            top: so many hits at most, all with a match; 0 for every map, those without a match last at score 0.
            exclude: (dataset, travel, metres): leave out its maps whose middle is not more than this away.
            method: with the pose words, or the paper's baseline without.
            filter: of Whoosh, or in its query language: ``dataset:NAME AND travel:[10 TO 20]``.

        Raises:
            QueryError: if the filter is not in the query language.
        """
        state, model = self._current(), self.model(method)
        allowed = [leaf.live for leaf in state.leaves]
        if exclude is not None:
            dataset, travel, metres = exclude
            near = [
                leaf.of_dataset(dataset) & (np.abs(leaf.middles - travel) <= metres) for leaf in state.leaves
            ]
            allowed = [live & ~out for live, out in zip(allowed, near, strict=True)]
        if filter is not None:
            matching = state.matching(self.parse(filter) if isinstance(filter, str) else filter)
            allowed = [live & match for live, match in zip(allowed, matching, strict=True)]
        places, scores = state.best(text, model, top, allowed)
        ids = [place.map_id for place in places]
        ranked = sorted(range(len(ids)), key=lambda k: (-scores.score[k], ids[k]))
        cell = self.parameters.mapping.cell
        return [
            Hit(
                places[k].document(),
                float(scores.score[k]),
                int(scores.matched[k]),
                scores.alignment[k] * [cell, cell, 1.0],
            )
            for k in ranked[: top or None]
        ]

    def scores(self, text: Text, method: "Method" = "m2t") -> "Scores":
        """The scores of all maps at once, in the order of `ids`."""
        return self._current().scores(text, self.model(method))

    def model(self, method: "Method" = "m2t") -> "MapWeighting":
        """The weighting of this index's profile."""
        from m2t_text.index.weighting import MapWeighting

        return MapWeighting.of(self.parameters.matching, method)

    def searcher(self, method: "Method" = "m2t") -> Any:
        """A Whoosh searcher of the latest state, for queries of any kind; to be closed by the caller."""
        return self.whoosh.searcher(weighting=self.model(method))

    def parse(self, string: str) -> Query:
        """The Whoosh query of a string; a bare token is looked up in the maps' texts.

        Raises:
            QueryError: saying what is wrong with it.
        """
        try:
            query = QueryParser("text", self.whoosh.schema).parse(string)
        except QueryParserError as error:
            raise QueryError(f"{string!r} is not a query: {error}") from error
        broken = [leaf.error for leaf in query.leaves() if leaf.error is not None]
        if broken or query is NullQuery:
            raise QueryError(f"{string!r} is not a query: {broken[0] if broken else 'it is empty'}")
        return query

    def _current(self) -> State:
        """The latest committed state. It is opened anew after each commit: Whoosh's refresh mixes states up."""
        state = self._state
        if state is None or not state.searcher.up_to_date():
            state = self._state = State(self.whoosh.searcher())
        return state
