"""PLY, the polygon file format (Turk, "The PLY polygon file format", Stanford 1994): its vertices.

An own reader: plyfile is under the GPL, which this project is not.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from os import SEEK_CUR
from typing import BinaryIO

import numpy as np

from m2t_text.clouds.parts import AXES, Field, count_of, header, left, records, rows
from m2t_text.errors import PartError
from m2t_text.util.types import Floats

CODES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}

LONGEST_LIST = 1 << 20  # values; no honest line has more


@dataclass(frozen=True)
class _Property:
    """One value of an element: its name, its type, and the type of its length if it is a list."""

    name: str
    code: str
    length: str | None = None


@dataclass(frozen=True)
class _Element:
    """A kind of records: how many there are, and what each holds."""

    name: str
    count: int
    properties: list[_Property]

    @property
    def lists(self) -> bool:
        return any(one.length for one in self.properties)

    @property
    def size(self) -> int:
        """Bytes of a record without lists."""
        return sum(int(one.code[1]) for one in self.properties)


def read_ply(file: BinaryIO) -> Floats:
    """The vertices (N, 2) or (N, 3) of a PLY file, in text or binary, whatever else it holds.

    Raises PartError if it is none, if it has no vertices with x and y, or if it is cut off.
    """
    if file.readline(8).strip() != b"ply":
        raise PartError("no PLY file: it does not begin with 'ply'")
    lines = list(header(file, "end_header"))
    formats = [words[1] for words in lines if words[0] == "format" and len(words) == 3]
    if len(formats) != 1 or formats[0] not in ORDERS:
        raise PartError(f"the header has no format of {', '.join(ORDERS)}")
    order, elements = ORDERS[formats[0]], _elements(lines)
    place = next((k for k, element in enumerate(elements) if element.name == "vertex"), None)
    if place is None:
        raise PartError(f"it has no vertices, but {' '.join(one.name for one in elements)[:80] or 'nothing'}")
    vertex = elements[place]
    names = [one.name for one in vertex.properties if not one.length]
    axes = [axis for axis in AXES if axis in names]
    if not {"x", "y"} <= set(axes):
        raise PartError(f"its vertices have {' '.join(names)[:80] or 'no numbers'}, and not x, y and z")
    if not order:
        for element in elements[:place]:
            _skip_lines(file, element)
        return _text_points(file, vertex, axes)
    for element in elements[:place]:
        _skip(file, element, order)
    return _binary_points(file, vertex, axes, order)


def _elements(lines: list[list[str]]) -> list[_Element]:
    """What a header says of the file's records."""
    elements: list[_Element] = []
    for words in lines:
        if words[0] == "element" and len(words) == 3:
            elements.append(_Element(words[1], count_of(words[2]), []))
        elif words[0] == "property" and elements:
            kinds, name = words[1:-1], words[-1]
            codes = [CODES.get(kind, "") for kind in kinds[-2:]]
            if len(kinds) == 1 and codes[0]:
                elements[-1].properties.append(_Property(name, codes[0]))
            elif len(kinds) == 3 and kinds[0] == "list" and codes[1] and codes[0][:1] in ("i", "u"):
                elements[-1].properties.append(_Property(name, codes[1], codes[0]))
            else:
                raise PartError(f"the header has no such property as {' '.join(words)[:60]!r}")
    return elements


def _skip_lines(file: BinaryIO, element: _Element) -> None:
    for _ in range(element.count):
        if not file.readline():
            raise PartError(f"cut off: {element.count} of {element.name} are claimed")


def _text_points(file: BinaryIO, vertex: _Element, axes: list[str]) -> Floats:
    names = [one.name for one in vertex.properties]
    first_list = next((k for k, one in enumerate(vertex.properties) if one.length), len(names))
    columns = [names.index(axis) for axis in axes]
    if max(columns) < first_list:
        return rows(file, columns, vertex.count)
    points = []
    for _ in range(vertex.count):
        words = iter(file.readline().split())
        try:
            row = {one.name: _values(words, one) for one in vertex.properties}
            points.append([row[axis] for axis in axes])
        except StopIteration as error:
            raise PartError(f"cut off: {vertex.count} points are claimed, {len(points)} are there") from error
    return np.array(points, dtype=np.float64).reshape(-1, len(axes))


def _values(words: Iterator[bytes], one: _Property) -> float:
    """The next value of a line; of a list its length, when it is passed."""
    value = float(next(words))
    for _ in range(int(min(max(value, 0.0), LONGEST_LIST)) if one.length else 0):
        next(words)
    return value


def _skip(file: BinaryIO, element: _Element, order: str) -> None:
    if element.lists:
        for _ in range(element.count):
            _record(file, element, order)
    elif element.count * element.size > left(file):
        raise PartError(f"cut off: {element.count} of {element.name} are claimed")
    else:
        file.seek(element.count * element.size, SEEK_CUR)


def _binary_points(file: BinaryIO, vertex: _Element, axes: list[str], order: str) -> Floats:
    if vertex.lists:
        points: list[list[float]] = []
        for _ in range(vertex.count):
            record = _record(file, vertex, order)
            points.append([record[axis] for axis in axes])
        return np.array(points, dtype=np.float64).reshape(-1, len(axes))
    fields, offset = {}, 0
    for one in vertex.properties:
        fields[one.name] = Field(order + one.code, offset)
        offset += int(one.code[1])
    return records(file, [fields[axis] for axis in axes], vertex.size, vertex.count)


def _record(file: BinaryIO, element: _Element, order: str) -> dict[str, float]:
    """The next record, lists left out. It takes a byte at least, so the file bounds how many there are."""
    found: dict[str, float] = {}
    for one in element.properties:
        code = order + (one.length or one.code)
        (value,) = np.frombuffer(_bytes(file, int(code[2])), code)
        if one.length:
            _bytes(file, max(0, int(value)) * int(one.code[1]))
        else:
            found[one.name] = float(value)
    return found


def _bytes(file: BinaryIO, count: int) -> bytes:
    if count > left(file):
        raise PartError("cut off before its last record")
    return file.read(count)
