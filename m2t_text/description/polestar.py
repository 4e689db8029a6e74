"""Polestar appearance words: how many points lie in rings about a keypoint (paper, III-A, III-B)."""

import numpy as np
from numpy.typing import NDArray

from m2t_text.util.compiling import kernel
from m2t_text.util.types import Floats


def polestar_words(points: Floats, radii: Floats) -> NDArray[np.int16]:
    """Appearance word of every point, (N,): ring i sets bit i when it holds more than its mean share.

    The counts of the D rings are divided by their sum (the L1 norm) and compared with the mean of the D
    shares, 1 / D. A point does not count itself; a point that nothing surrounds has the word 0.

    Args:
        points: (N, 2) keypoints, metres; all of them are described and counted.
        radii: (D,) outer radii of the rings, rising, metres; the inner radius of the first is 0.
    """
    counts = np.zeros((len(points), len(radii)), dtype=np.int32)
    order = np.argsort(points[:, 0])
    words = np.zeros(len(points), dtype=np.int16)
    _describe(points[order, 0], points[order, 1], order, radii[-1], radii * radii, counts, words)
    return words


@kernel
def _describe(
    x: Floats,
    y: Floats,
    order: NDArray[np.int64],
    reach: float,
    squared: Floats,
    counts: NDArray[np.int32],
    words: NDArray[np.int16],
) -> None:
    """Counts the other points in each ring about each point, and sets the bits of its word.

    Args:
        x, y: (N,) of the points in the order of x; the k-th is number ``order[k]``.
        reach, squared: the largest radius, and (D,) the squares of all.
        counts, words: (N, D) and (N,) results, 0 at first.
    """
    for p in range(len(x)):
        for q in range(p + 1, len(x)):
            dx = x[q] - x[p]
            if dx > reach:
                break
            dy = y[q] - y[p]
            d = dx * dx + dy * dy
            if d <= squared[-1]:
                ring = 0
                while d > squared[ring]:
                    ring += 1
                counts[order[p], ring] += 1
                counts[order[q], ring] += 1
    for i in range(len(words)):
        total = np.int64(0)
        for ring in range(len(squared)):
            total += counts[i, ring]
        for ring in range(len(squared)):
            if counts[i, ring] * len(squared) > total:
                words[i] |= 1 << ring
