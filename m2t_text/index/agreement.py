"""How far a query and each map agree on one offset of their viewpoints, compiled.

The paper keeps a match when the pose words differ by at most 1 m (IV-D, eqs. 2, 3), each on its own. Here
all matches of a map must agree: two keypoints with the same word vote for the offset between them, the
offset with most votes wins, and the histogram intersection is then taken at that offset, with a window of
one cell instead of ten, over all keypoints of both maps.
"""

from typing import Any

import numba
import numpy as np

from m2t_text.description.text import WORDS

NEAR = 1  # cells; keypoints this far apart in x and y match at the agreed offset
VOTERS = 48  # keypoints of one word of the query that vote, about
CANDIDATES = 4  # views whose overlap is measured, those with most votes; the best is then moved by a cell
WORTH = 0.5  # of the votes of the best view, below which a view is not measured


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
def _covered(xs: Any, ys: Any, begin: Any, end: Any, dx: Any, dy: Any, half: Any, grid: Any, value: Any) -> Any:
    """How many of the keypoints begin..end, moved by (dx, dy), lie in cells with the value."""
    count = 0
    side = np.uint32(2 * half)
    for k in range(begin, end):
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
def _vote(
    wx: Any, wy: Any, wa: Any, begin: Any, end: Any, slots: Any, first: Any, flat: Any,
    half: Any, window: Any, votes: Any,
) -> None:  # fmt: skip
    """votes[1 + offset in x, offset in y] of one map's keypoints and one view's; see `_voters` and `agree`."""
    side = 2 * half
    width = 2 * side
    _within(votes, window, width)[:] = 0  # what lies beyond is never read
    for k in range(begin, end):
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
def _overlap(
    query_x: Any, query_y: Any, seen: Any, wx: Any, wy: Any, begin: Any, end: Any, drawn: Any, stamp: Any,
    half: Any, dx: Any, dy: Any,
) -> Any:  # fmt: skip
    """|Q'|, |M'| of a view moved by (dx, dy) and of a map: keypoints with one of the other within NEAR."""
    here = _covered(query_x, query_y, 0, len(query_x), dx, dy, half, drawn, stamp)
    there = _covered(wx, wy, begin, end, -dx, -dy, half, seen, 1)
    return here, there


@numba.njit(cache=True, nogil=True)
def _prepare(query_x: Any, query_y: Any, query_a: Any, half: Any) -> Any:
    """Tables of a query's views: slots of its words, keypoints by word and x, flat cells, and near cells."""
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
    seen = np.zeros((count, side, side), dtype=np.int32)
    for v in range(count):
        _voters(query_x[v], query_y[v], query_a, half, slots, used, first[v], flat[v])
        for k in range(size):
            _mark(seen[v], query_x[v, k], query_y[v, k], half, 1)
    return slots, first, flat, seen


@numba.njit(cache=True, nogil=True)
def agree(
    starts: Any, wx: Any, wy: Any, wa: Any, query_x: Any, query_y: Any, query_a: Any,
    window: Any, begin: Any, end: Any, both: Any, matched: Any, found: Any,
) -> None:  # fmt: skip
    """Measures the agreement of the documents begin..end with every view of a query.

    Args:
        starts: (documents + 1,) where each document's keypoints begin.
        wx, wy, wa: (N,) int16 keypoints of all documents.
        query_x, query_y: (V, Q) int64 cells of the query in each view, Q > 0; query_a (Q,) int64 its words.
        window: largest offset of the viewpoints in x and in y, cells.
        both: (documents,) int32 result: keypoints of both maps that lie near one of the other map, |Q'| + |M'|.
        matched: (documents,) int32 result: min(|Q'|, |M'|).
        found: (documents, 3) int32 result: best view, and the offset in x and in y by which its keypoints move.
    """
    half = window + 2 * NEAR + 1 + max(np.abs(query_x).max(), np.abs(query_y).max())
    side = 2 * half
    slots, first, flat, seen = _prepare(query_x, query_y, query_a, half)
    votes = np.zeros((2 * window + 3) * 2 * side, dtype=np.int32)
    peaks = np.zeros((len(query_x), 3), dtype=np.int64)
    drawn = np.zeros((side, side), dtype=np.int32)  # the latest map is stamped with its number
    for document in range(begin, end):
        low, high = starts[document], starts[document + 1]
        for v in range(len(query_x)):
            _vote(wx, wy, wa, low, high, slots, first[v], flat[v], half, window, votes)
            peaks[v, 0], peaks[v, 1], peaks[v, 2] = _peak(votes, window, 2 * side)
        most = peaks[:, 0].max()
        if most == 0:
            continue
        for k in range(low, high):
            _mark(drawn, wx[k], wy[k], half, document + 1)
        best = -1
        for v in np.argsort(-peaks[:, 0], kind="mergesort")[:CANDIDATES]:
            if peaks[v, 0] >= WORTH * most:
                here, there = _overlap(
                    query_x[v],
                    query_y[v],
                    seen[v],
                    wx,
                    wy,
                    low,
                    high,
                    drawn,
                    document + 1,
                    half,
                    peaks[v, 1],
                    peaks[v, 2],
                )
                if best < 0 or here + there > both[document]:
                    best = v
                    both[document], matched[document] = here + there, min(here, there)
                    found[document] = peaks[v]
                    found[document, 0] = v
        for step in range(9):
            dx, dy = peaks[best, 1] + step // 3 - 1, peaks[best, 2] + step % 3 - 1
            here, there = _overlap(
                query_x[best], query_y[best], seen[best], wx, wy, low, high, drawn, document + 1, half, dx, dy
            )
            if here + there > both[document]:
                both[document], matched[document] = here + there, min(here, there)
                found[document, 1], found[document, 2] = dx, dy
