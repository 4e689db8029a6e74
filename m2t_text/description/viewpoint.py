"""Viewpoint planning: a pose from which similar maps are seen alike (paper, IV-B)."""

import math

import numpy as np

from m2t_text.util.compiling import kernel
from m2t_text.util.geometry import wrap
from m2t_text.util.types import Floats, Ints

BIN = 0.1  # m; width of a bin of the projections
COARSE, FINE = 45, 16  # directions tried over a quarter turn, then between the neighbours of the best
DEGREES = 90  # directions over a quarter turn at which other likely ones are looked for
SEPARATE = np.radians(10.0)  # between two likely directions
DEPTH = 0.5  # nats by which a likely direction's entropy may exceed the least


def projection_entropies(points: Floats, angles: Floats) -> Floats:
    """Entropy (A,), in nats, of the points' projections (N, 2) onto the axes turned by each of the ``angles``.

    Each point is shared between the two nearest bins, so that the entropy changes smoothly with the angle.
    """
    entropies, count = np.zeros(len(angles)), len(points)
    if count:
        axes = np.ascontiguousarray(points.T)
        widest = float(np.hypot(np.ptp(axes[0]), np.ptp(axes[1])))
        room = np.empty((2, int(widest / BIN) + 3))  # for all bins, whatever the angle
        _entropies(axes, angles, np.empty((2, count)), np.empty((2, count), dtype=np.int64), room, entropies)
    return entropies


@kernel
def _entropies(
    axes: Floats, angles: Floats, along: Floats, bins: Ints, room: Floats, entropies: Floats
) -> None:
    """Writes the entropies (A,) of points (2, N), N >= 1.

    Short loops, so that the processor takes several points at once, and both axes in one where each point has
    to wait for the last.

    Args:
        along, bins: (2, N) room for the projections and their bins.
        room: (2, B) for the histograms.
    """
    n = axes.shape[1]
    u, v, bins_u, bins_v, histogram_u, histogram_v = along[0], along[1], bins[0], bins[1], room[0], room[1]
    for a in range(len(angles)):
        c, s = math.cos(angles[a]), math.sin(angles[a])
        for axis in range(2):
            ahead, beside, projected = axes[axis], axes[1 - axis], along[axis]
            for i in range(n):
                projected[i] = c * ahead[i] + s * beside[i]
            s = -s
        low_u, high_u, low_v, high_v = u[0], u[0], v[0], v[0]
        for i in range(n):
            low_u, high_u = min(low_u, u[i]), max(high_u, u[i])
            low_v, high_v = min(low_v, v[i]), max(high_v, v[i])
        for axis in range(2):
            projected, own, low = along[axis], bins[axis], low_u if axis == 0 else low_v
            for i in range(n):
                place = (projected[i] - low) / BIN
                own[i] = place  # cut off
                projected[i] = place - own[i]
            for k in range(room.shape[1]):
                room[axis, k] = 0.0
        for i in range(n):
            histogram_u[bins_u[i]] += 1 - u[i]
            histogram_u[bins_u[i] + 1] += u[i]
            histogram_v[bins_v[i]] += 1 - v[i]
            histogram_v[bins_v[i] + 1] += v[i]
        entropy = 0.0
        for axis in range(2):
            count = math.floor((high_u - low_u if axis == 0 else high_v - low_v) / BIN) + 2
            for k in range(count):
                if room[axis, k] > 0:
                    share = room[axis, k] / n
                    entropy -= share * math.log(share)
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
