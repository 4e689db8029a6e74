"""The largest of many values."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from m2t_text.util.types import Floats

MANY = 1024  # times as many values as are looked for, from which on they are looked for block by block


def largest(values: NDArray[Any], count: int) -> NDArray[np.int64]:
    """The places of the ``count`` largest values, or of all if they are fewer, in any order."""
    if len(values) <= count:
        return np.arange(len(values))
    if len(values) < MANY * count:
        return np.argpartition(-values, count)[:count]
    # They lie in the blocks whose own largest values are the largest, or in the rest.
    block = len(values) // (count * int(MANY**0.5))
    end = len(values) // block * block
    blocks = largest(values[:end].reshape(-1, block).max(axis=1), count)
    places = np.append((blocks[:, None] * block + np.arange(block)).ravel(), np.arange(end, len(values)))
    return places[np.argpartition(-values[places], count)[:count]]


def smallest(values: NDArray[np.int32], count: int) -> NDArray[np.int64]:
    """The places, ascending, of the ``count`` smallest values, the first of equals; of all if they are fewer.
    The values are small, and 0 or more."""
    up_to = np.cumsum(np.bincount(values, minlength=1))
    last = int(np.searchsorted(up_to, count))
    chosen = np.flatnonzero(values <= last)
    equal = np.flatnonzero(values[chosen] == last)
    return np.delete(chosen, equal[len(equal) - max(len(chosen) - count, 0) :])


def reached(values: Floats, count: int) -> float:
    """What the ``count`` largest values reach, 0 if they are fewer."""
    behind = len(values) - count
    return float(np.partition(values, behind)[behind]) if behind >= 0 else 0.0


def descending(values: Floats) -> NDArray[np.int64]:
    """The order of values from the largest; 16 bits of each count, which are sorted in linear time."""
    most = float(values.max(initial=0.0))
    keys = np.floor(values * (65535 / most)) if most > 0 else values
    return np.argsort((65535 - keys).astype(np.uint16), kind="stable")
