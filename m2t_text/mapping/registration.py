"""Registration of a scan against a reference cloud: correlative search, then point-to-line ICP.

The search (Olson, "Real-time correlative scan matching", ICRA 2009) finds the right basin when odometry is far
off; the refinement (Censi, "An ICP variant using a point-to-line metric", ICRA 2008) finds the pose in it. Both
are held by the odometry's prior, so that a featureless corridor does not slide.
"""

import math
import threading

import numpy as np
from numpy.typing import NDArray

from m2t_text.util.compiling import inner, kernel
from m2t_text.util.types import Floats

CELL = 0.1  # m; side of a cell of the likelihood grid
HALF = 220  # cells; the grid reaches 22 m to each side of the predicted pose
SIDE = 2 * HALF
SIDE_LENGTH = SIDE * CELL  # m
# Likelihood of a hit so many cells away from a reference point, in x and y: a Gaussian of 0.12 m, floored.
BLUR = 3
KERNEL = np.array(
    [
        [math.exp(-0.5 * ((i * i + j * j) * CELL**2) / 0.12**2) for j in range(-BLUR, BLUR + 1)]
        for i in range(-BLUR, BLUR + 1)
    ],
    dtype=np.float32,
)
SEARCH_STEP = 0.1  # m; grid of the search
ANGLE_STEP = math.radians(1.0)
POINT_SIGMA = 0.03  # m; noise of a point about its line
CORRELATION = 10.0  # neighbouring beams err together: so many points count as one
ROUNDING = 1e-9  # m; more than what is lost where a distance is computed
ITERATIONS = 12
REACHES = np.array([max(0.4 * 0.75**k, 0.12) for k in range(ITERATIONS)])  # m; of neighbours


class Grids(threading.local):
    """Grids about the predicted pose, kept by each thread from one call to the next: new memory costs more.

    Attributes:
        likelihood: (SIDE, SIDE) of a hit in each cell.
        head: (SIDE, SIDE) the last reference point in each cell, -1 if there is none; see `_bucket`. It is -1
            everywhere from one call to the next.
    """

    def __init__(self) -> None:
        self.likelihood = np.empty((SIDE, SIDE), dtype=np.float32)
        self.head = np.full((SIDE, SIDE), -1, dtype=np.int32)


_grids = Grids()


@inner
def _likelihood(reference: Floats, grid: NDArray[np.float32]) -> None:
    """Writes to the grid how likely a hit is in each cell."""
    for x in range(SIDE):
        for y in range(SIDE):
            grid[x, y] = 0.0
    for k in range(len(reference)):
        cx = math.floor(reference[k, 0] / CELL) + HALF
        cy = math.floor(reference[k, 1] / CELL) + HALF
        if BLUR <= cx < SIDE - BLUR and BLUR <= cy < SIDE - BLUR and grid[cx, cy] < 1.0:  # else it was done
            for i in range(2 * BLUR + 1):
                for j in range(2 * BLUR + 1):
                    x, y = cx + i - BLUR, cy + j - BLUR
                    if KERNEL[i, j] > grid[x, y]:
                        grid[x, y] = KERNEL[i, j]


@inner
def _search(
    grid: NDArray[np.float32], scan: Floats, turn: float, sigma: Floats, totals: Floats, best: Floats
) -> None:
    """Writes the best pose near the predicted one (the origin) on a lattice, by likelihood and prior.

    The ``totals`` (2 * S + 1, 2 * S + 1) are room to work in; S is the number of steps to each side.
    """
    best_score = -1e18
    side = len(totals)
    steps = side // 2
    turns = math.ceil(turn / ANGLE_STEP)
    for t in range(-turns, turns + 1):
        angle = t * ANGLE_STEP
        c, s = math.cos(angle), math.sin(angle)
        for i in range(side):
            for j in range(side):
                totals[i, j] = 0.0
        for k in range(len(scan)):  # to all totals in turn: each has to wait until the last point is added
            x = math.floor((c * scan[k, 0] - s * scan[k, 1]) / CELL) + HALF - steps
            y = math.floor((s * scan[k, 0] + c * scan[k, 1]) / CELL) + HALF - steps
            first = max(0, -y)
            last = max(first, min(side, SIDE - y))
            for i in range(max(0, -x), min(side, SIDE - x)):
                row, total = grid[x + i, y + first : y + last], totals[i, first:last]
                for j in range(len(total)):
                    total[j] += row[j]
        for dx in range(-steps, steps + 1):
            for dy in range(-steps, steps + 1):
                off = (dx * dx + dy * dy) * SEARCH_STEP**2 / sigma[0] ** 2 + (angle / sigma[1]) ** 2
                score = totals[dx + steps, dy + steps] / CORRELATION - 0.5 * off
                if score > best_score:
                    best_score = score
                    best[0], best[1], best[2] = dx * SEARCH_STEP, dy * SEARCH_STEP, angle


