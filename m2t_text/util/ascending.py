"""Whole numbers in ascending order, looked up; `numpy.unique` and its like would hash or copy all of them."""

import numpy as np
from numpy.typing import NDArray

from m2t_text.util.types import Ints


def distinct(numbers: Ints) -> Ints:
    """The numbers of an array, ascending and each once."""
    ordered = np.sort(numbers, axis=None)
    return ordered[np.diff(ordered, prepend=ordered[:1] - 1) != 0]


def places_of(numbers: Ints, ascending: Ints) -> Ints:
    """(K,) where those of the numbers stand that are among ascending ones, each of which stands there once."""
    places = np.searchsorted(ascending, numbers)
    inside = places < len(ascending)
    places, numbers = places[inside], numbers[inside]
    return places[ascending[places] == numbers]


def absent(ascending: Ints, numbers: Ints) -> NDArray[np.bool_]:
    """Which of ascending numbers (K,) are none of others, in any order."""
    missing = np.ones(len(ascending), dtype=np.bool_)
    missing[places_of(numbers, ascending)] = False
    return missing
