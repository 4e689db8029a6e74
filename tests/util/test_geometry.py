"""Rigid motions: one by hand, the rest by their laws."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from m2t_text.util.geometry import between, compose, inverse, transform, travel, wrap

POSE = st.tuples(*[st.floats(-50, 50)] * 3).map(np.array)


def same(a, b) -> bool:
    difference = np.asarray(a) - np.asarray(b)
    difference[..., 2] = wrap(difference[..., 2])
    return bool(np.abs(difference).max() < 1e-6)


def test_by_hand():
    assert same(compose([1.0, 2.0, np.pi / 2], [1.0, 0.0, 0.1]), [1.0, 3.0, np.pi / 2 + 0.1])
    assert transform([1.0, 2.0, np.pi / 2], [[1.0, 0.0]]) == pytest.approx(np.array([[1.0, 3.0]]))
    assert travel(np.array([[0.0, 0, 0], [3, 4, 1], [3, 4, 2]])).tolist() == [0.0, 5.0, 5.0]


@given(POSE, POSE, POSE)
def test_the_laws_of_motions(a, b, c):
    assert same(compose(a, inverse(a)), np.zeros(3))
    assert same(compose(a, between(a, b)), compose(b, np.zeros(3)))
    assert same(compose(compose(a, b), c), compose(a, compose(b, c)))
