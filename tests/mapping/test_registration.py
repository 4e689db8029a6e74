"""Scan matching finds known motions, and holds still where nothing tells."""

from itertools import pairwise

import numpy as np
import pytest

from m2t_text.mapping.normals import cloud_normals, normals
from m2t_text.mapping.registration import register
from m2t_text.util.geometry import inverse, transform


def room(step: float = 0.05) -> np.ndarray:
    """The walls of an L-shaped room, in order, as a laser sees them."""
    corners = np.array([[-2, -3], [4, -3], [4, 1], [1, 1], [1, 3], [-2, 3], [-2, -3]], dtype=float)
    sides = []
    for a, b in pairwise(corners):
        count = int(np.hypot(*(b - a)) / step)
        sides.append(a + np.linspace(0, 1, count, endpoint=False)[:, None] * (b - a))
    return np.concatenate(sides)


@pytest.mark.parametrize("motion", [(0.0, 0.0, 0.0), (0.1, -0.05, 0.02), (0.6, 0.4, 0.4), (-0.5, 0.7, -0.5)])
def test_a_known_motion_is_found(motion):
    reference = room()
    rng = np.random.default_rng(0)
    scan = transform(inverse(motion), room(0.07)) + rng.normal(0, 0.01, (len(room(0.07)), 2))
    found, inliers = register(reference, normals(reference, 0.3), scan, 1.0, 0.7, np.array([0.5, 0.3]))
    assert np.abs(found - motion).max() < 0.01
    assert inliers > 0.95


def test_a_featureless_corridor_does_not_slide():
    x = np.arange(-8, 8, 0.05)
    walls = np.concatenate([np.stack([x, np.ones_like(x)], 1), np.stack([x, -np.ones_like(x)], 1)])
    moved = walls + np.array([0.0, 0.1])
    found, _ = register(walls, normals(walls, 0.3), moved, 0.5, 0.2, np.array([0.2, 0.1]))
    assert abs(found[0]) < 0.02 and found[1] == pytest.approx(-0.1, abs=0.01)


def test_nothing_to_match_leaves_the_prediction():
    found, inliers = register(np.empty((0, 2)), np.empty((0, 2)), room(), 0.5, 0.2, np.array([0.2, 0.1]))
    assert np.abs(found).max() < 1e-6 and inliers == 0


def test_normals_are_across_walls_and_missing_where_there_is_none():
    wall = np.stack([np.arange(0, 2, 0.1), np.zeros(20)], 1)
    lonely = np.array([[5.0, 5.0]])
    for found in (
        normals(np.concatenate([wall, lonely]), 0.3),
        cloud_normals(np.concatenate([wall, lonely]), 0.3),
    ):
        assert np.allclose(np.abs(found[2:18]), [0.0, 1.0])
        assert not found[-1].any()
