"""Scores and their bounds: what a query's weighting asks of the compiled code."""

import threading
from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.text import WORDS, Text
from m2t_text.index.kernels import agreement, bounds, intersection, sieve
from m2t_text.index.kernels.bitmaps import COARSE, FINE
from m2t_text.index.kernels.bound_tables import WINDOW, CoarseTables, FineTables
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.scores import Scores
from m2t_text.index.kernels.tile_tables import TileTables
from m2t_text.index.kernels.views import QUARTER, Views
from m2t_text.index.search.collection import Collection
from m2t_text.util.types import Floats

Documents = NDArray[np.int64]

REACH = 400  # cells; a query's keypoints farther from its viewpoint match nothing, and cost no memory
ROUNDING = 1 - 1e-12  # of a sum that is needed to reach a quotient


class WordScorer:
    """What bags of words and their filtered intersection have in common."""

    estimates_are_bounds = True
    sieves = False

    def __init__(self, text: Text, whole: Collection, weighted: bool) -> None:
        self.text = text
        self.whole = whole
        self.weighted = weighted
        self.counts = np.bincount(text.wa, minlength=WORDS).astype(np.int64)
        self.weights = whole.weights if weighted else np.ones(WORDS)
        self._own = float(self.weights[text.wa].sum())

    def norms(self, name: str, documents: Documents) -> Floats:
        """What the sums of documents are divided by."""
        if not self.weighted:
            return np.ones(len(documents))
        norms = np.sqrt(self._own * self.whole.norms[name][documents])
        return np.where(norms > 0, norms, 1.0)

    def unlikeness(self, name: str, documents: Documents) -> NDArray[np.int32]:
        return np.zeros(len(documents), dtype=np.int32)

    def may_reach(self, name: str, documents: Documents, threshold: float) -> NDArray[np.int32]:
        return np.ones(len(documents), dtype=np.int32)

    def estimate(self, name: str, documents: Documents) -> Floats:
        return self.bound(name, documents)

    def bound(self, name: str, documents: Documents, threshold: float = 0.0) -> Floats:
        sums = np.zeros(len(documents))
        intersection.bounds(self.texts(name), documents, self.counts, self.weights, sums)
        return sums / self.norms(name, documents)

    def fine_bound(self, name: str, documents: Documents, threshold: float) -> Floats:
        return np.full(len(documents), np.inf)  # nothing better is known

    def texts(self, name: str) -> Texts:
        """Those of a segment."""
        return self.whole.segments[name].texts


class BagScorer(WordScorer):
    """The paper's baseline without pose words (III-C)."""

    def score(self, name: str, documents: Documents, threshold: float = 0.0) -> Scores:
        count, sums = np.zeros(len(documents), dtype=np.int32), np.zeros(len(documents))
        intersection.bags(self.texts(name), documents, self.counts, self.weights, count, sums)
        return Scores(sums / self.norms(name, documents), count, np.zeros((len(documents), 3)))


class IntersectionScorer(WordScorer):
    """The filtered histogram intersection under several turns (IV-D)."""

    def __init__(
        self, text: Text, whole: Collection, window: int, turns: tuple[int, ...], weighted: bool
    ) -> None:
        super().__init__(text, whole, weighted)
        self._turns = np.isin(np.arange(intersection.TURNS), turns)
        self._tables = intersection.IntersectionTables.of(text, window)

    def score(self, name: str, documents: Documents, threshold: float = 0.0) -> Scores:
        shape = (len(documents), intersection.TURNS)
        count, sums = np.zeros(shape, dtype=np.int32), np.zeros(shape)
        norms = self.norms(name, documents)
        needed = threshold * norms * ROUNDING
        intersection.intersect(
            self.texts(name), documents, self._tables, self.weights, self._turns, needed, count, sums
        )
        turns = np.flatnonzero(self._turns)
        turn = turns[(sums / norms[:, None])[:, turns].argmax(axis=1)]  # the first of equals
        rows = np.arange(len(documents))
        alignment = np.zeros((len(documents), 3))
        alignment[:, 2] = turn * QUARTER
        return Scores(sums[rows, turn] / norms, count[rows, turn], alignment)


class OwnLook(threading.local):
    """Room for a map on both grids, kept by each thread from one call to the next."""

    def __init__(self) -> None:
        self.look = bounds.Look(COARSE.scratch(), FINE.scratch())


