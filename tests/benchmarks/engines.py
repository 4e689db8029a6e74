"""Five ways to find the maps that share most words with a query: within 1 m, under the best of four turns.

All are asked for the ten best. `whoosh-or` and `tantivy` look up every neighbour of every token that is in the
database, and count those of each map that match; `numpy`, `m2t` and `literal` compute the paper's intersection
(IV-D), the last of them with nothing but Whoosh's own classes on this project's index.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator

import numpy as np
import tantivy
from whoosh.fields import KEYWORD, NUMERIC, Schema
from whoosh.filedb.filestore import RamStorage
from whoosh.query import Or, Term
from whoosh.scoring import Frequency

from m2t_text.description.text import WORDS, Text
from m2t_text.index.map_index import MapIndex
from m2t_text.index.search.literal import LiteralIntersection, LiteralQuery

TOP, WINDOW = 10, 10


class M2T:
    """This project's index."""

    def __init__(self, index: MapIndex) -> None:
        self.index = index

    def search(self, text: Text) -> list[float]:
        return [hit.score for hit in self.index.search(text, TOP)]


class Literal:
    """The definition of the score, in plain Whoosh."""

    def __init__(self, index: MapIndex) -> None:
        self.searcher = index.whoosh.searcher(weighting=LiteralIntersection(WINDOW))

    def search(self, text: Text) -> list[float]:
        return [hit.score for hit in self.searcher.search(LiteralQuery("text", text), limit=TOP)]


class NumPy:
    """A scan of all keypoints of the query's words, vectorised."""

    def __init__(self, index: MapIndex) -> None:
        texts = [document.text for document in index.documents()]
        words = np.concatenate([text.wa for text in texts])
        order = np.argsort(words, kind="stable")
        self.maps = len(texts)
        self.doc = np.repeat(np.arange(len(texts)), [len(text) for text in texts])[order]
        self.x, self.y = (np.concatenate([getattr(text, w) for text in texts])[order] for w in ("wx", "wy"))
        self.starts = np.append(0, np.cumsum(np.bincount(words, minlength=WORDS)))

    def search(self, text: Text) -> list[float]:
        best = np.max([self._scores(text.turned(turn)) for turn in range(4)], axis=0)
        return np.sort(best)[::-1][:TOP].tolist()

    def _scores(self, text: Text) -> np.ndarray:
        scores = np.zeros(self.maps)
        for word in np.unique(text.wa):
            part = slice(self.starts[word], self.starts[word + 1])
            doc, x, y = self.doc[part], self.x[part], self.y[part]
            if not len(doc):
                continue
            mine = np.flatnonzero(text.wa == word)
            begins = np.flatnonzero(np.diff(doc, prepend=-1))
            seen, hit = np.zeros(len(begins)), np.zeros(len(doc), dtype=bool)
            for lane in range(0, len(mine), 64):
                mask = np.zeros(len(doc), dtype=np.uint64)
                for bit, k in enumerate(mine[lane : lane + 64]):
                    near = (np.abs(x - text.wx[k]) <= WINDOW) & (np.abs(y - text.wy[k]) <= WINDOW)
                    mask |= near.astype(np.uint64) << np.uint64(bit)
                seen += np.bitwise_count(np.bitwise_or.reduceat(mask, begins))
                hit |= mask != 0
            scores[doc[begins]] += np.minimum(seen, np.add.reduceat(hit.astype(np.int64), begins))
        return scores


class Vocabulary:
    """The tokens of a database, to expand a query's tokens to their neighbours among them."""

    def __init__(self, texts: Iterable[Text]) -> None:
        cells: dict[int, set[tuple[int, int]]] = defaultdict(set)
        for text in texts:
            for x, y, a in zip(text.wx.tolist(), text.wy.tolist(), text.wa.tolist(), strict=True):
                cells[a].add((x, y))
        self.cells = {word: np.array(sorted(found)) for word, found in cells.items()}

    def near(self, text: Text) -> Iterator[str]:
        """All tokens of the database that match one of the query's."""
        for word in np.unique(text.wa).tolist():
            cells = self.cells.get(word, np.zeros((0, 2), dtype=np.int64))
            mine = np.stack([text.wx, text.wy], axis=1)[text.wa == word].astype(np.int64)
            close = np.abs(cells[:, None] - mine[None]).max(axis=2, initial=0) <= WINDOW
            yield from (f"x{x}_y{y}_a{word}" for x, y in cells[close.any(axis=1)].tolist())


class WhooshOr:
    """Plain Whoosh: tokens as terms, the query an Or over all neighbours."""

    def __init__(self, index: MapIndex) -> None:
        texts = [document.text for document in index.documents()]
        self.vocabulary = Vocabulary(texts)
        self.whoosh = RamStorage().create_index(Schema(text=KEYWORD(), number=NUMERIC(stored=True)))
        with self.whoosh.writer(limitmb=512) as writer:
            for number, text in enumerate(texts):
                writer.add_document(text=str(text), number=number)
        self.searcher = self.whoosh.searcher(weighting=Frequency())

    def search(self, text: Text) -> list[float]:
        best: dict[int, float] = {}
        for turn in range(4):
            query = Or([Term("text", token) for token in self.vocabulary.near(text.turned(turn))])
            for hit in self.searcher.search(query, limit=TOP):
                best[hit["number"]] = max(best.get(hit["number"], 0.0), hit.score)
        return sorted(best.values(), reverse=True)[:TOP]


class Tantivy:
    """The same in a modern engine."""

    def __init__(self, index: MapIndex) -> None:
        texts = [document.text for document in index.documents()]
        self.vocabulary = Vocabulary(texts)
        builder = tantivy.SchemaBuilder()
        builder.add_text_field("text", tokenizer_name="whitespace", index_option="freq")
        builder.add_integer_field("number", stored=True)
        self.schema = builder.build()
        self.index = tantivy.Index(self.schema)
        writer = self.index.writer(256 << 20, 1)
        for number, text in enumerate(texts):
            writer.add_document(tantivy.Document(text=str(text), number=number))
        writer.commit()
        self.index.reload()
        self.searcher = self.index.searcher()

    def search(self, text: Text) -> list[float]:
        best: dict[int, float] = {}
        for turn in range(4):
            terms = [
                (
                    tantivy.Occur.Should,
                    tantivy.Query.const_score_query(tantivy.Query.term_query(self.schema, "text", token), 1.0),
                )
                for token in self.vocabulary.near(text.turned(turn))
            ]
            for score, place in self.searcher.search(tantivy.Query.boolean_query(terms), TOP).hits:
                number = self.searcher.doc(place)["number"][0]
                best[number] = max(best.get(number, 0.0), score)
        return sorted(best.values(), reverse=True)[:TOP]


ENGINES = {"m2t": M2T, "numpy": NumPy, "tantivy": Tantivy, "whoosh-or": WhooshOr, "literal": Literal}
