"""PCD, the files of the Point Cloud Library (https://pointclouds.org/documentation/tutorials/pcd_file_format.html).

An own reader: pypcd4 allocates what a header claims, and brings Pydantic along.
"""

import struct
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np

from m2t_text.clouds.parts import AXES, Field, count_of, doubles, header, left, records, rows
from m2t_text.errors import PartError
from m2t_text.util.types import Floats

CODES = {("F", 4), ("F", 8), *((kind, size) for kind in "IU" for size in (1, 2, 4, 8))}
EXPANSION = 100  # LZF turns three bytes into 264 at the most


@dataclass(frozen=True)
class _Header:
    """Where x, y and perhaps z are: ``fields`` of a record of ``size`` bytes, or ``columns`` of a line."""

    fields: list[Field]
    columns: list[int]
    size: int
    count: int
    encoding: str


def read_pcd(file: BinaryIO) -> Floats:
    """The points (N, 2) or (N, 3) of a PCD file, in text, binary or compressed.

    Raises PartError if it is none, or cut off.
    """
    head = _read_header(file)
    if head.encoding == "ascii":
        return rows(file, head.columns, head.count)
    if head.encoding == "binary":
        return records(file, head.fields, head.size, head.count)
    if head.encoding == "binary_compressed":
        return _decompressed(file, head)
    raise PartError("its DATA is not ascii, binary or binary_compressed")


def _read_header(file: BinaryIO) -> _Header:
    lines = {words[0]: words[1:] for words in header(file, "DATA")}
    names = lines.get("FIELDS", [])
    repeats = lines.get("COUNT", ["1"] * len(names))
    described = (names, lines.get("TYPE", []), lines.get("SIZE", []), repeats)
    if not names or len({len(words) for words in described}) > 1:
        raise PartError("no PCD header: its FIELDS, TYPE, SIZE and COUNT do not belong together")
    places: dict[str, tuple[Field, int]] = {}
    column = offset = 0
    for name, kind, width, repeat in zip(*described, strict=True):
        size, repeated = count_of(width), count_of(repeat)
        if (kind, size) not in CODES:
            raise PartError(f"no PCD header: there is no number of TYPE {kind[:9]} and SIZE {size}")
        places[name] = (Field(f"<{kind.lower()}{size}", offset), column)
        column, offset = column + repeated, offset + size * repeated
    axes = [places[axis] for axis in AXES if axis in places]
    if len(axes) < 2 or not {"x", "y"} <= set(places):
        raise PartError(f"its fields are {' '.join(names)[:80]}, and not x, y and z")
    fields, columns = [field for field, _ in axes], [place for _, place in axes]
    # An organised cloud of WIDTH by HEIGHT points has rows, which do not matter here.
    sides = lines.get("POINTS") or lines.get("WIDTH", []) + lines.get("HEIGHT", [])
    count = int(np.prod([count_of(side) for side in sides], dtype=object)) if sides else 0
    return _Header(fields, columns, offset, count, lines["DATA"][0] if lines["DATA"] else "")


def _decompressed(file: BinaryIO, head: _Header) -> Floats:
    """Compressed points are kept field by field."""
    if left(file) < 8:
        raise PartError("cut off before its points")
    packed, unpacked = struct.unpack("<II", file.read(8))
    if packed > left(file):
        raise PartError(f"cut off: {packed} bytes are claimed, {left(file)} are there")
    if unpacked != head.count * head.size or unpacked > packed * EXPANSION:
        raise PartError(f"{head.count} points of {head.size} bytes do not come from {packed} bytes")
    content = file.read(packed)
    if packed != unpacked:  # points that did not shrink are stored as they are
        content = _unpacked(content, unpacked)
    return doubles(*(np.frombuffer(content, f.code, head.count, f.offset * head.count) for f in head.fields))


def _unpacked(content: bytes, size: int) -> bytes:
    try:
        import lzf
    except ImportError as error:
        raise PartError(
            "a compressed cloud takes one more package: pip install 'm2t-text[pcd]', or save it uncompressed"
        ) from error
    unpacked: bytes | None = lzf.decompress(content, size)
    if unpacked is None or len(unpacked) != size:
        raise PartError("its compressed points are damaged")
    return unpacked
