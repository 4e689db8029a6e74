"""The filtered histogram intersection of one query with maps, compiled (paper, III-C, IV-D).

For one word the query's keypoints are numbered as bits. A table over x holds, for each cell, the set of those
within the window of it; another table does so over y. A map's keypoint matches the set that both tables
hold for it: one AND, however wide the window. The union of these sets over a map's keypoints is Q'_a; the
keypoints whose set is not empty are M'_a. Turning the query by quarters exchanges and mirrors the tables, so
all four turns are tried in one pass over two of them.
"""

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from m2t_text.description.text import WORDS, Text
from m2t_text.index.texts import Texts
from m2t_text.index.unpacking import cells_of, run_of, word_of

TURNS = 4
BITS = 64  # keypoints of the query in one machine word
U = np.uint64


class Tables(NamedTuple):
    """A query made ready for `intersect`.

    Attributes:
        half: cells from the middle of a table to its end.
        counts: (1024,) int64 keypoints of the query with each word.
        places: (1024,) int64 where the tables of a word begin in ``near``; it has one for each 64 keypoints.
        near: (T,) uint64; of each table 2 half cells, of each the sets within the window in x and in y.
    """

    half: int
    counts: NDArray[np.int64]
    places: NDArray[np.int64]
    near: NDArray[np.uint64]

    @classmethod
    def of(cls, text: Text, window: int) -> "Tables":
        """Of a query, for matches within ``window`` cells."""
        reach = max((int(np.abs(w.astype(np.int64)).max(initial=0)) for w in (text.wx, text.wy)), default=0)
        half = reach + window + 2
        counts = np.bincount(text.wa, minlength=WORDS).astype(np.int64)
        tables = (counts + BITS - 1) // BITS
        places = (np.cumsum(tables) - tables) * 4 * half
        near = np.zeros(int(tables.sum()) * 4 * half, dtype=np.uint64)
        words = text.wa.astype(np.int64)
        _fill(near, places[words], text.wx.astype(np.int64), text.wy.astype(np.int64), words, half, window)
        return cls(half, counts, places, near)


@numba.njit(cache=True, nogil=True)
def _fill(near: Any, places: Any, wx: Any, wy: Any, wa: Any, half: Any, window: Any) -> None:
    """Sets each keypoint's bit in the cells within the window of it; ``wa`` rises."""
    number = 0
    for k in range(len(wa)):
        number = 0 if k == 0 or wa[k] != wa[k - 1] else number + 1
        table = places[k] + number // BITS * 4 * half
        bit = U(1) << U(number % BITS)
        for step in range(-window, window + 1):
            near[table + 2 * (wx[k] + step + half)] |= bit
            near[table + 2 * (wy[k] + step + half) + 1] |= bit


@numba.njit(cache=True, nogil=True, inline="always")
def _popcount(bits: Any) -> Any:
    bits = bits - ((bits >> U(1)) & U(0x5555555555555555))
    bits = (bits & U(0x3333333333333333)) + ((bits >> U(2)) & U(0x3333333333333333))
    bits = (bits + (bits >> U(4))) & U(0x0F0F0F0F0F0F0F0F)
    return np.int64((bits * U(0x0101010101010101)) >> U(56))


@numba.njit(cache=True, nogil=True, inline="always")
def _sets(near: Any, base: Any, half: Any, x: Any, y: Any) -> Any:
    """The query's keypoints that one of a map matches, under each turn. The tables' cells beyond are empty."""
    last = U(2 * half - 1)
    i, j = min(U(np.int64(x) + half), last), min(U(np.int64(y) + half), last)
    k, m = last - i, last - j
    x_i, y_i = near[base + U(2) * i], near[base + U(2) * i + U(1)]
    x_j, y_j = near[base + U(2) * j], near[base + U(2) * j + U(1)]
    x_k, y_k = near[base + U(2) * k], near[base + U(2) * k + U(1)]
    x_m, y_m = near[base + U(2) * m], near[base + U(2) * m + U(1)]
    return x_i & y_j, y_k & x_j, x_k & y_m, y_i & x_m


