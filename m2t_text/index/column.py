"""Whoosh columns that are read without being copied: of texts, of numbers and records, and of names."""

import json
from array import array
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from numpy.typing import NDArray
from whoosh.columns import Column, ColumnReader, ColumnWriter

from m2t_text.description.text import Text
from m2t_text.errors import DamageError, SourceError
from m2t_text.index.kernels.packed import MOST, RUN, Texts, as_squares, as_words, pack
from m2t_text.util.names import checked_name

HEADER = np.dtype([("maps", "<u8"), ("keypoints", "<u8"), ("runs", "<u8"), ("wide", "<u8")])
COUNTS = np.dtype("<u4")
EMPTY = Text.of([], [], [])
HELD = 1 << 22  # bytes of a section that are held in memory while it is written
LIMIT = 1 << 24  # bytes of the names of a segment's datasets at most


def view(file: Any, position: int, length: int) -> Any:
    """Bytes of a column's file: not copied where it is mapped into memory."""
    buffer = getattr(file, "buffer", None)
    return file.get(position, length) if buffer is None else buffer[position : position + length]


class KeypointColumn(Column):
    """One `Text` a document.

    The file holds two parts: all keypoints, then all free squares, whose sides are kept as words are. Each part
    holds, after a header, the numbers of keypoints (squares), of runs and of wide keypoints of each document,
    and then the sections of `Texts`, in bytes, so that they can be used where they lie.
    """

    _default = EMPTY

    class Writer(ColumnWriter):
        """Collects documents in files without a name, as it is known only in the end where each section begins.

        Attributes:
            folder: of these files; None for where the system keeps temporary ones.
        """

        folder: Path | None = None

        def __init__(self, dbfile: Any) -> None:
            super().__init__(dbfile)
            self._parts = (_PartWriter(), _PartWriter())

        def fill(self, docnum: int) -> None:
            for part in self._parts:
                part.fill(docnum)

        def add(self, docnum: int, value: Text) -> None:
            self.fill(docnum)
            keypoints, squares = self._parts
            keypoints.add(pack(value), self.folder)
            squares.add(pack(as_words(value.free)), self.folder)

        def finish(self, docnum: int) -> None:
            self.fill(docnum)
            for part in self._parts:
                part.write(self._dbfile)

    class Reader(ColumnReader):
        """Raises DamageError if the sections do not fill the column, or the sizes the sections.

        Attributes:
            texts: the keypoints of all documents.
            squares: their free squares.
        """

        def __init__(self, dbfile: Any, basepos: int, length: int, doccount: int) -> None:
            super().__init__(dbfile, basepos, length, doccount)
            self.texts, end = _read_part(dbfile, basepos, basepos + length, doccount)
            self.squares, end = _read_part(dbfile, end, basepos + length, doccount)
            if end != basepos + length:
                raise _damage()

        def __getitem__(self, docnum: int) -> Text:
            return replace(self.texts.text(docnum), free=as_squares(self.squares.text(docnum)))


