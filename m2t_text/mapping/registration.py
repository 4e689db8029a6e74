"""Registration of a scan against a reference cloud: correlative search, then point-to-line ICP.

The search (Olson, "Real-time correlative scan matching", ICRA 2009) finds the right basin when odometry is far
off; the refinement (Censi, "An ICP variant using a point-to-line metric", ICRA 2008) finds the pose in it. Both
are held by the odometry's prior, so that a featureless corridor does not slide.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

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
ITERATIONS = 12


@njit(cache=True, nogil=True)
def _likelihood(reference: Floats, grid: NDArray[np.float32]) -> None:
    grid[:] = 0
    for k in range(len(reference)):
        cx = int(math.floor(reference[k, 0] / CELL)) + HALF
        cy = int(math.floor(reference[k, 1] / CELL)) + HALF
        if BLUR <= cx < SIDE - BLUR and BLUR <= cy < SIDE - BLUR:
            for i in range(2 * BLUR + 1):
                for j in range(2 * BLUR + 1):
                    x, y = cx + i - BLUR, cy + j - BLUR
                    if KERNEL[i, j] > grid[x, y]:
                        grid[x, y] = KERNEL[i, j]


@njit(cache=True, nogil=True)
def _search(grid: NDArray[np.float32], scan: Floats, window: float, turn: float, sigma: Floats) -> Floats:
    """The best pose near the predicted one (the origin) on a lattice, by likelihood and prior."""
    best = np.zeros(3)
    best_score = -1e18
    steps = int(math.ceil(window / SEARCH_STEP))
    turns = int(math.ceil(turn / ANGLE_STEP))
    n = len(scan)
    cells = np.empty((n, 2), dtype=np.int64)
    for t in range(-turns, turns + 1):
        angle = t * ANGLE_STEP
        c, s = math.cos(angle), math.sin(angle)
        for k in range(n):
            cells[k, 0] = int(math.floor((c * scan[k, 0] - s * scan[k, 1]) / CELL)) + HALF
            cells[k, 1] = int(math.floor((s * scan[k, 0] + c * scan[k, 1]) / CELL)) + HALF
        for dx in range(-steps, steps + 1):
            for dy in range(-steps, steps + 1):
                total = 0.0
                for k in range(n):
                    x, y = cells[k, 0] + dx, cells[k, 1] + dy
                    if 0 <= x < SIDE and 0 <= y < SIDE:
                        total += grid[x, y]
                off = (dx * dx + dy * dy) * SEARCH_STEP**2 / sigma[0] ** 2 + (angle / sigma[1]) ** 2
                score = total / CORRELATION - 0.5 * off
                if score > best_score:
                    best_score = score
                    best[0], best[1], best[2] = dx * SEARCH_STEP, dy * SEARCH_STEP, angle
    return best


@njit(cache=True, nogil=True)
def _bucket(reference: Floats, head: NDArray[np.int32], link: NDArray[np.int32]) -> None:
    head[:] = -1
    for k in range(len(reference)):
        cx = int(math.floor(reference[k, 0] / CELL)) + HALF
        cy = int(math.floor(reference[k, 1] / CELL)) + HALF
        if 0 <= cx < SIDE and 0 <= cy < SIDE:
            link[k] = head[cx, cy]
            head[cx, cy] = k


@njit(cache=True, nogil=True)
def _nearest(
    x: float, y: float, reach: float, reference: Floats, head: NDArray[np.int32], link: NDArray[np.int32]
) -> int:
    cells = int(math.ceil(reach / CELL))
    cx, cy = int(math.floor(x / CELL)) + HALF, int(math.floor(y / CELL)) + HALF
    best, best_distance = -1, reach * reach
    for i in range(max(cx - cells, 0), min(cx + cells + 1, SIDE)):
        for j in range(max(cy - cells, 0), min(cy + cells + 1, SIDE)):
            k = head[i, j]
            while k >= 0:
                dx, dy = reference[k, 0] - x, reference[k, 1] - y
                d = dx * dx + dy * dy
                if d < best_distance:
                    best, best_distance = k, d
                k = link[k]
    return best


@njit(cache=True, nogil=True)
def _refine(
    reference: Floats,
    reference_normals: Floats,
    scan: Floats,
    start: Floats,
    sigma: Floats,
    head: NDArray[np.int32],
    link: NDArray[np.int32],
) -> tuple[Floats, float]:
    """Gauss-Newton on point-to-line distances with a Cauchy loss; returns the pose and the inlier ratio."""
    pose = start.copy()
    inliers = 0.0
    for iteration in range(ITERATIONS):
        reach = max(0.4 * 0.75**iteration, 0.12)
        h = np.zeros((3, 3))
        g = np.zeros(3)
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
            h[0, 0] += w * nx * nx
            h[0, 1] += w * nx * ny
            h[0, 2] += w * nx * j2
            h[1, 1] += w * ny * ny
            h[1, 2] += w * ny * j2
            h[2, 2] += w * j2 * j2
            g[0] += w * nx * error
            g[1] += w * ny * error
            g[2] += w * j2 * error
        h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]
        for i in range(3):
            p = 1.0 / (sigma[1] if i == 2 else sigma[0]) ** 2
            h[i, i] += p
            g[i] += p * pose[i]
        step = _solved(h, g)
        pose -= step
        if abs(step[0]) + abs(step[1]) < 1e-4 and abs(step[2]) < 1e-5 and reach <= 0.12:
            break
    return pose, inliers / max(len(scan), 1)


@njit(cache=True, nogil=True)
def _solved(h: Floats, g: Floats) -> Floats:
    """The solution (3,) of h x = g for a positive definite h (3, 3), by Cholesky's factors."""
    a = np.sqrt(h[0, 0])
    b, c = h[1, 0] / a, h[2, 0] / a
    d = np.sqrt(h[1, 1] - b * b)
    e = (h[2, 1] - b * c) / d
    f = np.sqrt(h[2, 2] - c * c - e * e)
    u = g[0] / a
    v = (g[1] - b * u) / d
    w = (g[2] - c * u - e * v) / f
    x = np.empty(3)
    x[2] = w / f
    x[1] = (v - e * x[2]) / d
    x[0] = (u - b * x[1] - c * x[2]) / a
    return x


