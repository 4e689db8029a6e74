"""PLY, the polygon file format (Turk, "The PLY polygon file format", Stanford 1994): its vertices.

An own reader: plyfile is under the GPL, which this project is not.
"""

from typing import BinaryIO

from m2t_text.clouds.parts import AXES, Field, count_of, header, records, rows
from m2t_text.errors import PartError
from m2t_text.util.types import Floats

CODES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def read_ply(file: BinaryIO) -> Floats:
    """The vertices (N, 2) or (N, 3) of a PLY file, in text or binary.

    Raises PartError if it is none, if it does not begin with them, or if it is cut off.
    """
    if file.readline(8).strip() != b"ply":
        raise PartError("no PLY file: it does not begin with 'ply'")
    lines = list(header(file, "end_header"))
    formats = [words[1] for words in lines if words[0] == "format" and len(words) == 3]
    if len(formats) != 1 or formats[0] not in ORDERS:
        raise PartError(f"the header has no format of {', '.join(ORDERS)}")
    order = ORDERS[formats[0]]
    count, properties = _vertices(lines)
    fields, size = {}, 0
    for name, code in properties:
        fields[name] = Field(order + code, size)
        size += int(code[1])
    if not {"x", "y"} <= set(fields):
        raise PartError(f"its vertices have {' '.join(fields)[:80] or 'no numbers'}, and not x, y and z")
    axes = [axis for axis in AXES if axis in fields]
    if order:
        return records(file, [fields[axis] for axis in axes], size, count)
    names = [name for name, _ in properties]
    return rows(file, [names.index(axis) for axis in axes], count)


def _vertices(lines: list[list[str]]) -> tuple[int, list[tuple[str, str]]]:
    """Their number, and the names and types of the numbers of each."""
    begins = [k for k, words in enumerate(lines) if words[0] == "element" and len(words) == 3]
    if not begins or lines[begins[0]][1] != "vertex":
        raise PartError("its first element is not the vertex: save the cloud with its points first")
    properties = []
    for words in lines[begins[0] + 1 : begins[1] if len(begins) > 1 else len(lines) - 1]:
        if words[0] == "obj_info":
            continue
        if len(words) != 3 or words[0] != "property" or words[1] not in CODES:
            raise PartError(f"the vertex has no such property as {' '.join(words)[:60]!r}")
        properties.append((words[2], CODES[words[1]]))
    return count_of(lines[begins[0]][2]), properties
