"""The filtered histogram intersection of one query with maps, compiled (paper, III-C, IV-D).

For one word the query's keypoints are numbered as bits. A table over x holds, for each cell, the set of those
within the window of it; another table does so over y. A map's keypoint matches the set that both tables
hold for it: one AND, however wide the window. The union of these sets over a map's keypoints is Q'_a; the
keypoints whose set is not empty are M'_a. Turning the query by quarters exchanges and mirrors the tables, so
all four turns are tried in one pass over two of them.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.text import WORDS, Text
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.simd import at, every, filled, least, ones, put, rotated
from m2t_text.index.kernels.unpacking import cells_of, run_of, word_of
from m2t_text.util.compiling import inlined, inner, kernel

TURNS = 4
BITS = 64  # keypoints of the query in one machine word
U = np.uint64


class IntersectionTables(NamedTuple):
    """A query made ready for `intersect`.

    Attributes:
        half: cells from the middle of a table to its end.
        counts: (1024,) int64 keypoints of the query with each word.
        places: (1024,) int64 where the tables of a word begin in ``near``; it has one for each 64 keypoints.
        near: (T, 4) uint64; of each table 2 half cells, of each the sets within the window of it in x, of the
            cell opposite in y and in x, and of it in y.
    """

    half: int
    counts: NDArray[np.int64]
    places: NDArray[np.int64]
    near: NDArray[np.uint64]

    @classmethod
    def of(cls, text: Text, window: int) -> "IntersectionTables":
        """Of a query, for matches within ``window`` cells."""
        reach = max((int(np.abs(w.astype(np.int64)).max(initial=0)) for w in (text.wx, text.wy)), default=0)
        half = reach + window + 2
        counts = np.bincount(text.wa, minlength=WORDS).astype(np.int64)
        tables = (counts + BITS - 1) // BITS
        places = (np.cumsum(tables) - tables) * 2 * half
        near = np.zeros((int(tables.sum()) * 2 * half, TURNS), dtype=np.uint64)
        words = text.wa.astype(np.int64)
        _fill(near, places[words], text.wx.astype(np.int64), text.wy.astype(np.int64), words, half, window)
        return cls(half, counts, places, near)


@kernel
def _fill(near: Any, places: Any, wx: Any, wy: Any, wa: Any, half: Any, window: Any) -> None:
    """Sets each keypoint's bit in the cells within the window of it; ``wa`` rises."""
    number = 0
    for k in range(len(wa)):
        number = 0 if k == 0 or wa[k] != wa[k - 1] else number + 1
        table = places[k] + number // BITS * 2 * half
        last = table + 2 * half - 1
        bit = U(1) << U(number % BITS)
        for step in range(half - window, half + window + 1):
            near[table + wx[k] + step, 0] |= bit
            near[last - wy[k] - step, 1] |= bit
            near[last - wx[k] - step, 2] |= bit
            near[table + wy[k] + step, 3] |= bit


@inlined
def _sets(near: Any, table: Any, half: Any, x: Any, y: Any) -> Any:
    """The query's keypoints that one of a map matches, under each turn. The tables' cells beyond are empty.

    Under the second turn, for one, x of the query lies near y of the map, and y near the opposite of x.
    """
    last = U(2 * half - 1)
    i, j = min(U(np.int64(x) + half), last), min(U(np.int64(y) + half), last)
    return at(near, table + i) & rotated(at(near, table + j))


@inner
def _matches(near: Any, table: Any, half: Any, x: Any, y: Any, begin: Any, end: Any, both: Any) -> None:
    """Writes min(|Q'_a|, |M'_a|) under each turn to ``both`` (1, 4) uint64.

    All of the map's keypoints begin...end are of one word, and that of one table.
    """
    union, met = every(U(0)), every(U(0))
    for k in range(begin, end):
        sets = _sets(near, U(table), half, x[k], y[k])
        union, met = union | sets, met + filled(sets)
    put(both, U(0), least(ones(union), met))


@inner
def _many_matches(
    near: Any, table: Any, tables: Any, half: Any, x: Any, y: Any, begin: Any, end: Any, hit: Any, both: Any
) -> None:
    """The same of a word of several tables; ``hit`` (N, 4) uint64 is room to work in."""
    for k in range(end - begin):
        put(hit, k, every(U(0)))
    seen, met = every(U(0)), every(U(0))
    for t in range(tables):
        union = every(U(0))
        for k in range(begin, end):
            sets = _sets(near, U(table + t * 2 * half), half, x[k], y[k])
            union = union | sets
            put(hit, k - begin, at(hit, k - begin) | sets)
        seen = seen + ones(union)
    for k in range(end - begin):
        met = met + filled(at(hit, k))
    put(both, U(0), least(seen, met))


class Room(NamedTuple):
    """What an intersection is worked out in.

    Attributes:
        x, y: (N,) int32 cells of a map.
        hit: (N, 4) uint64 sets of the query's keypoints that were met.
        both: (1, 4) uint64 matches of one word under each turn.
        sums, total: (4,) weighted and plain matches so far.
        missing: (4,) what the sums lack so far to what no intersection exceeds.
    """

    x: Any
    y: Any
    hit: Any
    both: Any
    sums: Any
    total: Any
    missing: Any

    @classmethod
    def of(cls, texts: Texts, documents: Any) -> "Room":
        """Enough for any of the documents."""
        largest = texts.largest(documents)
        x, y = np.empty((2, largest), np.int32)
        hit = np.empty((largest, TURNS), np.uint64)
        sums, total = np.zeros(TURNS), np.zeros(TURNS, np.int64)
        return cls(x, y, hit, np.zeros((1, TURNS), np.uint64), sums, total, np.zeros(TURNS))


