"""One committed state of an index, as arrays over its maps."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from whoosh.query import Query
from whoosh.reading import TermNotFound

from m2t_text.description.document import Document, map_id_of
from m2t_text.description.text import Text
from m2t_text.index.results import Overview
from m2t_text.index.schema import RECORD, from_record
from m2t_text.index.search.collection import Collection, Statistics, collection, live_documents
from m2t_text.util.ascending import distinct, places_of

if TYPE_CHECKING:  # the compiled kernels are slow to import, and only searching needs them
    from m2t_text.index.kernels.scores import Scores
    from m2t_text.index.search.top_k import Promising, TopK
    from m2t_text.index.search.weighting import MapWeighting

EMPTY = Text.of([], [], [])
REMEMBERED = 64  # searches of which it is known what they found,
MOST_OF_ONE = 16  # so many maps of each


class Segment:
    """One segment of a state; its arrays are over all its documents, deleted ones too."""

    def __init__(self, searcher: Any, offset: int) -> None:
        self.reader = searcher.reader()
        self.name = str(self.reader.segment().segment_id())
        self.offset = offset
        self.live = live_documents(self.reader)

    def open(self) -> None:
        """Opens the texts; raises DamageError if they are damaged."""
        self.texts  # noqa: B018

    def number_of(self, map_id: str) -> int | None:
        """The number of the live map of this id, or None."""
        try:
            return int(self.reader.first_id("map_id", map_id))
        except (TermNotFound, UnicodeEncodeError):
            return None

    @cached_property
    def texts(self) -> Any:
        """The column of the texts."""
        return self.reader.column_reader("text", translate=False)

    @cached_property
    def records(self) -> NDArray[Any]:
        """(D,) what is known of each map."""
        return self.reader.column_reader("record", translate=False).array

    @cached_property
    def datasets(self) -> Any:
        """The column of the datasets' names."""
        return self.reader.column_reader("dataset", translate=False)

    def ids(self) -> list[str]:
        """The ids of all documents."""
        names, codes = self.datasets.names, self.datasets.codes.tolist()
        scans = self.records["first_scan"].tolist()
        return [map_id_of(names[code], scan) for code, scan in zip(codes, scans, strict=True)]

    def of_dataset(self, name: str) -> NDArray[np.bool_]:
        """(D,) which documents belong to a dataset."""
        return self.datasets.codes == self.datasets.code(name)

    @cached_property
    def middles(self) -> NDArray[np.float64]:
        """(D,) travel at the middle of each map, metres."""
        return self.reader.column_reader("travel", translate=False).array


@dataclass(frozen=True)
class Address:
    """Where a map lies: its segment, and its number there."""

    segment: Segment
    number: int

    @property
    def dataset(self) -> str:
        """The name of the map's dataset."""
        return str(self.segment.datasets.names[self.segment.datasets.codes[self.number]])

    @property
    def map_id(self) -> str:
        """The map's id."""
        return map_id_of(self.dataset, int(self.segment.records["first_scan"][self.number]))

    def document(self, text: bool = False) -> Document:
        """The map, with its text or an empty one."""
        segment, number = self.segment, self.number
        return from_record(self.dataset, segment.records[number], segment.texts[number] if text else EMPTY)


Wanted = Callable[[list[Address], "Scores"], NDArray[np.bool_]]  # which of some maps (K,) count


