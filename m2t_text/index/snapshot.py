"""One committed state of an index, as arrays over its maps."""

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from whoosh.query import Query

from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.index.ranking import Ranking, Recent, Wanted
from m2t_text.index.results import Overview
from m2t_text.index.schema import RECORD
from m2t_text.index.search.collection import Collection, Statistics, collection
from m2t_text.index.segment import Address, Segment

if TYPE_CHECKING:  # the compiled kernels are slow to import, and only searching needs them
    from m2t_text.index.kernels.scores import Scores
    from m2t_text.index.search.weighting import MapWeighting


class Snapshot:
    """One committed state of an index. Arrays over its live maps are in the order of map ids."""

    def __init__(self, searcher: Any) -> None:
        self.searcher = searcher
        leaves = searcher.leaf_searchers()
        self.segments = [Segment(leaf, offset) for leaf, offset in leaves if leaf.doc_count_all()]

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
        least: float = 0.0,
        wanted: Wanted | None = None,
        recent: Recent | None = None,
    ) -> Ranking:
        """A search among the ``allowed`` (D,) of segments. See `Ranking`."""
        segments = {segment.name: segment for segment in self.segments}
        scorer = model.text_scorer(text, self.collection)
        return Ranking(scorer, segments, allowed, top, least, wanted, recent)

    @property
    def collection(self) -> Collection:
        """The texts, as matching needs them."""
        return collection(self.searcher, "text")

    @cached_property
    def statistics(self) -> Statistics:
        """What words are weighted by, of these maps alone."""
        return Statistics(self.collection.maps, self.collection.frequency)

    def allowed(
        self, exclude: tuple[str, float, float] | None = None, filter: Query | None = None
    ) -> list[NDArray[np.bool_]]:
        """Of each segment (D,) which documents a search may find; see `MapIndex.search`."""
        allowed = [segment.live for segment in self.segments]
        if exclude is not None:
            dataset, travel, metres = exclude
            near = [
                segment.of_dataset(dataset) & (np.abs(segment.middles - travel) <= metres)
                for segment in self.segments
            ]
            allowed = [live & ~out for live, out in zip(allowed, near, strict=True)]
        if filter is not None:
            matching = self.matching(filter)
            allowed = [live & match for live, match in zip(allowed, matching, strict=True)]
        return allowed

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
