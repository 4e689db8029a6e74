"""How far a query and each map agree on one offset of their viewpoints, compiled.

The paper keeps a match when the pose words differ by at most 1 m (IV-D, eqs. 2, 3), each on its own. Here
all matches of a map must agree: two keypoints with the same word vote for the offset between them, the
offset with most votes wins, and the histogram intersection is then taken at that offset, with a window of
one cell instead of ten, over all keypoints of both maps.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.text import WORDS
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.unpacking import cells_of, words_of
from m2t_text.index.kernels.views import Views
from m2t_text.util.compiling import inlined, inner, kernel

NEAR = 1  # cells; keypoints this far apart in x and y match at the agreed offset
VOTERS = 48  # keypoints of one word of the query that vote, at most
FULL = 65_535  # votes for an offset that are counted: 16 bits take half the cache, and no map has more
CANDIDATES = 4  # views whose overlap is measured, those with most votes; the best is then moved by a cell
WORTH = 0.5  # of the votes of the best view, below which a view is not measured


class AgreementTables(NamedTuple):
    """A query made ready for `agree`.

    Attributes:
        window: largest offset of the viewpoints in x and in y, cells.
        half: cells from the middle of a grid to its border.
        x, y: (V, Q) int64 cells of the query in each view.
        slots: (1024,) int64 number of each of the query's U words, -1 for others.
        first, flat: (V, U, side + 1) uint16 and (V, Q) int32 keypoints that vote, see `_prepare`.
        near: (V, side, side) int32, 1 in the cells near a keypoint.
    """

    window: int
    half: int
    x: NDArray[np.int64]
    y: NDArray[np.int64]
    slots: NDArray[np.int64]
    first: NDArray[np.uint16]
    flat: NDArray[np.int32]
    near: NDArray[np.int32]

    @classmethod
    def of(cls, seen: Views, window: int) -> "AgreementTables":
        """Of a query with keypoints."""
        half = window + 2 * NEAR + 1 + int(max(np.abs(seen.wx).max(), np.abs(seen.wy).max()))
        words, slot, counts = np.unique(seen.wa, return_inverse=True, return_counts=True)
        slots = np.full(WORDS, -1, dtype=np.int64)
        slots[words] = np.arange(len(words))
        (views, size), side = seen.wx.shape, 2 * half
        order = np.argsort(slot * side + seen.wx, axis=1, kind="stable")
        first = np.empty((views, len(words), side + 1), dtype=np.uint16)
        flat = np.empty((views, size), dtype=np.int32)
        near = np.zeros((views, side, side), dtype=np.int32)
        _prepare(seen.wx, seen.wy, order, counts, half, first, flat, near)
        return cls(window, half, seen.wx, seen.wy, slots, first, flat, near)


class Drawn(NamedTuple):
    """A map as its overlap is counted.

    Attributes:
        x, y, words: of its first ``size`` keypoints.
        grid: (side, side) int32, ``stamp`` in the cells near them.
    """

    x: Any
    y: Any
    words: Any
    size: Any
    grid: Any
    stamp: Any


@inlined
def _mark(grid: Any, x: Any, y: Any, half: Any, value: Any) -> None:
    """Sets the cells near (x, y); a keypoint whose near cells are not all inside the grid is left out."""
    i, j = x + half, y + half
    if NEAR <= i < 2 * half - NEAR and NEAR <= j < 2 * half - NEAR:
        for column in range(i - NEAR, i + NEAR + 1):
            for row in range(j - NEAR, j + NEAR + 1):
                grid[np.uint32(column), np.uint32(row)] = value


@inner
def _covered(xs: Any, ys: Any, size: Any, dx: Any, dy: Any, half: Any, grid: Any, value: Any) -> Any:
    """How many of the first keypoints, moved by (dx, dy), lie in cells with the value."""
    count = 0
    side = np.uint32(2 * half)
    for k in range(size):
        x, y = np.uint32(xs[k] + dx + half), np.uint32(ys[k] + dy + half)  # below zero is beyond the side, too
        if x < side and y < side and grid[x, y] == value:
            count += 1
    return count


@kernel
def sums_needed(starts: Any, documents: Any, own: Any, threshold: Any, needed: Any) -> None:
    """Writes the least |Q'| + |M'| with which documents (K,) reach a score to ``needed`` (K,), and one more
    than there is where none does; ``own`` is |Q|, 1 or more."""
    for k in range(len(documents)):
        size = own + starts[documents[k] + 1] - starts[documents[k]]
        least = np.ceil(threshold * size)
        if (least - 1.0) / size >= threshold:  # rounding went up
            least -= 1.0
        needed[k] = min(least, size + 1.0)


@kernel
def _prepare(wx: Any, wy: Any, order: Any, counts: Any, half: Any, first: Any, flat: Any, near: Any) -> None:
    """Fills the last three of the `AgreementTables`.

    All of a rare word's keypoints vote, every so many of a common one, in the order of x. Those of the word in
    slot s with x' < x end at first[view, s, x] in flat[view], which holds their flat cells.

    Args:
        wx, wy: (V, Q) cells of the keypoints in each view.
        order: (V, Q) of the keypoints by their slot, then x.
        counts: (U,) keypoints of the word in each slot.
    """
    side = 2 * half
    for v in range(len(wx)):
        place, kept = 0, 0
        for slot in range(len(counts)):
            begin, count = place, counts[slot]
            every = 1 + (count - 1) // VOTERS
            for x in range(side + 1):
                while place < begin + count and wx[v, order[v, place]] + half < x:
                    if (place - begin) % every == 0:
                        k = order[v, place]
                        flat[v, kept] = (wx[v, k] + half) * 2 * side + wy[v, k] + half
                        kept += 1
                    place += 1
                first[v, slot, x] = kept
        for k in range(wx.shape[1]):
            _mark(near[v], wx[v, k], wy[v, k], half, 1)


@inner
def _vote(tables: Any, v: Any, one: Any, votes: Any) -> None:
    """votes[1 + offset in x, offset in y] of one map's keypoints and one view's; see `_prepare` and `agree`."""
    half, window, slots, first, flat = tables.half, tables.window, tables.slots, tables.first[v], tables.flat[v]
    wx, wy, wa = one.x, one.y, one.words
    side = 2 * half
    width = 2 * side
    few = one.size <= FULL // VOTERS
    for row in range(2 * window + 3):  # what lies beyond is never read
        begin = row * width + side - window - 1
        for k in range(begin, begin + 2 * window + 3):
            votes[np.uint32(k)] = 0
    for k in range(one.size):
        slot, x, y = slots[wa[k]], wx[k] + half, wy[k] + half
        if slot >= 0 and -window <= x < side + window and 0 <= y < side:
            base = (x + window + 1) * width + y + side
            begin, end = first[slot, max(x - window, 0)], first[slot, min(x + window + 1, side)]
            if few:
                for i in range(begin, end):
                    votes[np.uint32(base - flat[i])] += 1
            else:
                for i in range(begin, end):
                    place = np.uint32(base - flat[i])
                    votes[place] += votes[place] < FULL


@inner
def _peak(votes: Any, window: Any, width: Any) -> Any:
    """The offset with most votes, as (votes, x, y); the smallest of equals.

    A vote counts four times at its offset, and twice or once at the next ones: cells lie up to one step off.
    """
    size = 2 * window + 1
    first = width // 2 - window - 1
    for row in range(size + 2):  # beyond the window
        votes[row * width + first] = 0
        votes[row * width + first + size + 1] = 0
    best, x, y = np.int64(0), np.int64(0), np.int64(0)
    for r in range(size):
        above = np.uint32(r * width + first)
        here, below = above + np.uint32(width), above + np.uint32(2 * width)
        left = votes[above] + 2 * votes[here] + votes[below]
        one = np.uint32(1)
        middle = votes[above + one] + 2 * votes[here + one] + votes[below + one]
        for c in range(size):
            next_one = np.uint32(c + 2)
            right = votes[above + next_one] + 2 * votes[here + next_one] + votes[below + next_one]
            total = left + 2 * middle + right
            left, middle = middle, right
            if total > best:
                best, x, y = total, r - window, c - window
    return best, x, y


@inner
def _improve(tables: Any, v: Any, dx: Any, dy: Any, one: Any, best: Any) -> None:
    """Keeps the view moved by (dx, dy) as the best, if more keypoints of both maps match than before.

    Args:
        best: (5,) |Q'| + |M'|, min(|Q'|, |M'|), view, and offset in x and in y.
    """
    size, half = tables.x.shape[1], tables.half
    here = _covered(tables.x[v], tables.y[v], size, dx, dy, half, one.grid, one.stamp)
    there = _covered(one.x, one.y, one.size, -dx, -dy, half, tables.near[v], np.int64(1))
    if here + there > best[0]:
        best[0], best[1], best[2], best[3], best[4] = here + there, min(here, there), v, dx, dy


class Room(NamedTuple):
    """What agreement is worked out in.

    Attributes:
        x, y, words: (N,) int32 of a map.
        votes: uint16 for all offsets, see `_vote`.
        peaks: (V, 3) int64 votes and offset of each view.
        grid: (side, side) int32, the latest map stamped with its number.
        best: (5,) int64, see `_improve`.
    """

    x: Any
    y: Any
    words: Any
    votes: Any
    peaks: Any
    grid: Any
    best: Any

    @classmethod
    def of(cls, texts: Texts, documents: Any, tables: AgreementTables) -> "Room":
        """Enough for any of the documents."""
        largest, side = texts.largest(documents), 2 * tables.half
        x, y, words = np.empty((3, largest), dtype=np.int32)
        votes = np.zeros((2 * tables.window + 3) * 2 * side, dtype=np.uint16)
        peaks = np.zeros((len(tables.x), 3), dtype=np.int64)
        return cls(x, y, words, votes, peaks, np.zeros((side, side), np.int32), np.zeros(5, np.int64))


def agree(texts: Texts, documents: Any, tables: AgreementTables, both: Any, matched: Any, found: Any) -> None:
    """Measures how far some documents agree with a query. Results are in the order of ``documents``.

    Args:
        texts: of a segment.
        documents: (K,) int64 their numbers.
        both: (K,) int32 result: keypoints of both maps that lie near one of the other map, |Q'| + |M'|.
        matched: (K,) int32 result: min(|Q'|, |M'|).
        found: (K, 3) int32 result: best view, and the offset in x and in y by which its keypoints move.
    """
    _agree(texts, documents, tables, Room.of(texts, documents, tables), both, matched, found)


@kernel
def _agree(texts: Any, documents: Any, tables: Any, room: Any, both: Any, matched: Any, found: Any) -> None:
    half, window, views = tables.half, tables.window, len(tables.x)
    x, y, words, votes, peaks, grid, best = room
    for k in range(len(documents)):
        size = cells_of(texts, documents[k], x, y)
        words_of(texts, documents[k], size, words)
        one = Drawn(x, y, words, size, grid, k + 1)
        most: Any = np.int64(0)
        leading: Any = np.int64(0)
        for v in range(views):
            _vote(tables, v, one, votes)
            peaks[v, 0], peaks[v, 1], peaks[v, 2] = _peak(votes, window, 4 * half)
            if peaks[v, 0] > most:
                most, leading = peaks[v, 0], v
        for field in range(5):
            best[field] = 0
        if most > 0:
            for point in range(size):
                _mark(grid, x[point], y[point], half, k + 1)
            _measure_candidates(tables, peaks, most, one, best)
            if not best[0]:  # its cells lie at the border of the grid; the offset stands all the same
                best[2], best[3], best[4] = leading, peaks[leading, 1], peaks[leading, 2]
            view = best[2]
            for step in range(9):
                dx, dy = peaks[view, 1] + step // 3 - 1, peaks[view, 2] + step % 3 - 1
                _improve(tables, view, dx, dy, one, best)
        both[k], matched[k] = best[0], best[1]
        found[k, 0], found[k, 1], found[k, 2] = best[2], best[3], best[4]


@inner
def _measure_candidates(tables: Any, peaks: Any, most: Any, one: Any, best: Any) -> None:
    """Measures the views with most votes, from the most on; of equal ones the first is measured first."""
    votes, after = most, -1  # of the latest one, and its number
    for _ in range(CANDIDATES):
        chosen, count = -1, -1
        for v in range(len(peaks)):
            other = peaks[v, 0]
            if other > count and (other < votes or (other == votes and v > after)):
                chosen, count = v, other
        if chosen < 0 or count < WORTH * most:
            break
        _improve(tables, chosen, peaks[chosen, 1], peaks[chosen, 2], one, best)
        votes, after = count, chosen
