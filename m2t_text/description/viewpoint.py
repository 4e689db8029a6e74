"""Viewpoint planning: a pose from which similar maps are seen alike (paper, IV-B)."""

import numpy as np
from numba import njit

from m2t_text.util.geometry import wrap
from m2t_text.util.types import Floats

BIN = 0.1  # m; width of a bin of the projections
COARSE, FINE = 45, 16  # directions tried over a quarter turn, then between the neighbours of the best
DEGREES = 90  # directions over a quarter turn at which other likely ones are looked for
SEPARATE = np.radians(10.0)  # between two likely directions
DEPTH = 0.5  # nats by which a likely direction's entropy may exceed the least


@njit(cache=True, nogil=True)
def projection_entropy(points: Floats, angle: float) -> float:
    """Entropy, in nats, of the points' projections onto the axes turned by ``angle``.

    Each point is shared between the two nearest bins, so that the entropy changes smoothly with the angle.
    """
    n = len(points)
    c, s = np.cos(angle), np.sin(angle)
    entropy = 0.0
    for axis in range(2):
        along = np.empty(n)
        for i in range(n):
            along[i] = c * points[i, 0] + s * points[i, 1] if axis == 0 else c * points[i, 1] - s * points[i, 0]
        low = along.min()
        histogram = np.zeros(int((along.max() - low) / BIN) + 2)
        for i in range(n):
            place = (along[i] - low) / BIN
            k = int(place)
            histogram[k] += 1 - (place - k)
            histogram[k + 1] += place - k
        for count in histogram:
            if count > 0:
                entropy -= count / n * np.log(count / n)
    return entropy


@njit(cache=True, nogil=True)
def dominant_direction(points: Floats) -> float:
    """The direction in [0, pi/2) along which walls lie: where the entropy of the projections is least.

    Ties go to the smaller angle. Fewer than two points have the direction 0.
    """
    if len(points) < 2:
        return 0.0
    step = np.pi / 2 / COARSE
    best, least = 0.0, np.inf
    for k in range(COARSE):
        entropy = projection_entropy(points, k * step)
        if entropy < least - 1e-12:
            best, least = k * step, entropy
    centre = best
    for k in range(-FINE + 1, FINE):
        entropy = projection_entropy(points, centre + k * step / FINE)
        if entropy < least - 1e-12:
            best, least = centre + k * step / FINE, entropy
    return best % (np.pi / 2)


def plan_viewpoint(points: Floats, trajectory: Floats, on_trajectory: bool) -> tuple[Floats, Floats]:
    """The planned viewpoint of a local map, and its centre of gravity.

    Of the four directions along the walls the one nearest to the robot's heading is taken.

    Args:
        points: (N, 2) occupied cells.
        trajectory: (K, 3) the robot's poses, K >= 1.
        on_trajectory: whether the viewpoint is the trajectory pose nearest to the centre of gravity, or that
            centre itself.

    Returns:
        The viewpoint (3,) and the centre of gravity (2,) in the frame of the points. A map without points is
        seen from its first pose.
    """
    centre = points.mean(axis=0) if len(points) else trajectory[0, :2]
    nearest = trajectory[np.argmin(np.hypot(*(trajectory[:, :2] - centre).T))]
    place = nearest[:2] if on_trajectory else centre
    quarter = np.pi / 2
    direction = dominant_direction(points)
    direction += quarter * np.round((nearest[2] - direction) / quarter)
    return np.array([*place, wrap(direction)]), centre


def likely_directions(positions: Floats, most: int) -> list[float]:
    """Directions in [0, pi/2) along which a map's walls may be seen, the planned one (0) first.

    The others are the local minima of the entropy, the deepest first, at least SEPARATE away from each other.

    Args:
        positions: (N, 2) keypoints in cells, in the map's own frame.
        most: number of directions at most, the planned one included.
    """
    chosen = [0.0]
    if most > 1 and len(positions) > 1:
        angles = np.arange(DEGREES) * (np.pi / 2 / DEGREES)
        entropy = np.array([projection_entropy(positions * BIN, angle) for angle in angles])
        lows = np.flatnonzero((entropy <= np.roll(entropy, 1)) & (entropy <= np.roll(entropy, -1)))
        for k in lows[np.argsort(entropy[lows], kind="stable")]:
            away = [abs((angles[k] - other + np.pi / 4) % (np.pi / 2) - np.pi / 4) for other in chosen]
            if min(away) >= SEPARATE and entropy[k] - entropy.min() < DEPTH and len(chosen) < most:
                chosen.append(float(angles[k]))
    return chosen
