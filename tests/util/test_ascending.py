"""Looking up whole numbers in ascending ones, against sets."""

import numpy as np
import pytest

from m2t_text.util.ascending import absent, distinct, places_of


@pytest.mark.parametrize("seed", range(20))
def test_they_tell_what_sets_tell(seed):
    rng = np.random.default_rng(seed)
    numbers, others = (rng.integers(-5, 30, rng.integers(0, 40)) for _ in range(2))
    ascending = distinct(numbers)
    assert ascending.tolist() == sorted(set(numbers.tolist()))
    there = [ascending.tolist().index(other) for other in others.tolist() if other in set(numbers.tolist())]
    assert places_of(others, ascending).tolist() == there
    assert absent(ascending, others).tolist() == [number not in set(others.tolist()) for number in ascending]
