"""Tables of points: lines of numbers (.xyz, .csv), and the arrays of NumPy (.npy)."""

import re
from itertools import chain
from typing import BinaryIO

import numpy as np

from m2t_text.clouds.parts import AXES, LINE_LIMIT, doubles, left, table
from m2t_text.errors import PartError
from m2t_text.util.types import Floats

COMMENTS = ("#", "//")
LISTED = 80  # characters of the column names that are told
HEADER = re.compile(
    rb"\{'descr': '(?P<kind>[<>|](?:f[248]|[iu][1248]))', 'fortran_order': (?P<by_columns>True|False), "
    rb"'shape': \((?P<rows>\d{1,15}), (?P<columns>\d{1,15})\), \} *\n"
)


def read_lines(file: BinaryIO) -> Floats:
    """The points (N, 2) or (N, 3) of lines of numbers, separated by commas, semicolons, tabs or blanks.

    Where a line names the columns, those named x, y and z are read, else the first two or three. Comments begin
    with # or //, and may name the columns, too.

    Raises PartError if two columns are not told, ValueError for a line that has no numbers there.
    """
    names: list[str] = []
    for line in file:
        text = line.decode("utf-8").lstrip("\ufeff").strip()
        delimiter = _delimiter(text)
        comment = text.startswith(COMMENTS)
        words = [word.strip(" \"'").lower() for word in text.lstrip("#/ ").split(delimiter)]
        if {"x", "y"} <= set(words) and not names:
            names = words
        elif words and not comment:
            if not _is_number(words[0]):
                raise PartError(f"its columns are {' '.join(names or words)[:LISTED]!r}: name them x, y and z")
            columns = [names.index(axis) for axis in AXES if axis in names] or list(range(min(3, len(words))))
            if len(columns) < 2:
                raise PartError("its lines hold one number each, and not x, y and z")
            return table(chain([line], file), columns, delimiter)
    raise PartError("no line of numbers")


def _delimiter(text: str) -> str | None:
    """What separates the words of a line; None for blanks."""
    return next((mark for mark in ",;\t" if mark in text), None)


def _is_number(word: str) -> bool:
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
