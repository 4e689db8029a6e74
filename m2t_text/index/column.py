"""Whoosh columns that are read without being copied: of texts, of numbers and records, and of names."""

import json
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray
from whoosh.columns import Column, ColumnReader, ColumnWriter

from m2t_text.description.text import Text
from m2t_text.errors import DamageError, SourceError
from m2t_text.index.kernels.packed import MOST, RUN, Texts, pack
from m2t_text.util.names import checked_name

HEADER = np.dtype([("maps", "<u8"), ("keypoints", "<u8"), ("runs", "<u8"), ("wide", "<u8")])
COUNTS = np.dtype("<u4")
EMPTY = Text.of([], [], [])
LIMIT = 1 << 24  # bytes of the names of a segment's datasets at most


def view(file: Any, position: int, length: int) -> Any:
    """Bytes of a column's file: not copied where it is mapped into memory."""
    buffer = getattr(file, "buffer", None)
    return file.get(position, length) if buffer is None else buffer[position : position + length]


class KeypointColumn(Column):
    """One `Text` a document.

    The file holds, after a header, the numbers of keypoints, of runs and of wide keypoints of each document,
    and then the sections of `Texts`, in bytes, so that they can be used where they lie.
    """

    _default = EMPTY

    class Writer(ColumnWriter):
        def __init__(self, dbfile: Any) -> None:
            super().__init__(dbfile)
            self._sizes: list[tuple[int, int, int]] = []
            self._sections: tuple[list[bytes], ...] = ([], [], [], [])

        def fill(self, docnum: int) -> None:
            self._sizes.extend([(0, 0, 0)] * (docnum - len(self._sizes)))

        def add(self, docnum: int, value: Text) -> None:
            self.fill(docnum)
            rows = pack(value)
            for section, row in zip(self._sections, rows, strict=True):
                section.append(row)
            self._sizes.append((len(value), len(rows[0]) // 2, len(rows[3]) // 2))

        def finish(self, docnum: int) -> None:
            self.fill(docnum)
            sizes = np.array(self._sizes, dtype=np.int64).reshape(-1, 3).T
            totals = (docnum, *sizes.sum(axis=1).tolist())
            self._dbfile.write(np.array([totals], dtype=HEADER).tobytes())
            self._dbfile.write(sizes.astype(COUNTS).tobytes())
            for section in self._sections:
                self._dbfile.write(b"".join(section))

    class Reader(ColumnReader):
        """Raises DamageError if the sections do not fill the column, or the sizes the sections."""

        def __init__(self, dbfile: Any, basepos: int, length: int, doccount: int) -> None:
            super().__init__(dbfile, basepos, length, doccount)
            if length < HEADER.itemsize:
                raise DamageError("the keypoints of the maps are damaged")
            head = np.frombuffer(view(dbfile, basepos, HEADER.itemsize), HEADER)[0]
            maps, keypoints, runs, wide = (int(head[name]) for name in HEADER.names or ())
            sizes = (HEADER.itemsize, 3 * maps * COUNTS.itemsize, 2 * runs, keypoints, keypoints, 2 * wide)
            begins = list(accumulate(sizes, initial=basepos))
            if maps != doccount or begins[-1] != basepos + length:
                raise DamageError("the keypoints of the maps are damaged")
            table, *sections = (view(dbfile, *part) for part in zip(begins[1:-1], sizes[1:], strict=True))
            counts = np.frombuffer(table, COUNTS).reshape(3, maps)
            if tuple(counts.sum(axis=1, dtype=np.int64)) != (keypoints, runs, wide) or not _possible(counts):
                raise DamageError("the keypoints of the maps are damaged")
            self.texts = Texts.read(counts, *sections)

        def __getitem__(self, docnum: int) -> Text:
            return self.texts.text(docnum)


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
