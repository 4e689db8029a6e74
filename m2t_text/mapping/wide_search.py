"""Registration where little is known of the pose: a wide search that keeps several places, each refined.

The search is Olson's multi-resolution one ("Real-time correlative scan matching", ICRA 2009): blocks of the
lattice are bounded first, and only the most promising ones are looked into.
"""

import math

import numpy as np
from numpy.typing import NDArray

from m2t_text.mapping.registration import (
    ANGLE_STEP,
    CELL,
    CORRELATION,
    HALF,
    SEARCH_STEP,
    SIDE,
    fill_likelihood,
    likelihood_grid,
    refine,
)
from m2t_text.util.compiling import inner, kernel
from m2t_text.util.types import Floats, Ints

BLOCK = 4  # cells; side of a block
COARSE_POINTS, BLOCKS = 90, 400  # points of which bounds are made, and blocks that are looked into, at most
PLACES = 4  # that are refined,
SAME_POSE = (0.35, math.radians(8.0))  # m and rad; nearer ones are one
NOTHING = -1e18


def register_widely(
    reference: Floats, normals: Floats, scan: Floats, window: float, turn: float, sigma: Floats
) -> tuple[Floats, float]:
    """Where a scan was taken, if little is known of that: arguments and results as for `register`.

    The few best places that are apart are refined, and the one that fits best then is the answer.
    """
    poses, fits, inliers = fitting_places(reference, normals, scan, window, turn, sigma)
    chosen = int(np.argmax(fits))
    return poses[chosen], float(inliers[chosen])


