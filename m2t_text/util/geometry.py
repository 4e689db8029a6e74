"""Rigid motions of the plane. A pose is ``[x, y, theta]`` in metres and radians; arrays hold one a row."""

import math

import numpy as np
from numpy.typing import ArrayLike

from m2t_text.util.types import Floats


def wrap(angle: ArrayLike) -> Floats:
    """Angles brought into [-pi, pi)."""
    return (np.asarray(angle, dtype=float) + np.pi) % (2 * np.pi) - np.pi


def compose(a: ArrayLike, b: ArrayLike) -> Floats:
    """The pose ``b``, given in the frame of ``a``, in the frame in which ``a`` is given. Shapes (..., 3)."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    if a.ndim == b.ndim == 1:  # numbers take a tenth of the time of arrays with one
        x, y, theta = a.tolist()
        bx, by, turn = b.tolist()
        c, s = _direction(theta)
        return np.array([x + c * bx - s * by, y + s * bx + c * by, _wrapped(theta + turn)])
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    result = np.empty(np.broadcast_shapes(a.shape, b.shape))
    result[..., 0] = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    result[..., 1] = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    result[..., 2] = wrap(a[..., 2] + b[..., 2])
    return result


def inverse(pose: ArrayLike) -> Floats:
    """The pose of the frame's origin as seen from ``pose``. Shape (..., 3)."""
    pose = np.asarray(pose, dtype=float)
    if pose.ndim == 1:
        x, y, theta = pose.tolist()
        cos, sin = _direction(theta)
        return np.array([-cos * x - sin * y, sin * x - cos * y, _wrapped(-theta)])
    c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    result = np.empty(pose.shape)
    result[..., 0] = -c * pose[..., 0] - s * pose[..., 1]
    result[..., 1] = s * pose[..., 0] - c * pose[..., 1]
    result[..., 2] = wrap(-pose[..., 2])
    return result


def _direction(angle: float) -> tuple[float, float]:
    """Cosine and sine, as NumPy has them: of what is not finite NaN, where `math` raises."""
    return (math.cos(angle), math.sin(angle)) if math.isfinite(angle) else (math.nan, math.nan)


def _wrapped(angle: float) -> float:
    """`wrap` of one number."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


def between(a: ArrayLike, b: ArrayLike) -> Floats:
    """The pose ``b`` as seen from ``a``: ``compose(a, between(a, b)) == b``. Shape (..., 3)."""
    return compose(inverse(a), b)


def transform(pose: ArrayLike, points: ArrayLike) -> Floats:
    """Points (N, 2) given in the frame of ``pose`` (3,), in the frame in which ``pose`` is given."""
    x, y, theta = np.asarray(pose, dtype=float)
    c, s = np.cos(theta), np.sin(theta)
    return np.asarray(points, dtype=float) @ np.array([[c, s], [-s, c]]) + [x, y]


def travel(poses: Floats) -> Floats:
    """Metres travelled up to each pose: (S, 3) -> (S,), beginning with 0."""
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    return np.concatenate([[0.0], np.cumsum(steps)])
