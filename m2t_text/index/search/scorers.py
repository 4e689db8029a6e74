"""Scores and their bounds: what a query's weighting asks of the compiled code."""

import threading
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.text import Text
from m2t_text.index.kernels import agreement, bounds, intersection
from m2t_text.index.kernels.bitmaps import COARSE, FINE, Grid, Scratch
from m2t_text.index.kernels.bound_tables import WINDOW, Bounder, FineBounder
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.scores import Scores
from m2t_text.index.kernels.views import QUARTER, Views, views
from m2t_text.index.search.collection import Collection
from m2t_text.util.types import Floats

Documents = NDArray[np.int64]
Counts = NDArray[np.int32]
Made = TypeVar("Made")

REACH = 400  # cells; a query's keypoints farther from its viewpoint match nothing, and cost no memory
ROUNDING = 1 - 1e-12  # of a sum that is needed to reach a quotient


class WordMeasure:
    """What bags of words and their filtered intersection have in common."""

    promises_bounds = True

    def __init__(self, text: Text, whole: Collection, weighted: bool) -> None:
        self.text = text
        self.whole = whole
        self.weighted = weighted
        self.counts = np.bincount(text.wa, minlength=len(whole.frequency)).astype(np.int64)
        self.weights = whole.weights if weighted else np.ones(len(whole.frequency))
        self._own = float(self.weights[text.wa].sum())

    def norms(self, name: str, documents: Documents) -> Floats:
        """What the sums of documents are divided by."""
        if not self.weighted:
            return np.ones(len(documents))
        norms = np.sqrt(self._own * self.whole.norms[name][documents])
        return np.where(norms > 0, norms, 1.0)

    def promise(self, name: str, documents: Documents) -> Floats:
        return self.bound(name, documents)

    def bound(self, name: str, documents: Documents, threshold: float = 0.0) -> Floats:
        sums = np.zeros(len(documents))
        intersection.bounds(self.texts(name), documents, self.counts, self.weights, sums)
        return sums / self.norms(name, documents)

    def tighten(self, name: str, documents: Documents, threshold: float) -> Floats:
        return np.full(len(documents), np.inf)  # nothing better is known

    def texts(self, name: str) -> Texts:
        """Those of a segment."""
        return self.whole.segments[name].texts


class BagMeasure(WordMeasure):
    """The paper's baseline without pose words (III-C)."""

    def measure(self, name: str, documents: Documents, threshold: float = 0.0) -> Scores:
        count, sums = np.zeros(len(documents), dtype=np.int32), np.zeros(len(documents))
        intersection.bags(self.texts(name), documents, self.counts, self.weights, count, sums)
        return Scores(sums / self.norms(name, documents), count, np.zeros((len(documents), 3)))


class IntersectionMeasure(WordMeasure):
    """The filtered histogram intersection under several turns (IV-D)."""

    def __init__(
        self, text: Text, whole: Collection, window: int, turns: tuple[int, ...], weighted: bool
    ) -> None:
        super().__init__(text, whole, weighted)
        self._turns = np.isin(np.arange(intersection.TURNS), turns)
        self._tables = intersection.Tables.of(text, window)

    def measure(self, name: str, documents: Documents, threshold: float = 0.0) -> Scores:
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


class AgreementMeasure:
    """The share of keypoints that match at the agreed offset."""

    promises_bounds = False

    def __init__(
        self, text: Text, whole: Collection, window: int, turns: tuple[int, ...], directions: int
    ) -> None:
        self._whole = whole
        self._size = len(text)
        self._window = window
        seen = views(text, turns, directions)
        near = np.maximum(np.abs(seen.wx), np.abs(seen.wy)).max(axis=0, initial=0) <= REACH
        cells = (np.ascontiguousarray(words[..., near]) for words in (seen.wx, seen.wy, seen.wa))
        self._seen = Views(seen.angles, *cells)
        self._rooms = threading.local()
        self._made: dict[str, Any] = {}
        self._lock = threading.RLock()

    @property
    def _board(self) -> agreement.Board:
        return self._once("board", lambda: agreement.Board.of(self._seen, self._window))

    @property
    def _bounder(self) -> Bounder:
        return self._once("bounder", lambda: Bounder.of(self._seen))

    @property
    def _finer(self) -> FineBounder:
        return self._once("finer", lambda: FineBounder.of(self._seen, self._bounder))

    def _once(self, name: str, make: Callable[[], Made]) -> Made:
        """What the first thread that needs it makes, while the others wait."""
        with self._lock:
            if name not in self._made:
                self._made[name] = make()
            made: Made = self._made[name]
            return made

    def promise(self, name: str, documents: Documents) -> Floats:
        shares = np.zeros(len(documents))
        if len(self._seen.wa):
            bounds.glances(self._texts(name), documents, self._bounder, shares)
        return shares

    def bound(self, name: str, documents: Documents, threshold: float = 0.0) -> Floats:
        def coarse(needed: Counts, most: Counts) -> None:
            room = self._room(COARSE)
            bounds.coarse_bounds(self._texts(name), documents, self._bounder, needed, room, most)

        return self._bounded(coarse, name, documents, threshold)

    def tighten(self, name: str, documents: Documents, threshold: float) -> Floats:
        def fine(needed: Counts, most: Counts) -> None:
            query, rooms = (self._bounder, self._finer), (self._room(COARSE), self._room(FINE))
            bounds.fine_bounds(self._texts(name), documents, *query, needed, *rooms, most)

        return self._bounded(fine, name, documents, threshold)

    def _bounded(
        self, bound: Callable[[Counts, Counts], None], name: str, documents: Documents, threshold: float
    ) -> Floats:
        """Bounds of scores, by one of |Q'| + |M'| that, for what is needed, writes the most there may be."""
        if not len(self._seen.wa):
            return np.zeros(len(documents))
        if self._window > WINDOW:
            return np.ones(len(documents))
        sizes = self._sizes(name, documents)
        needed = np.ceil(threshold * sizes)
        needed -= (needed - 1) / sizes >= threshold  # where rounding went up
        most = np.zeros(len(documents), dtype=np.int32)
        bound(needed.astype(np.int32), most)
        return most / sizes

    def measure(self, name: str, documents: Documents, threshold: float = 0.0) -> Scores:
        if not len(self._seen.wa) or not len(documents):
            return Scores.none(len(documents))
        both, matched = np.zeros(len(documents), dtype=np.int32), np.zeros(len(documents), dtype=np.int32)
        found = np.zeros((len(documents), 3), dtype=np.int32)
        agreement.agree(self._texts(name), documents, self._board, both, matched, found)
        alignment = np.column_stack([found[:, 1:], self._seen.angles[found[:, 0]]])
        return Scores(both / self._sizes(name, documents), matched, alignment)

    def _texts(self, name: str) -> Texts:
        return self._whole.segments[name].texts

    def _sizes(self, name: str, documents: Documents) -> NDArray[np.int64]:
        """|Q| + |M| of documents."""
        starts = self._texts(name).starts
        return self._size + starts[documents + 1] - starts[documents]

    def _room(self, grid: Grid) -> Scratch:
        """Room for a map on this grid, kept by each thread from one call to the next."""
        rooms = self._rooms.__dict__.setdefault("rooms", {})
        if grid not in rooms:
            rooms[grid] = grid.scratch()
        return rooms[grid]