@njit(cache=True, nogil=True)
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
    start = np.zeros(3)
    if window > 0:
        grid = np.empty((SIDE, SIDE), dtype=np.float32)
        _likelihood(reference, grid)
        start = _search(grid, scan, window, turn, sigma)
    head = np.empty((SIDE, SIDE), dtype=np.int32)
    link = np.empty(len(reference), dtype=np.int32)
    _bucket(reference, head, link)
    return _refine(reference, reference_normals, scan, start, sigma, head, link)


@njit(cache=True, nogil=True)
def within(points: Floats, reference: Floats, reach: float) -> NDArray[np.bool_]:
    """(N,) which of the points (N, 2) have one of the reference (M, 2) nearer than ``reach`` metres."""
    head = np.empty((SIDE, SIDE), dtype=np.int32)
    link = np.empty(len(reference), dtype=np.int32)
    _bucket(reference, head, link)
    near = np.empty(len(points), dtype=np.bool_)
    for k in range(len(points)):
        near[k] = _nearest(points[k, 0], points[k, 1], reach, reference, head, link) >= 0
    return near


@njit(cache=True, nogil=True)
def fit(
    reference: Floats, reference_normals: Floats, scan: Floats, pose: Floats, reach: float = 0.15
) -> tuple[Floats, float, float]:
    """How well the points of a scan at a pose (3,) fit a reference, arguments as for `register`.

    Returns:
        The Hessian (3, 3) of half the squared point-to-line distances by a small motion of the scan in its own
        frame, for a noise of 1 m; the weighted RMS distance in metres; and the share of points that have a
        partner within ``reach`` metres.
    """
    head = np.empty((SIDE, SIDE), dtype=np.int32)
    link = np.empty(len(reference), dtype=np.int32)
    _bucket(reference, head, link)
    h = np.zeros((3, 3))
    slope = np.empty(3)
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
                h[i, j] += w * slope[i] * slope[j]
    return h, math.sqrt(squares / max(held, 1)), inliers / max(len(scan), 1)
