"""How maps are scored, as Whoosh weighting models: the paper's intersection, and one agreed offset."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from os import cpu_count
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from whoosh.scoring import BaseScorer, WeightingModel

from m2t_text.config import MatchingParameters
from m2t_text.description.text import Text
from m2t_text.index import agreement, kernel
from m2t_text.index.collection import Collection, collection, segment_name
from m2t_text.index.postings import Texts
from m2t_text.index.views import QUARTER, views

Method = Literal["m2t", "bow"]

SHARE = 64  # documents, at least, that a thread takes
REACH = 400  # cells; a query's keypoints farther from its viewpoint match nothing, and cost no memory


@dataclass(frozen=True)
class Scores:
    """How well a query fits each of (N,) maps.

    Attributes:
        score: (N,) float64.
        matched: (N,) int32, the smaller of both maps' numbers of matched keypoints: the sum over the words of
            min(|Q'_a|, |M'_a|), or min(|Q'|, |M'|) at the agreed offset.
        alignment: (N, 3) float64, the pose of the query's frame in the map's frame that gave the score, in
            cells and radians.
    """

    score: NDArray[np.float64]
    matched: NDArray[np.int32]
    alignment: NDArray[np.float64]

    @classmethod
    def none(cls, maps: int) -> "Scores":
        """Nothing matches."""
        return cls(np.zeros(maps), np.zeros(maps, dtype=np.int32), np.zeros((maps, 3)))

    @classmethod
    def joined(cls, parts: "list[Scores]") -> "Scores":
        """The scores of all parts, one after the other."""
        fields = ("score", "matched", "alignment")
        return cls(
            *(np.concatenate([getattr(part, name) for part in (cls.none(0), *parts)]) for name in fields)
        )

    def __getitem__(self, chosen: NDArray[Any]) -> "Scores":
        return Scores(self.score[chosen], self.matched[chosen], self.alignment[chosen])


class MapWeighting(WeightingModel):
    """Scores maps by a whole text. Terms of other fields add nothing to the score: they filter."""

    @classmethod
    def of(cls, matching: MatchingParameters, method: Method = "m2t") -> "MapWeighting":
        """The model of these parameters, or the paper's baseline, which ignores the pose words."""
        if method == "bow":
            return HistogramIntersection(None, (0,), matching.weighted)
        if matching.score == "agreement":
            return OffsetAgreement(matching.window, matching.turns, matching.directions)
        return HistogramIntersection(matching.window, matching.turns, matching.weighted)

    def scorer(self, searcher: Any, fieldname: str, text: Any, qf: float = 1) -> BaseScorer:
        """The scorer of a `Text` for the maps of a segment; of anything else, one that adds nothing."""
        if not isinstance(text, Text):
            return NoScore()
        whole, name = collection(searcher, fieldname), segment_name(searcher.reader())
        return MapScorer(self.scores(text, whole, name), whole.segments[name].live)

    def scores(self, text: Text, whole: Collection, name: str) -> Scores:
        """The scores of all maps of one segment, deleted ones too."""
        raise NotImplementedError


@dataclass(frozen=True)
class HistogramIntersection(MapWeighting):
    """Scores maps by the words that they share with the query (paper, III-C, IV-D).

    Attributes:
        window: cells by which matched keypoints may differ in x and in y; None for a bag of words.
        turns: quarter turns of the query that are tried; the best score is kept, the smallest turn on ties.
        weighted: words weighted by rarity, and the score divided by the geometric mean of both maps' own
            weights, so that it lies in 0...1. Otherwise the score is the plain number of matches.
    """

    window: int | None = 10
    turns: tuple[int, ...] = (0, 1, 2, 3)
    weighted: bool = True

    def scores(self, text: Text, whole: Collection, name: str) -> Scores:
        weights = whole.weights if self.weighted else np.ones(len(whole.frequency))
        count, score = intersect(whole.segments[name].texts.postings, text, self, weights)
        if self.weighted:
            own = float(weights[text.wa].sum())
            norm = np.sqrt(own * whole.norms[name])
            score /= np.where(norm > 0, norm, 1.0)[:, None]
        slot = score.argmax(axis=1)  # the first of equals, and turns ascend
        rows = np.arange(len(slot))
        alignment = np.zeros((len(slot), 3))
        alignment[:, 2] = np.array(sorted(self.turns) + [0] * kernel.SLOTS)[slot] * QUARTER
        return Scores(score[rows, slot], count[rows, slot], alignment)


