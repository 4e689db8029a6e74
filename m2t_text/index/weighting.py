"""The histogram intersection as a Whoosh weighting model (paper, III-C, IV-D)."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from whoosh.scoring import BaseScorer, WeightingModel

from m2t_text.config import MatchingParameters
from m2t_text.description.text import Text
from m2t_text.index import kernel
from m2t_text.index.collection import collection, segment_name

Method = Literal["m2t", "bow"]


@dataclass(frozen=True)
class Scores:
    """How well a query fits each of (N,) maps.

    Attributes:
        score: (N,) float64.
        matched: (N,) int32, the sum over the words of min(|Q'_a|, |M'_a|) at the best turn.
        turn: (N,) int8, the best turn: quarter turns of the query, counter-clockwise.
    """

    score: NDArray[np.float64]
    matched: NDArray[np.int32]
    turn: NDArray[np.int8]

    @classmethod
    def joined(cls, parts: "list[Scores]") -> "Scores":
        """The scores of all parts, one after the other."""
        none = cls(np.zeros(0), np.zeros(0, dtype=np.int32), np.zeros(0, dtype=np.int8))
        fields = ("score", "matched", "turn")
        return cls(*(np.concatenate([getattr(part, name) for part in (none, *parts)]) for name in fields))

    def __getitem__(self, chosen: NDArray[Any]) -> "Scores":
        return Scores(self.score[chosen], self.matched[chosen], self.turn[chosen])


@dataclass(frozen=True)
class HistogramIntersection(WeightingModel):
    """Scores maps by the words that they share with the query.

    Attributes:
        window: cells by which matched keypoints may differ in x and in y; None for a bag of words.
        turns: quarter turns of the query that are tried; the best score is kept, the smallest turn on ties.
        weighted: words weighted by rarity, and the score divided by the geometric mean of both maps' own
            weights, so that it lies in 0...1. Otherwise the score is the plain number of matches.

    Terms of other fields add nothing to the score: they filter.
    """

    window: int | None = 10
    turns: tuple[int, ...] = (0, 1, 2, 3)
    weighted: bool = True

    @classmethod
    def of(cls, matching: MatchingParameters, method: Method = "m2t") -> "HistogramIntersection":
        """The model of these parameters: with the window, or the paper's baseline without."""
        if method == "bow":
            return cls(None, (0,), matching.weighted)
        return cls(matching.window, matching.turns, matching.weighted)

    def scorer(self, searcher: Any, fieldname: str, text: Any, qf: float = 1) -> BaseScorer:
        """The scorer of a `Text` for the maps of a segment; of anything else, one that adds nothing."""
        if not isinstance(text, Text):
            return NoScore()
        return IntersectionScorer(self, searcher, fieldname, text)


class NoScore(BaseScorer):
    """Adds nothing to the score."""

    def score(self, matcher: Any) -> float:
        return 0.0

    def max_quality(self) -> float:
        return 0.0

    def block_quality(self, matcher: Any) -> float:
        return 0.0


class IntersectionScorer(BaseScorer):
    """The scores of one query for all maps of a segment, computed at once."""

    def __init__(self, model: HistogramIntersection, searcher: Any, fieldname: str, text: Text) -> None:
        whole = collection(searcher, fieldname)
        name = segment_name(searcher.reader())
        self.live = whole.segments[name].live
        weights = whole.weights if model.weighted else np.ones_like(whole.weights)
        count, score = intersect(whole.segments[name].postings, text, model, weights)
        if model.weighted:
            own = float(weights[text.wa].sum())
            norm = np.sqrt(own * whole.norms[name])
            score /= np.where(norm > 0, norm, 1.0)[:, None]
        slot = score.argmax(axis=1)  # the first of equals, and turns ascend
        rows = np.arange(len(slot))
        turns = np.array(sorted(model.turns) + [0] * kernel.SLOTS, dtype=np.int8)
        self.scores = Scores(score[rows, slot], count[rows, slot], turns[slot])

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
        x, y = kernel.turned(text.wx.astype(np.int64), text.wy.astype(np.int64), tuple(sorted(model.turns)))
        arrays = (postings.starts, postings.doc, postings.wx, postings.wy)
        kernel.filtered(*arrays, *query, x, y, model.window, weights, 0, postings.documents, count, score)
    return count, score
