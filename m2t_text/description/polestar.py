"""Polestar appearance words: how many points lie in rings about a keypoint (paper, III-A, III-B)."""

import numpy as np
from numpy.typing import NDArray

from m2t_text.util.compiling import kernel
from m2t_text.util.types import Floats, Ints


def polestar_words(points: Floats, radii: Floats) -> NDArray[np.int16]:
    """Appearance word of every point, (N,): ring i sets bit i when it holds more than its mean share.

    The counts of the D rings are divided by their sum (the L1 norm) and compared with the mean of the D
    shares, 1 / D. A point does not count itself; a point that nothing surrounds has the word 0.

    Args:
        points: (N, 2) keypoints, metres; all of them are described and counted.
        radii: (D,) outer radii of the rings, rising, metres; the inner radius of the first is 0.
    """
    order = np.argsort(points[:, 0], kind="stable")
    words, room = np.zeros(len(points), dtype=np.int16), np.empty(len(points))
    x, y = points[order, 0], points[order, 1]
    _describe(x, y, order, radii[-1], radii * radii, room, np.empty(len(radii), dtype=np.int64), words)
    return words


@kernel
def _describe(
    x: Floats,
    y: Floats,
    order: Ints,
    reach: float,
    squared: Floats,
    squares: Floats,
    within: Ints,
    words: NDArray[np.int16],
) -> None:
    """Counts the points in each ring about each point, and sets the bits of its word.

    For each ring all points near in x are compared, without a branch, so that the processor compares several at
    once.

    Args:
        x, y: (N,) of the points in the order of x; the k-th is number ``order[k]``.
        reach, squared: the largest radius, and (D,) the squares of all.
        squares, within: (N,) and (D,), room to work in.
        words: (N,) results, 0 at first.
    """
    first, last = 0, 0
    for p in range(len(x)):
        while x[p] - x[first] > reach:
            first += 1
        while last < len(x) and x[last] - x[p] <= reach:
            last += 1
        near_x, near_y = x[first:last], y[first:last]
        for q in range(len(near_x)):
            dx, dy = near_x[q] - x[p], near_y[q] - y[p]
            squares[q] = dx * dx + dy * dy
        for ring in range(len(squared)):
            count = 0
            for q in range(len(near_x)):
                count += squares[q] <= squared[ring]
            within[ring] = count
        total, inside = within[len(squared) - 1] - 1, 1  # a point does not count itself
        for ring in range(len(squared)):
            if (within[ring] - inside) * len(squared) > total:
                words[order[p]] |= 1 << ring
            inside = within[ring]