class Recent:
    """The maps that the latest searches of one state have found: those that follow each other often ask for
    places next to each other. Several threads may use it at once."""

    def __init__(self) -> None:
        self._found: deque[NDArray[np.int64]] = deque(maxlen=REMEMBERED)

    def add(self, addresses: Sequence[Address]) -> None:
        """Adds what a search has found."""
        numbers = [one.segment.offset + one.number for one in addresses[:MOST_OF_ONE]]
        self._found.append(np.array(numbers, dtype=np.int64))

    def places(self, segments: Sequence[Segment], documents: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
        """(K,) their places among all documents (D,) of segments, ascending; those that are missing there are
        left out."""
        known = distinct(np.concatenate([np.zeros(0, dtype=np.int64), *list(self._found)]))
        begins = np.cumsum([0, *(len(part) for part in documents)])
        places = [np.zeros(0, dtype=np.int64)]
        for segment, own, begin in zip(segments, documents, begins[:-1].tolist(), strict=True):
            places.append(begin + places_of(known - segment.offset, own))
        return np.concatenate(places)


class Ranking:
    """A search of one state in steps, between which several states can agree on what is good enough."""

    def __init__(
        self,
        segments: Sequence[Segment],
        documents: Sequence[NDArray[np.int64]],
        top_k: "TopK",
        top: int,
        least: float = 0.0,
        wanted: "Wanted | None" = None,
        recent: "Recent | None" = None,
        parts: int = 1,
    ) -> None:
        """``documents`` of each segment may be found; ``top`` of them are looked for, 0 for all. With a ``top``
        only those count whose score reaches ``least`` and that are ``wanted``. What ``recent`` searches found
        is looked at first; this state is one of so many ``parts`` that are searched together."""
        self._segments, self._documents, self._top_k, self._top = segments, documents, top_k, top
        self._least, self._wanted, self._recent, self._parts = least, wanted, recent, parts

    @cached_property
    def _promising(self) -> "Promising":
        wanted, likely = self._wanted, None
        if self._recent is not None:
            likely = self._recent.places(self._segments, self._documents)
        chosen = None if wanted is None else lambda found, scores: wanted(self._addresses(found), scores)
        return self._top_k.promising(self._top, self._least, chosen, likely, self._parts)

    def begin(self) -> tuple[NDArray[np.float64], bool]:
        """(K,) the best scores among the maps that promise most, in any order, as many as wanted at most; and
        whether they are those of a sample, so that `narrow` knows better."""
        if not self._top:
            return np.zeros(0), False
        return self._promising.best, self._promising.every is None

    def narrow(self, floor: float) -> tuple[NDArray[np.float64], bool]:
        """The same once more is known, of maps that may reach the ``floor``."""
        self._promising = self._top_k.narrowed(self._promising, floor)
        return self.begin()

    def best(self, floor: float = 0.0) -> "tuple[list[Address], Scores]":
        """The best maps with a match, and those that tie with the last; none below the ``floor``.

        If all maps are wanted, also those without a match.
        """
        if self._top:
            found, scores = self._top_k.rest(self._promising, floor)
        else:
            found, scores = np.arange(sum(map(len, self._documents))), self._top_k.all()
        addresses = self._addresses(found)
        if self._top and self._recent is not None:
            self._recent.add(addresses)
        return addresses, scores

    def _addresses(self, found: NDArray[np.int64]) -> list[Address]:
        """Where documents lie that are named by their places among all that may be found."""
        begins = np.cumsum([0, *(len(part) for part in self._documents)])
        owners = np.searchsorted(begins, found, side="right") - 1
        return [
            Address(self._segments[k], int(self._documents[k][number - begins[k]]))
            for k, number in zip(owners.tolist(), found.tolist(), strict=True)
        ]


class Snapshot:
    """One committed state of an index. Arrays over its live maps are in the order of map ids."""

    def __init__(self, searcher: Any) -> None:
        self.searcher = searcher
        leaves = searcher.leaf_searchers()
        self.segments = [Segment(leaf, offset) for leaf, offset in leaves if leaf.doc_count_all()]
        self._part: Collection | None = None

    @classmethod
    def open(cls, searcher: Any) -> "Snapshot":
        """The state that a searcher sees, with all texts opened: a damaged segment is a DamageError at once."""
        snapshot = cls(searcher)
        for segment in snapshot.segments:
            segment.open()
        return snapshot

    def __len__(self) -> int:
        return int(self.searcher.doc_count())

    @cached_property
    def _sorted(self) -> tuple[list[str], NDArray[np.int64]]:
        """The ids of all live maps, sorted, and (maps,) their numbers among the documents of all segments."""
        ids = np.array([map_id for segment in self.segments for map_id in segment.ids()], dtype=object)
        numbers = np.flatnonzero(self._all([segment.live for segment in self.segments], np.bool_))
        numbers = numbers[np.argsort(ids[numbers], kind="stable")]
        return ids[numbers].tolist(), numbers

    @property
    def ids(self) -> list[str]:
        """The ids of all maps, sorted."""
        return self._sorted[0]

    @property
    def _order(self) -> NDArray[np.int64]:
        return self._sorted[1]

    @property
    def keypoints(self) -> int:
        """Of all maps together."""
        return sum(int(segment.texts.texts.counts[segment.live].sum()) for segment in self.segments)

    def last_scan(self, dataset: str) -> int:
        """The first scan of the last map of a dataset; -1 if there is none."""
        firsts = [
            segment.records["first_scan"][segment.of_dataset(dataset) & segment.live].max(initial=-1)
            for segment in self.segments
        ]
        return int(max(firsts, default=-1))

    def maps(self) -> dict[str, int]:
        """How many maps each dataset has, by name."""
        counts: dict[str, int] = {}
        for segment in self.segments:
            for name, count in zip(
                segment.datasets.names, np.bincount(segment.datasets.codes[segment.live]), strict=False
            ):
                counts[name] = counts.get(name, 0) + int(count)
        return {name: counts[name] for name in sorted(counts) if counts[name]}

    def scores(self, text: Text, model: "MapWeighting") -> "Scores":
        """How well the text fits each map."""
        every = [np.ones(len(segment.live), dtype=np.bool_) for segment in self.segments]
        return self.ranking(text, model, 0, every).best()[1][self._order]

    def ranking(
        self,
        text: Text,
        model: "MapWeighting",
        top: int,
        allowed: Sequence[NDArray[np.bool_]],
        whole: Statistics | None = None,
        least: float = 0.0,
        wanted: "Wanted | None" = None,
        recent: "Recent | None" = None,
        parts: int = 1,
    ) -> "Ranking":
        """A search among the ``allowed`` (D,) of segments; words are weighted by what is known of a ``whole``,
        of which these maps are a part, or of them alone. See `Ranking`."""
        from m2t_text.index.search.top_k import TopK

        documents = [np.flatnonzero(part) for part in allowed]
        scorer = model.text_scorer(text, self._collection(whole))
        names = [segment.name for segment in self.segments]
        top_k = TopK(scorer, dict(zip(names, documents, strict=True)))
        return Ranking(self.segments, documents, top_k, top, least, wanted, recent, parts)

    def _collection(self, whole: Statistics | None) -> Collection:
        """The texts, which keep their weights as long as those of the same whole are asked for."""
        own = collection(self.searcher, "text")
        if whole is None:
            return own
        if self._part is None or self._part.whole is not whole:
            self._part = own.within(whole)
        return self._part

    @cached_property
    def statistics(self) -> Statistics:
        """What words are weighted by, of these maps alone."""
        own = collection(self.searcher, "text")
        return Statistics(own.maps, own.frequency)

    def matching(self, query: Query) -> list[NDArray[np.bool_]]:
        """Of each segment (D,) whether a Whoosh query matches."""
        matches = np.zeros(self.searcher.doc_count_all(), dtype=np.bool_)
        matches[list(self.searcher.docs_for_query(query))] = True
        return [matches[segment.offset : segment.offset + len(segment.live)] for segment in self.segments]

    def address(self, map_id: str) -> Address | None:
        """Where the map of this id lies, or None."""
        for segment in self.segments:
            number = segment.number_of(map_id)
            if number is not None:
                return Address(segment, number)
        return None

    @cached_property
    def overview(self) -> Overview:
        """All live maps without their texts."""
        names = list(self.maps())
        known = {name: code for code, name in enumerate(names)}
        parts = [
            np.array([known.get(name, -1) for name in segment.datasets.names])[segment.datasets.codes]
            for segment in self.segments
        ]
        codes = self._all(parts, np.int64)
        records = self._all([segment.records for segment in self.segments], RECORD)
        numbers = np.flatnonzero(self._all([segment.live for segment in self.segments], np.bool_))
        order = numbers[np.lexsort((records["first_scan"][numbers], codes[numbers]))]
        return Overview(names, codes[order], records[order], order)

    def numbered(self, number: int) -> Document:
        """The map of this number among the documents of all segments, with its text."""
        return self._address(number).document(text=True)

    def runs(self, dataset: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """(M,) the first scans of a dataset's maps, ascending, and (M,) the travel where they begin, metres."""
        scans, begins = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
        for segment in self.segments:
            own = segment.of_dataset(dataset) & segment.live
            scans.append(segment.records["first_scan"][own])
            begins.append(segment.records["travel"][own, 0])
        order = np.argsort(np.concatenate(scans), kind="stable")
        return np.concatenate(scans)[order], np.concatenate(begins)[order]

    def addresses(self) -> Iterator[Address]:
        """All maps in the order of ids."""
        return map(self._address, self._order.tolist())

    def _address(self, number: int) -> Address:
        segment = next(segment for segment in reversed(self.segments) if segment.offset <= number)
        return Address(segment, number - segment.offset)

    def _all(self, parts: Sequence[NDArray[Any]], dtype: Any) -> NDArray[Any]:
        return np.concatenate([np.zeros(0, dtype=dtype), *parts])