@numba.njit(cache=True, nogil=True)
def _matches(near: Any, table: Any, half: Any, x: Any, y: Any, begin: Any, end: Any) -> Any:
    """min(|Q'_a|, |M'_a|) under each turn, of the map's keypoints begin...end, all of a word of one table."""
    base = U(table)
    all_0, all_1, all_2, all_3 = U(0), U(0), U(0), U(0)
    met_0, met_1, met_2, met_3 = 0, 0, 0, 0
    for k in range(begin, end):
        set_0, set_1, set_2, set_3 = _sets(near, base, half, x[k], y[k])
        all_0, all_1, all_2, all_3 = all_0 | set_0, all_1 | set_1, all_2 | set_2, all_3 | set_3
        met_0, met_1 = met_0 + (set_0 != U(0)), met_1 + (set_1 != U(0))
        met_2, met_3 = met_2 + (set_2 != U(0)), met_3 + (set_3 != U(0))
    return (
        min(_popcount(all_0), met_0), min(_popcount(all_1), met_1),
        min(_popcount(all_2), met_2), min(_popcount(all_3), met_3),
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def _many_matches(near: Any, table: Any, tables: Any, half: Any, x: Any, y: Any, begin: Any, end: Any) -> Any:
    """The same of a word of several tables."""
    seen, met = np.zeros(TURNS, np.int64), np.zeros(TURNS, np.int64)
    hit = np.zeros((end - begin, TURNS), np.bool_)
    for t in range(tables):
        base = U(table + t * 4 * half)
        union = np.zeros(TURNS, np.uint64)
        for k in range(begin, end):
            sets = _sets(near, base, half, x[k], y[k])
            for turn in range(TURNS):
                union[turn] |= sets[turn]
                hit[k - begin, turn] |= sets[turn] != U(0)
        for turn in range(TURNS):
            seen[turn] += _popcount(union[turn])
    for row in hit:
        met += row
    return min(seen[0], met[0]), min(seen[1], met[1]), min(seen[2], met[2]), min(seen[3], met[3])


@numba.njit(cache=True, nogil=True)
def intersect(
    texts: Texts, documents: Any, tables: Tables, weights: Any, turns: Any, needed: Any, count: Any, score: Any
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
    room = np.int64(0)
    for document in documents:
        room = max(room, texts.starts[document + 1] - texts.starts[document])
    x, y = np.empty(room, np.int32), np.empty(room, np.int32)
    open_sums = np.zeros(TURNS)
    runs, run_starts, near, half = texts.runs, texts.run_starts, tables.near, tables.half
    counts, places = tables.counts, tables.places
    for k in range(len(documents)):
        document = documents[k]
        size = U(cells_of(texts, document, x, y))
        count[k], score[k] = 0, 0.0
        place, end = U(run_starts[document]), U(run_starts[document + 1])
        open_sums[:] = _most(runs, place, end, counts, weights)
        keypoint = U(0)
        while place < end:
            word, run, place = word_of(runs, place, end)
            found = counts[word]
            last = min(keypoint + run, size)  # no farther, even if the index is damaged
            if found:
                if found <= BITS:
                    both = _matches(near, places[word], half, x, y, keypoint, last)
                else:
                    number = (found + BITS - 1) // BITS
                    both = _many_matches(near, places[word], number, half, x, y, keypoint, last)
                possible = False
                for turn in range(TURNS):
                    if turns[turn]:
                        count[k, turn] += both[turn]
                        score[k, turn] += weights[word] * both[turn]
                        open_sums[turn] -= weights[word] * (min(found, np.int64(run)) - both[turn])
                        possible |= open_sums[turn] >= needed[k]
                if not possible:
                    count[k], score[k] = 0, 0.0
                    break
            keypoint = last


@numba.njit(cache=True, nogil=True)
def _most(runs: Any, begin: Any, end: Any, counts: Any, weights: Any) -> Any:
    """What no filtered intersection exceeds; see `bounds`."""
    total = 0.0
    for place in range(begin, end):
        word, run = run_of(runs, place)
        total += weights[word] * min(np.int64(run), counts[word])
    return total


@numba.njit(cache=True, nogil=True)
def bounds(texts: Texts, documents: Any, counts: Any, weights: Any, score: Any) -> None:
    """Writes what the weighted intersection with documents (K,) cannot exceed to ``score``.

    It is that of the bags of words, but each run of keypoints counts as if it were the only one of its word.
    """
    runs, run_starts = texts.runs, texts.run_starts
    for k in range(len(documents)):
        document = documents[k]
        score[k] = _most(runs, U(run_starts[document]), U(run_starts[document + 1]), counts, weights)


@numba.njit(cache=True, nogil=True)
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


@numba.njit(cache=True, nogil=True)
def document_frequency(texts: Texts, live: Any, frequency: Any) -> None:
    """Adds the number of live documents with each word to ``frequency`` (1024,)."""
    runs, run_starts = texts.runs, texts.run_starts
    for document in range(len(live)):
        place, end = U(run_starts[document]), U(run_starts[document + 1])
        while live[document] and place < end:
            word, _, place = word_of(runs, place, end)
            frequency[word] += 1


@numba.njit(cache=True, nogil=True)
def document_weight(texts: Texts, weights: Any, total: Any) -> None:
    """Writes the sum of the weights of each document's keypoints to ``total`` (documents,)."""
    runs, run_starts = texts.runs, texts.run_starts
    for document in range(len(total)):
        total[document] = 0.0
        for place in range(U(run_starts[document]), U(run_starts[document + 1])):
            word, run = run_of(runs, place)
            total[document] += weights[word] * run
