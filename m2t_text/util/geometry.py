"""Rigid motions of the plane. A pose is ``[x, y, theta]`` in metres and radians; arrays hold one a row."""

import numpy as np
from numpy.typing import ArrayLike

from m2t_text.util.types import Floats


def wrap(angle: ArrayLike) -> Floats:
    """Angles brought into [-pi, pi)."""
    return (np.asarray(angle, dtype=float) + np.pi) % (2 * np.pi) - np.pi


def compose(a: ArrayLike, b: ArrayLike) -> Floats:
    """The pose ``b``, given in the frame of ``a``, in the frame in which ``a`` is given. Shapes (..., 3)."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    y = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    return np.stack([x, y, wrap(a[..., 2] + b[..., 2])], axis=-1)


def inverse(pose: ArrayLike) -> Floats:
    """The pose of the frame's origin as seen from ``pose``. Shape (..., 3)."""
    pose = np.asarray(pose, dtype=float)
    c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x = -c * pose[..., 0] - s * pose[..., 1]
    y = s * pose[..., 0] - c * pose[..., 1]
    return np.stack([x, y, wrap(-pose[..., 2])], axis=-1)


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
