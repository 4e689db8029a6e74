"""What answers for shards: their indexes opened, and searches between their steps."""

import threading
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from m2t_text.cluster.joint import JointIndex, JointSearch
from m2t_text.cluster.manifest import Manifest
from m2t_text.cluster.search import Known, Search
from m2t_text.cluster.store import Store
from m2t_text.description.document import Document, map_id_of
from m2t_text.errors import ClusterError
from m2t_text.index.map_index import MapIndex
from m2t_text.index.results import Hit

BEGUN = 64  # searches that were begun and not finished; those who asked are gone
GENERATIONS = 4  # that are held open
JOINED = 16  # sets of shards that were asked for together lately

Numbers = tuple[int, ...]  # of shards
Runs = tuple[NDArray[np.int64], NDArray[np.float64]]


class ShardServer:
    """Answers for the shards of a store, each as it was in the generation that is asked for.

    Shards that are asked for together are searched as one index. Each method says something of each of them.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._manifests: dict[int, Manifest] = {}
        self._indexes: dict[str, MapIndex] = {}
        self._joined: OrderedDict[tuple[int, Numbers], JointIndex] = OrderedDict()
        self._begun: OrderedDict[tuple[str, Numbers], JointSearch] = OrderedDict()
        self._lock = threading.Lock()  # where many searches go on at once, what they share is changed by one

    def answer(
        self, method: str, generation: int, numbers: Sequence[int], arguments: tuple[Any, ...]
    ) -> dict[int, Any]:
        """What a method says of each of these shards."""
        answer: dict[int, Any] = getattr(self, method)(generation, tuple(numbers), *arguments)
        return answer

    def begin(self, generation: int, numbers: Numbers, search: Search) -> dict[int, Known]:
        """The first step of a search, and the only one if these are all shards."""
        joint = self._joint(generation, numbers)
        begun = JointSearch(joint, search)
        if joint.parts > 1:
            self._keep(begun, numbers, search)
        return begun.begin()

    def narrow(self, generation: int, numbers: Numbers, search: Search, floor: float) -> dict[int, Known]:
        """A step between, after a sample: more is known of maps that may reach the floor."""
        begun = self._taken(generation, numbers, search)
        self._keep(begun, numbers, search)
        return begun.narrow(floor)

    def finish(self, generation: int, numbers: Numbers, search: Search, floor: float) -> dict[int, list[Hit]]:
        """The last step: the best hits of these shards together, none below the floor."""
        return self._taken(generation, numbers, search).finish(floor)

    def find_document(self, generation: int, numbers: Numbers, map_id: str) -> dict[int, Document | None]:
        """The map of this id with its text; None if there is none."""
        return {number: self._opened(generation, number).find_document(map_id) for number in numbers}

    def runs(self, generation: int, numbers: Numbers, dataset: str) -> dict[int, Runs]:
        """The first scans of a dataset's maps, and the travel at which they begin."""
        return {number: self._opened(generation, number).runs(dataset) for number in numbers}

    def ready(self, generation: int, numbers: Numbers) -> dict[int, int]:
        """Opens shards, and returns how many maps each has. One search of each compiles what others need."""
        return {number: self._ready(generation, number) for number in numbers}

    def _ready(self, generation: int, number: int) -> int:
        index = self._opened(generation, number)
        scan = next((int(index.runs(one.name)[0][0]) for one in index.datasets()), None)
        if scan is not None:
            first = index.document(map_id_of(index.datasets()[0].name, scan))
            index.search(first.text, top=1, exclude=(first.dataset, first.middle, 0.0))
        return len(index)

    def _opened(self, generation: int, number: int) -> MapIndex:
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
            for key in [key for key in self._joined if key[0] not in self._manifests]:
                del self._joined[key]
        return self._manifests[generation]

    def _joint(self, generation: int, numbers: Numbers) -> JointIndex:
        shards = {number: self._opened(generation, number) for number in numbers}
        with self._lock:
            manifest, key = self._manifest(generation), (generation, numbers)
            if key not in self._joined:
                self._joined[key] = JointIndex(shards, len(manifest.shards), manifest.statistics)
            self._joined.move_to_end(key)
            while len(self._joined) > JOINED:
                self._joined.popitem(last=False)
            return self._joined[key]

    def _taken(self, generation: int, numbers: Numbers, search: Search) -> JointSearch:
        """A search that was begun. Steps that another server took, this one takes anew."""
        with self._lock:
            begun = self._begun.pop((search.key, numbers), None)
        return begun or JointSearch(self._joint(generation, numbers), search)

    def _keep(self, begun: JointSearch, numbers: Numbers, search: Search) -> None:
        with self._lock:
            self._begun[search.key, numbers] = begun
            while len(self._begun) > BEGUN:
                self._begun.popitem(last=False)
