"""The best maps of many without measuring all: the most promising first, until bounds leave out the rest."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from m2t_text.index.kernels.scores import Scores
from m2t_text.index.search.largest import descending, largest, reached, smallest
from m2t_text.index.search.scorer import Documents, Scorer
from m2t_text.util.ascending import absent, distinct
from m2t_text.util.types import Floats
from m2t_text.util.workers import own_cores, together

Part = TypeVar("Part")
Wanted = Callable[[NDArray[np.int64], Scores], NDArray[np.bool_]]

SHARES = 8  # parts for each of several threads, so that all of them end together; but
GROWTH = 4  # of batches
SIEVED = 4096  # documents from which on a sieve is worth its tables
SAMPLES = (2048, 16_384)  # of them, at most, are looked at to find what is needed: one half anywhere, and of
GLANCED, BLOCK = 65_536, 64  # some, in blocks of neighbours, those that are most like the query at a glance;
AROUND = 32  # and those on either side of the best, which one drive has often made of one place; the second
FEW = 1024  # sample only if more than its size would pass the sieve, as so many documents tell
LIKELY = 8192  # if more pass, so many of them are looked at before bounds leave out most of the others
LOOSE = 0.8  # share that a sieve lets through at most, if it is to be used: a bound takes 15 times as long
TRIED = 3  # times as many documents as looked for are scored in a step, in all parts of a whole together
# Documents in a part, at least: to begin one takes as long as some of them take,
GLANCE = 1024  # by the sieve or to guess their scores,
LOOK = 256  # for a bound,
MEASURE = 8  # for a fine bound or a score.


@dataclass(frozen=True)
class Promising:
    """What a search knows once it has scored the most promising documents, of all or of a sample.

    Attributes:
        top: how many documents are looked for.
        floor: a score that those reach.
        wanted: which documents count; all if None.
        parts: of how many parts of a whole, which are searched together, these documents are one.
        samples: how many samples were looked at.
        done: (K,) the places of documents that were scored.
        guesses: (K,) of their scores, from before.
        scores: of them.
        every: (M,) the places of documents that may be among the best; None if a sample was looked at.
        estimate: (M,) guesses of their scores; None where those are no bounds, and only some were looked at.
    """

    top: int
    floor: float
    wanted: Wanted | None
    parts: int = 1
    samples: int = 0
    done: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    guesses: Floats = field(default_factory=lambda: np.zeros(0))
    scores: Scores = field(default_factory=lambda: Scores.none(0))
    every: NDArray[np.int64] | None = None
    estimate: Floats | None = None

    @property
    def tried(self) -> int:
        """How many of those that promise most are scored in a step."""
        return -(-TRIED * self.top // self.parts)

    @property
    def best(self) -> NDArray[np.int64]:
        """(K,) which of those that were scored are the best so far, ``top`` at most, in any order."""
        return largest(self.scores.score, self.top)

    @property
    def last(self) -> float:
        """A score that the best ``top`` documents reach, by what is known so far."""
        return max(self.floor, reached(self.scores.score, self.top))


class TopK:
    """The documents that a search chooses from, worked on by threads.

    Args:
        scorer: of the query.
        allowed: documents (K,) of each segment that may be found.
    """

    def __init__(self, scorer: Scorer, allowed: Mapping[str, Documents]) -> None:
        self._scorer = scorer
        self._names = list(allowed)
        self._begins = np.cumsum([0, *[len(part) for part in allowed.values()]])
        self._documents = np.concatenate([np.zeros(0, dtype=np.int64), *allowed.values()])

    def all(self) -> Scores:
        """The scores of all documents, in the order in which they were given."""
        return self._scores(np.arange(len(self._documents)), 0.0)

    def best(
        self, top: int, least: float = 0.0, wanted: Wanted | None = None
    ) -> tuple[NDArray[np.int64], Scores]:
        """The ``top`` best documents and all that tie with the last of them: their places, and scores.

        Places count in the order in which the documents were given. Those without a match are left out. Exact:
        whatever else there is has a bound below ``top`` scores.

        Args:
            top: 1 or more.
            least: only documents whose score reaches it.
            wanted: which documents count, given the places and scores of some (K,); all if None. It is asked
                only for those whose score matters.
        """
        return self.rest(self.promising(top, least, wanted))

    def promising(
        self,
        top: int,
        least: float = 0.0,
        wanted: Wanted | None = None,
        likely: NDArray[np.int64] | None = None,
        parts: int = 1,
    ) -> Promising:
        """The first step of `best`: scores the documents that promise most, of all or, if they are many, of
        the ``likely`` places, or of a sample. What its best reach, others have to reach as well.

        Where these documents are one of several parts of a whole, fewer of each are looked at and scored.
        """
        found = Promising(top, least, wanted, parts)
        if not self._sieves:
            return self._scored(found, self._every)
        if likely is None or len(likely) < found.tried:
            return self._sampled(found)
        return replace(self._scored(found, likely), every=None, estimate=None)

    def narrowed(self, promising: Promising, floor: float = 0.0) -> Promising:
        """The next step after that, to be taken until ``every`` place that may be among the best is known.

        Looks at a sample, or a larger one, if more places than that has may reach the floor, else scores those
        of them that promise most.

        Args:
            promising: what the step before found.
            floor: a score that the ``top`` best of more documents than these reach.
        """
        if promising.every is not None:
            return promising
        found, every = replace(promising, floor=max(floor, promising.last)), self._every
        share = self._share(every, found.floor, FEW // found.parts)
        most = share * len(every) * found.parts
        if found.samples < len(SAMPLES) and most > SAMPLES[found.samples]:
            return self._sampled(found)
        if share > LOOSE:
            return self._scored(found, every)
        passing, promise = self._sieved(every, found.floor)
        if len(passing) <= LIKELY:
            return replace(found, every=passing, estimate=None)
        some = passing[np.sort(largest(promise, LIKELY))]
        return replace(self._scored(found, some), every=passing, estimate=None)

    def rest(self, promising: Promising, floor: float = 0.0) -> tuple[NDArray[np.int64], Scores]:
        """The last step of `best`: looks at the other documents.

        Args:
            promising: what the steps before found.
            floor: a score that the ``top`` best of more documents than these reach; lower ones are left out.
        """
        found = promising
        while found.every is None:
            found = self.narrowed(found, floor)
        scores, done, best = found.scores, found.done, found.scores.score[found.best]
        floor = max(floor, found.floor)
        last = max(floor, found.last)
        rest, bounds = self._hopeful(found, last)
        size = max(len(done), 1)
        while len(rest):
            # Batches grow: few of them, and what the first ones find spares a close look at the later ones.
            batch, rest, bounds = rest[:size], rest[size:], bounds[size:]
            size *= GROWTH
            tight = _joined(self._each(self._scorer.fine_bound, MEASURE, np.sort(batch), last))
            close = np.sort(batch)[tight >= last]
            more = self._counted(close, last, found.wanted)
            scores, done = Scores.joined([scores, more]), np.append(done, close)
            best = np.append(best, more.score)
            best = best[largest(best, found.top)]
            last = max(floor, reached(best, found.top))
            rest, bounds = rest[bounds >= last], bounds[bounds >= last]
        kept = np.flatnonzero((scores.score > 0) & (scores.score >= last))
        return done[kept], scores[kept]

    @property
    def _sieves(self) -> bool:
        return len(self._documents) >= SIEVED and self._scorer.sieves

    @cached_property
    def _every(self) -> NDArray[np.int64]:
        """All places."""
        return np.arange(len(self._documents))

    def _sieved(self, places: NDArray[np.int64], floor: float) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        """The places where scores may reach the floor, and how much these promise."""
        parts = self._each(self._scorer.may_reach, GLANCE, places, floor)
        promise = np.concatenate([np.zeros(0, np.int32), *parts])
        passing = np.flatnonzero(promise > 0)
        return places[passing], promise[passing]

    def _share(self, places: NDArray[np.int64], floor: float, few: int = FEW) -> float:
        """The share of places that the sieve lets through, as so few tell."""
        some = places[:: -(-len(places) // max(few, 1))]
        return len(self._sieved(some, floor)[0]) / len(some)

    def _hopeful(self, found: Promising, last: float) -> tuple[NDArray[np.int64], Floats]:
        """The places whose bounds reach the score of the last, and the bounds, the largest first."""
        assert found.every is not None
        every, bounds = found.every, found.estimate
        if self._sieves and last > found.floor:
            few = FEW // found.parts
            if len(every) <= few or self._share(every, last, few) <= LOOSE:
                every = self._sieved(every, last)[0]
        if not self._scorer.estimates_are_bounds:
            bounds = _joined(self._each(self._scorer.bound, LOOK, every, last))
        assert bounds is not None
        hopeful = np.flatnonzero((bounds > 0) & (bounds >= last))
        hopeful = hopeful[absent(every[hopeful], found.done)]
        hopeful = hopeful[descending(bounds[hopeful])]
        return every[hopeful], bounds[hopeful]

    def _sampled(self, found: Promising) -> Promising:
        """What is known once those that promise most of the next sample are scored, too."""
        every, half = len(self._documents), max(SAMPLES[found.samples] // 2 // found.parts, 1)
        anywhere = np.arange(0, every, -(-every // half))
        like = self._likeliest(half, GLANCED // found.parts)
        found = self._scored(found, distinct(np.concatenate([anywhere, like])))
        found = self._scored(found, self._around(found))
        return replace(found, samples=found.samples + 1, every=None, estimate=None)

    def _likeliest(self, count: int, glanced: int) -> NDArray[np.int64]:
        """So many places that look most like the query at a glance, of blocks all over the documents."""
        every = len(self._documents)
        begins = np.arange(0, every, BLOCK * -(-every // glanced))
        places = (begins[:, None] + np.arange(BLOCK)).ravel()
        places = places[: np.searchsorted(places, every)]
        parts = self._each(self._scorer.unlikeness, GLANCE, places)
        return places[smallest(np.concatenate([np.zeros(0, np.int32), *parts]), count)]

    def _around(self, found: Promising) -> NDArray[np.int64]:
        """The places next to those of the best that were not scored yet."""
        best = found.done[largest(found.scores.score, -(-found.tried // 2))]
        places = distinct(best[:, None] + np.arange(-AROUND, AROUND + 1))
        inside = places[(places >= 0) & (places < len(self._documents))]
        return inside[absent(inside, found.done)]

    def _scored(self, found: Promising, places: NDArray[np.int64]) -> Promising:
        """What is known once those that promise most of ascending places are scored, too."""
        estimate = _joined(self._each(self._scorer.estimate, GLANCE, places))
        others = np.flatnonzero(absent(places, found.done))
        best = largest(np.append(found.guesses, estimate[others]), found.tried) - len(found.done)
        chosen = others[np.sort(best[best >= 0])]
        scores = self._counted(places[chosen], found.floor, found.wanted)
        return replace(
            found,
            done=np.append(found.done, places[chosen]),
            guesses=np.append(found.guesses, estimate[chosen]),
            scores=Scores.joined([found.scores, scores]),
            every=places,
            estimate=estimate,
        )

    def _counted(self, places: NDArray[np.int64], threshold: float, wanted: Wanted | None) -> Scores:
        """The scores at places, 0 of those that are not wanted; those below the threshold do not matter."""
        scores = self._scores(places, threshold)
        if wanted is not None:
            asked = np.flatnonzero((scores.score > 0) & (scores.score >= threshold))
            scores.score[asked[~wanted(places[asked], scores[asked])]] = 0.0
        return scores

    def _scores(self, places: NDArray[np.int64], threshold: float) -> Scores:
        order = np.argsort(places)
        back = np.empty(len(places), dtype=np.int64)
        back[order] = np.arange(len(places))
        return Scores.joined(self._each(self._scorer.score, MEASURE, places[order], threshold))[back]

    def _each(
        self, work: Callable[..., Part], least: int, places: NDArray[np.int64], *arguments: float
    ) -> Sequence[Part]:
        """What the work gives for ascending places, part by part of one segment each, at ``least`` so many."""
        threads = own_cores()
        share = max(least, len(places) // (SHARES * threads if threads > 1 else 1), 1)
        parts: list[tuple[str, Documents]] = []
        whole = len(places) == len(self._documents)  # they need not be picked
        for number, name in enumerate(self._names):
            begin, end = np.searchsorted(places, self._begins[number : number + 2])
            own = self._documents[begin:end] if whole else self._documents[places[begin:end]]
            parts += [(name, own[k : k + share]) for k in range(0, len(own), share)]
        return together(lambda part: work(*part, *arguments), parts)


def _joined(parts: Sequence[Floats]) -> Floats:
    return np.concatenate([np.zeros(0), *parts])