@inner
def _bucket(reference: Floats, head: NDArray[np.int32], link: NDArray[np.int32]) -> None:
    """Chains the points in each cell: ``head`` has the last one's number, ``link`` that of the one before."""
    for k in range(len(reference)):
        cx = math.floor(reference[k, 0] / CELL) + HALF
        cy = math.floor(reference[k, 1] / CELL) + HALF
        if 0 <= cx < SIDE and 0 <= cy < SIDE:
            link[k] = head[cx, cy]
            head[cx, cy] = k


@inner
def _empty(reference: Floats, head: NDArray[np.int32]) -> None:
    """Makes ``head`` what it was before `_bucket`: that takes less time than to clear all of it."""
    for k in range(len(reference)):
        cx = math.floor(reference[k, 0] / CELL) + HALF
        cy = math.floor(reference[k, 1] / CELL) + HALF
        if 0 <= cx < SIDE and 0 <= cy < SIDE:
            head[cx, cy] = -1


@inner
def _nearest(
    x: float, y: float, reach: float, reference: Floats, head: NDArray[np.int32], link: NDArray[np.int32]
) -> int:
    """The number of the reference point nearest to (x, y) and nearer than ``reach``, or -1.

    Any point in the same cell shows how near it is at least, so that few cells are left to look into.
    """
    cx, cy = math.floor(x / CELL) + HALF, math.floor(y / CELL) + HALF
    best, best_distance = -1, reach * reach
    within = reach
    if 0 <= cx < SIDE and 0 <= cy < SIDE and head[cx, cy] >= 0:
        dx, dy = reference[head[cx, cy], 0] - x, reference[head[cx, cy], 1] - y
        within = min(reach, math.sqrt(dx * dx + dy * dy) + ROUNDING)
    left, right = math.floor((x - within) / CELL) + HALF, math.floor((x + within) / CELL) + HALF
    low, high = math.floor((y - within) / CELL) + HALF, math.floor((y + within) / CELL) + HALF
    for i in range(max(left, 0), min(right + 1, SIDE)):
        for j in range(max(low, 0), min(high + 1, SIDE)):
            k = head[i, j]
            while k >= 0:
                dx, dy = reference[k, 0] - x, reference[k, 1] - y
                d = dx * dx + dy * dy
                if d < best_distance:
                    best, best_distance = k, d
                k = link[k]
    return best


