"""Whoosh columns that are read without being copied: of texts, of numbers and records, and of names."""

import json
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray
from whoosh.columns import Column, ColumnReader, ColumnWriter

from m2t_text.description.text import Text
from m2t_text.errors import MapIndexError
from m2t_text.index.mapped import view
from m2t_text.index.texts import Texts, pack

HEADER = np.dtype([("maps", "<u8"), ("keypoints", "<u8"), ("runs", "<u8"), ("wide", "<u8")])
COUNTS = np.dtype("<u4")
EMPTY = Text.of([], [], [])


def damaged() -> MapIndexError:
    """What a column tells whose parts do not fit together."""
    return MapIndexError("the index's files are damaged; index the logs again")


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
        """Raises MapIndexError if the sections do not fill the column, or the sizes the sections."""

        def __init__(self, dbfile: Any, basepos: int, length: int, doccount: int) -> None:
            super().__init__(dbfile, basepos, length, doccount)
            if length < HEADER.itemsize:
                raise damaged()
            head = np.frombuffer(view(dbfile, basepos, HEADER.itemsize), HEADER)[0]
            maps, keypoints, runs, wide = (int(head[name]) for name in HEADER.names or ())
            sizes = (HEADER.itemsize, 3 * maps * COUNTS.itemsize, 2 * runs, keypoints, keypoints, 2 * wide)
            begins = list(accumulate(sizes, initial=basepos))
            if maps != doccount or begins[-1] != basepos + length:
                raise damaged()
            table, *sections = (view(dbfile, *part) for part in zip(begins[1:-1], sizes[1:], strict=True))
            counts = np.frombuffer(table, COUNTS).reshape(3, maps)
            self.texts = Texts.read(counts, *sections)
            if (counts.sum(axis=1, dtype=np.int64) != (keypoints, runs, wide)).any():
                raise damaged()

        def __getitem__(self, docnum: int) -> Text:
            return self.texts.text(docnum)


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
                raise damaged()
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
                raise damaged()
            self.codes: NDArray[np.int32] = np.frombuffer(view(dbfile, basepos, end), "<i4")
            try:
                self.names: list[str] = json.loads(bytes(view(dbfile, basepos + end, length - end)))
            except ValueError as error:
                raise damaged() from error
            if doccount and not 0 <= self.codes.min() <= self.codes.max() < len(self.names):
                raise damaged()

        def __getitem__(self, docnum: int) -> bytes:
            return self.names[self.codes[docnum]].encode()
