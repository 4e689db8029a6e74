"""What matching needs of a whole index: the texts of each segment, and the statistics over all of them."""

import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from itertools import count
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.text import WORDS
from m2t_text.index.kernels import intersection
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.tiles import Tiles, TilesPart
from m2t_text.util.workers import cores

ALONE = 3  # searches without tiles before they are made
CHUNK = 4096  # maps whose tiles are made together
GRID = 2.0**-32  # sums below 2^21 are exact in a float: the weights of 100,000 keypoints

_collecting, _tiling = threading.RLock(), threading.Lock()


@dataclass(frozen=True)
class SegmentTexts:
    """One segment as a reader sees it.

    Attributes:
        texts: of all its documents; they never change.
        live: (documents,) bool, False where this reader's state of the index has the document deleted.
    """

    texts: Texts
    live: NDArray[np.bool_]

    @cached_property
    def tiles(self) -> Tiles:
        """Of all documents, half of the memory that their texts take."""
        with ThreadPoolExecutor(cores(None)) as threads:
            begins = range(0, len(self.live), CHUNK)
            parts = [
                threads.submit(TilesPart.of, self.texts, k, min(k + CHUNK, len(self.live))) for k in begins
            ]
            return Tiles.joined([part.result() for part in parts])


@dataclass(frozen=True)
class Statistics:
    """What words are weighted by.

    Attributes:
        maps: N, number of live maps.
        frequency: (1024,) live maps with each word.
    """

    maps: int
    frequency: NDArray[np.int64]


@dataclass(frozen=True)
class Collection:
    """All live maps that a reader sees, whatever the segments that they lie in.

    Attributes:
        segments: by segment id.
        maps: N, number of live maps.
        whole: statistics of all indexes that are searched together, this being one of them.
    """

    segments: dict[str, SegmentTexts]
    maps: int
    whole: Statistics | None = None
    _searches: "count[int]" = field(default_factory=count, compare=False, repr=False)

    @classmethod
    def joined(cls, parts: Mapping[str, "Collection"], whole: Statistics) -> "Collection":
        """The maps of several readers, as a part of a whole; segments are called ``part/segment``."""
        segments = {
            f"{name}/{segment}": texts
            for name, part in parts.items()
            for segment, texts in part.segments.items()
        }
        return cls(segments, sum(part.maps for part in parts.values()), whole)

    @cached_property
    def frequency(self) -> NDArray[np.int64]:
        """(1024,) live maps with each word."""
        frequency = np.zeros(WORDS, dtype=np.int64)
        for segment in self.segments.values():
            intersection.document_frequency(segment.texts, segment.live, frequency)
        return frequency

    @cached_property
    def weights(self) -> NDArray[np.float64]:
        """(1024,) the rarity of each word: log((N + 1) / df). Positive, as Whoosh asks of scores.

        Rounded to a grid on which sums are exact, so that equal scores are equal whatever the order of adding.
        """
        whole = self.whole or Statistics(self.maps, self.frequency)
        rarity = np.log((whole.maps + 1) / np.clip(whole.frequency, 1, whole.maps + 1))
        return np.ceil(rarity / GRID) * GRID

    @property
    def uses_tiles(self) -> bool:
        """Whether a search uses tiles, which are there then. They are made once these maps have been searched
        ALONE times: it takes as long as a few searches."""
        with _tiling:  # one thread makes them
            if next(self._searches) < ALONE and not all("tiles" in vars(one) for one in self.segments.values()):
                return False
            for segment in self.segments.values():
                segment.tiles  # noqa: B018
        return True

    @cached_property
    def norms(self) -> dict[str, NDArray[np.float64]]:
        """For each segment (documents,) the weight of each map: the sum of its keypoints' weights."""
        norms = {name: np.zeros(len(segment.live)) for name, segment in self.segments.items()}
        for name, segment in self.segments.items():
            intersection.document_weight(segment.texts, self.weights, norms[name])
        return norms


_collections: WeakKeyDictionary[Any, Collection] = WeakKeyDictionary()


def collection(searcher: Any, fieldname: str) -> Collection:
    """The collection that a searcher, or the parent of a segment's searcher, sees.

    It lives as long as the reader does.
    """
    reader = searcher.get_parent().reader()
    with _collecting:
        if reader not in _collections:
            _collections[reader] = _collect(reader, fieldname)
        return _collections[reader]


def live_documents(reader: Any) -> NDArray[np.bool_]:
    """(D,) which documents of a segment are not deleted."""
    live = np.ones(reader.doc_count_all(), dtype=np.bool_)
    live[list(reader.segment().deleted_docs())] = False
    return live


def segment_name(reader: Any) -> str:
    """The id of a segment reader's segment; ids are random, and a segment's contents never change."""
    return str(reader.segment().segment_id())


def leaves(reader: Any) -> Iterator[Any]:
    """The segment readers below a reader; none for an index without documents."""
    return (leaf for leaf, _ in reader.leaf_readers() if leaf.doc_count_all())


def _collect(reader: Any, fieldname: str) -> Collection:
    segments = {segment_name(leaf): _segment(leaf, fieldname) for leaf in leaves(reader)}
    return Collection(segments, sum(int(segment.live.sum()) for segment in segments.values()))


def _segment(leaf: Any, fieldname: str) -> SegmentTexts:
    return SegmentTexts(leaf.column_reader(fieldname, translate=False).texts, live_documents(leaf))
