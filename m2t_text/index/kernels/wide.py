"""Sixty-four bytes, or numbers of 16 bits, that are worked on at once, compiled; see `simd` for four words.

Each is for one way to lay a query on a map: LANES of them are tried together.
"""

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

LANES = 64
BYTE, NUMBER, WORD = ir.IntType(8), ir.IntType(16), ir.IntType(64)
BYTES, NUMBERS = ir.VectorType(BYTE, LANES), ir.VectorType(NUMBER, LANES)


class Wide(types.Type):
    """The type of such bytes or numbers in compiled code; Python never sees one."""

    def __init__(self, name: str) -> None:
        super().__init__(name=name)


class WideBytes(Wide):
    """Of bytes."""


class WideNumbers(Wide):
    """Of numbers of 16 bits."""


wide_bytes, wide_numbers = WideBytes("WideBytes"), WideNumbers("WideNumbers")


@register_model(WideBytes)
class _Bytes(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, BYTES)


@register_model(WideNumbers)
class _Numbers(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, NUMBERS)


@type_callable(operator.and_)
def _and_typed(context: Any) -> Any:
    return lambda a, b: wide_bytes if a is wide_bytes and b is wide_bytes else None


@lower_builtin(operator.and_, WideBytes, WideBytes)
def _and(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.and_(*arguments)


@type_callable(operator.add)
def _add_typed(context: Any) -> Any:
    return lambda a, b: wide_numbers if a is wide_numbers and b is wide_numbers else None


@lower_builtin(operator.add, WideNumbers, WideNumbers)
def _add(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.add(*arguments)


def _row(context: Any, builder: Any, signature: Any, arguments: Any, vector: Any) -> Any:
    """A row of an array's memory as a vector."""
    data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
    pointer = builder.gep(data, [builder.mul(arguments[1], WORD(LANES))])
    return builder.load(builder.bitcast(pointer, vector.as_pointer()), align=1)


@intrinsic
def bytes_at(typing: Any, array: Any, row: Any) -> Any:
    """A row of a C-contiguous (N, LANES) uint8 array."""

    def load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _row(context, builder, signature, arguments, BYTES)

    return wide_bytes(array, types.uint64), load


@intrinsic
def numbers_at(typing: Any, array: Any, row: Any) -> Any:
    """A row of a C-contiguous (N, LANES) uint16 array."""

    def load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _row(context, builder, signature, arguments, NUMBERS)

    return wide_numbers(array, types.uint64), load


def _spread(builder: Any, value: Any, scalar: Any, vector: Any) -> Any:
    one = builder.insert_element(
        ir.Constant(vector, ir.Undefined), builder.trunc(value, scalar), ir.IntType(32)(0)
    )
    places = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(one, one, places)


@intrinsic
def every_byte(typing: Any, value: Any) -> Any:
    """The same byte in all lanes."""

    def spread(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _spread(builder, arguments[0], BYTE, BYTES)

    return wide_bytes(types.uint64), spread


@intrinsic
def added(typing: Any, a: Any, b: Any) -> Any:
    """The sum of two bytes in each lane, 255 if it is more."""

    def add(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        total = builder.add(*arguments)
        over = builder.icmp_unsigned("<", total, arguments[0])
        return builder.select(over, ir.Constant(BYTES, [255] * LANES), total)

    return wide_bytes(wide_bytes, wide_bytes), add


@intrinsic
def any_up_to(typing: Any, value: Any, most: Any) -> Any:
    """Whether a byte is not more than this in any lane."""

    def compare(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        found = builder.icmp_unsigned("<=", arguments[0], _spread(builder, arguments[1], BYTE, BYTES))
        whole = ir.IntType(LANES)
        return builder.icmp_unsigned("!=", builder.bitcast(found, whole), whole(0))

    return types.boolean(wide_bytes, types.uint64), compare


@intrinsic
def any_reaches(typing: Any, covered: Any, missed: Any, shift: Any, needed: Any) -> Any:
    """Whether covered - (missed << shift) >= needed, as signed numbers, in any lane."""

    def compare(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        covered, missed, shift, needed = arguments
        missed = builder.shl(builder.zext(missed, NUMBERS), _spread(builder, shift, NUMBER, NUMBERS))
        least = _spread(builder, needed, NUMBER, NUMBERS)
        found = builder.icmp_signed(">=", builder.sub(covered, missed), least)
        whole = ir.IntType(LANES)
        return builder.icmp_unsigned("!=", builder.bitcast(found, whole), whole(0))

    return types.boolean(wide_numbers, wide_bytes, types.uint64, types.int64), compare


@intrinsic
def lowest(typing: Any, bits: Any) -> Any:
    """The number of the lowest bit that is set; one must be."""

    def count(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], ir.IntType(1)(1))

    return types.uint64(types.uint64), count
