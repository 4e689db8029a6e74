"""The keypoints of all maps of a segment, as a Whoosh column of texts."""

from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray
from whoosh.columns import Column, ColumnReader, ColumnWriter

from m2t_text.description.text import Text
from m2t_text.errors import MapIndexError
from m2t_text.index.postings import Texts

RUN = 64  # keypoints in a run at most: a word of 10 bits leaves 6 for the count
HEADER = np.dtype([("maps", "<u4"), ("runs", "<u8"), ("keypoints", "<u8"), ("wide", "<u8")])
COUNTS = np.dtype([("runs", "<u4"), ("keypoints", "<u4"), ("wide", "<u4")])
EMPTY = Text.of([], [], [])


class KeypointColumn(Column):
    """One `Text` a document, about 2.5 bytes a keypoint.

    The file holds, after a header, five sections for all documents together, so that a segment is decoded
    in a few vectorised steps: counts of each document; runs of equal words, ``word * 64 + length - 1`` in
    16 bits; the low bytes of x; those of y; and the high bytes of x and y of the documents that need them
    (a coordinate outside -128...127 cells). The reader gives what the writer takes, as merging demands.
    """

    _default = EMPTY

    class Writer(ColumnWriter):
        def __init__(self, dbfile: Any) -> None:
            super().__init__(dbfile)
            self._counts: list[tuple[int, int, int]] = []
            self._sections: tuple[list[bytes], ...] = ([], [], [], [])

        def fill(self, docnum: int) -> None:
            self._counts.extend([(0, 0, 0)] * (docnum - len(self._counts)))

        def add(self, docnum: int, value: Text) -> None:
            self.fill(docnum)
            runs = pack_words(value.wa)
            x, y = value.wx.astype(np.int8), value.wy.astype(np.int8)  # keeps the low byte
            high = np.stack([value.wx - x.astype(np.int32), value.wy - y.astype(np.int32)], axis=1) >> 8
            wide = len(value) if high.any() else 0
            rows: tuple[NDArray[Any], ...] = (runs, x, y, high[:wide].astype(np.int8))
            for section, row in zip(self._sections, rows, strict=True):
                section.append(row.tobytes())
            self._counts.append((len(runs), len(value), wide))

        def finish(self, docnum: int) -> None:
            self.fill(docnum)
            counts = np.array(self._counts, dtype=COUNTS)
            sums = (int(counts[name].sum(dtype=np.int64)) for name in ("runs", "keypoints", "wide"))
            self._dbfile.write(np.array([(len(counts), *sums)], dtype=HEADER).tobytes())
            self._dbfile.write(counts.tobytes())
            for section in self._sections:
                self._dbfile.write(b"".join(section))

    class Reader(ColumnReader):
        """Raises MapIndexError if the sections do not fill the column."""

        def __init__(self, dbfile: Any, basepos: int, length: int, doccount: int) -> None:
            super().__init__(dbfile, basepos, length, doccount)
            head = np.frombuffer(dbfile.get(basepos, HEADER.itemsize), HEADER)[0]
            maps, runs, keypoints, wide = (int(head[name]) for name in HEADER.names or ())
            sizes = (HEADER.itemsize, maps * COUNTS.itemsize, 2 * runs, keypoints, keypoints, 2 * wide)
            self._at = list(accumulate(sizes, initial=basepos))
            if maps != doccount or self._at[-1] != basepos + length:
                raise MapIndexError("the index's keypoints are damaged; index the logs again")
            self._counts = np.frombuffer(dbfile.get(self._at[1], sizes[1]), COUNTS)
            self._first: NDArray[np.int64] | None = None

        def __getitem__(self, docnum: int) -> Text:
            if self._first is None:
                before = [np.cumsum(self._counts[name]) - self._counts[name] for name in COUNTS.names or ()]
                self._first = np.stack(before, axis=1)
            return self._read(self._first[docnum], np.array(self._counts[docnum].tolist()))

        def _read(self, first: NDArray[np.int64], count: NDArray[np.int64]) -> Text:
            """The text of the documents that begin at these runs, keypoints and wide keypoints."""

            def section(number: int, kind: int, size: int, dtype: str) -> NDArray[Any]:
                place = self._at[number] + size * int(first[kind])
                return np.frombuffer(self._dbfile.get(place, size * int(count[kind])), dtype)

            x, y = (section(number, 1, 1, "i1").astype(np.int16) for number in (3, 4))
            if count[2]:
                high = section(5, 2, 2, "i1").reshape(-1, 2).astype(np.int16) * 256
                needed = slice(None) if len(high) == len(x) else self._wide()
                x[needed] += high[:, 0]
                y[needed] += high[:, 1]
            return Text(x, y, unpack_words(section(2, 0, 2, "<u2")))

        def _wide(self) -> NDArray[np.bool_]:
            return np.repeat(self._counts["wide"] > 0, self._counts["keypoints"])

        def counts(self) -> NDArray[np.int64]:
            """(documents,) number of keypoints of each document."""
            return self._counts["keypoints"].astype(np.int64)

        def all(self) -> Texts:
            """All keypoints in the order of documents."""
            sums = np.array([int(self._counts[name].sum(dtype=np.int64)) for name in COUNTS.names or ()])
            return Texts(self.counts(), self._read(np.zeros(3, dtype=np.int64), sums))


def pack_words(wa: NDArray[np.int16]) -> NDArray[np.uint16]:
    """Sorted words as runs of at most 64: word * 64 + length - 1."""
    place = np.arange(len(wa))
    fresh = np.diff(wa, prepend=-1) != 0
    in_word = place - np.maximum.accumulate(np.where(fresh, place, 0)) if len(wa) else place
    begins = np.flatnonzero(in_word % RUN == 0)
    lengths = np.diff(begins, append=len(wa))
    return (wa[begins].astype(np.int64) * RUN + lengths - 1).astype("<u2")


def unpack_words(runs: NDArray[np.uint16]) -> NDArray[np.int16]:
    """The words that `pack_words` packed."""
    return np.repeat((runs // RUN).astype(np.int16), (runs % RUN).astype(np.int64) + 1)
