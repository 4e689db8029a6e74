"""The histogram intersections of one query with all maps of a segment, compiled (paper, III-C, IV-D).

For one word the query's keypoints are numbered as bits. A table over x holds, for each cell, the set of those
within the window of it; another table does so over y. A map's keypoint matches the set that both tables
hold for it: one AND, however wide the window. The union of these sets over a map's keypoints is Q'_a; the
keypoints whose set is not empty are M'_a. All turns of the query, at most four, are tried in one pass.
"""

from typing import Any

import numba
import numpy as np
from numba import types

SLOTS = 4  # turns of the query that one pass tries
BITS = 64  # keypoints of the query in one machine word

I2, I4, I8, F8 = (types.Array(t, 1, "C") for t in (types.int16, types.int32, types.int64, types.float64))
I4x2, I8x2, F8x2 = (types.Array(t, 2, "C") for t in (types.int32, types.int64, types.float64))
U64 = np.uint64


@numba.njit(types.int64(types.uint64), cache=True, nogil=True, inline="always")
def _popcount(bits: Any) -> Any:
    bits = bits - ((bits >> U64(1)) & U64(0x5555555555555555))
    bits = (bits & U64(0x3333333333333333)) + ((bits >> U64(2)) & U64(0x3333333333333333))
    bits = (bits + (bits >> U64(4))) & U64(0x0F0F0F0F0F0F0F0F)
    return np.int64((bits * U64(0x0101010101010101)) >> U64(56))


@numba.njit(cache=True, nogil=True)
def _fill(table: Any, coordinates: Any, first: Any, last: Any, turns: Any, window: Any) -> None:
    """table[cell, turn] = the query's keypoints first..last within the window of the cell, as bits."""
    table[:] = U64(0)
    reach = table.shape[0] // 2
    for turn in range(turns):
        for point in range(first, last):
            number = point - first
            bit = U64(1) << U64(number % BITS)
            for cell in range(coordinates[turn, point] - window, coordinates[turn, point] + window + 1):
                table[cell + reach, turn, number // BITS] |= bit


@numba.njit(cache=True, nogil=True, inline="always")
def _flush(document: Any, seen: Any, matched: Any, words: Any, weight: Any, count: Any, score: Any) -> None:
    """Adds a document's min(|Q'_a|, |M'_a|) for each turn and clears the sums."""
    for turn in range(SLOTS):
        if matched[turn]:
            found = 0
            for word in range(words):
                found += _popcount(seen[turn, word])
                seen[turn, word] = U64(0)
            both = min(found, matched[turn])
            count[document, turn] += both
            score[document, turn] += weight * both
            matched[turn] = 0


@numba.njit(cache=True, nogil=True, inline="always")
def _scan(
    doc: Any, wx: Any, wy: Any, begin: Any, end: Any,
    near_x: Any, near_y: Any, words: Any, weight: Any, count: Any, score: Any,
) -> None:  # fmt: skip
    """One word's postings against the tables of the query's keypoints with that word."""
    reach = near_x.shape[0] // 2
    seen = np.zeros((SLOTS, words), dtype=U64)
    matched = np.zeros(SLOTS, dtype=np.int64)
    document = doc[begin]
    for posting in range(begin, end):
        if doc[posting] != document:
            _flush(document, seen, matched, words, weight, count, score)
            document = doc[posting]
        x, y = wx[posting] + reach, wy[posting] + reach
        if 0 <= x < near_x.shape[0] and 0 <= y < near_y.shape[0]:
            for turn in range(SLOTS):
                hit = U64(0)
                for word in range(words):
                    both = near_x[x, turn, word] & near_y[y, turn, word]
                    seen[turn, word] |= both
                    hit |= both
                matched[turn] += hit != U64(0)
    _flush(document, seen, matched, words, weight, count, score)


@numba.njit(
    types.void(I8, I4, I2, I2, I8, I8, I8x2, I8x2, types.int64, F8, types.int64, types.int64, I4x2, F8x2),
    cache=True,
    nogil=True,
)
def filtered(
    starts: Any, doc: Any, wx: Any, wy: Any, words: Any, firsts: Any, x: Any, y: Any,
    window: Any, weights: Any, begin: Any, end: Any, count: Any, score: Any,
) -> None:  # fmt: skip
    """Adds the filtered intersection with the documents begin..end to `count` and `score`.

    Args:
        starts, doc, wx, wy: postings.
        words: (U,) the query's different words, ascending.
        firsts: (U + 1,) where each one's keypoints begin in x and y.
        x, y: (turns, N) the query's keypoints under each turn, in cells.
        window: cells; D_xy.
        weights: (1024,) of the words.
        count, score: (documents, 4), the sums over the words of min(|Q'_a|, |M'_a|), plain and weighted.
    """
    reach = 0
    for turn in range(x.shape[0]):
        for point in range(x.shape[1]):
            reach = max(reach, abs(x[turn, point]), abs(y[turn, point]))
    size = 2 * (reach + window) + 1
    for k in range(len(words)):
        a = words[k]
        low, high = starts[a], starts[a + 1]
        first = low + np.searchsorted(doc[low:high], begin)
        last = low + np.searchsorted(doc[low:high], end)
        if first == last:
            continue
        lanes = (firsts[k + 1] - firsts[k] + BITS - 1) // BITS
        near_x = np.empty((size, SLOTS, lanes), dtype=U64)
        near_y = np.empty((size, SLOTS, lanes), dtype=U64)
        _fill(near_x, x, firsts[k], firsts[k + 1], x.shape[0], window)
        _fill(near_y, y, firsts[k], firsts[k + 1], x.shape[0], window)
        if lanes == 1:  # a constant lets the compiler unroll: nearly all words come here
            _scan(doc, wx, wy, first, last, near_x, near_y, 1, weights[a], count, score)
        else:
            _scan(doc, wx, wy, first, last, near_x, near_y, lanes, weights[a], count, score)


@numba.njit(types.void(I8, I4, I8, I8, F8, I4, F8), cache=True, nogil=True)
def unfiltered(starts: Any, doc: Any, words: Any, firsts: Any, weights: Any, count: Any, score: Any) -> None:
    """Adds the plain histogram intersection, the sum of min(|Q_a|, |M_a|), of every document (paper, III-C)."""
    for k in range(len(words)):
        a = words[k]
        posting = starts[a]
        while posting < starts[a + 1]:
            document, run = doc[posting], 0
            while posting < starts[a + 1] and doc[posting] == document:
                run += 1
                posting += 1
            both = min(run, firsts[k + 1] - firsts[k])
            count[document] += both
            score[document] += weights[a] * both


@numba.njit(types.void(I8, I4, types.Array(types.boolean, 1, "C"), I8), cache=True, nogil=True)
def document_frequency(starts: Any, doc: Any, live: Any, frequency: Any) -> None:
    """Adds the number of live documents with each word to `frequency` (1024,)."""
    for a in range(len(frequency)):
        for posting in range(starts[a], starts[a + 1]):
            if live[doc[posting]] and (posting == starts[a] or doc[posting] != doc[posting - 1]):
                frequency[a] += 1


@numba.njit(types.void(I8, I4, F8, F8), cache=True, nogil=True)
def document_weight(starts: Any, doc: Any, weights: Any, total: Any) -> None:
    """Adds the weights of each document's keypoints to `total` (documents,), in the order of words."""
    for a in range(len(weights)):
        for posting in range(starts[a], starts[a + 1]):
            total[doc[posting]] += weights[a]
