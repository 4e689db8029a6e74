"""Viewpoint planning: a pose from which similar maps are seen alike (paper, IV-B)."""

import numpy as np

from m2t_text.util.compiling import kernel
from m2t_text.util.geometry import wrap
from m2t_text.util.types import Floats

BIN = 0.1  # m; width of a bin of the projections
COARSE, FINE = 45, 16  # directions tried over a quarter turn, then between the neighbours of the best
DEGREES = 90  # directions over a quarter turn at which other likely ones are looked for
SEPARATE = np.radians(10.0)  # between two likely directions
DEPTH = 0.5  # nats by which a likely direction's entropy may exceed the least


def projection_entropies(points: Floats, angles: Floats) -> Floats:
    """Entropy (A,), in nats, of the points' projections (N, 2) onto the axes turned by each of the ``angles``.

    Each point is shared between the two nearest bins, so that the entropy changes smoothly with the angle.
    """
    widest = float(np.hypot(np.ptp(points[:, 0]), np.ptp(points[:, 1]))) if len(points) else 0.0
    room = np.empty(int(widest / BIN) + 3)  # for all bins, whatever the angle
    entropies = np.zeros(len(angles))
    _entropies(np.ascontiguousarray(points), angles, np.empty(len(points)), room, entropies)
    return entropies


@kernel
def _entropies(points: Floats, angles: Floats, along: Floats, histogram: Floats, entropies: Floats) -> None:
    n = len(points)
    for a in range(len(angles)):
        c, s = np.cos(angles[a]), np.sin(angles[a])
        entropy = 0.0
        for axis in range(2):
            low, high = np.inf, -np.inf
            for i in range(n):
                if axis == 0:
                    place = c * points[i, 0] + s * points[i, 1]
                else:
                    place = c * points[i, 1] - s * points[i, 0]
                along[i] = place
                low, high = min(low, place), max(high, place)
            bins = int((high - low) / BIN) + 2 if n else 0
            for k in range(bins):
                histogram[k] = 0.0
            for i in range(n):
                place = (along[i] - low) / BIN
                k = int(place)
                histogram[k] += 1 - (place - k)
                histogram[k + 1] += place - k
            for k in range(bins):
                count = histogram[k]
                if count > 0:
                    entropy -= count / n * np.log(count / n)
        entropies[a] = entropy


def dominant_direction(points: Floats) -> float:
    """The direction in [0, pi/2) along which walls lie: where the entropy of the projections is least.

    Ties go to the smaller angle. Fewer than two points have the direction 0.
    """
    if len(points) < 2:
        return 0.0
    step: float = np.pi / 2 / COARSE
    angles = np.linspace(0.0, np.pi / 2, COARSE, endpoint=False)
    best, least = _least(points, angles, 0.0, np.inf)
    angles = np.asarray(best + np.arange(-FINE + 1, FINE) * step / FINE)
    best, least = _least(points, angles, best, least)
    return best % (np.pi / 2)


def _least(points: Floats, angles: Floats, best: float, least: float) -> tuple[float, float]:
    """The angle of the least entropy, and that, if it is clearly less than the least so far."""
    for angle, entropy in zip(angles.tolist(), projection_entropies(points, angles).tolist(), strict=True):
        if entropy < least - 1e-12:
            best, least = angle, entropy
    return best, least


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
        entropy = projection_entropies(positions * BIN, angles.astype(float))
        lows = np.flatnonzero((entropy <= np.roll(entropy, 1)) & (entropy <= np.roll(entropy, -1)))
        for k in lows[np.argsort(entropy[lows], kind="stable")]:
            away = [abs((angles[k] - other + np.pi / 4) % (np.pi / 2) - np.pi / 4) for other in chosen]
            if min(away) >= SEPARATE and entropy[k] - entropy.min() < DEPTH and len(chosen) < most:
                chosen.append(float(angles[k]))
    return chosen
