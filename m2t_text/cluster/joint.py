"""Several shards searched as one index, by a server that answers for all of them."""

from collections.abc import Mapping
from functools import partial

import numpy as np

from m2t_text.cluster.search import Known, Search
from m2t_text.index.map_index import MapIndex
from m2t_text.index.ranking import Ranking, Recent, are_wanted, hits_at
from m2t_text.index.results import Hit, best_first
from m2t_text.index.search.collection import Collection, Statistics
from m2t_text.index.writing.folder import damage_errors


class JointIndex:
    """Some of the shards of a whole.

    Args:
        shards: pinned, by number.
        of: how many shards the whole has.
        whole: what words are weighted by.
    """

    def __init__(self, shards: Mapping[int, MapIndex], of: int, whole: Statistics) -> None:
        index = next(iter(shards.values()))
        self.path = index.path if len(shards) == 1 else index.path.parent
        self.parameters, self.model = index.parameters, index.model
        self.parts = -(-of // len(shards))
        self.recent = Recent()
        self.snapshots = {number: shard.snapshot() for number, shard in shards.items()}
        self.numbers = {one: number for number, state in self.snapshots.items() for one in state.segments}
        self.segments = {f"{number}/{one.name}": one for one, number in self.numbers.items()}
        collections = {str(number): state.collection for number, state in self.snapshots.items()}
        self.collection = Collection.joined(collections, whole)


class JointSearch:
    """A search of a `JointIndex`, in steps; what it says of maps it says by the number of their shard."""

    def __init__(self, index: JointIndex, search: Search) -> None:
        self._index, self._search = index, search
        self._cell = index.parameters.mapping.cell
        wanted = None if search.wanted is None else partial(are_wanted, search.wanted, cell=self._cell)
        states = index.snapshots.values()
        with damage_errors(index.path):
            allowed = [part for state in states for part in state.allowed(search.exclude, search.filter)]
        self._ranking = Ranking(
            index.model(search.method).text_scorer(search.text, index.collection),
            index.segments,
            allowed,
            search.top,
            search.least,
            wanted,
            index.recent,
            index.parts,
        )

    def begin(self) -> dict[int, Known]:
        """The first step, and the only one if no other shards are searched elsewhere."""
        if self._index.parts > 1:
            return self._known()
        hits = self.finish(0.0)
        return {number: Known(np.array([hit.score for hit in own]), False, own) for number, own in hits.items()}

    def narrow(self, floor: float) -> dict[int, Known]:
        """A step between, after a sample: more is known of maps that may reach the floor."""
        with damage_errors(self._index.path):
            self._ranking.narrow(floor)
        return self._known()

    def finish(self, floor: float) -> dict[int, list[Hit]]:
        """The last step: the best hits of these shards together, none below the floor."""
        with damage_errors(self._index.path):
            addresses, scores = self._ranking.best(floor)
            hits = hits_at(addresses, scores, self._cell, self._search.texts)
        numbers = [self._index.numbers[address.segment] for address in addresses]
        owners = {hit.map_id: number for hit, number in zip(hits, numbers, strict=True)}
        kept = best_first(hits, self._search.top)
        return {
            number: [hit for hit in kept if owners[hit.map_id] == number] for number in self._index.snapshots
        }

    def _known(self) -> dict[int, Known]:
        with damage_errors(self._index.path):
            segments, scores = self._ranking.known()
            sampled = self._ranking.sampled
        owners = np.array(list(self._index.numbers.values()), dtype=np.int64)[segments]
        return {number: Known(scores[owners == number], sampled) for number in self._index.snapshots}
