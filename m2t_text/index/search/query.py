"""Queries that Whoosh lacks: for a whole map, and for a range of a column of numbers."""

from bisect import bisect_left
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray
from whoosh.matching import Matcher, NullMatcher, ReadTooFar
from whoosh.query import Query

from m2t_text.description.text import Text
from m2t_text.index.search.weighting import HistogramIntersection, MapScorer, MapWeighting, OffsetAgreement


class SegmentQuery(Query):
    """A query that is equal to another by its attributes, and of which nothing is known before it is run."""

    def _key(self) -> tuple[Any, ...]:
        raise NotImplementedError

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SegmentQuery) and type(self) is type(other) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def estimate_size(self, ixreader: Any) -> int:
        return int(ixreader.doc_count_all())

    def estimate_min_size(self, ixreader: Any) -> int:
        return 0


class MapQuery(SegmentQuery):
    """Finds the maps that share keypoints with a text: same word, and position within the window.

    The searcher's weighting decides window, turns and score if it is a `MapWeighting`, else the parameters of
    the index do. It composes with any other query, filter and mask.

    Args:
        text: of the whole query map; one keypoint stands for its token and all neighbours.
        turns: quarter turns to try instead of the weighting's; (0,) for tokens typed in the maps' own frame.
        window: cells, with ``turns`` only, instead of the weighting's.
    """

    def __init__(
        self,
        text: Text,
        fieldname: str = "text",
        turns: tuple[int, ...] | None = None,
        window: int | None = None,
        boost: float = 1.0,
    ) -> None:
        self.text = text
        self.fieldname = fieldname
        self.turns = turns
        self.window = window
        self.boost = boost

    def _key(self) -> tuple[Any, ...]:
        return str(self.text), self.fieldname, self.turns, self.window, self.boost

    def __repr__(self) -> str:
        return f"MapQuery({str(self)!r}, turns={self.turns}, window={self.window}, boost={self.boost})"

    def __str__(self) -> str:
        shown = str(self.text) if len(self.text) <= 3 else f"{len(self.text)} keypoints"
        return f"{self.fieldname}:{shown}"

    __unicode__ = __str__

    def matcher(self, searcher: Any, context: Any = None) -> Matcher:
        """The matches in one segment; numbers are the segment's own, deleted maps are left out."""
        if not searcher.reader().doc_count_all():
            return NullMatcher()
        model = self._model(searcher, context.weighting if context is not None else None)
        scorer = model.scorer(searcher, self.fieldname, self.text)
        assert isinstance(scorer, MapScorer)
        scores = scorer.scores.score
        found = np.flatnonzero((scores > 0) & scorer.live)
        return ArrayMatcher(found, scores[found] * self.boost)

    def _model(self, searcher: Any, weighting: Any) -> MapWeighting:
        """Also without scores the searcher's weighting decides what matches."""
        for model in (weighting, searcher.weighting):
            if isinstance(model, MapWeighting):
                break
        else:
            model = MapWeighting.of(searcher.schema[self.fieldname].parameters.matching)
        if self.turns is None:
            return model
        own = model.window if isinstance(model, HistogramIntersection | OffsetAgreement) else None
        window = own if self.window is None else self.window
        return HistogramIntersection(window, self.turns, weighted=False)


class AnyToken(SegmentQuery):
    """Finds the maps that have tokens. Whoosh's own `Every` reads the documents of each term for it."""

    def __init__(self, fieldname: str = "text", boost: float = 1.0) -> None:
        self.fieldname = fieldname
        self.boost = boost

    def _key(self) -> tuple[Any, ...]:
        return self.fieldname, self.boost

    def __repr__(self) -> str:
        return f"AnyToken{self._key()!r}"

    def __str__(self) -> str:
        return f"{self.fieldname}:*"

    __unicode__ = __str__

    def matcher(self, searcher: Any, context: Any = None) -> Matcher:
        reader = searcher.reader()
        found = [number for number in reader.all_doc_ids() if reader.doc_field_length(number, self.fieldname)]
        return ArrayMatcher(np.array(found, dtype=np.int64), np.full(len(found), self.boost))


