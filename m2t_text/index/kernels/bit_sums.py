"""Sums of many bits at once, compiled: masks are added in binary digits, one plane a digit.

A mask has 64 bits in each of its lanes. Eight masks are first added to each other by carry-save adders, which
keeps most of the work in registers.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from m2t_text.index.kernels.simd import at, bytes_at, every, gathered, put, rotated, some
from m2t_text.util.compiling import inlined, inner

U = np.uint64
INNER = 9  # digits that are held in registers while masks are added; sums have as many from the lowest one on


@inlined
def _add(a: Any, b: Any, c: Any) -> Any:
    """The sum of three bits, and what they carry."""
    either = a ^ b
    return either ^ c, a ^ (either & (a ^ c))


@inlined
def _add_four(p0: Any, p1: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """The lowest two digits of a sum with four masks added, and what they carry."""
    p0, two_a = _add(p0, a, b)
    p0, two_b = _add(p0, c, d)
    p1, four = _add(p1, two_a, two_b)
    return p0, p1, four


def mask_of(source: Any, places: Any, k: Any) -> Any:
    """The mask of a number, in compiled code alone; see `add_masks`."""
    raise NotImplementedError


@overload(mask_of, inline="always")
def _mask_of(source: Any, places: Any, k: Any) -> Callable[..., Any]:
    def of_rows(source: Any, places: Any, k: Any) -> Any:
        return bytes_at(source, U(places[k]))

    def of_lanes(source: Any, places: Any, k: Any) -> Any:
        return gathered(source[0], places, k, source[1])

    return of_lanes if isinstance(source, types.BaseTuple) else of_rows


@inner
def add_masks(source: Any, places: Any, begin: Any, end: Any, sums: Any, digit: Any) -> None:
    """Adds masks to ``sums``, each as often as the digit says.

    Args:
        source, places: the k-th mask is the rows of bytes in ``source`` (N, 4) from places[k] on, for all lanes
            together; see `by_lane`. Or the bytes in source[0] (N,) from those of places (K, 4) on, for each
            lane, moved by source[1] bytes.
        begin, end: numbers of the first mask and of the one behind the last, a multiple of eight apart.
        sums: (D, 4) uint64, the binary digits of the sums.
        digit: 0 to add each mask once, 1 twice, 2 four times, ...
    """
    d = U(digit)
    p0, p1, p2 = at(sums, d), at(sums, d + U(1)), at(sums, d + U(2))
    p3, p4, p5 = at(sums, d + U(3)), at(sums, d + U(4)), at(sums, d + U(5))
    p6, p7, p8 = at(sums, d + U(6)), at(sums, d + U(7)), at(sums, d + U(8))
    k, behind = U(begin), U(end)
    while k < behind:
        m0, m1 = mask_of(source, places, k), mask_of(source, places, k + U(1))
        m2, m3 = mask_of(source, places, k + U(2)), mask_of(source, places, k + U(3))
        p0, p1, four_a = _add_four(p0, p1, m0, m1, m2, m3)
        m4, m5 = mask_of(source, places, k + U(4)), mask_of(source, places, k + U(5))
        m6, m7 = mask_of(source, places, k + U(6)), mask_of(source, places, k + U(7))
        p0, p1, four_b = _add_four(p0, p1, m4, m5, m6, m7)
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
        k += U(8)
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
    for digit in range(len(sums)):
        put(sums, U(digit), every(U(0)))


@inner
def add_sums(sums: Any, others: Any, result: Any) -> None:
    """Writes the sums of two (D, 4) uint64 sums to a third."""
    carried = every(U(0))
    for digit in range(U(len(sums))):
        a, b = at(sums, digit), at(others, digit)
        put(result, digit, a ^ b ^ carried)
        carried = (a & b) | (carried & (a ^ b))


@inner
def fold(sums: Any, others: Any, lane: Any, number: Any, result: Any) -> Any:
    """Writes the sums of all four lanes, and those in one lane of others, to each lane of a third.

    Returns a mask of those that reach a number; see `at_least`.
    """
    carried, carried_too, reached = every(U(0)), every(U(0)), every(~U(0))
    for digit in range(U(len(sums))):
        a = at(sums, digit)
        b = rotated(rotated(a))
        plane, carried = _add(a, b, carried)
        put(result, digit, plane)
    carried = every(U(0))
    for digit in range(U(len(sums))):
        a = at(result, digit)
        b = rotated(a)
        plane, carried = _add(a, b, carried)
        other = every(others[digit, lane])
        plane, carried_too = _add(plane, other, carried_too)
        put(result, digit, plane)
        spared = every((U(number) >> digit & U(1)) - U(1))  # where the number has no bit
        reached = plane & (reached | spared) | reached & spared
    return reached


@inner
def largest(sums: Any, among: Any) -> Any:
    """The largest of the sums whose bits ``among`` has in any lane."""
    left, value = every(U(among)), 0
    for digit in range(len(sums) - 1, -1, -1):
        higher = left & at(sums, U(digit))
        if some(higher):
            left = higher
            value += 1 << digit
    return value


@inlined
def at_least(sums: Any, number: Any) -> Any:
    """A mask of the sums that reach a number, which is not negative and has no more digits than they have."""
    greater, equal = every(U(0)), every(~U(0))
    for digit in range(len(sums) - 1, -1, -1):
        plane = at(sums, U(digit))
        wanted = every(U(0) - (U(number) >> U(digit) & U(1)))  # not a branch, which might be guessed wrong
        greater = greater | equal & plane & ~wanted
        equal = equal & ~(plane ^ wanted)
    return greater | equal