def intersect(
    texts: Texts,
    documents: Any,
    tables: IntersectionTables,
    weights: Any,
    turns: Any,
    needed: Any,
    count: Any,
    score: Any,
) -> None:
    """The intersection with each document under each quarter turn of the query.

    A document is left, with zeros, as soon as it cannot reach what is needed.

    Args:
        texts: of a segment.
        documents: (K,) int64 their numbers.
        weights: (1024,) of the words.
        turns: (4,) bool, which quarter turns are tried.
        needed: (K,) weighted sums of interest; 0 to measure all.
        count, score: (K, 4) results: the sums over the words of min(|Q'_a|, |M'_a|), plain and weighted.
    """
    _intersect(texts, documents, tables, weights, turns, needed, Room.of(texts, documents), count, score)


@kernel
def _intersect(
    texts: Any, documents: Any, tables: Any, weights: Any, turns: Any, needed: Any, room: Any, count: Any,
    score: Any,
) -> None:  # fmt: skip
    x, y, hit, both, sums, total, missing = room
    runs, run_starts, near, half = texts.runs, texts.run_starts, tables.near, tables.half
    counts, places = tables.counts, tables.places
    for k in range(len(documents)):
        document = documents[k]
        size = U(cells_of(texts, document, x, y))
        for turn in range(TURNS):
            sums[turn], total[turn], missing[turn] = 0.0, 0, 0.0 if turns[turn] else np.inf
        place, end = U(run_starts[document]), U(run_starts[document + 1])
        most = _most(runs, place, end, counts, weights)
        keypoint = U(0)
        while place < end:
            word, run, place = word_of(runs, place, end)
            found = counts[word]
            last = min(keypoint + run, size)  # no farther, even if the index is damaged
            if found:
                if found <= BITS:
                    _matches(near, places[word], half, x, y, keypoint, last, both)
                else:
                    number = (found + BITS - 1) // BITS
                    _many_matches(near, places[word], number, half, x, y, keypoint, last, hit, both)
                weight, possible = weights[word], min(found, np.int64(run))
                for turn in range(TURNS):
                    matched = np.int64(both[0, turn])
                    total[turn] += matched
                    sums[turn] += weight * matched
                    missing[turn] += weight * (possible - matched)
                if most - min(missing[0], missing[1], missing[2], missing[3]) < needed[k]:
                    for turn in range(TURNS):
                        sums[turn], total[turn] = 0.0, 0
                    break
            keypoint = last
        for turn in range(TURNS):
            count[k, turn], score[k, turn] = total[turn] * turns[turn], sums[turn] * turns[turn]


@inner
def _most(runs: Any, begin: Any, end: Any, counts: Any, weights: Any) -> Any:
    """What no filtered intersection exceeds; see `bounds`."""
    total = 0.0
    for place in range(begin, end):
        word, run = run_of(runs, place)
        total += weights[word] * min(np.int64(run), counts[word])
    return total


@kernel
def bounds(texts: Texts, documents: Any, counts: Any, weights: Any, score: Any) -> None:
    """Writes what the weighted intersection with documents (K,) cannot exceed to ``score``.

    It is that of the bags of words, but each run of keypoints counts as if it were the only one of its word.
    """
    runs, run_starts = texts.runs, texts.run_starts
    for k in range(len(documents)):
        document = documents[k]
        score[k] = _most(runs, U(run_starts[document]), U(run_starts[document + 1]), counts, weights)


@kernel
def bags(texts: Texts, documents: Any, counts: Any, weights: Any, count: Any, score: Any) -> None:
    """Writes the plain histogram intersection, the sum of min(|Q_a|, |M_a|), of documents (K,) to ``count``.

    And the weighted one to ``score`` (paper, III-C). ``counts`` (1024,) are the query's.
    """
    runs, run_starts = texts.runs, texts.run_starts
    for k in range(len(documents)):
        count[k], score[k] = 0, 0.0
        place, end = U(run_starts[documents[k]]), U(run_starts[documents[k] + 1])
        while place < end:
            word, run, place = word_of(runs, place, end)
            both = min(np.int64(run), counts[word])
            count[k] += both
            score[k] += weights[word] * both


@kernel
def document_frequency(texts: Texts, live: Any, frequency: Any) -> None:
    """Adds the number of live documents with each word to ``frequency`` (1024,)."""
    runs, run_starts = texts.runs, texts.run_starts
    for document in range(len(live)):
        place, end = U(run_starts[document]), U(run_starts[document + 1])
        while live[document] and place < end:
            word, _, place = word_of(runs, place, end)
            frequency[word] += 1


@kernel
def document_weight(texts: Texts, weights: Any, total: Any) -> None:
    """Writes the sum of the weights of each document's keypoints to ``total`` (documents,)."""
    runs, run_starts = texts.runs, texts.run_starts
    for document in range(len(total)):
        total[document] = 0.0
        for place in range(U(run_starts[document]), U(run_starts[document + 1])):
            word, run = run_of(runs, place)
            total[document] += weights[word] * run
