"""Maps as rasters, and the poses in which one fits another; compiled.

A raster holds for each cell the nearest keypoint and what is known of the cell, so that a keypoint laid on it
is judged by one look. What the other map never saw says nothing about a keypoint, for or against.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.text import Text
from m2t_text.mapping.normals import cloud_normals
from m2t_text.mapping.registration import CELL, CORRELATION, HALF, ITERATIONS, POINT_SIGMA, solved
from m2t_text.util.compiling import kernel
from m2t_text.util.types import Floats

INLIER = 0.15  # m; a keypoint is an inlier if the other map has one so near
NORMAL_REACH = 0.3  # m; about a keypoint, for the direction of its wall
ICP_REACH = 0.4  # m; farther keypoints are no partners
LINK = 0.25  # m; misfits nearer to each other than this are of one patch
SEEN_REACH = 0.3  # m about what is free or occupied, in which the laser would have shown a wall
EXTENT = CELL * HALF  # m from the viewpoint to each side; what lies farther is not laid on anything
LOOSENESS = (0.5, 0.1)  # m and rad by which the start of an alignment may be off
FREE, SEEN = np.uint8(1), np.uint8(2)  # bits of what is known of a cell
NONE_NEAR = np.int64(1) << 62  # where no keypoint is in reach of a cell
NUMBER = np.int64((1 << 32) - 1)  # the half of `Raster.nearest` that holds the number of a keypoint
U = np.uint64


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
        nearest: (W, H) number of the keypoint nearest to the cell's middle, in the lower half, and the squared
            distance of its cell in the higher one; NONE_NEAR without one within ICP_REACH.
        known: (W, H) bits FREE and SEEN.
        complete: whether the text tells what is free; else it is unknown what the laser did not see.
    """

    cell: float
    points: Floats
    normals: Floats
    low: NDArray[np.int64]
    nearest: NDArray[np.int64]
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
        cells = np.floor(shape.points / cell).astype(np.int64)
        low, high = _bounds(cells, squares, cell)
        known, nearest = np.zeros(high - low, dtype=np.uint8), np.full(high - low, NONE_NEAR)
        _fill(cells - low, squares - [*low, 0], int(round(SEEN_REACH / cell)), _ranks(cell), known, nearest)
        return cls(cell, *shape, low, nearest, known, len(squares) > 0)


def _bounds(
    cells: NDArray[np.int64], squares: NDArray[np.int64], cell: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The first cell of a raster along x and y, and those just beyond its last."""
    corners, opposite = squares[:, :2].T, (squares[:, :2] + squares[:, 2:]).T
    lowest = np.minimum(cells.T.min(axis=1, initial=0), corners.min(axis=1, initial=0))
    highest = np.maximum(cells.T.max(axis=1, initial=0), opposite.max(axis=1, initial=0))
    margin, most = math.ceil(ICP_REACH / cell) + 1, math.ceil(EXTENT / cell)
    low = np.clip(lowest - margin, -most, most - 1)
    return low, np.clip(highest + margin + 1, low + 1, most)


@cache
def _ranks(cell: float) -> NDArray[np.int64]:
    """(2 R + 1, 2 R + 1) how near the cells about a keypoint's own are: their squared distance, in the higher
    half of each number; NONE_NEAR beyond ICP_REACH."""
    reach = math.ceil(ICP_REACH / cell)
    steps = np.arange(-reach, reach + 1)
    squared = steps[:, None] ** 2 + steps**2
    return np.where(squared < (ICP_REACH / cell) ** 2, squared << 32, NONE_NEAR)


@kernel
def _fill(
    cells: NDArray[np.int64],
    squares: NDArray[np.int64],
    margin: int,
    around: NDArray[np.int64],
    known: NDArray[np.uint8],
    nearest: NDArray[np.int64],
) -> None:
    """Fills ``known``, 0 at first, and ``nearest``, NONE_NEAR at first.

    The least of all that a cell may hold is that of the nearest keypoint, the first of equally near ones.
    """
    width, height = known.shape
    for k in range(len(squares)):
        x, y, side = squares[k, 0], squares[k, 1], squares[k, 2]
        for i in range(max(x - margin, 0), min(x + side + margin, width)):
            for j in range(max(y - margin, 0), min(y + side + margin, height)):
                known[i, j] |= SEEN
                if x <= i < x + side and y <= j < y + side:
                    known[i, j] |= FREE
    wide, reach = len(around), len(around) // 2
    for k in range(len(cells)):
        x, y = cells[k, 0], cells[k, 1]
        left, below = x - reach, y - reach
        first, end = U(max(-below, 0)), U(max(min(wide, height - below), 0))
        for i in range(max(-left, 0), min(wide, width - left)):
            for j in range(first, end):
                place = U(below) + j
                nearest[left + i, place] = min(nearest[left + i, place], around[i, j] + k)
        for i in range(max(x - margin, 0), min(x + margin + 1, width)):
            for j in range(max(y - margin, 0), min(y + margin + 1, height)):
                known[i, j] |= SEEN


def refined(query: Raster, found: Raster, starts: Floats) -> Floats:
    """The poses (S, 3) of the query's frame in the found map's, by point-to-line ICP from ``starts`` (S, 3).

    Gauss-Newton with a Cauchy loss, as in `registration`, held near the start so that a featureless corridor
    does not slide.
    """
    poses = np.array(starts, dtype=np.float64)
    _refine(query, found, poses)
    return poses


@kernel
def _refine(query: Raster, found: Raster, poses: Floats) -> None:
    points, walls, normals = query.points, found.points, found.normals
    width, height = found.nearest.shape
    per_metre = 1.0 / found.cell
    in_place, in_angle = 1.0 / LOOSENESS[0] ** 2, 1.0 / LOOSENESS[1] ** 2
    for pose in poses:
        start_x, start_y, start_angle = pose[0], pose[1], pose[2]
        for iteration in range(ITERATIONS):
            reach = max(ICP_REACH * 0.75**iteration, 0.12)
            h00, h01, h02, h11, h12, h22 = in_place, 0.0, 0.0, in_place, 0.0, in_angle
            g0, g1 = in_place * (pose[0] - start_x), in_place * (pose[1] - start_y)
            g2 = in_angle * (pose[2] - start_angle)
            c, s = math.cos(pose[2]), math.sin(pose[2])
            for k in range(len(points)):
                rx, ry = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
                x, y = rx + pose[0], ry + pose[1]
                i = int(math.floor(x * per_metre)) - found.low[0]
                j = int(math.floor(y * per_metre)) - found.low[1]
                if not (0 <= i < width and 0 <= j < height):
                    continue
                if found.nearest[i, j] == NONE_NEAR:
                    continue
                m = found.nearest[i, j] & NUMBER
                dx, dy, nx, ny = x - walls[m, 0], y - walls[m, 1], normals[m, 0], normals[m, 1]
                if dx * dx + dy * dy >= reach * reach or (nx == 0.0 and ny == 0.0):
                    continue
                error, lever = nx * dx + ny * dy, nx * -ry + ny * rx
                w = (4.0 / CORRELATION) / (4.0 * POINT_SIGMA**2 + error * error)  # Cauchy's
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
