"""A search in steps, of which each leaves out more of the maps."""

from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from m2t_text.index.results import Hit
from m2t_text.index.segment import Address, Segment
from m2t_text.util.ascending import places_of
from m2t_text.util.types import Floats

if TYPE_CHECKING:  # the compiled kernels are slow to import, and only searching needs them
    from m2t_text.index.kernels.scores import Scores
    from m2t_text.index.search.scorer import Scorer
    from m2t_text.index.search.top_k import Promising

REMEMBERED = 64  # searches of which it is known what they found,
MOST_OF_ONE = 16  # so many maps of each; of the last
FOLLOWED = 4  # one must have found a map that one before had found, if they are to be of use to the next

Wanted = Callable[[list[Address], "Scores"], NDArray[np.bool_]]  # which of some maps (K,) count


class Recent:
    """The maps that the latest searches have found: those that follow each other along a drive ask for places
    next to each other. Several threads may use it at once."""

    def __init__(self) -> None:
        self._found: deque[frozenset[Address]] = deque(maxlen=REMEMBERED)
        self._followed: deque[bool] = deque(maxlen=FOLLOWED)

    def add(self, addresses: Sequence[Address]) -> None:
        """Adds what a search has found."""
        found = frozenset(addresses[:MOST_OF_ONE])
        self._followed.append(not all(found.isdisjoint(before) for before in list(self._found)))
        self._found.append(found)

    def places(self, segments: Iterable[Segment], documents: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
        """(K,) their places among all documents (D,) of segments, ascending; those that are missing there are
        left out. There are no places if searches have not followed each other lately."""
        places, begin = [np.zeros(0, dtype=np.int64)], 0
        if not any(list(self._followed)):
            return places[0]
        known: defaultdict[Segment, set[int]] = defaultdict(set)
        for address in frozenset().union(*list(self._found)):
            known[address.segment].add(address.number)
        for segment, own in zip(segments, documents, strict=True):
            places.append(begin + places_of(np.array(sorted(known[segment]), dtype=np.int64), own))
            begin += len(own)
        return np.concatenate(places)


class Ranking:
    """A search among the maps of some segments.

    Other maps may be searched elsewhere at the same time, for the best of all: then it is taken step by step,
    between which all agree on a score that the best reach.
    """

    def __init__(
        self,
        scorer: "Scorer",
        segments: Mapping[str, Segment],
        allowed: Sequence[NDArray[np.bool_]],
        top: int,
        least: float = 0.0,
        wanted: Wanted | None = None,
        recent: Recent | None = None,
        parts: int = 1,
    ) -> None:
        """Of segments by name, those documents (D,) may be found that are ``allowed``; ``top`` of them are
        looked for, 0 for all. With a ``top`` only those count whose score reaches ``least`` and that are
        ``wanted``. What ``recent`` searches found is looked at first; these are one of about so many ``parts``
        that are searched together."""
        from m2t_text.index.search.top_k import TopK

        self._segments = list(segments.values())
        self._documents = [np.flatnonzero(part) for part in allowed]
        self._begins = np.cumsum([0, *map(len, self._documents)])
        self._top_k = TopK(scorer, dict(zip(segments, self._documents, strict=True)))
        self._top, self._least, self._wanted, self._recent, self._parts = top, least, wanted, recent, parts

    @cached_property
    def _promising(self) -> "Promising":
        wanted, likely = self._wanted, None
        if self._recent is not None:
            likely = self._recent.places(self._segments, self._documents)
        chosen = None if wanted is None else lambda found, scores: wanted(self._addresses(found), scores)
        return self._top_k.promising(self._top, self._least, chosen, likely, self._parts)

    @property
    def sampled(self) -> bool:
        """Whether only a sample of the maps was looked at, so that `narrow` tells more."""
        return self._promising.every is None

    def known(self) -> tuple[NDArray[np.int64], Floats]:
        """Of the best maps among those that promise most, as many as wanted at most and in any order: (K,) the
        places of their segments among all, and their scores."""
        best = self._promising.best
        return self._owners(self._promising.done[best]), self._promising.scores.score[best]

    def narrow(self, floor: float) -> None:
        """Looks at more maps, after a sample: at those that may reach the ``floor``."""
        self._promising = self._top_k.narrowed(self._promising, floor)

    def best(self, floor: float = 0.0) -> "tuple[list[Address], Scores]":
        """The best maps with a match, and those that tie with the last; none below the ``floor``.

        If all maps are wanted, also those without a match.
        """
        if self._top:
            found, scores = self._top_k.rest(self._promising, floor)
        else:
            found, scores = np.arange(self._begins[-1]), self._top_k.all()
        addresses = self._addresses(found)
        if self._top and self._recent is not None:
            self._recent.add(addresses)
        return addresses, scores

    def _owners(self, places: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.searchsorted(self._begins, places, side="right") - 1

    def _addresses(self, places: NDArray[np.int64]) -> list[Address]:
        """Where documents lie that are named by their places among all that may be found."""
        owners = self._owners(places)
        return [
            Address(self._segments[k], int(self._documents[k][place - self._begins[k]]))
            for k, place in zip(owners.tolist(), places.tolist(), strict=True)
        ]


def hits_at(addresses: Iterable[Address], scores: "Scores", cell: float, texts: bool = False) -> list[Hit]:
    """Maps and their scores as hits, in the same order; ``cell`` is in metres. See `MapIndex.search`."""
    return [
        Hit(
            address.document(text=texts),
            float(scores.score[k]),
            int(scores.matched[k]),
            scores.alignment[k] * [cell, cell, 1.0],
        )
        for k, address in enumerate(addresses)
    ]


def are_wanted(
    wanted: Callable[[Hit], bool], addresses: list[Address], scores: "Scores", cell: float
) -> NDArray[np.bool_]:
    """(K,) which maps are ``wanted`` with these scores."""
    return np.array([wanted(hit) for hit in hits_at(addresses, scores, cell)], dtype=np.bool_)
