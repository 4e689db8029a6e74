"""Sixty-four bytes, or sixteen words, that are worked on at once, compiled; see `simd` for four words.

A byte is for one way to lay a query on a map: LANES of them are tried together. Words are rows of bits.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

LANES = 64
WORDS = 16  # of a row of bits
BYTE, WORD = ir.IntType(8), ir.IntType(64)
BYTES, ROW = ir.VectorType(BYTE, LANES), ir.VectorType(WORD, WORDS)


class WideBytes(types.Type):
    """The type of such bytes in compiled code; Python never sees one."""

    def __init__(self) -> None:
        super().__init__(name="WideBytes")


class WideWords(types.Type):
    """The type of WORDS words in compiled code."""

    def __init__(self) -> None:
        super().__init__(name="WideWords")


wide_bytes, wide_words = WideBytes(), WideWords()


@register_model(WideBytes)
class _Bytes(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, BYTES)


@register_model(WideWords)
class _Words(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ROW)


def _spread(builder: Any, value: Any) -> Any:
    first = builder.insert_element(
        ir.Constant(BYTES, ir.Undefined), builder.trunc(value, BYTE), ir.IntType(32)(0)
    )
    return _picked(builder, first, first, [0] * LANES)


def _picked(builder: Any, a: Any, b: Any, places: list[int]) -> Any:
    """For each lane an element of two vectors, the second of which is numbered on from the first."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(ir.IntType(32), LANES), places))


def _place(context: Any, builder: Any, signature: Any, arguments: Any, kind: Any) -> Any:
    """Where a row of an array (N, as many as the kind has) lies: anywhere that its numbers may."""
    array, number = arguments
    data = context.make_array(signature.args[0])(context, builder, array).data
    return builder.bitcast(builder.gep(data, [builder.mul(number, WORD(kind.count))]), kind.as_pointer())