class AgreementQuery:
    """A query as it is compared with maps: seen in several directions, and in tables.

    Tables are made when first used: verification needs no bounds, most searches no fine ones.
    """

    def __init__(self, seen: Views, window: int) -> None:
        self.size = len(seen.wa)
        self.window = window
        near = np.maximum(np.abs(seen.wx), np.abs(seen.wy)).max(axis=0, initial=0) <= REACH
        cells = (np.ascontiguousarray(words[..., near]) for words in (seen.wx, seen.wy, seen.wa))
        self.seen = Views(seen.angles, *cells)

    @cached_property
    def tables(self) -> agreement.AgreementTables:
        """For scores."""
        return agreement.AgreementTables.of(self.seen, self.window)

    @cached_property
    def coarse(self) -> CoarseTables:
        """For estimates and coarse bounds."""
        return CoarseTables.of(self.seen)

    @cached_property
    def tiles(self) -> TileTables:
        """For the sieve."""
        return TileTables.of(self.seen)

    @cached_property
    def fine(self) -> FineTables:
        """For fine bounds."""
        return FineTables.of(self.seen, self.coarse)


class AgreementScorer:
    """The share of keypoints that match at the agreed offset."""

    estimates_are_bounds = False

    def __init__(self, query: AgreementQuery, whole: Collection) -> None:
        self._query = query
        self._whole = whole
        self._own = OwnLook()

    def estimate(self, name: str, documents: Documents) -> Floats:
        if not len(self._query.seen.wa):
            return np.zeros(len(documents))
        return bounds.estimates(self._texts(name), documents, *self._bounder)

    @cached_property
    def sieves(self) -> bool:
        """Whether `unlikeness` and `may_reach` say something of a map."""
        return self._bounded and self._whole.uses_tiles

    def unlikeness(self, name: str, documents: Documents) -> NDArray[np.int32]:
        unlike = np.empty(len(documents), dtype=np.int32)
        sieve.unlikeness(self._whole.segments[name].tiles, documents, self._query.tiles, unlike)
        return unlike

    def may_reach(self, name: str, documents: Documents, threshold: float) -> NDArray[np.int32]:
        promise, needed = np.empty(len(documents), dtype=np.int32), self._needed(name, documents, threshold)
        sieve.may_reach(self._whole.segments[name].tiles, documents, self._query.tiles, needed, promise)
        return promise

    def bound(self, name: str, documents: Documents, threshold: float = 0.0) -> Floats:
        return self._shares(bounds.coarse_bounds, name, documents, threshold)

    def fine_bound(self, name: str, documents: Documents, threshold: float) -> Floats:
        return self._shares(bounds.fine_bounds, name, documents, threshold)

    def _shares(
        self, bounds_of: Callable[..., NDArray[np.int32]], name: str, documents: Documents, threshold: float
    ) -> Floats:
        """What the shares of documents (K,) cannot exceed."""
        if not self._bounded:
            return np.full(len(documents), float(len(self._query.seen.wa) > 0))
        coarse, fine, look = self._bounder
        needed = self._needed(name, documents, threshold)
        most = bounds_of(self._texts(name), documents, coarse, fine, needed, look)
        return most / self._sizes(name, documents)

    @property
    def _bounder(self) -> tuple[CoarseTables, FineTables, bounds.Look]:
        return self._query.coarse, self._query.fine, self._own.look

    @property
    def _bounded(self) -> bool:
        """Whether there is more to say than that a share is at most 1."""
        return len(self._query.seen.wa) > 0 and self._query.window <= WINDOW

    def _needed(self, name: str, documents: Documents, threshold: float) -> NDArray[np.int32]:
        """The least |Q'| + |M'| with which documents reach the threshold."""
        needed = np.empty(len(documents), dtype=np.int32)
        agreement.sums_needed(self._texts(name).starts, documents, self._query.size, threshold, needed)
        return needed

    def score(self, name: str, documents: Documents, threshold: float = 0.0) -> Scores:
        if not len(self._query.seen.wa) or not len(documents):
            return Scores.none(len(documents))
        both, matched = np.zeros(len(documents), dtype=np.int32), np.zeros(len(documents), dtype=np.int32)
        found = np.zeros((len(documents), 3), dtype=np.int32)
        agreement.agree(self._texts(name), documents, self._query.tables, both, matched, found)
        alignment = np.column_stack([found[:, 1:], self._query.seen.angles[found[:, 0]]])
        return Scores(both / self._sizes(name, documents), matched, alignment)

    def _texts(self, name: str) -> Texts:
        return self._whole.segments[name].texts

    def _sizes(self, name: str, documents: Documents) -> NDArray[np.int64]:
        """|Q| + |M| of documents."""
        starts = self._texts(name).starts
        return self._query.size + starts[documents + 1] - starts[documents]
