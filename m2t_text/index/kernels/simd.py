"""Four 64 bit words that are worked on at once, compiled: a vector register of any common processor holds them.

Compiled code computes with them as with numbers: ``&``, ``|``, ``^`` and ``~`` of all bits, ``+`` and ``>>`` of
each word.
"""

import operator
from functools import partial
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

LANES = 4
WORD = ir.IntType(64)
VECTOR = ir.VectorType(WORD, LANES)


class Lanes(types.Type):
    """The type of such four words in compiled code; Python never sees one."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


lanes = Lanes()


@register_model(Lanes)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


def _operation(operation: Any, instruction: str) -> None:
    """Makes an operation on lanes one instruction."""

    @type_callable(operation)
    def typed(context: Any) -> Any:
        return lambda a, b: lanes if a is lanes and b is lanes else None

    @lower_builtin(operation, Lanes, Lanes)
    def lowered(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return getattr(builder, instruction)(*arguments)


_operation(operator.and_, "and_")
_operation(operator.or_, "or_")
_operation(operator.xor, "xor")
_operation(operator.add, "add")
_operation(operator.rshift, "lshr")


@type_callable(operator.invert)
def _invert_typed(context: Any) -> Any:
    return lambda a: lanes if a is lanes else None


@lower_builtin(operator.invert, Lanes)
def _invert(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.not_(arguments[0])


def _pointer(context: Any, builder: Any, array: Any, value: Any, place: Any) -> Any:
    """To an element of an array's memory."""
    return builder.gep(context.make_array(array)(context, builder, value).data, [place])


def _load_lanes(
    context: Any, builder: Any, signature: Any, arguments: Any, align: int, across: int = LANES
) -> Any:
    """A vector from a row of an array on, whose rows have so many elements, one for each lane or one in all."""
    place = builder.mul(arguments[1], WORD(across))
    pointer = _pointer(context, builder, signature.args[0], arguments[0], place)
    return builder.load(builder.bitcast(pointer, VECTOR.as_pointer()), align=align)


def _store_lanes(context: Any, builder: Any, signature: Any, arguments: Any, align: int, across: int) -> Any:
    """Writes a vector to where `_load_lanes` reads it."""
    place = builder.mul(arguments[1], WORD(across))
    pointer = _pointer(context, builder, signature.args[0], arguments[0], place)
    builder.store(arguments[2], builder.bitcast(pointer, VECTOR.as_pointer()), align=align)
    return context.get_dummy_value()


@intrinsic
def at(typing: Any, array: Any, row: Any) -> Any:
    """A row of a C-contiguous (N, 4) uint64 array."""
    return lanes(array, types.uint64), partial(_load_lanes, align=8)


@intrinsic
def bytes_at(typing: Any, array: Any, row: Any) -> Any:
    """Eight rows of a C-contiguous (N, 4) uint8 array, from one on; see `by_lane`."""
    return lanes(array, types.uint64), partial(_load_lanes, align=1)


@intrinsic
def strip_at(typing: Any, array: Any, place: Any) -> Any:
    """As many bytes of a uint8 array, from a place on."""
    return lanes(array, types.uint64), partial(_load_lanes, align=1, across=1)


@intrinsic
def by_lane(typing: Any, value: Any) -> Any:
    """Bytes that were loaded as eight rows of four, each column of them in a lane."""

    def shuffle(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        size = 8 * LANES
        vector = ir.VectorType(ir.IntType(8), size)
        order = [LANES * (place % 8) + place // 8 for place in range(size)]
        places = ir.Constant(ir.VectorType(ir.IntType(32), size), order)
        rows = builder.bitcast(arguments[0], vector)
        return builder.bitcast(builder.shuffle_vector(rows, rows, places), VECTOR)

    return lanes(lanes), shuffle


@intrinsic
def put(typing: Any, array: Any, row: Any, value: Any) -> Any:
    """Writes a row of such an array."""

    return types.void(array, types.uint64, lanes), partial(_store_lanes, align=8, across=LANES)


@intrinsic
def put_strip(typing: Any, array: Any, place: Any, value: Any) -> Any:
    """Writes the bytes of a uint8 array that `strip_at` reads."""
    return types.void(array, types.uint64, lanes), partial(_store_lanes, align=1, across=1)


@intrinsic
def gathered(typing: Any, windows: Any, places: Any, row: Any, move: Any) -> Any:
    """Eight bytes of a uint8 array for each lane, the first one lowest.

    They begin ``move`` bytes behind the places in a row of a C-contiguous (N, 4) uint32 array.
    """

    def gather(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value = ir.Constant(VECTOR, ir.Undefined)
        begin = builder.mul(arguments[2], WORD(LANES))
        for lane in range(LANES):
            number = builder.add(begin, WORD(lane))
            place = builder.load(_pointer(context, builder, signature.args[1], arguments[1], number))
            place = builder.zext(place, WORD)
            place = builder.add(place, arguments[3])
            pointer = _pointer(context, builder, signature.args[0], arguments[0], place)
            word = builder.load(builder.bitcast(pointer, WORD.as_pointer()), align=1)
            value = builder.insert_element(value, word, ir.IntType(32)(lane))
        return value

    return lanes(windows, places, types.uint64, types.int64), gather


@intrinsic
def every(typing: Any, word: Any) -> Any:
    """The same word in all lanes."""

    def spread(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value = ir.Constant(VECTOR, ir.Undefined)
        for lane in range(LANES):
            value = builder.insert_element(value, arguments[0], ir.IntType(32)(lane))
        return value

    return lanes(types.uint64), spread


@intrinsic
def some(typing: Any, value: Any) -> Any:
    """Whether any bit is set."""

    def compare(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole = ir.IntType(64 * LANES)
        return builder.icmp_unsigned("!=", builder.bitcast(arguments[0], whole), whole(0))

    return types.boolean(lanes), compare


@intrinsic
def filled(typing: Any, value: Any) -> Any:
    """1 in each lane that is not 0."""

    def compare(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        zero = ir.Constant(VECTOR, [0] * LANES)
        return builder.zext(builder.icmp_unsigned("!=", arguments[0], zero), VECTOR)

    return lanes(lanes), compare


@intrinsic
def full(typing: Any, value: Any) -> Any:
    """All bits of each lane that is not 0."""

    def compare(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        zero = ir.Constant(VECTOR, [0] * LANES)
        return builder.sext(builder.icmp_unsigned("!=", arguments[0], zero), VECTOR)

    return lanes(lanes), compare


@intrinsic
def rotated(typing: Any, value: Any) -> Any:
    """The last lane first, and the others behind it."""

    def shuffle(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        order = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [LANES - 1, *range(LANES - 1)])
        return builder.shuffle_vector(arguments[0], arguments[0], order)

    return lanes(lanes), shuffle


@intrinsic
def ones(typing: Any, value: Any) -> Any:
    """The number of bits set in each lane."""

    def count(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        counted = ir.Constant(VECTOR, ir.Undefined)
        for lane in range(LANES):
            number = ir.IntType(32)(lane)
            bits = builder.ctpop(builder.extract_element(arguments[0], number))
            counted = builder.insert_element(counted, bits, number)
        return counted

    return lanes(lanes), count


@intrinsic
def least(typing: Any, value: Any, other: Any) -> Any:
    """The smaller number of each lane."""

    def choose(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.select(builder.icmp_unsigned("<", *arguments), *arguments)

    return lanes(lanes, lanes), choose
