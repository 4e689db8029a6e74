"""The names of maps and datasets, as a Whoosh column of short strings."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from whoosh.columns import Column, ColumnReader, ColumnWriter

from m2t_text.errors import DamageError

OFFSET = np.dtype("<u4")


class NameColumn(Column):
    """One string a document, as UTF-8: where each begins, and where the last one ends; then all of them."""

    _default = b""

    class Writer(ColumnWriter):
        def __init__(self, dbfile: Any) -> None:
            super().__init__(dbfile)
            self._names: list[bytes] = []

        def fill(self, docnum: int) -> None:
            self._names.extend([b""] * (docnum - len(self._names)))

        def add(self, docnum: int, value: bytes) -> None:
            self.fill(docnum)
            self._names.append(value)

        def finish(self, docnum: int) -> None:
            self.fill(docnum)
            ends = np.cumsum([0, *(len(name) for name in self._names)])
            self._dbfile.write(ends.astype(OFFSET).tobytes())
            self._dbfile.write(b"".join(self._names))

    class Reader(ColumnReader):
        """Raises DamageError if the column is too short for its documents."""

        def __init__(self, dbfile: Any, basepos: int, length: int, doccount: int) -> None:
            super().__init__(dbfile, basepos, length, doccount)
            size = (doccount + 1) * OFFSET.itemsize
            if size > length:
                raise DamageError("the names of the maps are damaged")
            self._offsets = np.frombuffer(dbfile.get(basepos, size), OFFSET).tolist()
            self._text = dbfile.get(basepos + size, length - size)

        def __getitem__(self, docnum: int) -> bytes:
            return self._text[self._offsets[docnum] : self._offsets[docnum + 1]]

        def __iter__(self) -> Iterator[bytes]:
            return (self[docnum] for docnum in range(self._doccount))

        def check(self) -> None:
            """Raises DamageError unless the names are whole, and nothing but names."""
            offsets = np.array(self._offsets)
            whole = offsets[0] == 0 and offsets[-1] == len(self._text) and (np.diff(offsets) >= 0).all()
            try:
                plain = self._text.decode().isprintable()
            except UnicodeDecodeError:
                plain = False
            if not (whole and plain):
                raise DamageError("the names of the maps are damaged")