def fitting_places(
    reference: Floats, normals: Floats, scan: Floats, window: float, turn: float, sigma: Floats
) -> tuple[Floats, Floats, Floats]:
    """The few best places of a scan, refined: poses (K, 3), their log-likelihoods and inlier ratios (K,).

    Arguments as for `register`; K >= 1. Places that were apart may have become one.
    """
    grid = likelihood_grid()
    fill_likelihood(reference, grid)
    scan = np.ascontiguousarray(scan)
    steps = math.ceil(window / (BLOCK * SEARCH_STEP))
    turns = math.ceil(turn / ANGLE_STEP)
    some = np.ascontiguousarray(scan[:: max(1, len(scan) // COARSE_POINTS)])
    bounds = np.empty((2 * turns + 1, 2 * steps + 1, 2 * steps + 1))
    cells = np.empty((len(scan), 2), dtype=np.int64)
    pooled = _pooled(grid)
    _bound(pooled, some, cells[: len(some)], bounds)
    bounds *= len(scan) / max(len(some), 1) / CORRELATION
    bounds += _prior(steps, turns, sigma)
    best = np.argsort(-bounds, axis=None, kind="stable")[:BLOCKS]
    blocks = np.column_stack(np.unravel_index(best, bounds.shape)) - [turns, steps, steps]
    places, scores = np.zeros((PLACES, 3)), np.full(PLACES, NOTHING)
    _look_into(grid, scan, cells, blocks.astype(np.int64), sigma, places, scores)
    poses = places[scores > NOTHING] if scores[0] > NOTHING else places[:1]
    inliers = refine(reference, normals, scan, sigma, poses)
    fits = np.array([_fit(grid, scan, pose, sigma) for pose in poses])
    return poses, fits, inliers


def _pooled(grid: NDArray[np.float32]) -> NDArray[np.float32]:
    """The greatest value of each square of BLOCK x BLOCK cells that begins at a cell."""
    pooled = grid.copy()
    for k in range(1, BLOCK):
        np.maximum(pooled[:, :-k], grid[:, k:], out=pooled[:, :-k])
    rows = pooled.copy()
    for k in range(1, BLOCK):
        np.maximum(pooled[:-k], rows[k:], out=pooled[:-k])
    return pooled


def _prior(steps: int, turns: int, sigma: Floats) -> Floats:
    """(2 * turns + 1, 2 * steps + 1, 2 * steps + 1) the greatest log-prior in each block."""
    block = np.arange(-steps, steps + 1)
    nearest = np.where(block < 0, block * BLOCK + BLOCK - 1, block * BLOCK) * SEARCH_STEP / sigma[0]
    angles = np.arange(-turns, turns + 1) * ANGLE_STEP / sigma[1]
    prior: Floats = -0.5 * (
        angles[:, None, None] ** 2 + nearest[None, :, None] ** 2 + nearest[None, None, :] ** 2
    )
    return prior


@kernel
def _bound(pooled: NDArray[np.float32], scan: Floats, cells: Ints, bounds: Floats) -> None:
    """Writes the sums of the greatest values that the points can have in each block; ``cells`` is room."""
    turns, steps = (bounds.shape[0] - 1) // 2, (bounds.shape[1] - 1) // 2
    for t in range(bounds.shape[0]):
        _turn(scan, (t - turns) * ANGLE_STEP, cells)
        for i in range(bounds.shape[1]):
            for j in range(bounds.shape[2]):
                bounds[t, i, j] = _sum(pooled, cells, (i - steps) * BLOCK, (j - steps) * BLOCK)


@kernel
def _look_into(
    grid: NDArray[np.float32],
    scan: Floats,
    cells: Ints,
    blocks: Ints,
    sigma: Floats,
    places: Floats,
    scores: Floats,
) -> None:
    """Puts the best ``places`` (K, 3) in blocks (B, 3) in order of their ``scores`` (K,); ``cells`` is room."""
    for k in range(len(blocks)):
        angle = blocks[k, 0] * ANGLE_STEP
        _turn(scan, angle, cells)
        for a in range(BLOCK):
            for b in range(BLOCK):
                dx, dy = blocks[k, 1] * BLOCK + a, blocks[k, 2] * BLOCK + b
                off = (dx * dx + dy * dy) * SEARCH_STEP**2 / sigma[0] ** 2 + (angle / sigma[1]) ** 2
                score = _sum(grid, cells, dx, dy) / CORRELATION - 0.5 * off
                _keep(places, scores, dx * SEARCH_STEP, dy * SEARCH_STEP, angle, score)


@inner
def _turn(scan: Floats, angle: float, cells: Ints) -> None:
    """Writes the cells of a scan's points, turned."""
    c, s = math.cos(angle), math.sin(angle)
    for k in range(len(scan)):
        cells[k, 0] = int(math.floor((c * scan[k, 0] - s * scan[k, 1]) / CELL)) + HALF
        cells[k, 1] = int(math.floor((s * scan[k, 0] + c * scan[k, 1]) / CELL)) + HALF


@inner
def _sum(grid: NDArray[np.float32], cells: Ints, dx: int, dy: int) -> float:
    total = 0.0
    for k in range(len(cells)):
        x, y = cells[k, 0] + dx, cells[k, 1] + dy
        if 0 <= x < SIDE and 0 <= y < SIDE:
            total += grid[x, y]
    return total


@inner
def _keep(places: Floats, scores: Floats, x: float, y: float, angle: float, score: float) -> None:
    """Puts a place among the best ones (K, 3), unless a better one lies near; drops a worse one near it."""
    last = len(scores) - 1
    if score <= scores[last]:
        return
    at = last  # which is dropped
    for k in range(len(scores)):
        away = math.hypot(places[k, 0] - x, places[k, 1] - y)
        if away < SAME_POSE[0] and abs(places[k, 2] - angle) < SAME_POSE[1] and scores[k] > NOTHING:
            if scores[k] >= score:
                return
            at = k
            break
    while at > 0 and scores[at - 1] < score:
        scores[at] = scores[at - 1]
        for axis in range(3):
            places[at, axis] = places[at - 1, axis]
        at -= 1
    scores[at] = score
    places[at, 0], places[at, 1], places[at, 2] = x, y, angle


def _fit(grid: NDArray[np.float32], scan: Floats, pose: Floats, sigma: Floats) -> float:
    """The log-likelihood of a pose, up to a constant."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    points = scan @ np.array([[c, s], [-s, c]]) + pose[:2]
    x, y = (np.floor(points / CELL).astype(np.int64) + HALF).T
    inside = (x >= 0) & (x < SIDE) & (y >= 0) & (y < SIDE)
    off = (pose[0] ** 2 + pose[1] ** 2) / sigma[0] ** 2 + (pose[2] / sigma[1]) ** 2
    return float(grid[x[inside], y[inside]].sum(dtype=np.float64)) / CORRELATION - 0.5 * float(off)
