"""Four 64 bit words that are worked on at once, compiled: a vector register of any common processor holds them.

Compiled code computes with them as with numbers: ``&``, ``|``, ``^`` and ``~`` of all 256 bits.
"""

import operator
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


def _bitwise(operation: Any, instruction: str) -> None:
    """Makes an operation of two lanes one instruction."""

    @type_callable(operation)
    def typed(context: Any) -> Any:
        return lambda a, b: lanes if a is lanes and b is lanes else None

    @lower_builtin(operation, Lanes, Lanes)
    def lowered(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return getattr(builder, instruction)(*arguments)


_bitwise(operator.and_, "and_")
_bitwise(operator.or_, "or_")
_bitwise(operator.xor, "xor")


@type_callable(operator.invert)
def _invert_typed(context: Any) -> Any:
    return lambda a: lanes if a is lanes else None


@lower_builtin(operator.invert, Lanes)
def _invert(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.not_(arguments[0])


def _pointer(context: Any, builder: Any, array: Any, value: Any, place: Any) -> Any:
    """To an element of an array's memory."""
    return builder.gep(context.make_array(array)(context, builder, value).data, [place])


@intrinsic
def at(typing: Any, array: Any, row: Any) -> Any:
    """A row of a C-contiguous (N, 4) uint64 array."""

    def load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = builder.mul(arguments[1], WORD(LANES))
        pointer = _pointer(context, builder, signature.args[0], arguments[0], place)
        return builder.load(builder.bitcast(pointer, VECTOR.as_pointer()), align=8)

    return lanes(array, types.uint64), load


@intrinsic
def put(typing: Any, array: Any, row: Any, value: Any) -> Any:
    """Writes a row of such an array."""

    def store(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = builder.mul(arguments[1], WORD(LANES))
        pointer = _pointer(context, builder, signature.args[0], arguments[0], place)
        builder.store(arguments[2], builder.bitcast(pointer, VECTOR.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.void(array, types.uint64, lanes), store


@intrinsic
def gathered(typing: Any, windows: Any, places: Any, row: Any, move: Any) -> Any:
    """Eight bytes of a uint8 array for each lane, the first one lowest.

    They begin ``move`` bytes behind the places in a row of a C-contiguous (N, 4) int64 array.
    """

    def gather(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value = ir.Constant(VECTOR, ir.Undefined)
        begin = builder.mul(arguments[2], WORD(LANES))
        for lane in range(LANES):
            number = builder.add(begin, WORD(lane))
            place = builder.load(_pointer(context, builder, signature.args[1], arguments[1], number))
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
