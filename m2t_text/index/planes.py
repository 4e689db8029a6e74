"""Sixty-four sums at once, compiled: bit masks are added in binary digits, one 64 bit word a digit.

Eight masks are first added to each other by carry-save adders, which keeps most of the work in registers.
"""

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

U = np.uint64
DIGITS = 24  # of a sum
INNER = 9  # of them are held in registers while masks are added


@intrinsic
def eight_bytes(typing: Any, array: Any, place: Any) -> Any:
    """Eight bytes of a uint8 array from any place on, the first one lowest."""

    def load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        pointer = builder.bitcast(builder.gep(data, [arguments[1]]), ir.IntType(64).as_pointer())
        return builder.load(pointer, align=1)

    return types.uint64(array, types.int64), load


@numba.njit(inline="always")
def _add(a: Any, b: Any, c: Any) -> Any:
    """The sum of three bits, and what they carry."""
    either = a ^ b
    return either ^ c, (a & b) | (either & c)


@numba.njit(cache=True, nogil=True)
def add_masks(masks: Any, count: Any, planes: Any, digit: Any) -> None:
    """Adds the first ``count`` masks, a multiple of eight, to ``planes``, each as often as the digit says.

    Args:
        masks: (>= count,) uint64.
        planes: (DIGITS,) uint64, the binary digits of the sums.
        digit: 0 to add each mask once, 1 twice, 2 four times, ...
    """
    at = U(digit)
    p0, p1, p2, p3, p4 = planes[at], planes[at + U(1)], planes[at + U(2)], planes[at + U(3)], planes[at + U(4)]
    p5, p6, p7, p8 = planes[at + U(5)], planes[at + U(6)], planes[at + U(7)], planes[at + U(8)]
    for block in range(U(count // 8)):
        k = block * U(8)
        p0, two_a = _add(p0, masks[k], masks[k + U(1)])
        p0, two_b = _add(p0, masks[k + U(2)], masks[k + U(3)])
        p1, four_a = _add(p1, two_a, two_b)
        p0, two_a = _add(p0, masks[k + U(4)], masks[k + U(5)])
        p0, two_b = _add(p0, masks[k + U(6)], masks[k + U(7)])
        p1, four_b = _add(p1, two_a, two_b)
        p2, carried = _add(p2, four_a, four_b)
        p3, carried = p3 ^ carried, p3 & carried
        p4, carried = p4 ^ carried, p4 & carried
        p5, carried = p5 ^ carried, p5 & carried
        p6, carried = p6 ^ carried, p6 & carried
        p7, carried = p7 ^ carried, p7 & carried
        p8, carried = p8 ^ carried, p8 & carried
        place = at + U(INNER)
        while carried:  # only sums of 512 and more come here
            planes[place], carried = planes[place] ^ carried, planes[place] & carried
            place += U(1)
    planes[at], planes[at + U(1)], planes[at + U(2)], planes[at + U(3)], planes[at + U(4)] = p0, p1, p2, p3, p4
    planes[at + U(5)], planes[at + U(6)], planes[at + U(7)], planes[at + U(8)] = p5, p6, p7, p8


@numba.njit(cache=True, nogil=True)
def largest(planes: Any, among: Any) -> Any:
    """The largest of the sums whose bits ``among`` has."""
    left, value = among, 0
    for digit in range(DIGITS - 1, -1, -1):
        higher = left & planes[digit]
        if higher:
            left = higher
            value += 1 << digit
    return value


@numba.njit(cache=True, nogil=True)
def at_least(planes: Any, number: Any) -> Any:
    """A mask of the sums that reach a number; it is not negative."""
    greater, equal = U(0), ~U(0)
    for digit in range(DIGITS - 1, -1, -1):
        if (number >> digit) & 1:
            equal &= planes[digit]
        else:
            greater |= equal & planes[digit]
            equal &= ~planes[digit]
    return greater | equal
