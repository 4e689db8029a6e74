"""The paper's matching word for word, in plain Whoosh (III-C, IV-D): slow, and the definition of the fast one.

A map is a document of tokens. A token of the query finds itself and its neighbours in the lexicon: the same
word, and a position within the window. Of a word a, Q'_a are the query's tokens that find one in the map, and
M'_a the map's tokens that are found. The score is the sum of min(|Q'_a|, |M'_a|) over all words; of several
turns of the query, the best counts.

Nothing is compiled here, and no index of this package is needed: any Whoosh index will do whose field of texts
has vectors. `MapQuery` scores the same to the last bit, under the `HistogramIntersection` that is not weighted.

Examples:
    >>> import m2t_text as m2t
    >>> from m2t_text.index.search.literal import LiteralIntersection, LiteralQuery
    >>> index = m2t.MapIndex.open("indexes/default")
    >>> text = index.document("drive/000040").text
    >>> with index.whoosh.searcher(weighting=LiteralIntersection(window=0, turns=(0,))) as searcher:
    ...     best = searcher.search(LiteralQuery("text", text), limit=1)[0]
    ...     print(best["map_id"], best.score == len(text))
    drive/000040 True
"""

import re
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from whoosh.matching import Matcher, WrappingMatcher
from whoosh.query import MultiTerm, Or, Query
from whoosh.scoring import BaseScorer, Frequency, WeightingModel
from whoosh.searching import SearchContext

from m2t_text.description.text import Text


@dataclass(unsafe_hash=True)
class NearToken(MultiTerm):
    """Finds the documents with a token, or one of the same word at most ``window`` cells away in x and y."""

    fieldname: str
    token: str
    window: int
    boost: float = 1.0

    def field(self) -> str:
        return self.fieldname

    def _btexts(self, ixreader: Any) -> Iterator[bytes]:
        x, y, word = map(int, re.findall(r"-?\d+", self.token))
        for near_x in range(x - self.window, x + self.window + 1):
            for near_y in range(y - self.window, y + self.window + 1):
                neighbour = f"x{near_x}_y{near_y}_a{word}".encode()
                if (self.fieldname, neighbour) in ixreader:
                    yield neighbour


@dataclass(eq=False)
class LiteralQuery(Query):
    """Finds the documents with a token near one of a text's, under any turn of a `LiteralIntersection`."""

    fieldname: str
    text: Text
    boost: float = 1.0

    def matcher(self, searcher: Any, context: Any = None) -> Matcher:
        model = searcher.weighting
        assert isinstance(model, LiteralIntersection)
        tokens = {token for turned in model.turned(self.text) for token in turned}
        near = Or([NearToken(self.fieldname, token, model.window) for token in sorted(tokens)])
        found = near.matcher(searcher, SearchContext(weighting=Frequency()))
        return ScoredMatcher(found, model.scorer(searcher, self.fieldname, self.text), self.boost)


@dataclass(frozen=True)
class LiteralIntersection(WeightingModel):
    """Scores documents by their filtered histogram intersection with a text.

    Attributes:
        window: cells by which tokens that match may differ in x and in y.
        turns: quarter turns of the text that are tried.
    """

    window: int = 10
    turns: tuple[int, ...] = (0, 1, 2, 3)

    def turned(self, text: Text) -> list[Counter[str]]:
        """The tokens of the text's keypoints under each turn, and how often each occurs."""
        texts = (str(text.turned(turn)).split() for turn in self.turns)
        return [Counter(token for token in tokens if "_a" in token) for tokens in texts]

    def scorer(self, searcher: Any, fieldname: str, text: Any, qf: float = 1) -> "LiteralScorer":
        reader = searcher.reader()
        near = [
            {
                (token, n): set(NearToken(fieldname, token, self.window)._btexts(reader))
                for token, n in turned.items()
            }
            for turned in self.turned(text)
        ]
        return LiteralScorer(reader, fieldname, near)


@dataclass
class LiteralScorer(BaseScorer):
    """The intersection of one text with documents.

    Attributes:
        near: for each turn, of each token and its number, the neighbours in the lexicon.
    """

    reader: Any
    fieldname: str
    near: list[dict[tuple[str, int], set[bytes]]]

    def score(self, matcher: Matcher) -> float:
        field, vector = self.reader.schema[self.fieldname], ("frequency", matcher.id(), self.fieldname)
        held = {field.to_bytes(token): n for token, n in self.reader.vector_as(*vector)}
        return float(max(intersection(near, held) for near in self.near))


def intersection(near: dict[tuple[str, int], set[bytes]], held: dict[bytes, int]) -> int:
    """The sum of min(|Q'_a|, |M'_a|); ``held`` are the tokens of the map, and how often it has each."""
    of_query, of_map = Counter[str](), defaultdict[str, set[bytes]](set)
    for (token, n), neighbours in near.items():
        word, found = token.rpartition("_a")[2], neighbours & held.keys()
        of_query[word] += n if found else 0
        of_map[word] |= found
    return sum(min(of_query[word], sum(held[token] for token in of_map[word])) for word in of_query)


class ScoredMatcher(WrappingMatcher):
    """The documents of another matcher, with scores of their own."""

    def __init__(self, child: Matcher, scorer: LiteralScorer, boost: float = 1.0) -> None:
        super().__init__(child, boost)
        self._scorer = scorer

    def score(self) -> float:
        return self._scorer.score(self) * self.boost

    def supports_block_quality(self) -> bool:
        return False

    def replace(self, minquality: float = 0) -> Matcher:
        return self
