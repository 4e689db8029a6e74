"""Pickles read as data: nothing is imported, called or made but numbers, strings and plain containers.

Python's own unpickler runs what a pickle asks for. Whoosh keeps pickles in its files, and files come from
strangers; so they are read here, operation by operation, and only the operations that our own files need.
"""

import pickletools
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from typing import Any

from m2t_text.errors import DamageError

CONTAINERS = 100_000  # that one pickle may hold: an empty one takes one byte in a file, and sixty in memory

CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
VALUES = {"BININT", "BININT1", "BININT2", "LONG1", "BINFLOAT", "BINUNICODE", "SHORT_BINUNICODE"}
EMPTY: dict[str, Callable[[], Any]] = {
    "EMPTY_DICT": dict,
    "EMPTY_LIST": list,
    "EMPTY_SET": set,
    "EMPTY_TUPLE": tuple,
}
SIZES = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
BROKEN = (ValueError, IndexError, KeyError, TypeError)  # what malformed operations raise


@dataclass(eq=False)
class Made:
    """An object as its pickle tells of it.

    Attributes:
        name: "module class" that it would be an object of.
        state: what its attributes would be set to.
    """

    name: str
    state: Any = None


@dataclass(frozen=True)
class Named:
    """A class that a pickle names."""

    name: str


def load(data: bytes, classes: frozenset[str] = frozenset()) -> tuple[Any, int]:
    """What a pickle at the beginning of ``data`` describes, and the number of bytes that it takes.

    Args:
        classes: names, "module class", that it may hold objects of; each becomes a `Made`.

    Raises:
        DamageError: if it is malformed, holds any other class, calls anything, or claims too much.
    """
    file, machine = BytesIO(data), _Machine(classes)
    try:
        while True:
            operation = OPERATIONS.get(file.read(1))
            if operation is None:
                raise DamageError("a pickle in it holds what no index of maps does")
            name, read = operation
            argument = None if read is None else read(file)
            if name == "STOP":
                return machine.stack.pop(), file.tell()
            machine.step(name, argument)
    except BROKEN as error:
        raise DamageError("a pickle in it is malformed") from error


class _Machine:
    """The stack that the operations of a pickle work on."""

    def __init__(self, classes: frozenset[str]) -> None:
        self.stack: list[Any] = []
        self._marks: list[int] = []
        self._memo: dict[int, Any] = {}
        self._classes = classes
        self._room = CONTAINERS

    def step(self, name: str, argument: Any) -> None:
        if name in CONSTANTS:
            self.stack.append(CONSTANTS[name])
        elif name in VALUES:
            self.stack.append(argument)
        elif name in EMPTY:
            self._make(EMPTY[name]())
        elif name in SIZES:
            self._make(tuple(self.stack.pop() for _ in range(SIZES[name]))[::-1])
        else:
            HANDLERS[name](self, argument)

    def _make(self, value: Any) -> None:
        self._room -= 1
        if self._room < 0:
            raise DamageError("a pickle in it holds more than an index needs")
        self.stack.append(value)

    def ignore(self, argument: Any) -> None:
        """The version, and the length of what follows: both are seen anyway."""

    def mark(self, argument: Any) -> None:
        self._marks.append(len(self.stack))

    def _marked(self) -> list[Any]:
        begin = self._marks.pop()
        values = self.stack[begin:]
        del self.stack[begin:]
        return values

    def tuple(self, argument: Any) -> None:
        self._make(tuple(self._marked()))

    def append(self, argument: Any) -> None:
        value = self.stack.pop()
        _a(self.stack[-1], list).append(value)

    def appends(self, argument: Any) -> None:
        values = self._marked()
        _a(self.stack[-1], list).extend(values)

    def add_items(self, argument: Any) -> None:
        values = self._marked()
        _a(self.stack[-1], set).update(_a(value, int) for value in values)

    def set_item(self, argument: Any) -> None:
        value, key = self.stack.pop(), self.stack.pop()
        _a(self.stack[-1], dict)[_a(key, str)] = value

    def set_items(self, argument: Any) -> None:
        values = self._marked()
        keys = [_a(key, str) for key in values[::2]]  # a nested key could take for ever to be hashed
        _a(self.stack[-1], dict).update(zip(keys, values[1::2], strict=True))

    def put(self, argument: Any) -> None:
        if argument > len(self._memo):
            raise ValueError("a number that is not the next one")
        self._memo[argument] = self.stack[-1]

    def memoize(self, argument: Any) -> None:
        self._memo[len(self._memo)] = self.stack[-1]

    def get(self, argument: Any) -> None:
        self.stack.append(self._memo[argument])

    def name(self, argument: Any) -> None:
        if argument not in self._classes:
            raise DamageError(f"it holds {argument[:80]!r}: not one of maps, or not to be trusted")
        self._make(Named(argument))

    def stack_name(self, argument: Any) -> None:
        name, module = self.stack.pop(), self.stack.pop()
        self.name(f"{_a(module, str)} {_a(name, str)}")

    def new(self, argument: Any) -> None:
        if self.stack.pop() != ():
            raise DamageError("a pickle in it makes objects of arguments")
        self._make(Made(_a(self.stack.pop(), Named).name))

    def build(self, argument: Any) -> None:
        state = self.stack.pop()
        _a(self.stack[-1], Made).state = state


def _a(value: Any, kind: type) -> Any:
    """The value, which must be of just this type."""
    if type(value) is not kind:
        raise TypeError(f"{kind.__name__} expected")
    return value


HANDLERS: dict[str, Callable[[_Machine, Any], None]] = {
    "PROTO": _Machine.ignore,
    "FRAME": _Machine.ignore,
    "MARK": _Machine.mark,
    "TUPLE": _Machine.tuple,
    "APPEND": _Machine.append,
    "APPENDS": _Machine.appends,
    "ADDITEMS": _Machine.add_items,
    "SETITEM": _Machine.set_item,
    "SETITEMS": _Machine.set_items,
    "BINPUT": _Machine.put,
    "LONG_BINPUT": _Machine.put,
    "MEMOIZE": _Machine.memoize,
    "BINGET": _Machine.get,
    "LONG_BINGET": _Machine.get,
    "GLOBAL": _Machine.name,
    "STACK_GLOBAL": _Machine.stack_name,
    "NEWOBJ": _Machine.new,
    "BUILD": _Machine.build,
}
KNOWN = {"STOP", *CONSTANTS, *VALUES, *EMPTY, *SIZES, *HANDLERS}
OPERATIONS = {
    operation.code.encode("latin-1"): (operation.name, operation.arg.reader if operation.arg else None)
    for operation in pickletools.opcodes
    if operation.name in KNOWN
}
