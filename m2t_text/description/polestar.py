"""Polestar appearance words: how many points lie in rings about a keypoint (paper, III-A, III-B)."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from m2t_text.util.types import Floats


@njit(cache=True, nogil=True)
def polestar_words(points: Floats, radii: Floats) -> NDArray[np.int16]:
    """Appearance word of every point, (N,): ring i sets bit i when it holds more than its mean share.

    The counts of the D rings are divided by their sum (the L1 norm) and compared with the mean of the D
    shares, 1 / D. A point does not count itself; a point that nothing surrounds has the word 0.

    Args:
        points: (N, 2) keypoints, metres; all of them are described and counted.
        radii: (D,) outer radii of the rings, rising, metres; the inner radius of the first is 0.
    """
    n, rings = len(points), len(radii)
    words = np.zeros(n, dtype=np.int16)
    counts = np.zeros((n, rings), dtype=np.int32)
    squared = radii * radii
    order = np.argsort(points[:, 0])
    for p in range(n):
        i = order[p]
        for q in range(p + 1, n):
            j = order[q]
            dx = points[j, 0] - points[i, 0]
            if dx > radii[-1]:
                break
            dy = points[j, 1] - points[i, 1]
            d = dx * dx + dy * dy
            if d <= squared[-1]:
                ring = 0
                while d > squared[ring]:
                    ring += 1
                counts[i, ring] += 1
                counts[j, ring] += 1
    for i in range(n):
        total = counts[i].sum()
        for ring in range(rings):
            if counts[i, ring] * rings > total:
                words[i] |= 1 << ring
    return words
