"""Maps as rasters, and how well one fits another once it is laid on it; compiled.

A raster holds for each cell the nearest keypoint and what is known of the cell, so that a keypoint laid on it
is judged by one look. What the other map never saw says nothing about a keypoint, for or against.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.text import Text
from m2t_text.mapping.normals import cloud_normals
from m2t_text.mapping.registration import CELL, CORRELATION, HALF, ITERATIONS, POINT_SIGMA, solved
from m2t_text.util.compiling import inner, kernel
from m2t_text.util.types import Floats

INLIER = 0.15  # m; a keypoint is an inlier if the other map has one so near
NORMAL_REACH = 0.3  # m; about a keypoint, for the direction of its wall
ICP_REACH = 0.4  # m; farther keypoints are no partners
LINK = 0.25  # m; misfits nearer to each other than this are of one patch
SEEN_REACH = 0.3  # m about what is free or occupied, in which the laser would have shown a wall
EXTENT = CELL * HALF  # m from the viewpoint to each side; what lies farther is not laid on anything
LOOSENESS = (0.5, 0.1)  # m and rad by which the start of an alignment may be off
FREE, SEEN = np.uint8(1), np.uint8(2)  # bits of what is known of a cell


class Shape(NamedTuple):
    """A text as geometry: ``points`` (N, 2) in metres and unit ``normals`` (N, 2) of their walls, or zeros."""

    points: Floats
    normals: Floats

    @classmethod
    def of(cls, text: Text, cell: float) -> "Shape":
        """The middles of the keypoints' cells; ``cell`` is the pose words' step, metres."""
        points = text.positions() * cell
        return cls(points, cloud_normals(points, NORMAL_REACH))


class Raster(NamedTuple):
    """A text's keypoints, and W x H cells about its viewpoint.

    Attributes:
        cell: metres, side of a cell.
        points: (N, 2) middles of the keypoints' cells, metres, in the map's own frame.
        normals: (N, 2) unit normals of their walls; zero where unknown.
        low: (2,) the cell of ``nearest[0, 0]`` and ``known[0, 0]``, along x and y.
        nearest: (W, H) number of the keypoint nearest to the cell's middle, -1 without one within ICP_REACH.
        known: (W, H) bits FREE and SEEN.
        complete: whether the text tells what is free; else it is unknown what the laser did not see.
    """

    cell: float
    points: Floats
    normals: Floats
    low: NDArray[np.int64]
    nearest: NDArray[np.int32]
    known: NDArray[np.uint8]
    complete: bool

    @classmethod
    def of(cls, text: Text, cell: float) -> "Raster":
        """The raster of a text whose pose words have the step ``cell``, metres."""
        squares = np.stack([text.free.wx, text.free.wy, text.free.size], axis=1).astype(np.int64)
        return cls.drawn(Shape.of(text, cell), squares, cell)

    @classmethod
    def drawn(cls, shape: Shape, squares: NDArray[np.int64], cell: float) -> "Raster":
        """The raster of a shape and of free squares (F, 3): lower corner and side, in cells."""
        low, high = _bounds(shape.points, squares, cell)
        nearest = np.full(high - low, -1, dtype=np.int32)
        known = np.zeros(high - low, dtype=np.uint8)
        away = np.full(high - low, (ICP_REACH / cell) ** 2, dtype=np.float32)
        _fill(shape.points, squares, cell, low, nearest, known, away)
        return cls(cell, *shape, low, nearest, known, len(squares) > 0)


def _bounds(
    points: Floats, squares: NDArray[np.int64], cell: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The first cell of a raster along x and y, and those just beyond its last."""
    corners = [np.floor(points / cell), squares[:, :2], squares[:, :2] + squares[:, 2:]]
    everything = np.concatenate([*corners, np.zeros((1, 2))])
    margin, most = math.ceil(ICP_REACH / cell) + 1, math.ceil(EXTENT / cell)
    low = np.clip(everything.min(axis=0) - margin, -most, most - 1)
    high = np.clip(everything.max(axis=0) + margin + 1, low + 1, most)
    return low.astype(np.int64), high.astype(np.int64)


@kernel
def _fill(
    points: Floats,
    squares: NDArray[np.int64],
    cell: float,
    low: NDArray[np.int64],
    nearest: NDArray[np.int32],
    known: NDArray[np.uint8],
    away: NDArray[np.float32],
) -> None:
    """Fills ``nearest`` and ``known``; ``away`` holds squared distances to the nearest keypoints, in cells."""
    width, height = nearest.shape
    margin, reach = int(round(SEEN_REACH / cell)), int(math.ceil(ICP_REACH / cell))
    for k in range(len(squares)):
        x, y, side = squares[k, 0] - low[0], squares[k, 1] - low[1], squares[k, 2]
        for i in range(max(x - margin, 0), min(x + side + margin, width)):
            for j in range(max(y - margin, 0), min(y + side + margin, height)):
                known[i, j] |= SEEN
                if x <= i < x + side and y <= j < y + side:
                    known[i, j] |= FREE
    for k in range(len(points)):
        x = int(math.floor(points[k, 0] / cell)) - low[0]
        y = int(math.floor(points[k, 1] / cell)) - low[1]
        for i in range(max(x - reach, 0), min(x + reach + 1, width)):
            for j in range(max(y - reach, 0), min(y + reach + 1, height)):
                distance = (i - x) ** 2 + (j - y) ** 2
                if distance < away[i, j]:
                    away[i, j], nearest[i, j] = distance, k
                if abs(i - x) <= margin and abs(j - y) <= margin:
                    known[i, j] |= SEEN


