"""An index on disk: opening, committing, reading back and searching."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from whoosh.query import Query

from m2t_text.config import PROFILES, Parameters
from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.errors import DamageError, MapIndexError, QueryError, listed
from m2t_text.index.query_language import parse_query
from m2t_text.index.ranking import Recent, are_wanted, hits_at
from m2t_text.index.results import DatasetSummary, Hit, IndexInfo, Overview, best_first
from m2t_text.index.snapshot import Snapshot
from m2t_text.index.writing.folder import (
    check_new,
    create_whoosh,
    damage_errors,
    holds_index,
    is_empty,
    open_whoosh,
)
from m2t_text.index.writing.map_writer import MapWriter, open_writer, other_parameters
from m2t_text.util.types import StageProgress
from m2t_text.util.workers import threaded

if TYPE_CHECKING:  # the compiled kernel is slow to import, and only searching needs it
    from m2t_text.description.source import Source
    from m2t_text.index.search.collection import Statistics
    from m2t_text.index.search.weighting import MapWeighting, Method, Scores

LOCK_SECONDS = 60.0  # to wait for another writer


class MapIndex:
    """The maps of any number of datasets, described with the same parameters, in one folder.

    Every call sees one committed state, the latest. Use `open`, `create`, or `open_index` for either.

    Examples:
        >>> import m2t_text as m2t
        >>> index = m2t.MapIndex.open("indexes/default")
        >>> index.document("drive/000040").last_scan > 40
        True
        >>> [(dataset.name, dataset.scans) for dataset in index.datasets()]
        [('drive', 242)]
    """

    def __init__(self, path: Path, whoosh: Any, parameters: Parameters) -> None:
        """``whoosh`` is None where the index is to be made by the first commit; see `open_index`."""
        self.path = path
        self.parameters = parameters
        self._whoosh = whoosh
        self._snapshot: Snapshot | None = None
        self._pinned = False
        self._recent: Recent | None = None  # of an index that is pinned

    def __repr__(self) -> str:
        try:
            held = f"{len(self):,} maps" if holds_index(self.path) else "not made yet"
        except MapIndexError:
            held = "unreadable"
        return f"MapIndex({str(self.path)!r}, {held}, {self.parameters.profile})"

    @property
    def whoosh(self) -> Any:
        """The Whoosh index. Raises MapIndexError if it was not made yet."""
        if self._whoosh is None:
            self._whoosh, self.parameters = open_whoosh(self.path)
        return self._whoosh

    @classmethod
    def create(cls, path: str | Path, parameters: Parameters) -> "MapIndex":
        """A new, empty index in a folder that is made, is empty, or was left half made.

        Raises:
            MapIndexError: if the folder holds an index or anything else, or cannot be written.
        """
        create_whoosh(Path(path), parameters, LOCK_SECONDS)
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
            if not is_empty(whoosh):
                raise other_parameters(folder, stored, parameters)
            stored = parameters  # they are the index's with its first maps
        return cls(folder, whoosh, stored)

    @property
    def missing_maps(self) -> int:
        """None: a search is of all maps, or fails."""
        return 0

    def pinned(self) -> "MapIndex":
        """The same index at its latest committed state, which it keeps whatever is committed later.

        It also remembers what was found: searches for places next to each other become quicker, not different.
        """
        pinned = MapIndex(self.path, self.whoosh, self.parameters)
        with self._reading() as snapshot:
            pinned._snapshot, pinned._pinned = snapshot, True
        pinned._recent = self._recent or Recent()
        return pinned

    @contextmanager
    def writer(self) -> Iterator[MapWriter]:
        """Changes that are committed together when the block ends, or not at all if it raises.

        Raises:
            MapIndexError: if another process keeps writing, or the disk refuses.
        """
        if self._whoosh is None and not holds_index(self.path):
            try:
                create_whoosh(self.path, self.parameters, LOCK_SECONDS)
            except MapIndexError:
                if not holds_index(self.path):  # else another process was quicker
                    raise
        with open_writer(self.path, self.parameters, LOCK_SECONDS) as writer:
            yield writer

    def add(self, source: "Source", jobs: int = 1, progress: "StageProgress | None" = None) -> None:
        """Describes every local map of a source and puts them into the index as one dataset, in one commit.

        A dataset of the source's name that the index holds is replaced.

        Args:
            source: see `open_source`. The ground truth of a log is not used.
            jobs: processes that describe maps.
            progress: called with (stage, done, total).

        Raises:
            SourceError: if there is no map in it.
            MapIndexError: if another process keeps writing, or the disk refuses.

        Examples:
            >>> import m2t_text as m2t
            >>> index = m2t.open_index("indexes/new")
            >>> index.add(m2t.open_source("drive.log"))
            >>> index.add(m2t.LogSource(m2t.simulate(m2t.Simulation(length=24.0, travel=8.0))))
            >>> [dataset.name for dataset in index.datasets()]
            ['drive', 'simulated-0']
        """
        described = source.describe(self.parameters, jobs, progress or (lambda stage, done, of: None))
        self.replace(source.name, described.documents, described.drive)

    def replace(self, name: str, documents: Iterable[Document], drive: tuple[int, float] | None = None) -> None:
        """These documents instead of all that the dataset had, in one commit; see `MapWriter.replace`."""
        with self.writer() as writer:
            writer.replace(name, documents, drive)

    def append(self, name: str, documents: Iterable[Document], instead_of: Iterable[Document] = ()) -> None:
        """These documents besides those that the dataset has, in one commit, as of an unfinished drive.

        Others may search meanwhile. A commit costs as much for one map as for a hundred: collect some.

        Args:
            name: of the dataset; it is made with its first maps.
            documents: in the order of their first scans, all after those of the dataset.
            instead_of: maps of any datasets that are removed in the same commit.

        Raises:
            MapIndexError: if a document cannot be kept, or does not come after those before it; nothing is
                added then.

        Examples:
            >>> import m2t_text as m2t
            >>> documents = list(m2t.MapIndex.open("indexes/default").documents("drive"))
            >>> index = m2t.open_index("indexes/new")
            >>> index.append("drive", documents[:30])
            >>> index.append("drive", documents[30:])
            >>> len(index) == len(documents)
            True
        """
        with self.writer() as writer:
            latest = MapIndex(self.path, self.whoosh, self.parameters)  # be this one pinned; nobody writes now
            with latest._reading() as snapshot:
                last = snapshot.last_scan(name)
            for map_ in instead_of:
                writer.remove_map(map_)
            writer.append(name, documents, last)

    def remove(self, *names: str) -> None:
        """Removes datasets with all their maps, in one commit.

        Raises:
            MapIndexError: if the index lacks one of them; nothing is removed then.

        Examples:
            >>> import m2t_text as m2t
            >>> m2t.open_index("indexes/default").remove("drives")
            Traceback (most recent call last):
            m2t_text.errors.MapIndexError: no dataset 'drives' in indexes/default; it holds drive
        """
        held = [dataset.name for dataset in self.datasets()]
        for name in names:
            if name not in held:
                raise MapIndexError(self.lacking(name))
        with self.writer() as writer:
            for name in dict.fromkeys(names):
                writer.remove(name)

    def optimize(self, progress: Callable[[int, int], None] | None = None) -> None:
        """Merges all segments into one without deletions; ``progress`` is called with (maps done, total)."""
        maps = len(self)
        with self.writer() as writer:
            writer.optimize = True
            if progress is not None:
                writer.progress = lambda done: progress(done, maps)

    def __len__(self) -> int:
        with self._reading() as snapshot:
            return len(snapshot)

    @property
    def ids(self) -> list[str]:
        """The ids of all maps, sorted."""
        with self._reading() as snapshot:
            return snapshot.ids

    def find_document(self, map_id: str) -> Document | None:
        """The map of this id with its text; None if there is none."""
        with self._reading() as snapshot:
            address = snapshot.address(map_id)
            return None if address is None else address.document(text=True)

    def runs(self, dataset: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """(M,) the first scans of a dataset's maps, ascending, and (M,) the travel at which they begin, metres;
        both empty if the index lacks the dataset."""
        with self._reading() as snapshot:
            return snapshot.runs(dataset)

    def document(self, map_id: str) -> Document:
        """The map of this id, exactly as it was indexed. An id that the index lacks is a QueryError."""
        document = self.find_document(map_id)
        if document is None:
            raise QueryError(f"no map {map_id!r} in {self.path}")
        return document

    def documents(self, dataset: str | None = None) -> Iterator[Document]:
        """The maps of a dataset, or all, ordered by id."""
        with self._reading() as snapshot:
            for address in snapshot.addresses():
                if dataset is None or address.dataset == dataset:
                    yield address.document(text=True)

    def overview(self) -> Overview:
        """All maps without their texts, as arrays."""
        with self._reading() as snapshot:
            return snapshot.overview

    def numbered(self, numbers: Iterable[int]) -> Iterator[Document]:
        """The maps of these numbers, which an `overview` of the same state gave; pin the index before."""
        with self._reading() as snapshot:
            for number in numbers:
                yield snapshot.numbered(number)

    def matching(self, query: Query | str) -> NDArray[np.bool_]:
        """(M,) which maps match a query of Whoosh, or in its query language, in the order of `overview`.

        Raises:
            QueryError: if it is not in the query language.

        Examples:
            >>> import m2t_text as m2t
            >>> index = m2t.MapIndex.open("indexes/default")
            >>> int(index.matching("first_scan:[40 TO 49]").sum())
            10
        """
        parsed = self.parse(query) if isinstance(query, str) else query
        with self._reading() as snapshot:
            found = np.concatenate([np.zeros(0, dtype=np.bool_), *snapshot.matching(parsed)])
            matches: NDArray[np.bool_] = found[snapshot.overview.numbers]
            return matches

    def datasets(self) -> list[DatasetSummary]:
        """The datasets ordered by name."""
        with self._reading() as snapshot:
            drives = snapshot.searcher.schema["text"].drives
            maps = snapshot.maps()
            for name in maps:
                if name not in drives:
                    raise DamageError(f"dataset {name!r} is not in its table of contents")
        return [DatasetSummary(name, count, *drives[name]) for name, count in maps.items()]

    def lacking(self, dataset: str) -> str:
        """What to tell who names a dataset that the index does not hold."""
        known = listed([summary.name for summary in self.datasets()])
        return f"no dataset {dataset!r} in {self.path}; it holds {known or 'none'}"

    def info(self) -> IndexInfo:
        """What the index holds and takes."""
        with self._reading() as snapshot:
            size = sum(file.stat().st_size for file in self.path.iterdir() if file.is_file())
            return IndexInfo(
                self.path, self.parameters, len(snapshot), snapshot.keypoints, size, self.datasets()
            )

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
        """The best maps for a query's text; equal scores are ordered by map id.

        Args:
            text: of the query map.
            top: so many hits at most, all with a match; 0 for every map, those without a match last at score 0.
            exclude: (dataset, travel, metres): leave out its maps whose middle is not more than this away.
            method: with the pose words, or the paper's baseline without.
            filter: of Whoosh, or in its query language: ``dataset:NAME AND travel:[10 TO 20]``.
            texts: whether the hits' documents hold their texts; reading each by its id takes longer.
            least: only maps whose score reaches it; without meaning if ``top`` is 0, as is ``wanted``.
            wanted: whether a hit counts. It is asked for no more hits than it must: a search for the best of
                those that it wants looks no farther than one without it would.

        Raises:
            QueryError: if the filter is not in the query language.

        Examples:
            >>> import m2t_text as m2t
            >>> index = m2t.MapIndex.open("indexes/default")
            >>> text = index.document("drive/000040").text
            >>> [hit.map_id for hit in index.search(text, top=1)]
            ['drive/000040']
            >>> hit = index.search(text, top=1, filter="travel:[20 TO 30]")[0]
            >>> 20.0 <= hit.document.middle <= 30.0, hit.alignment.shape
            (True, (3,))
        """
        model, cell = self.model(method), self.parameters.mapping.cell
        query = self.parse(filter) if isinstance(filter, str) else filter
        chosen = None if wanted is None else partial(are_wanted, wanted, cell=cell)
        with self._reading() as snapshot:
            allowed = snapshot.allowed(exclude, query)
            ranking = snapshot.ranking(text, model, top, allowed, least, chosen, self._recent)
            hits = hits_at(*ranking.best(), cell, texts)
        return best_first(hits, top)

    def search_many(
        self, texts: Iterable[Text], top: int = 10, method: "Method" = "m2t"
    ) -> Iterator[list[Hit]]:
        """The best maps for each of many texts, in their order and of one state, in less time than one by one.

        Each core works on a text of its own, and what the texts before it found is looked at first; texts are
        taken as they are needed. `find_many` also verifies.

        Examples:
            >>> import m2t_text as m2t
            >>> index = m2t.MapIndex.open("indexes/default")
            >>> texts = [document.text for document in index.documents("drive")][:20]
            >>> many = list(index.search_many(texts, top=1))
            >>> many[7][0].map_id == index.search(texts[7], top=1)[0].map_id
            True
        """
        pinned = self.pinned()
        pinned.model(method)  # loads the compiled code
        return threaded(lambda text: pinned.search(text, top, method=method), texts)

    def statistics(self) -> "Statistics":
        """What words are weighted by."""
        with self._reading() as snapshot:
            return snapshot.statistics

    def keypoints(self) -> int:
        """Of all maps together."""
        with self._reading() as snapshot:
            return snapshot.keypoints

    def scores(self, text: Text, method: "Method" = "m2t") -> "Scores":
        """The scores of all maps at once, in the order of `ids`."""
        with self._reading() as snapshot:
            return snapshot.scores(text, self.model(method))

    def model(self, method: "Method" = "m2t") -> "MapWeighting":
        """The weighting of this index's profile."""
        from m2t_text.index.search.weighting import MapWeighting

        return MapWeighting.of(self.parameters.matching, method)

    def searcher(self, method: "Method" = "m2t") -> Any:
        """A Whoosh searcher of the latest state, for queries of any kind; to be closed by the caller."""
        return self.whoosh.searcher(weighting=self.model(method))

    def parse(self, string: str) -> Query:
        """The Whoosh query of a string; see `parse_query`. Raises QueryError, saying what is wrong with it."""
        with self._reading() as snapshot:  # Whoosh's index would read its table of contents for it
            return parse_query(string, snapshot.searcher.schema)

    def snapshot(self) -> Snapshot:
        """The latest committed state, or that at which the index is pinned."""
        with self._reading() as snapshot:
            return snapshot

    @contextmanager
    def _reading(self) -> Iterator[Snapshot]:
        """The latest committed state; damage that shows in the block is reported as `damage_errors` does.

        It is opened anew after each commit: Whoosh's refresh mixes states up.
        """
        with damage_errors(self.path):
            snapshot = self._snapshot
            if snapshot is None or not (self._pinned or snapshot.searcher.up_to_date()):
                self._snapshot = snapshot = Snapshot.open(self.whoosh.searcher())
            yield snapshot


def open_index(path: str | Path, parameters: Parameters | None = None) -> MapIndex:
    """The index in a folder. If there is none, the first commit makes it; until then nothing is written.

    Args:
        path: of the folder.
        parameters: of a new index, those of the profile ``default`` if None. An index that is there must have
            been made with them, if they are given.

    Raises:
        MapIndexError: if the folder holds something else, or an index of another version or other parameters.

    Examples:
        >>> import m2t_text as m2t
        >>> m2t.open_index("indexes/paper", m2t.PROFILES["paper"])
        MapIndex('indexes/paper', not made yet, paper)
        >>> m2t.open_index("indexes/default")
        MapIndex('indexes/default', 217 maps, default)
    """
    folder = Path(path)
    if holds_index(folder):
        return MapIndex.open(folder, parameters)
    check_new(folder)
    return MapIndex(folder, None, parameters or PROFILES["default"])
