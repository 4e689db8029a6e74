"""The beams of one sweep: at most one turn of them, counter-clockwise."""

import math
from functools import lru_cache

import numpy as np

from m2t_text.errors import PartError
from m2t_text.util.types import Floats

FULL_TURN = 2.01 * math.pi  # rad; a laser that looks all around may send its first direction again
WIDEST = 4.1 * math.pi  # rad; beyond it the numbers are no angles in radians


def beams_in_a_turn(start: float, step: float, count: int) -> int:
    """How many of ``count`` beams make one turn: some spinning lasers send a few more.

    Raises PartError if they are no field of view.
    """
    field = abs(step) * (count - 1)
    if not (count >= 2 and abs(start) <= WIDEST and field > 0):  # false for NaN, too
        raise PartError("with an impossible field of view")
    if field > WIDEST:
        degrees = ", as of angles in degrees where radians should be" if field <= 361 else ""
        raise PartError(f"with an impossible field of view of {field:.4g} rad{degrees}")
    return count if field <= FULL_TURN else int(2 * math.pi / abs(step) * (1 + 1e-6))


def upside_down(ranges: Floats, angles: Floats) -> tuple[Floats, Floats]:
    """The readings and angles (B,) of a laser that hangs upside down, as those of one that does not."""
    return ranges[::-1], -angles[::-1]


@lru_cache(maxsize=8)  # a log has one laser or two
def half_circle(count: int) -> Floats:
    """Angles of a scan over 180 degrees; an odd count includes both ends, an even one has as many steps."""
    return -np.pi / 2 + np.arange(count, dtype=np.float64) * (np.pi / (count - count % 2))
