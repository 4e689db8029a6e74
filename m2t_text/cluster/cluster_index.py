"""Many shards searched as one index: the same ids, order, scores and verdicts as if all lay in one."""

from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from secrets import token_hex
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from whoosh.query import Query

from m2t_text.cluster.carrier import Carrier, InProcess
from m2t_text.cluster.manifest import Manifest
from m2t_text.cluster.remote import open_store
from m2t_text.cluster.search import Known, Search
from m2t_text.cluster.writing import sharded_writer
from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.errors import DamageError, MapIndexError, QueryError, listed
from m2t_text.index.query_language import parse_query
from m2t_text.index.results import DatasetSummary, Hit, IndexInfo, best_first
from m2t_text.index.schema import schema
from m2t_text.index.search.largest import reached

if TYPE_CHECKING:
    from m2t_text.index.search.weighting import MapWeighting, Method

REMEMBERED = 256  # documents whose texts came along with hits


class ClusterIndex:
    """The maps of all shards, as `find` and the command line use a `MapIndex`.

    Where several servers answer, a search takes steps: each scores the maps that promise most, and what the
    best of all reach is the floor below which none has to look. A search is exact, or it raises: an answer
    without some of the shards is given only where ``partial`` allows it, and `missing` says which.

    Examples:
        >>> import m2t_text as m2t
        >>> from m2t_text.cluster.store import Store
        >>> from m2t_text.cluster.writing import sharded_writer
        >>> documents = list(m2t.MapIndex.open("indexes/default").documents())
        >>> with sharded_writer(Store("fleet"), m2t.PROFILES["default"], shards=2) as writer:
        ...     writer.replace("drive", documents)
        >>> index = m2t.ClusterIndex.open("fleet")
        >>> len(index) == len(documents)
        True
        >>> index.search(documents[40].text, top=1)[0].map_id == documents[40].map_id
        True
    """

    def __init__(self, carrier: Carrier, path: Path | str, partial: bool = False) -> None:
        self.path = path
        self.partial = partial
        self._carrier = carrier
        self._pinned: Manifest | None = None
        self._missing: set[int] = set()
        self._texts: OrderedDict[str, Document] = OrderedDict()

    @classmethod
    def open(cls, folder: str | Path) -> "ClusterIndex":
        """The shards in a folder or at a URL, opened in this process; a ClusterError if there are none."""
        store = open_store(folder)
        store.manifest()
        return cls(InProcess(store), store.path)

    def __repr__(self) -> str:
        manifest = self.manifest
        return (
            f"ClusterIndex({str(self.path)!r}, {manifest.maps:,} maps in {len(manifest.shards)} shards, "
            f"{manifest.parameters.profile})"
        )

    @property
    def manifest(self) -> Manifest:
        """The generation that is asked: the latest, unless it is pinned."""
        return self._pinned or self._carrier.manifest()

    @property
    def missing(self) -> dict[int, int]:
        """The shards that did not answer, by number, and how many maps each has."""
        return {number: self.manifest.shards[number].maps for number in sorted(self._missing)}

    @property
    def missing_maps(self) -> int:
        """How many maps the shards have that did not answer."""
        return sum(self.missing.values())

    @property
    def parameters(self) -> Parameters:
        """With which all maps were described."""
        return self.manifest.parameters

    def pinned(self) -> "ClusterIndex":
        """The same index at its latest generation, which it keeps whatever is written later."""
        if self._pinned is not None:
            return self
        pinned = ClusterIndex(self._carrier, self.path, self.partial)
        pinned._pinned = self.manifest
        return pinned

    def __len__(self) -> int:
        return self.manifest.maps

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
        """The best maps for a query's text; see `MapIndex.search`. What is ``wanted`` goes to the shards.

        Raises:
            QueryError: if the filter is not in the query language.
            ClusterError: if a shard does not answer.
        """
        query = self.parse(filter) if isinstance(filter, str) else filter
        manifest, key = self.manifest, token_hex(16)
        search = Search(key, text, top, exclude, method, query, texts, least, wanted)
        found = self._found(manifest, search)
        for number, hits in found.items():
            _check(manifest, number, hits)
        ranked = best_first((hit for hits in found.values() for hit in hits), top)
        if texts and self._pinned is not None:
            self._remember(hit.document for hit in ranked)
        return ranked

    def _found(self, manifest: Manifest, search: Search) -> dict[int, list[Hit]]:
        """The best hits of each shard; what is not among the best of all may be left out."""
        every, floor = range(len(manifest.shards)), 0.0
        if search.top:
            known: dict[int, Known] = self._ask(manifest, "begin", every, search)
            ended = {number: one.hits for number, one in known.items() if one.hits is not None}
            if len(ended) == len(known):
                return ended
            floor = self._floor(manifest, search, known)
        return self._ask(manifest, "finish", every, search, floor)

    def _floor(self, manifest: Manifest, search: Search, known: dict[int, Known]) -> float:
        """A score that the best maps of all shards reach together, of which something is known."""
        told = known
        while sampled := [number for number, one in told.items() if one.sampled]:
            floor = _reached(known, search.top)
            told = self._ask(manifest, "narrow", sampled, search, floor)
            known = known | told
        return _reached(known, search.top)

    def find_document(self, map_id: str) -> Document | None:
        """The map of this id with its text; None if there is none."""
        if map_id in self._texts:
            return self._texts[map_id]
        manifest = self.manifest
        number = manifest.places.get(map_id.rpartition("/")[0])
        if number is None:
            return None
        document: Document | None = self._ask_one(manifest, "find_document", number, map_id)
        return document

    def document(self, map_id: str) -> Document:
        """The map of this id, exactly as it was indexed. An id that no shard has is a QueryError."""
        document = self.find_document(map_id)
        if document is None:
            raise QueryError(f"no map {map_id!r} in {self.path}")
        return document

    def runs(self, dataset: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """(M,) the first scans of a dataset's maps, ascending, and (M,) the travel at which they begin, metres;
        both empty if no shard has the dataset."""
        manifest = self.manifest
        number = manifest.places.get(dataset)
        if number is None:
            return np.zeros(0, dtype=np.int64), np.zeros(0)
        runs: tuple[NDArray[np.int64], NDArray[np.float64]] = self._ask_one(manifest, "runs", number, dataset)
        return runs

    def datasets(self) -> list[DatasetSummary]:
        """The datasets of all shards, ordered by name."""
        return self.manifest.datasets

    def remove(self, *names: str) -> None:
        """Removes datasets with all their maps, in one generation.

        Raises:
            MapIndexError: if no shard has one of them; nothing is removed then.
        """
        with sharded_writer(open_store(self.path), self.parameters) as writer:
            for name in dict.fromkeys(names):
                if name not in self.manifest.places:
                    raise MapIndexError(self.lacking(name))
                writer.remove(name)

    def lacking(self, dataset: str) -> str:
        """What to tell who names a dataset that no shard has."""
        known = listed([summary.name for summary in self.datasets()])
        return f"no dataset {dataset!r} in {self.path}; it holds {known or 'none'}"

    def info(self) -> IndexInfo:
        """What all shards hold and take."""
        manifest = self.manifest
        shards = manifest.shards
        return IndexInfo(
            self.path,
            manifest.parameters,
            manifest.maps,
            sum(shard.keypoints for shard in shards),
            sum(shard.bytes for shard in shards),
            manifest.datasets,
        )

    def parse(self, string: str) -> Query:
        """The Whoosh query of a string. Raises QueryError, saying what is wrong with it."""
        return parse_query(string, schema(self.parameters))

    def model(self, method: "Method" = "m2t") -> "MapWeighting":
        """The weighting of the profile."""
        from m2t_text.index.search.weighting import MapWeighting

        return MapWeighting.of(self.parameters.matching, method)

    def _ask(self, manifest: Manifest, method: str, numbers: Iterable[int], *arguments: Any) -> dict[int, Any]:
        """What all shards answer; who was missing once is not waited for again."""
        wanted = [number for number in numbers if number not in self._missing]
        answers = self._carrier.ask(method, manifest.generation, wanted, *arguments, partial=self.partial)
        silent = set(wanted) - answers.keys()
        if silent and not self.partial:
            raise DamageError(f"shards {sorted(silent)} of {self.path} gave no answer")
        self._missing |= silent
        return answers

    def _ask_one(self, manifest: Manifest, method: str, number: int, *arguments: Any) -> Any:
        """What the one shard answers that knows; it must."""
        return self._carrier.ask(method, manifest.generation, [number], *arguments)[number]

    def _remember(self, documents: Iterable[Document]) -> None:
        for document in documents:
            self._texts[document.map_id] = document
        while len(self._texts) > REMEMBERED:
            self._texts.popitem(last=False)


def _reached(known: Mapping[int, Known], top: int) -> float:
    """The score that the ``top`` best of all shards reach, 0 while there are fewer."""
    return reached(np.concatenate([np.zeros(0), *(one.scores for one in known.values())]), top)


def _check(manifest: Manifest, number: int, hits: list[Hit]) -> None:
    """Raises DamageError if a shard answers with maps that the manifest places elsewhere."""
    for hit in hits:
        if manifest.places.get(hit.document.dataset) != number:
            raise DamageError(f"shard {number} answered with {hit.map_id!r}, which is not its own")
