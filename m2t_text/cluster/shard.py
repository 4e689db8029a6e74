"""What answers for shards: their indexes opened, and searches between their two steps."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from whoosh.query import Query

from m2t_text.cluster.manifest import Manifest
from m2t_text.cluster.store import Store
from m2t_text.description.document import Document, map_id_of
from m2t_text.description.text import Text
from m2t_text.errors import ClusterError
from m2t_text.index.map_index import MapIndex
from m2t_text.index.results import Hit
from m2t_text.index.snapshot import Ranking
from m2t_text.util.workers import beside_others, own_cores, together

if TYPE_CHECKING:
    from m2t_text.index.search.weighting import Method

BEGUN = 64  # searches that were begun and not finished; those who asked are gone
GENERATIONS = 4  # that are held open


@dataclass(frozen=True)
class Search:
    """A search of a whole cluster.

    Attributes:
        key: no other search has it.
        text, top, exclude, method, filter, texts, least, wanted: as for `MapIndex.search`.
    """

    key: str
    text: Text
    top: int
    exclude: tuple[str, float, float] | None
    method: "Method"
    filter: Query | None
    texts: bool
    least: float = 0.0
    wanted: Callable[[Hit], bool] | None = None


class ShardServer:
    """Answers for the shards of a store, each as it was in the generation that is asked for."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._manifests: dict[int, Manifest] = {}
        self._indexes: dict[str, MapIndex] = {}
        self._begun: OrderedDict[tuple[str, int], Ranking] = OrderedDict()
        self._lock = threading.Lock()  # where many searches go on at once, what they share is changed by one

    def answer(
        self, method: str, generation: int, numbers: Sequence[int], arguments: tuple[Any, ...]
    ) -> dict[int, Any]:
        """What a method returns for each of these shards. If there are at least as many as cores, several are
        worked on at once, each by one thread."""
        work = getattr(self, method)
        if len(numbers) < own_cores():
            return {number: work(generation, number, *arguments) for number in numbers}
        answers = together(lambda number: beside_others(lambda: work(generation, number, *arguments)), numbers)
        return dict(zip(numbers, answers, strict=True))

    def begin(self, generation: int, number: int, search: Search) -> tuple[NDArray[np.float64], bool]:
        """The first step: (K,) the best scores that are known after it, ``top`` at most; and whether they are
        those of a sample, so that `narrow` knows better."""
        ranking = self._ranking(generation, number, search)
        with self._lock:
            self._begun[search.key, number] = ranking
            while len(self._begun) > BEGUN * len(self._indexes):
                self._begun.popitem(last=False)
        return ranking.begin()

    def narrow(
        self, generation: int, number: int, search: Search, floor: float
    ) -> tuple[NDArray[np.float64], bool]:
        """A step between, after a sample: the same once more is known, of maps that may reach the floor."""
        if (search.key, number) not in self._begun:
            self.begin(generation, number, search)
        with self._lock:
            ranking = self._begun[search.key, number]
        return ranking.narrow(floor)

    def finish(self, generation: int, number: int, search: Search, floor: float) -> list[Hit]:
        """The last step: the best hits, none below the floor. Steps that another server took, it takes anew."""
        with self._lock:
            begun = self._begun.pop((search.key, number), None)
        ranking = begun or self._ranking(generation, number, search)
        return self.opened(generation, number).hits(ranking, search.top, search.texts, floor)

    def find_document(self, generation: int, number: int, map_id: str) -> Document | None:
        """The map of this id with its text; None if there is none."""
        return self.opened(generation, number).find_document(map_id)

    def runs(self, generation: int, number: int, dataset: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The first scans of a dataset's maps, and the travel at which they begin."""
        return self.opened(generation, number).runs(dataset)

    def ready(self, generation: int, number: int) -> int:
        """Opens a shard, and returns how many maps it has. One search compiles what others need."""
        index = self.opened(generation, number)
        scan = next((int(index.runs(one.name)[0][0]) for one in index.datasets()), None)
        if scan is not None:
            first = index.document(map_id_of(index.datasets()[0].name, scan))
            index.search(first.text, top=1, exclude=(first.dataset, first.middle, 0.0))
        return len(index)

    def opened(self, generation: int, number: int) -> MapIndex:
        """The index of a shard in a generation."""
        with self._lock:
            manifest = self._manifest(generation)
            if number >= len(manifest.shards):
                raise ClusterError(f"generation {generation} of {self._store.path} has no shard {number}")
            shard = manifest.shards[number]
            if shard.folder not in self._indexes:
                self._indexes[shard.folder] = self._store.opened(shard)
            return self._indexes[shard.folder]

    def _manifest(self, generation: int) -> Manifest:
        if generation not in self._manifests:
            self._manifests[generation] = self._store.manifest(generation)
            for old in sorted(self._manifests)[:-GENERATIONS]:
                if old != generation:
                    del self._manifests[old]
            held = {shard.folder for manifest in self._manifests.values() for shard in manifest.shards}
            self._indexes = {name: index for name, index in self._indexes.items() if name in held}
        return self._manifests[generation]

    def _ranking(self, generation: int, number: int, search: Search) -> Ranking:
        index = self.opened(generation, number)
        weighted = getattr(index.model(search.method), "weighted", False)
        whole = self._manifests[generation].statistics if weighted else None
        return index.ranking(
            search.text,
            search.top,
            search.exclude,
            search.method,
            search.filter,
            whole,
            search.least,
            search.wanted,
            len(self._manifests[generation].shards),
        )