def _row(context: Any, builder: Any, signature: Any, arguments: Any, kind: Any) -> Any:
    """Such a row."""
    pointer = _place(context, builder, signature, arguments, kind)
    return builder.load(pointer, align=kind.element.width // 8)


@intrinsic
def every_byte(typing: Any, value: Any) -> Any:
    """The same byte in all lanes."""

    def spread(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _spread(builder, arguments[0])

    return wide_bytes(types.uint64), spread


@intrinsic
def bytes_at(typing: Any, array: Any, row: Any) -> Any:
    """A row of a C-contiguous (N, LANES) uint8 array."""

    def load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _row(context, builder, signature, arguments, BYTES)

    return wide_bytes(array, types.uint64), load


@intrinsic
def quads_at(typing: Any, array: Any, place: Any) -> Any:
    """The bytes of all quads, of such an array without rows: each byte in the four lanes of its quad."""

    def load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        quads = ir.VectorType(BYTE, LANES // 4)
        pointer = _place(context, builder, signature, arguments, quads)
        loaded = builder.load(pointer, align=1)
        order = [4 * (lane // 16) + 2 * (lane // 8 % 2) + lane // 2 % 2 for lane in range(LANES)]
        return _picked(builder, loaded, loaded, order)

    return wide_bytes(array, types.uint64), load


@intrinsic
def put_bytes(typing: Any, array: Any, row: Any, value: Any) -> Any:
    """Writes a row of such an array."""

    def store(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = _place(context, builder, signature, arguments[:2], BYTES)
        builder.store(arguments[2], pointer, align=1)
        return context.get_dummy_value()

    return types.void(array, types.uint64, wide_bytes), store


def _mixed(builder: Any, arguments: Any, first: int) -> Any:
    """The lanes of two in turns, from one on."""
    order = [first + lane // 2 + LANES * (lane % 2) for lane in range(LANES)]
    a, b = arguments
    return _picked(builder, a, b, order)


@intrinsic
def first_halves(typing: Any, a: Any, b: Any) -> Any:
    """The first half of both, a lane of each in turns."""

    def mix(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _mixed(builder, arguments, 0)

    return wide_bytes(wide_bytes, wide_bytes), mix


@intrinsic
def second_halves(typing: Any, a: Any, b: Any) -> Any:
    """The second half of both, a lane of each in turns."""

    def mix(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _mixed(builder, arguments, LANES // 2)

    return wide_bytes(wide_bytes, wide_bytes), mix


@intrinsic
def shifted(typing: Any, value: Any, places: Any) -> Any:
    """Each byte shifted down by so many bits."""

    def shift(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.lshr(arguments[0], _spread(builder, arguments[1]))

    return wide_bytes(wide_bytes, types.uint64), shift


@intrinsic
def added(typing: Any, a: Any, b: Any, lanes: Any) -> Any:
    """The sum of two bytes in each lane whose bit is set, 255 if it is more; the first one in the others."""

    def add(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        a, b, lanes = arguments
        chosen = builder.bitcast(lanes, ir.VectorType(ir.IntType(1), LANES))
        b = builder.select(chosen, b, ir.Constant(BYTES, [0] * LANES))
        total = builder.add(a, b)
        over = builder.icmp_unsigned("<", total, a)
        return builder.select(over, ir.Constant(BYTES, [255] * LANES), total)

    return wide_bytes(wide_bytes, wide_bytes, types.uint64), add


@intrinsic
def smaller(typing: Any, a: Any, b: Any) -> Any:
    """The smaller byte of two in each lane."""

    def choose(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.select(builder.icmp_unsigned("<", *arguments), *arguments)

    return wide_bytes(wide_bytes, wide_bytes), choose


@intrinsic
def up_to(typing: Any, value: Any, most: Any) -> Any:
    """A bit for each lane whose byte is not more than this."""

    def compare(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        found = builder.icmp_unsigned("<=", arguments[0], _spread(builder, arguments[1]))
        return builder.bitcast(found, WORD)

    return types.uint64(wide_bytes, types.uint64), compare


@intrinsic
def byte_of(typing: Any, value: Any, lane: Any) -> Any:
    """The byte of a lane."""

    def extract(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.zext(builder.extract_element(*arguments), WORD)

    return types.uint64(wide_bytes, types.uint64), extract


def _called(builder: Any, name: str, result: Any, argument: Any) -> Any:
    """What a function of LLVM's own returns."""
    kind = ir.FunctionType(result, [argument.type])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), [argument])


@intrinsic
def fetch(typing: Any, array: Any, place: Any) -> Any:
    """Has the line of the processor's cache loaded that a number of an array lies in, and does not wait."""

    def load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        pointer = builder.bitcast(builder.gep(data, [arguments[1]]), BYTE.as_pointer())
        number = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [pointer.type, number, number, number])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(function, [pointer, number(0), number(3), number(1)])
        return context.get_dummy_value()

    return types.void(array, types.uint64), load


@intrinsic
def words_at(typing: Any, array: Any, row: Any) -> Any:
    """A row of a C-contiguous (N, WORDS) uint64 array."""

    def load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _row(context, builder, signature, arguments, ROW)

    return wide_words(array, types.uint64), load


@intrinsic
def no_words(typing: Any) -> Any:
    """Zero in each word."""

    def zero(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return ir.Constant(ROW, [0] * WORDS)

    return wide_words(), zero


@intrinsic
def twice_plus_common(typing: Any, total: Any, a: Any, b: Any) -> Any:
    """Twice each word of the total, and how many bits are set in both of two words."""

    def add(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        total, a, b = arguments
        counted = _called(builder, f"llvm.ctpop.v{WORDS}i64", ROW, builder.and_(a, b))
        return builder.add(builder.add(total, total), counted)

    return wide_words(wide_words, wide_words, wide_words), add


@intrinsic
def sum_of(typing: Any, value: Any) -> Any:
    """The sum of all words."""

    def add(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _called(builder, f"llvm.vector.reduce.add.v{WORDS}i64", WORD, arguments[0])

    return types.uint64(wide_words), add


@intrinsic
def lowest(typing: Any, bits: Any) -> Any:
    """The number of the lowest bit that is set; one must be."""

    def count(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], ir.IntType(1)(1))

    return types.uint64(types.uint64), count
