"""What the keypoints of one map meet on another that they are laid on; compiled."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from m2t_text.recognition.raster import FREE, INLIER, LINK, NONE_NEAR, NUMBER, SEEN, SEEN_REACH, Raster
from m2t_text.util.compiling import inlined, inner, kernel
from m2t_text.util.types import Floats


class Overlay(NamedTuple):
    """What the keypoints of one map meet on another, under each of S poses.

    Attributes:
        inliers: (S,) those within INLIER of a keypoint.
        conflicts: (S,) those where the other map was seen to be free.
        seen: (S,) those where the other map's laser looked; where that is not known, those in reach of the map.
        patch: (S,) keypoints in the largest patch of misfits: of conflicts, and of seen keypoints without one
            of the other map within SEEN_REACH. A wall that one map lacks is one patch, noise is many.
        grip: (S,) 0…0.5, the share of the inliers' walls that hold the pose in its loosest direction: the
            smaller eigenvalue of their normals' spread, 0 between two parallel walls, along which the map may
            slide.
        apart: (S,) metres, sum of the inliers' distances from the nearest keypoint of the other map.
    """

    inliers: NDArray[np.int64]
    conflicts: NDArray[np.int64]
    seen: NDArray[np.int64]
    patch: NDArray[np.int64]
    grip: Floats
    apart: Floats


def overlaid(query: Raster, poses: Floats, found: Raster) -> Overlay:
    """What a query's keypoints meet on a map in whose frame its own has each of the ``poses`` (S, 3)."""
    counts, shares = np.zeros((4, len(poses)), dtype=np.int64), np.zeros((2, len(poses)))
    _overlay(query, poses, found, np.empty(len(query.points), dtype=np.int64), counts, shares)
    return Overlay(*counts, *shares)


@kernel
def _overlay(
    query: Raster,
    poses: Floats,
    found: Raster,
    misfits: NDArray[np.int64],
    counts: NDArray[np.int64],
    shares: Floats,
) -> None:
    points, normals = query.points, query.normals
    width, height = found.nearest.shape
    per_metre = 1.0 / found.cell
    for n in range(len(poses)):
        c, s = math.cos(poses[n, 2]), math.sin(poses[n, 2])
        inliers, conflicts, seen, count = 0, 0, 0, 0
        apart = 0.0
        xx, xy, yy = 0.0, 0.0, 0.0
        for k in range(len(points)):
            x = poses[n, 0] + c * points[k, 0] - s * points[k, 1]
            y = poses[n, 1] + s * points[k, 0] + c * points[k, 1]
            i = int(math.floor(x * per_metre)) - found.low[0]
            j = int(math.floor(y * per_metre)) - found.low[1]
            if not (0 <= i < width and 0 <= j < height):
                continue
            looked = not found.complete or found.known[i, j] & SEEN != 0
            seen += looked
            distance = _nearest(found, x, y, i, j)
            if distance < INLIER * INLIER:
                inliers += 1
                apart += math.sqrt(distance)
                xx += normals[k, 0] * normals[k, 0]
                xy += normals[k, 0] * normals[k, 1]
                yy += normals[k, 1] * normals[k, 1]
                continue
            free = found.known[i, j] & FREE != 0
            conflicts += free
            if free or (looked and distance >= SEEN_REACH * SEEN_REACH):
                misfits[count] = k
                count += 1
        grip = ((xx + yy) / 2 - math.sqrt(((xx - yy) / 2) ** 2 + xy * xy)) / max(inliers, 1)
        counts[0, n], counts[1, n], counts[2, n] = inliers, conflicts, seen
        counts[3, n] = _largest_patch(points, misfits, count)
        shares[0, n], shares[1, n] = max(grip, 0.0), apart


@inlined
def _nearest(found: Raster, x: float, y: float, i: int, j: int) -> float:
    """Squared distance from (x, y), which lies in the cell (i, j) of the raster, to the nearest keypoint.

    It is exact within INLIER, and farther away that to a keypoint about as near; infinite without one in reach.

    The keypoint nearest to the middle of the cell need not be that nearest to (x, y): look at the cells beside.
    """
    width, height = found.nearest.shape
    least = math.inf
    for a in range(max(i - 1, 0), min(i + 2, width)):
        for b in range(max(j - 1, 0), min(j + 2, height)):
            if found.nearest[a, b] != NONE_NEAR:
                m = found.nearest[a, b] & NUMBER
                least = min(least, (x - found.points[m, 0]) ** 2 + (y - found.points[m, 1]) ** 2)
    return least


@inner
def _largest_patch(points: Floats, chosen: NDArray[np.int64], count: int) -> int:
    """The size of the largest set of the first ``count`` chosen points that are linked by steps of less than
    LINK; reorders them."""
    largest, done = 0, 0
    while done < count:
        first, end = done, done + 1
        while done < end:  # all between are linked, and those of them before `done` have no more links
            p, done = chosen[done], done + 1
            for k in range(end, count):
                q = chosen[k]
                if (points[p, 0] - points[q, 0]) ** 2 + (points[p, 1] - points[q, 1]) ** 2 < LINK * LINK:
                    chosen[k], chosen[end] = chosen[end], chosen[k]
                    end += 1
        largest = max(largest, end - first)
    return largest
