"""How far a query and each map agree on one offset of their viewpoints, compiled.

The paper keeps a match when the pose words differ by at most 1 m (IV-D, eqs. 2, 3), each on its own. Here
all matches of a map must agree: two keypoints with the same word vote for the offset between them, the
offset with most votes wins, and the histogram intersection is then taken at that offset, with a window of
one cell instead of ten, over all keypoints of both maps.
"""

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from m2t_text.description.text import WORDS
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.unpacking import cells_of, words_of
from m2t_text.index.kernels.views import Views

NEAR = 1  # cells; keypoints this far apart in x and y match at the agreed offset
VOTERS = 48  # keypoints of one word of the query that vote, about
CANDIDATES = 4  # views whose overlap is measured, those with most votes; the best is then moved by a cell
WORTH = 0.5  # of the votes of the best view, below which a view is not measured


class AgreementTables(NamedTuple):
    """A query made ready for `agree`.

    Attributes:
        window: largest offset of the viewpoints in x and in y, cells.
        half: cells from the middle of a grid to its border.
        x, y: (V, Q) int64 cells of the query in each view.
        slots: (1024,) int64 number of each of the query's U words, -1 for others.
        first, flat: (V, U, side + 1) and (V, Q) int32 keypoints that vote, see `_voters`.
        near: (V, side, side) int32, 1 in the cells near a keypoint.
    """

    window: int
    half: int
    x: NDArray[np.int64]
    y: NDArray[np.int64]
    slots: NDArray[np.int64]
    first: NDArray[np.int32]
    flat: NDArray[np.int32]
    near: NDArray[np.int32]

    @classmethod
    def of(cls, seen: Views, window: int) -> "AgreementTables":
        """Of a query with keypoints."""
        half = window + 2 * NEAR + 1 + int(max(np.abs(seen.wx).max(), np.abs(seen.wy).max()))
        return cls(window, half, seen.wx, seen.wy, *_prepare(seen.wx, seen.wy, seen.wa, half))


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


@numba.njit(cache=True, nogil=True)
def _voters(wx: Any, wy: Any, wa: Any, half: Any, slots: Any, used: Any, first: Any, flat: Any) -> None:
    """Which of a view's keypoints vote: all of a rare word, every so many of a common one, in the order of x.

    Those of the word in slot s with x' < x end at first[s, x] in ``flat``, which holds their flat cells.
    """
    side = 2 * half
    key = slots[wa] * side + wx + half
    order = np.argsort(key, kind="mergesort")
    place, kept = 0, 0
    for slot in range(used):
        begin = place
        count = np.count_nonzero(key < (slot + 1) * side) - begin
        every = 1 + (count - 1) // VOTERS
        for x in range(side + 1):
            while place < begin + count and key[order[place]] < slot * side + x:
                if (place - begin) % every == 0:
                    k = order[place]
                    flat[kept] = (wx[k] + half) * 2 * side + wy[k] + half
                    kept += 1
                place += 1
            first[slot, x] = kept


@numba.njit(cache=True, nogil=True, inline="always")
def _mark(grid: Any, x: Any, y: Any, half: Any, value: Any) -> None:
    """Sets the cells near (x, y); a keypoint whose near cells are not all inside the grid is left out."""
    i, j = x + half, y + half
    if NEAR <= i < 2 * half - NEAR and NEAR <= j < 2 * half - NEAR:
        for column in range(i - NEAR, i + NEAR + 1):
            for row in range(j - NEAR, j + NEAR + 1):
                grid[np.uint32(column), np.uint32(row)] = value


@numba.njit(cache=True, nogil=True)
def _covered(xs: Any, ys: Any, size: Any, dx: Any, dy: Any, half: Any, grid: Any, value: Any) -> Any:
    """How many of the first keypoints, moved by (dx, dy), lie in cells with the value."""
    count = 0
    side = np.uint32(2 * half)
    for k in range(size):
        x, y = np.uint32(xs[k] + dx + half), np.uint32(ys[k] + dy + half)  # below zero is beyond the side, too
        if x < side and y < side and grid[x, y] == value:
            count += 1
    return count


@numba.njit(cache=True, nogil=True)
def _within(votes: Any, window: Any, width: Any) -> Any:
    """The votes for offsets within the window, and a border of one cell about them."""
    size = 2 * window + 1
    first = width // 2 - window
    return votes.reshape((size + 2, width))[:, first - 1 : first + size + 1]


@numba.njit(cache=True, nogil=True)
def _vote(tables: AgreementTables, v: Any, one: Drawn, votes: Any) -> None:
    """votes[1 + offset in x, offset in y] of one map's keypoints and one view's; see `_voters` and `agree`."""
    half, window, slots, first, flat = tables.half, tables.window, tables.slots, tables.first[v], tables.flat[v]
    wx, wy, wa = one.x, one.y, one.words
    side = 2 * half
    width = 2 * side
    _within(votes, window, width)[:] = 0  # what lies beyond is never read
    for k in range(one.size):
        slot, x, y = slots[wa[k]], wx[k] + half, wy[k] + half
        if slot >= 0 and -window <= x < side + window and 0 <= y < side:
            base = (x + window + 1) * width + y + side
            for i in range(first[slot, max(x - window, 0)], first[slot, min(x + window + 1, side)]):
                votes[np.uint32(base - flat[i])] += 1


