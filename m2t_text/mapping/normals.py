"""Directions of walls at their points: unit normals of scans and of point sets."""

import math

import numpy as np
from numpy.typing import NDArray

from m2t_text.util.compiling import inner, kernel
from m2t_text.util.types import Floats

LINEAR = 0.6  # (l1 - l2) / (l1 + l2) of the neighbours' spread above which they are a line
BESIDE = 3  # neighbours in beam order to each side, at most


def normals(points: Floats, reach: float) -> Floats:
    """Unit normals (N, 2) of a scan's points in beam order; zero where no neighbour lies within ``reach`` m."""
    result = np.zeros((len(points), 2))
    _normals(np.ascontiguousarray(points), reach, result)
    return result


@kernel
def _normals(points: Floats, reach: float, result: Floats) -> None:
    n = len(points)
    for i in range(n):
        first, last = i, i
        while first > 0 and i - first < BESIDE and _near(points, first - 1, first, reach):
            first -= 1
        while last < n - 1 and last - i < BESIDE and _near(points, last + 1, last, reach):
            last += 1
        if last - first < 2:
            continue
        mx, my = 0.0, 0.0
        for k in range(first, last + 1):
            mx += points[k, 0]
            my += points[k, 1]
        mx /= last + 1 - first
        my /= last + 1 - first
        sxx, syy, sxy = 0.0, 0.0, 0.0
        for k in range(first, last + 1):
            dx, dy = points[k, 0] - mx, points[k, 1] - my
            sxx += dx * dx
            syy += dy * dy
            sxy += dx * dy
        along = 0.5 * math.atan2(2 * sxy, sxx - syy)
        result[i, 0], result[i, 1] = -math.sin(along), math.cos(along)


@inner
def _near(points: Floats, i: int, j: int, reach: float) -> bool:
    return math.hypot(points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]) < reach


def cloud_normals(points: Floats, reach: float) -> Floats:
    """Unit normals (N, 2) of points in any order, from the neighbours within ``reach`` metres.

    Zero where fewer than three points, or points that lie on no line, are near.
    """
    order = np.argsort(points[:, 0], kind="stable")
    moments = np.zeros((len(points), 6))  # of each point's neighbours, itself included: n, x, y, xx, yy, xy
    moments[:, 0] = 1.0
    result = np.zeros((len(points), 2))
    _cloud_normals(np.ascontiguousarray(points), reach, order, moments, result)
    return result


@kernel
def _cloud_normals(
    points: Floats, reach: float, order: NDArray[np.int64], moments: Floats, result: Floats
) -> None:
    n = len(points)
    for p in range(n):
        for q in range(p + 1, n):
            i, j = order[p], order[q]
            dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
            if dx > reach:
                break
            if dx * dx + dy * dy <= reach * reach:
                _add_neighbour(moments, i, dx, dy)
                _add_neighbour(moments, j, -dx, -dy)
    for i in range(n):
        count, x, y = moments[i, 0], moments[i, 1] / moments[i, 0], moments[i, 2] / moments[i, 0]
        xx, yy, xy = moments[i, 3] / count - x * x, moments[i, 4] / count - y * y, moments[i, 5] / count - x * y
        if count >= 3 and math.hypot(xx - yy, 2 * xy) > LINEAR * (xx + yy):
            along = 0.5 * math.atan2(2 * xy, xx - yy)
            result[i, 0], result[i, 1] = -math.sin(along), math.cos(along)


@inner
def _add_neighbour(moments: Floats, i: int, dx: float, dy: float) -> None:
    moments[i, 0] += 1.0
    moments[i, 1] += dx
    moments[i, 2] += dy
    moments[i, 3] += dx * dx
    moments[i, 4] += dy * dy
    moments[i, 5] += dx * dy
