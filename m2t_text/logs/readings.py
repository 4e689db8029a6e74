"""Readings of a laser as its driver sends them: which are returns, and the decimal numbers behind 32 bits."""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m2t_text.util.types import Floats

MAX_READING = 1e6  # m; beyond it a number is damage
DECIMALS = 4  # of readings in metres and of angles in degrees; lasers tell no more


def returned(ranges: ArrayLike, least: float = 0.0, most: float = 0.0) -> Floats:
    """Readings (B,) in metres, ``inf`` where there was no return.

    No return is what is not finite, not above 0, below the ``least`` that the laser measures, or not below the
    ``most``: Stage, Gazebo and older drivers report their maximum so. A ``most`` of 0 is none.
    """
    readings = np.asarray(ranges)
    finite = np.nan_to_num(readings, nan=0.0, posinf=0.0, neginf=0.0)
    limit = most if 0 < most < MAX_READING else MAX_READING
    hit = (finite > 0) & ~(finite < least) & (finite < limit)
    kept = np.where(hit, finite, finite.dtype.type(np.inf) if finite.dtype.kind == "f" else np.inf)
    return exact(kept) if kept.dtype == np.float32 else kept.astype(np.float64)


def exact(ranges: NDArray[np.float32]) -> Floats:
    """The decimal numbers that were rounded to 32 bits; where there are none, the numbers themselves."""
    wide = ranges.astype(np.float64)
    short = np.round(wide, DECIMALS)
    return np.where(short.astype(np.float32) == ranges, short, wide)


@lru_cache(maxsize=8)
def bearings(start: float, step: float, count: int) -> Floats:
    """(count,) radians of the beams of a scan; shared by the scans, which are many."""
    return exact_angle(start) + exact_angle(step) * np.arange(count, dtype=np.float64)


def exact_angle(angle: float) -> float:
    """The decimal number of degrees that was rounded to 32 bits, if there is one; else the angle itself."""
    short = math.radians(round(math.degrees(angle), DECIMALS))
    return short if np.float32(short) == np.float32(angle) else angle
