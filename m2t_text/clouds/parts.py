"""The parts that files of points are made of: lines of a header, rows of words, and binary records.

Nothing is allocated that a file merely claims to hold.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BufferedReader, FileIO
from itertools import chain, islice
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from m2t_text.errors import PartError
from m2t_text.util.types import Floats, Progress

AXES = ("x", "y", "z")
LINE_LIMIT, LINES_LIMIT = 4096, 1000  # bytes and lines; no honest header has longer ones or more
DIGITS = 18  # of a count
LINES_PER_PROGRESS = 4096  # lines between two calls of progress


class WatchedFile(BufferedReader):
    """An open file that tells while its lines are read how many bytes of it were, and of how many."""

    def __init__(self, file: BufferedReader, progress: Progress | None) -> None:
        super().__init__(FileIO(file.fileno(), closefd=False))
        self._progress = progress
        self._lines = 0

    def __next__(self) -> bytes:
        self._lines += 1
        if self._progress and self._lines % LINES_PER_PROGRESS == 0:
            self._progress(self.tell(), self.tell() + left(self))
        return super().__next__()


@dataclass(frozen=True)
class Field:
    """A number in a binary record: its type as NumPy writes it, and bytes from the record's begin."""

    code: str
    offset: int


def left(file: BinaryIO) -> int:
    """Bytes from the place in a file to its end."""
    return os.fstat(file.fileno()).st_size - file.tell()


def header(file: BinaryIO, end: str) -> Iterator[list[str]]:
    """The words of each line up to the one that begins with ``end``, that one included; no comments.

    Raises PartError if there is no such line.
    """
    for _ in range(LINES_LIMIT):
        line = file.readline(LINE_LIMIT)
        if not line.endswith(b"\n"):
            break
        words = line.decode("ascii", errors="replace").split()
        if words and not words[0].startswith(("#", "comment")):
            yield words
            if words[0] == end:
                return
    raise PartError(f"no header that ends with {end!r}")


def count_of(word: str) -> int:
    """The count that a word of a header is. Raises PartError if it is none."""
    if not (word.isdecimal() and word.isascii() and len(word) <= DIGITS):
        raise PartError(f"the header has {word[:40]!r} where a count should be")
    return int(word)


def records(file: BinaryIO, fields: Sequence[Field], size: int, count: int) -> Floats:
    """The fields of the next ``count`` records of ``size`` bytes: (count, fields)."""
    if count * size > left(file):
        raise PartError(f"cut off: {count} points of {size} bytes are claimed, {left(file)} bytes are there")
    names = [str(k) for k in range(len(fields))]
    codes, offsets = [field.code for field in fields], [field.offset for field in fields]
    kind = np.dtype({"names": names, "formats": codes, "offsets": offsets, "itemsize": size})
    content = np.frombuffer(file.read(count * size), kind)
    return doubles(*(content[name] for name in names))


def doubles(*columns: NDArray[Any]) -> Floats:
    """Columns of numbers of any kind side by side, (N, columns)."""
    with np.errstate(invalid="ignore"):  # a NaN may be one that signals
        return np.column_stack([column.astype(np.float64) for column in columns])


def rows(file: BinaryIO, columns: Sequence[int], count: int) -> Floats:
    """Columns of the next ``count`` lines of numbers: (count, columns)."""
    found = table(islice(file, count), columns)
    if len(found) < count:
        raise PartError(f"cut off: {count} points are claimed, {len(found)} are there")
    return found


def table(lines: Iterator[bytes], columns: Sequence[int], delimiter: str | None = None) -> Floats:
    """Columns of lines of numbers: (lines, columns). Empty lines are left out.

    Raises ValueError naming the row that is no such line.
    """
    first = next((line for line in lines if line.strip()), None)
    if first is None:
        return np.empty((0, len(columns)))
    decoded = (line.decode("utf-8") for line in chain([first], lines))
    return np.loadtxt(decoded, delimiter=delimiter, usecols=columns, comments=None, ndmin=2)
