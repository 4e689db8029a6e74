"""Tables of points: lines of numbers (.xyz, .pts, .asc, .csv), and the arrays of NumPy (.npy)."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import BinaryIO

import numpy as np

from m2t_text.clouds.parts import AXES, DIGITS, LINE_LIMIT, doubles, left, table
from m2t_text.errors import PartError
from m2t_text.util.types import Floats

COMMENTS = ("#", "//")
MISSING, NOTHING = "nan", ("", "nan", "null", "na", "n/a", "none", "-", "--")  # of a value
WORD = re.compile(r"[^0-9eE+\-.,;\t ]")  # what no line of plain numbers has
COMMA = re.compile(r"[+-]?\d+(?:,\d*)?(?:[eE][+-]?\d+)?")  # a number that may have a decimal comma
UNIT = re.compile(r"(?P<name>[^\[(]*?) *[\[(] *(?P<unit>\w*) *[\])]")
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1000.0, "ft": 0.3048}
OTHER_NAMES = {
    "points:0": "x",
    "points:1": "y",
    "points:2": "z",
    "points_0": "x",
    "points_1": "y",
    "points_2": "z",
}
LISTED = 80  # characters of the column names that are shown
HEADER = re.compile(
    rb"\{'descr': '(?P<kind>[<>|](?:f[248]|[iu][1248]))', 'fortran_order': (?P<by_columns>True|False), "
    rb"'shape': \((?P<rows>\d{1,15}), (?P<columns>\d{1,15})\), \} *\n"
)


@dataclass(frozen=True)
class _Layout:
    """How the lines of a table are written.

    Attributes:
        delimiter: what separates the words; None for blanks.
        commas: whether numbers have a decimal comma.
        columns: of x, y and perhaps z.
        units: metres in the unit of each of these.
        count: how many points the file claims to hold; None if it does not say.
    """

    delimiter: str | None
    commas: bool
    columns: list[int]
    units: list[float]
    count: int | None


def read_lines(file: BinaryIO) -> Floats:
    """The points (N, 2) or (N, 3) of lines of numbers, separated by commas, semicolons, tabs or blanks.

    Where a line names the columns, those named x, y and z are read, else the first two or three. Comments begin
    with # or //, and may name the columns, too. The number of points may come first. Numbers may have decimal
    commas where something else separates them; what is missing is read as NaN.

    Raises PartError if two columns are not told, ValueError for a line that has no numbers there.
    """
    names: list[tuple[str, float]] = []
    count: int | None = None
    for line in file:
        text = _decoded(line)
        delimiter, commas = _separation(text)
        words = [word.strip(" \"'\r").lower() for word in text.lstrip("#/ ").split(delimiter)]
        named = [_name(word) for word in words]
        if {"x", "y"} <= {name for name, _ in named} and not names:
            names = named
        elif len(words) == 1 and words[0].isdecimal() and len(words[0]) <= DIGITS and count is None:
            count = int(words[0])
        elif any(words) and not text.startswith(COMMENTS):
            layout = _layout(names, words, delimiter, commas, count)
            found = table(_numbers(chain([line], file), layout), layout.columns, layout.delimiter)
            if layout.count is not None and len(found) < layout.count:
                raise PartError(f"cut off: {layout.count} points are claimed, {len(found)} are there")
            return found * np.array(layout.units)
    raise PartError("no line of numbers")


def _layout(
    names: list[tuple[str, float]], words: list[str], delimiter: str | None, commas: bool, count: int | None
) -> _Layout:
    """Of a table whose first line of numbers has these words."""
    if not _is_number(words[0].replace(",", ".") if commas else words[0]):
        told = " ".join(name for name, _ in names) or " ".join(words)
        raise PartError(f"its columns are {told[:LISTED]!r}: name them x, y and z")
    found = {name: (column, unit) for column, (name, unit) in reversed(list(enumerate(names)))}
    chosen = [found[axis] for axis in AXES if axis in found] or [(k, 1.0) for k in range(min(3, len(words)))]
    if len(chosen) < 2:
        raise PartError("its lines hold one number each, and not x, y and z")
    return _Layout(delimiter, commas, [column for column, _ in chosen], [unit for _, unit in chosen], count)


def _numbers(lines: Iterator[bytes], layout: _Layout) -> Iterator[bytes]:
    """The lines as they are read: with decimal points, NaN for what is missing, and without further counts."""
    mark = layout.delimiter
    for line in lines:
        text = _decoded(line)
        if text.startswith(COMMENTS) or (mark is None and text.isdecimal()):
            continue  # files of several scans have a count before each
        if layout.commas:
            text = text.replace(",", ".")
        if mark is not None and (
            mark * 2 in text or text.startswith(mark) or text.endswith(mark) or WORD.search(text)
        ):
            words = [word.strip(" \"'") for word in text.split(mark)]
            if not any(words):
                words = [MISSING] * (max(layout.columns) + 1)
            text = mark.join(MISSING if word.lower() in NOTHING else word for word in words)
        yield text.encode()


def _decoded(line: bytes) -> str:
    """A line's text. Raises PartError for one of 16 bits a letter, ValueError for other bytes."""
    if line.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise PartError("its letters have 16 bits: save it as UTF-8")
    return line.decode("utf-8").lstrip("\ufeff").strip(" \r\n")


def _separation(text: str) -> tuple[str | None, bool]:
    """What separates the words of a line, None for blanks, and whether their numbers have decimal commas."""
    mark = next((mark for mark in ";\t" if mark in text), None)
    words = text.split(mark)
    if mark is not None or (len(words) > 1 and all(COMMA.fullmatch(word) for word in words)):
        return mark, any(COMMA.fullmatch(word.strip(" \"'")) and "," in word for word in words)
    return ("," if "," in text else None), False


def _name(word: str) -> tuple[str, float]:
    """A column's name without its unit, and the unit in metres: "x [mm]" is x, 0.001."""
    match = UNIT.fullmatch(word)
    name, unit = (match["name"], UNITS.get(match["unit"], 1.0)) if match else (word, 1.0)
    return OTHER_NAMES.get(name, name), unit


def _is_number(word: str) -> bool:
    if word in NOTHING:
        return True
    try:
        float(word)
    except ValueError:
        return False
    return True


def read_npy(file: BinaryIO) -> Floats:
    """The points (N, 2) or (N, 3) of a NumPy array of numbers, (N, 2 or more).

    An own reader: NumPy's allocates what a header claims, and runs Python's parser over it.

    Raises PartError if it is none, or cut off.
    """
    magic = file.read(8)  # and the version, of which 1 has a shorter field for the header's length
    if len(magic) < 8 or not magic.startswith(b"\x93NUMPY"):
        raise PartError("no NumPy array")
    length = int.from_bytes(file.read(2 if magic[6] == 1 else 4), "little")
    header = HEADER.fullmatch(file.read(min(length, LINE_LIMIT)))
    if header is None or int(header["columns"]) < 2:
        raise PartError("no array of points: save one of numbers, (points, 2) or (points, 3)")
    kind = np.dtype(header["kind"].decode())
    shape = (int(header["rows"]), int(header["columns"]))
    needed = shape[0] * shape[1] * kind.itemsize
    if needed > left(file):
        raise PartError(f"cut off: {needed} bytes are claimed, {left(file)} are there")
    content = np.frombuffer(file.read(needed), kind)
    array = content.reshape(shape, order="F" if header["by_columns"] == b"True" else "C")
    return doubles(*array.T[:3])