class Overlay(NamedTuple):
    """What the keypoints of one map meet on another.

    Attributes:
        inliers: those within INLIER of a keypoint.
        conflicts: those where the other map was seen to be free.
        seen: those where the other map's laser looked; where that is not known, those in reach of the map.
        grip: 0…0.5, the share of the inliers' walls that hold the pose in its loosest direction: the smaller
            eigenvalue of their normals' spread, 0 between two parallel walls, along which the map may slide.
        apart: metres, sum of the inliers' distances from the nearest keypoint of the other map.
        patch: keypoints in the largest patch of misfits: of conflicts, and of seen keypoints without one of the
            other map within SEEN_REACH. A wall that one map lacks is one patch, noise is many.
    """

    inliers: int
    conflicts: int
    seen: int
    grip: float
    apart: float
    patch: int


@inner
def _nearest(found: Raster, x: float, y: float, i: int, j: int) -> float:
    """Squared distance from (x, y), which lies in the cell (i, j) of the raster, to the nearest keypoint.

    It is exact within INLIER, and farther away that to a keypoint about as near; infinite without one in reach.

    The keypoint nearest to the middle of the cell need not be that nearest to (x, y): look at the cells beside.
    """
    width, height = found.nearest.shape
    least = math.inf
    for a in range(max(i - 1, 0), min(i + 2, width)):
        for b in range(max(j - 1, 0), min(j + 2, height)):
            m = found.nearest[a, b]
            if m >= 0:
                least = min(least, (x - found.points[m, 0]) ** 2 + (y - found.points[m, 1]) ** 2)
    return least


def overlaid(query: Raster, pose: Floats, found: Raster) -> Overlay:
    """What a query's keypoints meet on a map in whose frame its own has the ``pose`` (3,)."""
    misfits = np.empty(len(query.points), dtype=np.int64)
    return Overlay(*_overlaid(query, float(pose[0]), float(pose[1]), float(pose[2]), found, misfits))


@kernel
def _overlaid(
    query: Raster, left: float, up: float, turn: float, found: Raster, misfits: NDArray[np.int64]
) -> tuple[int, int, int, float, float, int]:
    points, normals = query.points, query.normals
    c, s = math.cos(turn), math.sin(turn)
    width, height = found.nearest.shape
    inliers, conflicts, seen, count = 0, 0, 0, 0
    apart = 0.0
    xx, xy, yy = 0.0, 0.0, 0.0
    for k in range(len(points)):
        x, y = left + c * points[k, 0] - s * points[k, 1], up + s * points[k, 0] + c * points[k, 1]
        i = int(math.floor(x / found.cell)) - found.low[0]
        j = int(math.floor(y / found.cell)) - found.low[1]
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
    return inliers, conflicts, seen, max(grip, 0.0), apart, _largest_patch(points, misfits, count)


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


def refined(query: Raster, found: Raster, start: Floats) -> Floats:
    """The pose (3,) of the query's frame in the found map's, by point-to-line ICP from a ``start`` (3,).

    Gauss-Newton with a Cauchy loss, as in `registration`, held near the start so that a featureless corridor
    does not slide.
    """
    pose = np.array(start, dtype=np.float64)
    _refine(query, found, pose)
    return pose


@kernel
def _refine(query: Raster, found: Raster, pose: Floats) -> None:
    points, walls, normals = query.points, found.points, found.normals
    width, height = found.nearest.shape
    start_x, start_y, start_angle = pose[0], pose[1], pose[2]
    in_place, in_angle = 1.0 / LOOSENESS[0] ** 2, 1.0 / LOOSENESS[1] ** 2
    for iteration in range(ITERATIONS):
        reach = max(ICP_REACH * 0.75**iteration, 0.12)
        h00, h01, h02, h11, h12, h22 = in_place, 0.0, 0.0, in_place, 0.0, in_angle
        g0, g1 = in_place * (pose[0] - start_x), in_place * (pose[1] - start_y)
        g2 = in_angle * (pose[2] - start_angle)
        c, s = math.cos(pose[2]), math.sin(pose[2])
        for k in range(len(points)):
            rx, ry = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
            x, y = rx + pose[0], ry + pose[1]
            i = int(math.floor(x / found.cell)) - found.low[0]
            j = int(math.floor(y / found.cell)) - found.low[1]
            if not (0 <= i < width and 0 <= j < height):
                continue
            m = found.nearest[i, j]
            if m < 0:
                continue
            dx, dy, nx, ny = x - walls[m, 0], y - walls[m, 1], normals[m, 0], normals[m, 1]
            if dx * dx + dy * dy >= reach * reach or (nx == 0.0 and ny == 0.0):
                continue
            error, lever = nx * dx + ny * dy, nx * -ry + ny * rx
            w = 1.0 / (1.0 + (error / (2 * POINT_SIGMA)) ** 2) / (POINT_SIGMA**2 * CORRELATION)
            h00 += w * nx * nx
            h01 += w * nx * ny
            h02 += w * nx * lever
            h11 += w * ny * ny
            h12 += w * ny * lever
            h22 += w * lever * lever
            g0 += w * nx * error
            g1 += w * ny * error
            g2 += w * lever * error
        x, y, angle = solved(h00, h01, h02, h11, h12, h22, g0, g1, g2)
        pose[0] -= x
        pose[1] -= y
        pose[2] -= angle
        if abs(x) + abs(y) < 1e-4 and abs(angle) < 1e-5 and reach <= 0.12:
            break