@dataclass(frozen=True)
class OffsetAgreement(MapWeighting):
    """Scores maps by the share of keypoints that match at the one offset for which most words vote.

    The score is (|Q'| + |M'|) / (|Q| + |M|), 1 for equal maps; see `agreement`. It depends on the two maps
    alone, not on what else the index holds.

    Attributes:
        window: cells by which the two viewpoints may lie apart in x and in y.
        turns: quarter turns of the query that are tried in each direction.
        directions: likely directions of the query's walls that are tried, at most.
    """

    window: int = 10
    turns: tuple[int, ...] = (0, 1, 2, 3)
    directions: int = 3

    def scores(self, text: Text, whole: Collection, name: str) -> Scores:
        return agreed(whole.segments[name].texts, text, self)


class NoScore(BaseScorer):
    """Adds nothing to the score."""

    def score(self, matcher: Any) -> float:
        return 0.0

    def max_quality(self) -> float:
        return 0.0

    def block_quality(self, matcher: Any) -> float:
        return 0.0


class MapScorer(BaseScorer):
    """The scores of one query for all maps of a segment, computed at once; ``live`` tells deleted ones."""

    def __init__(self, scores: Scores, live: NDArray[np.bool_]) -> None:
        self.scores = scores
        self.live = live

    def score(self, matcher: Any) -> float:
        return float(self.scores.score[matcher.id()])


def intersect(
    postings: Any, text: Text, model: HistogramIntersection, weights: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """(documents, turns) numbers of matches with each document under each turn, and their weighted sums."""
    words, firsts = np.unique(text.wa, return_index=True)
    query = (words.astype(np.int64), np.append(firsts, len(text)).astype(np.int64))
    shape = (postings.documents, 1 if model.window is None else kernel.SLOTS)
    count, score = np.zeros(shape, dtype=np.int32), np.zeros(shape)
    if model.window is None:
        kernel.unfiltered(postings.starts, postings.doc, *query, weights, count[:, 0], score[:, 0])
    elif len(text):
        seen = views(text, model.turns)
        arrays = (postings.starts, postings.doc, postings.wx, postings.wy)
        kernel.filtered(
            *arrays, *query, seen.wx, seen.wy, model.window, weights, 0, postings.documents, count, score
        )
    return count, score


def agreed(texts: Texts, text: Text, model: OffsetAgreement) -> Scores:
    """How far each document of a segment agrees with the query on one offset. Threads share the documents."""
    documents = len(texts.counts)
    if not len(text):
        return Scores.none(documents)
    seen = views(text, model.turns, model.directions)
    near = np.maximum(np.abs(seen.wx), np.abs(seen.wy)).max(axis=0) <= REACH
    cut = [np.ascontiguousarray(words[..., near]) for words in (seen.wx, seen.wy, seen.wa)]
    if not near.any():
        return Scores.none(documents)
    both, matched = np.zeros(documents, dtype=np.int32), np.zeros(documents, dtype=np.int32)
    found = np.zeros((documents, 3), dtype=np.int32)
    stored = (texts.starts, texts.text.wx, texts.text.wy, texts.text.wa)
    measure = partial(agreement.agree, *stored, *cut, model.window)
    parts = min(cpu_count() or 1, max(1, documents // SHARE))
    bounds = np.linspace(0, documents, parts + 1).astype(np.int64)
    with ThreadPoolExecutor(parts) as pool:
        list(pool.map(lambda k: measure(bounds[k], bounds[k + 1], both, matched, found), range(parts)))
    alignment = np.column_stack([found[:, 1:], seen.angles[found[:, 0]]])
    return Scores(both / (len(text) + texts.counts), matched, alignment)
