"""How maps are scored, as Whoosh weighting models: the paper's intersection, and one agreed offset."""

import threading
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from whoosh.scoring import BaseScorer, WeightingModel

from m2t_text.config import MatchingParameters
from m2t_text.description.text import Text
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.scores import Scores
from m2t_text.index.kernels.views import views
from m2t_text.index.search.collection import Collection, SegmentTexts, collection, segment_name
from m2t_text.index.search.scorers import AgreementQuery, AgreementScorer, BagScorer, IntersectionScorer
from m2t_text.index.search.top_k import Scorer, TopK
from m2t_text.util.workers import together

Method = Literal["m2t", "bow"]


class MapWeighting(WeightingModel):
    """Scores maps by a whole text. Terms of other fields add nothing to the score: they filter."""

    @staticmethod
    def of(matching: MatchingParameters, method: Method = "m2t") -> "MapWeighting":
        """The model of a profile: its own score, or the paper's baseline without pose words."""
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
        documents = np.arange(len(whole.segments[name].live))
        scores = TopK(self.text_scorer(text, whole), {name: documents}).all()
        return MapScorer(scores, whole.segments[name].live)

    def text_scorer(self, text: Text, whole: Collection) -> Scorer:
        """How well a text fits the maps of a collection."""
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

    def text_scorer(self, text: Text, whole: Collection) -> Scorer:
        if self.window is None:
            return BagScorer(text, whole, self.weighted)
        return IntersectionScorer(text, whole, self.window, self.turns, self.weighted)


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

    def text_scorer(self, text: Text, whole: Collection) -> Scorer:
        return AgreementScorer(self._query(text), whole)

    def _query(self, text: Text) -> AgreementQuery:
        """The text in tables; where several indexes are searched as one, it is made once for all of them."""
        with _making:
            latest = _latest.get("query")
            if latest is None or latest[0] is not text or latest[1] != self:
                made = AgreementQuery(views(text, self.turns, self.directions), self.window)
                _latest["query"] = latest = (text, self, made)
            return latest[2]


_making = threading.Lock()
_latest: dict[str, tuple[Text, OffsetAgreement, AgreementQuery]] = {}


def agreed_by_turn(texts: Texts, text: Text, model: OffsetAgreement) -> list[Scores]:
    """How far each of some packed texts agrees with a query, under each of the model's turns alone."""
    live, every = np.ones(texts.documents, dtype=np.bool_), np.arange(texts.documents)
    whole = Collection({"": SegmentTexts(texts, live)}, texts.documents)
    seen = views(text, model.turns, model.directions)

    def of_turn(number: int) -> Scores:
        query = AgreementQuery(seen[number :: len(model.turns)], model.window)
        return AgreementScorer(query, whole).score("", every)

    return together(of_turn, range(len(model.turns)))


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
