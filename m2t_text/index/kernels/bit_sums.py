"""Sums of many bits at once, compiled: masks are added in binary digits, one plane a digit.

A mask has 64 bits in each of its lanes. Eight masks are first added to each other by carry-save adders, which
keeps most of the work in registers.
"""

from typing import Any

import numpy as np

from m2t_text.index.kernels.simd import at, every, put, some
from m2t_text.util.compiling import inlined, inner

U = np.uint64
DIGITS = 24  # of a sum
INNER = 9  # of them are held in registers while masks are added


@inlined
def _add(a: Any, b: Any, c: Any) -> Any:
    """The sum of three bits, and what they carry."""
    either = a ^ b
    return either ^ c, (a & b) | (either & c)


@inner
def add_masks(masks: Any, count: Any, sums: Any, digit: Any) -> None:
    """Adds the first ``count`` masks, a multiple of eight, to ``sums``, each as often as the digit says.

    Args:
        masks: (>= count, 4) uint64.
        sums: (DIGITS, 4) uint64, the binary digits of the sums.
        digit: 0 to add each mask once, 1 twice, 2 four times, ...
    """
    d = U(digit)
    p0, p1, p2 = at(sums, d), at(sums, d + U(1)), at(sums, d + U(2))
    p3, p4, p5 = at(sums, d + U(3)), at(sums, d + U(4)), at(sums, d + U(5))
    p6, p7, p8 = at(sums, d + U(6)), at(sums, d + U(7)), at(sums, d + U(8))
    for block in range(U(count // 8)):
        k = block * U(8)
        p0, two_a = _add(p0, at(masks, k), at(masks, k + U(1)))
        p0, two_b = _add(p0, at(masks, k + U(2)), at(masks, k + U(3)))
        p1, four_a = _add(p1, two_a, two_b)
        p0, two_a = _add(p0, at(masks, k + U(4)), at(masks, k + U(5)))
        p0, two_b = _add(p0, at(masks, k + U(6)), at(masks, k + U(7)))
        p1, four_b = _add(p1, two_a, two_b)
        p2, carried = _add(p2, four_a, four_b)
        p3, carried = p3 ^ carried, p3 & carried
        p4, carried = p4 ^ carried, p4 & carried
        p5, carried = p5 ^ carried, p5 & carried
        p6, carried = p6 ^ carried, p6 & carried
        p7, carried = p7 ^ carried, p7 & carried
        p8, carried = p8 ^ carried, p8 & carried
        place = d + U(INNER)
        while some(carried):  # only sums of 512 and more come here
            plane = at(sums, place)
            put(sums, place, plane ^ carried)
            carried = plane & carried
            place += U(1)
    put(sums, d, p0)
    put(sums, d + U(1), p1)
    put(sums, d + U(2), p2)
    put(sums, d + U(3), p3)
    put(sums, d + U(4), p4)
    put(sums, d + U(5), p5)
    put(sums, d + U(6), p6)
    put(sums, d + U(7), p7)
    put(sums, d + U(8), p8)


@inner
def clear(sums: Any) -> None:
    """Makes all sums zero."""
    for digit in range(DIGITS):
        put(sums, U(digit), every(U(0)))


@inner
def add_sums(sums: Any, others: Any, result: Any) -> None:
    """Writes the sums of two (DIGITS, 4) uint64 sums to a third."""
    carried = every(U(0))
    for digit in range(U(DIGITS)):
        a, b = at(sums, digit), at(others, digit)
        put(result, digit, a ^ b ^ carried)
        carried = (a & b) | (carried & (a ^ b))


@inner
def largest(sums: Any, among: Any) -> Any:
    """The largest of the sums whose bits ``among`` has in any lane."""
    left, value = every(U(among)), 0
    for digit in range(DIGITS - 1, -1, -1):
        higher = left & at(sums, U(digit))
        if some(higher):
            left = higher
            value += 1 << digit
    return value


@inlined
def at_least(sums: Any, number: Any) -> Any:
    """A mask of the sums that reach a number; it is not negative."""
    greater, equal = every(U(0)), every(~U(0))
    for digit in range(DIGITS - 1, -1, -1):
        plane = at(sums, U(digit))
        if (number >> digit) & 1:
            equal = equal & plane
        else:
            greater = greater | equal & plane
            equal = equal & ~plane
    return greater | equal