class NumberRange(SegmentQuery):
    """Finds the documents whose number in a column lies in a range; None is an open end."""

    def __init__(
        self,
        fieldname: str,
        start: float | None,
        end: float | None,
        startexcl: bool = False,
        endexcl: bool = False,
        boost: float = 1.0,
    ) -> None:
        self.fieldname = fieldname
        self.start, self.end = start, end
        self.startexcl, self.endexcl = startexcl, endexcl
        self.boost = boost

    def _key(self) -> tuple[Any, ...]:
        return self.fieldname, self.start, self.end, self.startexcl, self.endexcl, self.boost

    def __repr__(self) -> str:
        return f"NumberRange{self._key()!r}"

    def __str__(self) -> str:
        left, right = "{" if self.startexcl else "[", "}" if self.endexcl else "]"
        start, end = ("" if end is None else str(end) for end in (self.start, self.end))
        return f"{self.fieldname}:{left}{start} TO {end}{right}"

    __unicode__ = __str__

    def is_range(self) -> bool:
        return True

    def matcher(self, searcher: Any, context: Any = None) -> Matcher:
        """The matches in one segment. Each scores the boost; where maps are ranked by their texts, nothing."""
        reader = searcher.reader()
        if not reader.doc_count_all():
            return NullMatcher()
        values = reader.column_reader(self.fieldname, translate=False).array
        inside = np.ones(len(values), dtype=np.bool_)
        if self.start is not None:
            inside &= values > self.start if self.startexcl else values >= self.start
        if self.end is not None:
            inside &= values < self.end if self.endexcl else values <= self.end
        inside[list(reader.segment().deleted_docs())] = False
        found = np.flatnonzero(inside)
        by_text = context is not None and isinstance(context.weighting, MapWeighting)
        return ArrayMatcher(found, np.full(len(found), 0.0 if by_text else self.boost))


class ArrayMatcher(Matcher):
    """Matches and scores that are known beforehand.

    It offers no block qualities: scoring is done, so skipping saves little, and where Whoosh joins two
    matchers it skips one by the other's current block, which loses matches when their blocks differ.

    Args:
        docs: (N,) ascending document numbers in the segment.
        scores: (N,) of them.
    """

    def __init__(self, docs: NDArray[np.int64], scores: NDArray[np.float64], place: int = 0) -> None:
        self._docs: list[int] = docs.tolist()
        self._scores: list[float] = scores.tolist()
        self._place = place

    def is_active(self) -> bool:
        return self._place < len(self._docs)

    def id(self) -> int:
        return self._docs[self._place]

    def score(self) -> float:
        return self._scores[self._place]

    def weight(self) -> float:
        return self.score()

    def all_ids(self) -> list[int]:
        return self._docs[self._place :]

    def next(self) -> bool:
        if not self.is_active():
            raise ReadTooFar
        self._place += 1
        return True

    def skip_to(self, id: int) -> None:
        if not self.is_active():
            raise ReadTooFar
        self._place = bisect_left(self._docs, id, self._place)

    def reset(self) -> None:
        self._place = 0

    def copy(self) -> "ArrayMatcher":
        return copy(self)

    def replace(self, minquality: float = 0) -> Matcher:
        return self if self.is_active() else NullMatcher()

    def supports(self, astype: str) -> bool:
        return False

    def supports_block_quality(self) -> bool:
        return False

    def max_quality(self) -> float:
        """A bound for the scores to come; joined matchers ask for it even where blocks are not supported."""
        return max(self._scores, default=0.0)

    def block_quality(self) -> float:
        return self.max_quality()

    def skip_to_quality(self, minquality: float) -> int:
        return 0
