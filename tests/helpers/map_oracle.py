"""Random maps and an independent, slow oracle: a plain Whoosh index with every token as an ordinary term."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from functools import cached_property
from math import log, sqrt

import numpy as np
from whoosh.fields import ID, KEYWORD, Schema
from whoosh.filedb.filestore import RamStorage
from whoosh.query import Or, Term

from m2t_text.description.document import Document
from m2t_text.description.free_squares import FreeSquares
from m2t_text.description.text import Text, parse


def text_of(tokens: str) -> Text:
    return parse(tokens)


def document(dataset: str, first: int, text: Text, travel: float | None = None) -> Document:
    begin = first * 0.5 if travel is None else travel - 1.5
    rng = np.random.default_rng(first)
    return Document(
        dataset=dataset,
        first_scan=first,
        last_scan=first + 7,
        travel=np.array([begin, begin + 3.0]),
        pose=rng.normal(size=3),
        viewpoint=rng.normal(size=3),
        centre_of_gravity=rng.normal(size=2),
        points=100 + first,
        text=text,
    )


def random_text(rng: np.random.Generator, keypoints: int, span: int = 25, words: int = 12) -> Text:
    """Few words, skewed, over positions that are often within the window of each other, and often not.

    Some have free squares, beside the keypoints.
    """
    wa = np.minimum(rng.geometric(0.25, keypoints) - 1, words - 1)
    wx, wy = rng.integers(-span, span, (2, keypoints))
    squares = int(rng.integers(0, 8))
    free = FreeSquares.of(rng.integers(span, 2 * span, squares), *rng.integers(4, 30, (2, squares)))
    return Text.of(wx, wy, wa, free)


def random_documents(seed: int, dataset: str, count: int, keypoints: int = 40) -> list[Document]:
    rng = np.random.default_rng(seed)
    return [
        document(dataset, number, random_text(rng, int(rng.integers(0, keypoints)))) for number in range(count)
    ]


class Oracle:
    """The definitions of the paper (IV-D) in plain Python over what Whoosh's own postings say."""

    def __init__(self, documents: Iterable[Document]) -> None:
        schema = Schema(map_id=ID(stored=True), text=KEYWORD())
        self.index = RamStorage().create_index(schema)
        self.ids: list[str] = []
        with self.index.writer() as writer:
            for one in documents:
                self.ids.append(one.map_id)
                writer.add_document(map_id=one.map_id, text=" ".join(keypoints(one.text)))

    def postings(self, tokens: set[str]) -> dict[str, Counter[tuple[int, int, int]]]:
        """Of each map found by Whoosh's Or over the tokens: how often it has each of them."""
        found: dict[str, Counter[tuple[int, int, int]]] = defaultdict(Counter)
        with self.index.searcher() as searcher:
            reader = searcher.reader()
            hits = searcher.search(Or([Term("text", token) for token in tokens]), limit=None) if tokens else []
            named = {hit.docnum: hit["map_id"] for hit in hits}
            for token in tokens:
                matcher = reader.postings("text", token)
                while matcher.is_active():
                    found[named[matcher.id()]][numbers(token)] += round(matcher.weight())
                    matcher.next()
        return found

    @cached_property
    def vocabulary(self) -> set[str]:
        with self.index.reader() as reader:
            return {token.decode() for token in reader.lexicon("text")}

    @cached_property
    def all_postings(self) -> dict[str, Counter[tuple[int, int, int]]]:
        return self.postings(self.vocabulary)

    @cached_property
    def weights(self) -> dict[int, float]:
        with_word: dict[int, set[str]] = defaultdict(set)
        for map_id, tokens in self.all_postings.items():
            for _, _, word in tokens:
                with_word[word].add(map_id)
        return {word: log((len(self.ids) + 1) / len(maps)) for word, maps in with_word.items()}

    def scores(
        self, query: Text, window: int | None, turns: Sequence[int], weighted: bool
    ) -> dict[str, tuple[float, int, int]]:
        """(score, matched, turn) of every map."""
        rare = log(len(self.ids) + 1)
        best = dict.fromkeys(self.ids, (0.0, 0, min(turns)))
        for turn in sorted(turns):
            points = Counter(numbers(token) for token in keypoints(query.turned(turn)))
            reachable = {token for token in self.vocabulary if reached(numbers(token), points, window)}
            for map_id, tokens in self.postings(reachable).items():
                matched = intersection(points, tokens, window)
                score: float = sum(matched.values())
                if weighted:
                    own = sum(n * self.weights.get(point[2], rare) for point, n in points.items())
                    other = sum(n * self.weights[point[2]] for point, n in self.all_postings[map_id].items())
                    score = sum(n * self.weights[word] for word, n in matched.items()) / sqrt(own * other)
                if score > best[map_id][0] + 1e-9:  # beyond rounding
                    best[map_id] = (score, sum(matched.values()), turn)
        return best


def keypoints(text: Text) -> list[str]:
    """The tokens of a text that stand for keypoints."""
    return [token for token in str(text).split() if "_a" in token]


def numbers(token: str) -> tuple[int, int, int]:
    x, y, a = token.split("_")
    return int(x[1:]), int(y[1:]), int(a[1:])


def near(point: tuple[int, int, int], other: tuple[int, int, int], window: int | None) -> bool:
    if point[2] != other[2]:
        return False
    return window is None or (abs(point[0] - other[0]) <= window and abs(point[1] - other[1]) <= window)


def reached(other: tuple[int, int, int], points: Iterable[tuple[int, int, int]], window: int | None) -> bool:
    return any(near(point, other, window) for point in points if point[2] == other[2])


def intersection(
    query: Counter[tuple[int, int, int]], found: Counter[tuple[int, int, int]], window: int | None
) -> Counter[int]:
    """For each word min(|Q'_a|, |M'_a|)."""
    of_query: Counter[int] = Counter()
    of_map: Counter[int] = Counter()
    for point, n in query.items():
        of_query[point[2]] += n * reached(point, found, window)
    for other, n in found.items():
        of_map[other[2]] += n * reached(other, query, window)
    return Counter({word: min(of_query[word], of_map[word]) for word in of_query})