class _PartWriter:
    """One part of a column of texts while it is written: sizes and sections of each document."""

    def __init__(self) -> None:
        self._sizes = array("I")
        self._sections = (_Section(), _Section(), _Section(), _Section())

    def fill(self, docnum: int) -> None:
        """Makes the documents before this one that have nothing."""
        self._sizes.extend([0] * (3 * docnum - len(self._sizes)))

    def add(self, rows: tuple[bytes, bytes, bytes, bytes], folder: Path | None) -> None:
        """The next document, packed."""
        for section, row in zip(self._sections, rows, strict=True):
            section.add(row, folder)
        self._sizes.extend((len(rows[1]), len(rows[0]) // 2, len(rows[3]) // 2))

    def write(self, file: Any) -> None:
        sizes = np.array(self._sizes, dtype=COUNTS).reshape(-1, 3).T
        totals = (sizes.shape[1], *sizes.sum(axis=1, dtype=np.int64).tolist())
        file.write(np.array([totals], dtype=HEADER).tobytes())
        file.write(sizes.tobytes())
        for section in self._sections:
            section.write(file)


class _Section:
    """Bytes that are collected, those that are many in a file without a name."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._file: Any = None

    def add(self, row: bytes, folder: Path | None) -> None:
        self._bytes += row
        if len(self._bytes) > HELD:
            if self._file is None:
                self._file = TemporaryFile(dir=folder)  # noqa: SIM115
            self._file.write(self._bytes)
            self._bytes.clear()

    def write(self, file: Any) -> None:
        """Moves all of them into a file."""
        if self._file is not None:
            self._file.seek(0)
            while part := self._file.read(HELD):
                file.write(part)
            self._file.close()
        file.write(bytes(self._bytes))
        self._bytes.clear()


def _read_part(file: Any, begin: int, end: int, documents: int) -> tuple[Texts, int]:
    """One part of a column of texts that ends at ``end`` or before, and where it ends. Raises DamageError."""
    if end - begin < HEADER.itemsize:
        raise _damage()
    head = np.frombuffer(view(file, begin, HEADER.itemsize), HEADER)[0]
    maps, keypoints, runs, wide = (int(head[name]) for name in HEADER.names or ())
    sizes = (HEADER.itemsize, 3 * maps * COUNTS.itemsize, 2 * runs, keypoints, keypoints, 2 * wide)
    begins = list(accumulate(sizes, initial=begin))
    if maps != documents or begins[-1] > end:
        raise _damage()
    table, *sections = (view(file, *part) for part in zip(begins[1:-1], sizes[1:], strict=True))
    counts = np.frombuffer(table, COUNTS).reshape(3, maps)
    if tuple(counts.sum(axis=1, dtype=np.int64)) != (keypoints, runs, wide) or not _possible(counts):
        raise _damage()
    return Texts.read(counts, *sections), begins[-1]


def _damage() -> DamageError:
    return DamageError("the texts of the maps are damaged")


def _possible(counts: NDArray[np.uint32]) -> bool:
    """Whether texts can have these (3, D) numbers of keypoints, runs and wide keypoints."""
    keypoints, runs, wide = counts.astype(np.int64)
    filled = (runs <= keypoints) & (keypoints <= RUN * runs) & (keypoints <= MOST)
    return bool((filled & ((wide == 0) | (wide == keypoints))).all())


class ArrayColumn(Column):
    """A number or a record of a fixed dtype a document; ``reader(…).array`` has them all."""

    def __init__(self, dtype: Any) -> None:
        self.dtype = np.dtype(dtype).str if np.dtype(dtype).names is None else dtype

    def default_value(self, reverse: bool = False) -> Any:
        return np.zeros((), self.dtype)[()]

    def writer(self, dbfile: Any) -> "ArrayColumn.Writer":
        return self.Writer(dbfile, np.dtype(self.dtype))

    def reader(self, dbfile: Any, basepos: int, length: int, doccount: int) -> "ArrayColumn.Reader":
        return self.Reader(dbfile, basepos, length, doccount, np.dtype(self.dtype))

    class Writer(ColumnWriter):
        def __init__(self, dbfile: Any, dtype: Any) -> None:
            super().__init__(dbfile)
            self._dtype = dtype
            self._count = 0

        def fill(self, docnum: int) -> None:
            self._dbfile.write(bytes(self._dtype.itemsize * (docnum - self._count)))
            self._count = docnum

        def add(self, docnum: int, value: Any) -> None:
            self.fill(docnum)
            self._dbfile.write(np.array(value, dtype=self._dtype).tobytes())
            self._count = docnum + 1

        def finish(self, docnum: int) -> None:
            self.fill(docnum)

    class Reader(ColumnReader):
        def __init__(self, dbfile: Any, basepos: int, length: int, doccount: int, dtype: Any) -> None:
            super().__init__(dbfile, basepos, length, doccount)
            if length != doccount * dtype.itemsize:
                raise DamageError("the records of the maps are damaged")
            self.array: NDArray[Any] = np.frombuffer(view(dbfile, basepos, length), dtype)
            self._sign = 1

        def __getitem__(self, docnum: int) -> Any:
            return self.array[docnum].item()

        def sort_key(self, docnum: int) -> Any:
            return self._sign * self[docnum]

        def set_reverse(self) -> None:
            self._sign = -1


class NameColumn(Column):
    """One of few names a document; ``reader(…).names`` are they, ``codes`` (documents,) their numbers."""

    _default = b""

    class Writer(ColumnWriter):
        def __init__(self, dbfile: Any) -> None:
            super().__init__(dbfile)
            self._numbers: dict[str, int] = {}
            self._codes: list[int] = []

        def fill(self, docnum: int) -> None:
            missing = docnum - len(self._codes)
            if missing:
                self._codes.extend([self._numbers.setdefault("", len(self._numbers))] * missing)

        def add(self, docnum: int, value: bytes) -> None:
            self.fill(docnum)
            self._codes.append(self._numbers.setdefault(value.decode(), len(self._numbers)))

        def finish(self, docnum: int) -> None:
            self.fill(docnum)
            self._dbfile.write(np.array(self._codes, dtype="<i4").tobytes())
            self._dbfile.write(json.dumps(list(self._numbers)).encode())

    class Reader(ColumnReader):
        def __init__(self, dbfile: Any, basepos: int, length: int, doccount: int) -> None:
            super().__init__(dbfile, basepos, length, doccount)
            end = 4 * doccount
            if length < end:
                raise DamageError("the names of the datasets are damaged")
            self.codes: NDArray[np.int32] = np.frombuffer(view(dbfile, basepos, end), "<i4")
            self.names = _names(bytes(view(dbfile, basepos + end, min(length - end, LIMIT))))
            if doccount and not 0 <= self.codes.min() <= self.codes.max() < len(self.names):
                raise DamageError("the names of the datasets are damaged")

        def __getitem__(self, docnum: int) -> bytes:
            return self.names[self.codes[docnum]].encode()

        def code(self, name: str) -> int:
            """The number of a name, -1 if there is none."""
            return self.names.index(name) if name in self.names else -1


def _names(data: bytes) -> list[str]:
    """Names as JSON has them, if they can be names of datasets."""
    try:
        names = [name if name == "" else checked_name(name) for name in json.loads(data)]
    except (ValueError, TypeError, AttributeError, RecursionError, SourceError) as error:
        raise DamageError("the names of the datasets are damaged") from error
    if len(set(names)) < len(names):
        raise DamageError("the names of the datasets are damaged")
    return names