@inner
def _refine(
    reference: Floats,
    reference_normals: Floats,
    scan: Floats,
    sigma: Floats,
    head: NDArray[np.int32],
    link: NDArray[np.int32],
    pose: Floats,
) -> float:
    """Moves the pose by Gauss-Newton on point-to-line distances, Cauchy loss; returns the inlier ratio."""
    inliers = 0.0
    for iteration in range(ITERATIONS):
        reach = REACHES[iteration]
        h00, h01, h02, h11, h12, h22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        g0, g1, g2 = 0.0, 0.0, 0.0
        c, s = math.cos(pose[2]), math.sin(pose[2])
        inliers = 0.0
        for k in range(len(scan)):
            rx, ry = c * scan[k, 0] - s * scan[k, 1], s * scan[k, 0] + c * scan[k, 1]
            x, y = rx + pose[0], ry + pose[1]
            m = _nearest(x, y, reach, reference, head, link)
            if m < 0:
                continue
            inliers += 1
            nx, ny = reference_normals[m, 0], reference_normals[m, 1]
            if nx == 0.0 and ny == 0.0:
                continue
            error = nx * (x - reference[m, 0]) + ny * (y - reference[m, 1])
            j2 = -nx * ry + ny * rx
            w = 1.0 / (1.0 + (error / (2 * POINT_SIGMA)) ** 2) / (POINT_SIGMA**2 * CORRELATION)
            h00 += w * nx * nx
            h01 += w * nx * ny
            h02 += w * nx * j2
            h11 += w * ny * ny
            h12 += w * ny * j2
            h22 += w * j2 * j2
            g0 += w * nx * error
            g1 += w * ny * error
            g2 += w * j2 * error
        in_place, in_angle = 1.0 / sigma[0] ** 2, 1.0 / sigma[1] ** 2
        g0, g1, g2 = g0 + in_place * pose[0], g1 + in_place * pose[1], g2 + in_angle * pose[2]
        x, y, angle = solved(h00 + in_place, h01, h02, h11 + in_place, h12, h22 + in_angle, g0, g1, g2)
        pose[0] -= x
        pose[1] -= y
        pose[2] -= angle
        if abs(x) + abs(y) < 1e-4 and abs(angle) < 1e-5 and reach <= 0.12:
            break
    return inliers / max(len(scan), 1)


@inner
def solved(
    h00: float, h01: float, h02: float, h11: float, h12: float, h22: float, g0: float, g1: float, g2: float
) -> tuple[float, float, float]:
    """The solution of h x = g for a positive definite, symmetric h (3, 3), by Cholesky's factors."""
    a = math.sqrt(h00)
    b, c = h01 / a, h02 / a
    d = math.sqrt(h11 - b * b)
    e = (h12 - b * c) / d
    f = math.sqrt(h22 - c * c - e * e)
    u = g0 / a
    v = (g1 - b * u) / d
    w = (g2 - c * u - e * v) / f
    x2 = w / f
    x1 = (v - e * x2) / d
    return (u - b * x1 - c * x2) / a, x1, x2


def register(
    reference: Floats,
    reference_normals: Floats,
    scan: Floats,
    window: float,
    turn: float,
    sigma: Floats,
) -> tuple[Floats, float]:
    """Where a scan was taken, near where odometry predicts it.

    Args:
        reference: (M, 2) points in the predicted robot frame, metres.
        reference_normals: (M, 2) their unit normals in the same frame; zero where unknown.
        scan: (N, 2) points of the scan in its robot frame.
        window, turn: how far the search goes in x and y (metres) and in angle (radians); 0 skips the search.
        sigma: (2,) standard deviation of the prediction in x and y (metres) and in angle (radians).

    Returns:
        The pose (3,) of the scan in the predicted frame, and the share of points that found a partner.
    """
    side = 2 * math.ceil(window / SEARCH_STEP) + 1
    totals, link, pose = np.empty((side, side)), np.empty(len(reference), dtype=np.int32), np.zeros(3)
    inliers = _register(
        np.ascontiguousarray(reference), np.ascontiguousarray(reference_normals), np.ascontiguousarray(scan),
        float(turn), sigma, _grids.likelihood, totals, _grids.head, link, pose,
    )  # fmt: skip
    return pose, inliers


@kernel
def _register(
    reference: Floats,
    reference_normals: Floats,
    scan: Floats,
    turn: float,
    sigma: Floats,
    grid: NDArray[np.float32],
    totals: Floats,
    head: NDArray[np.int32],
    link: NDArray[np.int32],
    pose: Floats,
) -> float:
    """The inlier ratio of `register`; ``pose`` (3,) is 0 at first; the other new arrays are room to work in."""
    if len(totals) > 1:
        _likelihood(reference, grid)
        _search(grid, scan, turn, sigma, totals, pose)
    _bucket(reference, head, link)
    inliers = _refine(reference, reference_normals, scan, sigma, head, link, pose)
    _empty(reference, head)
    return inliers