@numba.njit(cache=True, nogil=True)
def _peak(votes: Any, window: Any, width: Any) -> Any:
    """The offset with most votes, as (votes, x, y); the smallest of equals.

    A vote counts four times at its offset, and twice or once at the next ones: cells lie up to one step off.
    """
    size = 2 * window + 1
    table = _within(votes, window, width)
    table[:, 0] = 0  # beyond the window
    table[:, size + 1] = 0
    best, x, y = 0, 0, 0
    for r in range(size):
        above, here, below = table[r], table[r + 1], table[r + 2]
        left = above[0] + 2 * here[0] + below[0]
        middle = above[1] + 2 * here[1] + below[1]
        for c in range(size):
            right = above[c + 2] + 2 * here[c + 2] + below[c + 2]
            total = left + 2 * middle + right
            left, middle = middle, right
            if total > best:
                best, x, y = total, r - window, c - window
    return best, x, y


@numba.njit(cache=True, nogil=True)
def _prepare(query_x: Any, query_y: Any, query_a: Any, half: Any) -> Any:
    """The tables of a `AgreementTables`."""
    count, size = query_x.shape
    side = 2 * half
    slots = np.full(WORDS, -1, dtype=np.int64)
    used = 0
    for a in query_a:
        if slots[a] < 0:
            slots[a] = used
            used += 1
    first = np.empty((count, used, side + 1), dtype=np.int32)
    flat = np.empty((count, size), dtype=np.int32)
    near = np.zeros((count, side, side), dtype=np.int32)
    for v in range(count):
        _voters(query_x[v], query_y[v], query_a, half, slots, used, first[v], flat[v])
        for k in range(size):
            _mark(near[v], query_x[v, k], query_y[v, k], half, 1)
    return slots, first, flat, near


@numba.njit(cache=True, nogil=True)
def _improve(tables: AgreementTables, v: Any, dx: Any, dy: Any, one: Drawn, best: Any) -> None:
    """Keeps the view moved by (dx, dy) as the best, if more keypoints of both maps match than before.

    Args:
        best: (5,) |Q'| + |M'|, min(|Q'|, |M'|), view, and offset in x and in y.
    """
    here = _covered(tables.x[v], tables.y[v], tables.x.shape[1], dx, dy, tables.half, one.grid, one.stamp)
    there = _covered(one.x, one.y, one.size, -dx, -dy, tables.half, tables.near[v], 1)
    if here + there > best[0]:
        best[0], best[1], best[2], best[3], best[4] = here + there, min(here, there), v, dx, dy


@numba.njit(cache=True, nogil=True)
def agree(texts: Texts, documents: Any, tables: AgreementTables, both: Any, matched: Any, found: Any) -> None:
    """Measures how far some documents agree with a query. Results are in the order of ``documents``.

    Args:
        texts: of a segment.
        documents: (K,) int64 their numbers.
        both: (K,) int32 result: keypoints of both maps that lie near one of the other map, |Q'| + |M'|.
        matched: (K,) int32 result: min(|Q'|, |M'|).
        found: (K, 3) int32 result: best view, and the offset in x and in y by which its keypoints move.
    """
    half, window, views = tables.half, tables.window, len(tables.x)
    side = 2 * half
    largest = np.int64(0)
    for document in documents:
        largest = max(largest, texts.starts[document + 1] - texts.starts[document])
    words = np.empty((3, largest), dtype=np.int32)
    wx, wy, wa = words[0], words[1], words[2]
    votes = np.zeros((2 * window + 3) * 2 * side, dtype=np.int32)
    peaks = np.zeros((views, 3), dtype=np.int64)
    grid = np.zeros((side, side), dtype=np.int32)  # the latest map is stamped with its number
    best = np.zeros(5, dtype=np.int32)
    for k in range(len(documents)):
        size = cells_of(texts, documents[k], wx, wy)
        words_of(texts, documents[k], size, wa)
        one = Drawn(wx, wy, wa, size, grid, k + 1)
        for v in range(views):
            _vote(tables, v, one, votes)
            peaks[v, 0], peaks[v, 1], peaks[v, 2] = _peak(votes, window, 2 * side)
        best[:] = 0
        most = peaks[:, 0].max()
        if most > 0:
            for point in range(size):
                _mark(grid, wx[point], wy[point], half, k + 1)
            for v in np.argsort(-peaks[:, 0], kind="mergesort")[:CANDIDATES]:
                if peaks[v, 0] >= WORTH * most:
                    _improve(tables, v, peaks[v, 1], peaks[v, 2], one, best)
            if not best[0]:  # its cells lie at the border of the grid; the offset stands all the same
                best[2] = np.argmax(peaks[:, 0])
                best[3], best[4] = peaks[best[2], 1], peaks[best[2], 2]
            view = best[2]
            for step in range(9):
                dx, dy = peaks[view, 1] + step // 3 - 1, peaks[view, 2] + step % 3 - 1
                _improve(tables, view, dx, dy, one, best)
        both[k], matched[k] = best[0], best[1]
        found[k, 0], found[k, 1], found[k, 2] = best[2], best[3], best[4]
