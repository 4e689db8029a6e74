"""Appearance words by hand, against a slow definition, and under turns."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from m2t_text.description.polestar import polestar_words

RADII = np.array([1.0, 2.0, 3.0])


def slow_word(points: np.ndarray, k: int, radii: np.ndarray) -> int:
    """The definition (paper, III-A, III-B), step by step."""
    distance = np.hypot(*(np.delete(points, k, axis=0) - points[k]).T)
    inner = np.concatenate([[0.0], radii[:-1]])
    counts = np.array(
        [
            np.sum((distance <= high) & ((distance > low) | (low == 0)))
            for low, high in zip(inner, radii, strict=True)
        ]
    )
    if not counts.sum():
        return 0
    shares = counts / counts.sum()
    return int(sum(2**i for i, share in enumerate(shares) if share > shares.mean() + 1e-12))


def test_a_word_by_hand():
    # About the origin: one point in the first ring, none in the second, three in the third. The shares are
    # 1/4, 0, 3/4 and their mean is 1/3: only the third bit is set.
    points = np.array([[0.0, 0.0], [0.5, 0.0], [2.5, 0.0], [0.0, 2.5], [-2.5, 0.0], [9.0, 9.0]])
    words = polestar_words(points, RADII)
    assert words[0] == 0b100
    assert words[5] == 0  # nothing is near


def test_a_share_equal_to_the_mean_sets_no_bit():
    points = np.array([[0.0, 0.0], [0.5, 0.0], [1.5, 0.0], [2.5, 0.0]])
    assert polestar_words(points, RADII)[0] == 0


def test_a_point_on_a_circle_belongs_to_the_inner_ring():
    assert polestar_words(np.array([[0.0, 0.0], [1.0, 0.0]]), RADII).tolist() == [1, 1]


def test_points_in_one_place_see_each_other():
    assert polestar_words(np.zeros((3, 2)), RADII).tolist() == [1, 1, 1]


def test_no_points_no_words():
    assert polestar_words(np.empty((0, 2)), RADII).tolist() == []


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60))
def test_words_are_those_of_the_definition(seed, count):
    points = np.random.default_rng(seed).normal(0, 1.5, (count, 2))
    radii = np.array([0.25, 0.5, 0.75, 1.0, 1.5, 2.0])
    assert polestar_words(points, radii).tolist() == [slow_word(points, k, radii) for k in range(count)]


@given(st.integers(0, 2**32 - 1), st.floats(-3.0, 3.0))
def test_turning_and_shifting_change_no_word(seed, angle):
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 1.5, (40, 2))
    c, s = np.cos(angle), np.sin(angle)
    moved = points @ np.array([[c, s], [-s, c]]) + rng.normal(0, 5, 2)
    assert polestar_words(moved, RADII).tolist() == polestar_words(points, RADII).tolist()