def refine(reference: Floats, reference_normals: Floats, scan: Floats, sigma: Floats, poses: Floats) -> Floats:
    """(K,) the inlier ratios of poses (K, 3), arguments as for `register`, which are refined in place."""
    link, inliers = np.empty(len(reference), dtype=np.int32), np.empty(len(poses))
    _refine_all(
        np.ascontiguousarray(reference), np.ascontiguousarray(reference_normals), np.ascontiguousarray(scan),
        sigma, _grids.head, link, poses, inliers,
    )  # fmt: skip
    return inliers


@kernel
def _refine_all(
    reference: Floats,
    reference_normals: Floats,
    scan: Floats,
    sigma: Floats,
    head: NDArray[np.int32],
    link: NDArray[np.int32],
    poses: Floats,
    inliers: Floats,
) -> None:
    _bucket(reference, head, link)
    for k in range(len(poses)):
        inliers[k] = _refine(reference, reference_normals, scan, sigma, head, link, poses[k])
    _empty(reference, head)


def likelihood_grid() -> NDArray[np.float32]:
    """(SIDE, SIDE) this thread's grid, to be filled."""
    return _grids.likelihood


@kernel
def _fill(reference: Floats, grid: NDArray[np.float32]) -> None:
    _likelihood(reference, grid)


def fill_likelihood(reference: Floats, grid: NDArray[np.float32]) -> None:
    """Writes to a grid how likely a hit is in each cell about the origin, given reference points (M, 2)."""
    _fill(np.ascontiguousarray(reference), grid)


def fit(
    reference: Floats, reference_normals: Floats, scan: Floats, pose: Floats, reach: float = 0.15
) -> tuple[Floats, float, float]:
    """How well the points of a scan at a pose (3,) fit a reference, arguments as for `register`.

    Returns:
        The Hessian (3, 3) of half the squared point-to-line distances by a small motion of the scan in its own
        frame, for a noise of 1 m; the weighted RMS distance in metres; and the share of points that have a
        partner within ``reach`` metres.
    """
    link, hessian = np.empty(len(reference), dtype=np.int32), np.zeros((3, 3))
    squares, held, inliers = _fit(
        np.ascontiguousarray(reference), np.ascontiguousarray(reference_normals), np.ascontiguousarray(scan),
        pose, reach, _grids.head, link, np.empty(3), hessian,
    )  # fmt: skip
    return hessian, math.sqrt(squares / max(held, 1)), inliers / max(len(scan), 1)


@kernel
def _fit(
    reference: Floats,
    reference_normals: Floats,
    scan: Floats,
    pose: Floats,
    reach: float,
    head: NDArray[np.int32],
    link: NDArray[np.int32],
    slope: Floats,
    hessian: Floats,
) -> tuple[float, int, int]:
    """The sum of the weighted squares, the number of points on lines and of those with a partner.

    Adds to the Hessian. The ``slope`` (3,) is room to work in.
    """
    _bucket(reference, head, link)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    squares, held, inliers = 0.0, 0, 0
    for k in range(len(scan)):
        x = pose[0] + c * scan[k, 0] - s * scan[k, 1]
        y = pose[1] + s * scan[k, 0] + c * scan[k, 1]
        m = _nearest(x, y, reach, reference, head, link)
        if m < 0:
            continue
        inliers += 1
        nx, ny = reference_normals[m, 0], reference_normals[m, 1]
        if nx == 0.0 and ny == 0.0:
            continue
        error = nx * (x - reference[m, 0]) + ny * (y - reference[m, 1])
        w = 1.0 / (1.0 + (error / (2 * POINT_SIGMA)) ** 2)
        squares += w * error * error
        held += 1
        slope[0], slope[1] = c * nx + s * ny, -s * nx + c * ny
        slope[2] = slope[1] * scan[k, 0] - slope[0] * scan[k, 1]
        for i in range(3):
            for j in range(3):
                hessian[i, j] += w * slope[i] * slope[j]
    _empty(reference, head)
    return squares, held, inliers
