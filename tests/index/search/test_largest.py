"""The largest of many values, against sorting all."""

import numpy as np
import pytest

from m2t_text.index.search.largest import descending, largest, reached, smallest


@pytest.mark.parametrize("size", [0, 1, 7, 40, 7 * 1024 - 1, 7 * 1024, 12_345])
@pytest.mark.parametrize("kinds", [3, 10**9])  # with ties, and without
def test_they_are_those_of_all_sorted(size, kinds):
    values = np.random.default_rng(size).integers(-kinds, kinds, size) / 8
    ordered = np.sort(values)[::-1]
    for count in (1, 7):
        places = largest(values, count)
        assert len(set(places.tolist())) == min(count, size)
        assert np.sort(values[places])[::-1].tolist() == ordered[:count].tolist()
        assert reached(values, count) == (ordered[count - 1] if size >= count else 0.0)


@pytest.mark.parametrize("size", [0, 1, 7, 1000])
def test_the_smallest_are_the_first_of_all_sorted(size):
    values = np.random.default_rng(size).integers(0, 30, size).astype(np.int32)
    for count in (1, 6, 7, 500, 1000):
        assert smallest(values, count).tolist() == sorted(np.argsort(values, kind="stable")[:count].tolist())


def test_the_order_is_descending_as_far_as_sixteen_bits_tell():
    values = np.random.default_rng(0).random(5000)
    ordered = values[descending(values)]
    assert sorted(ordered) == sorted(values) and (np.diff(ordered) <= 1 / 65535).all()
    assert descending(np.zeros(3)).tolist() == [0, 1, 2] and descending(np.zeros(0)).tolist() == []
