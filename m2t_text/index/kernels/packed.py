"""The tokens of many texts, packed into bytes: as the column stores them, and as matching reads them."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.free_squares import FreeSquares
from m2t_text.description.text import Text
from m2t_text.errors import DamageError

RUN = 64  # keypoints in a run at most: a word of 10 bits leaves 6 for the count
MOST = 1 << 20  # keypoints of a map at most: sums over them fit into the digits of `planes`

Bytes = NDArray[np.uint8]
SignedBytes = NDArray[np.int8]
Starts = NDArray[np.int64]


class Tokens(NamedTuple):
    """Tokens of a segment.

    Attributes:
        document: (N,) in which each stands, ascending.
        x, y: (N,) int16 cells.
        word: (N,) int16 appearance words, or sides of free squares.
    """

    document: NDArray[np.int64]
    x: NDArray[np.int16]
    y: NDArray[np.int16]
    word: NDArray[np.int16]


class Texts(NamedTuple):
    """All texts of a segment in the order of documents, about 2.5 bytes a keypoint.

    Attributes:
        starts: (D + 1,) where each document's keypoints begin.
        run_starts: (D + 1,) where its runs of equal words begin.
        wide_starts: (D + 1,) where its high bytes begin; a document has them for all its keypoints or none.
        runs: (2 R,) word * 64 + length - 1 of each run, low byte first.
        x, y: (N,) low bytes of the cells.
        high: (2 W,) high bytes of the x and the y of wide documents: those with a cell outside -128...127.
    """

    starts: Starts
    run_starts: Starts
    wide_starts: Starts
    runs: Bytes
    x: SignedBytes
    y: SignedBytes
    high: SignedBytes

    @classmethod
    def of(cls, texts: Iterable[Text]) -> "Texts":
        """The texts packed."""
        rows = [pack(text) for text in texts]
        sizes = np.array([(len(x), len(runs) // 2, len(high) // 2) for runs, x, _, high in rows]).reshape(-1, 3)
        sections = [b"".join(part) for part in zip(*rows, strict=True)] or [b""] * 4
        return cls.read(sizes.T, *sections)

    @classmethod
    def read(cls, sizes: NDArray[Any], runs: Any, x: Any, y: Any, high: Any) -> "Texts":
        """From (3, D) numbers of keypoints, of runs and of wide keypoints of each document, and their bytes."""
        starts, run_starts, wide_starts = (np.append(0, np.cumsum(size, dtype=np.int64)) for size in sizes)
        cells = (np.frombuffer(part, np.int8) for part in (x, y, high))
        return cls(starts, run_starts, wide_starts, np.frombuffer(runs, np.uint8), *cells)

    @property
    def documents(self) -> int:
        """D, their number."""
        return len(self.starts) - 1

    @property
    def counts(self) -> Starts:
        """(D,) number of keypoints of each document."""
        return np.diff(self.starts)

    def tokens(self) -> Tokens:
        """All tokens of all documents in their order. Raises DamageError if words and cells are not as many."""
        packed = _pairs(self.runs)
        if (packed % RUN + 1).sum(dtype=np.int64) != len(self.x):
            raise DamageError("the texts of the maps are damaged")
        x, y = self.x.astype(np.int16), self.y.astype(np.int16)
        wide = np.repeat(np.diff(self.wide_starts) > 0, self.counts)
        high = self.high.astype(np.int16).reshape(-1, 2) * 256
        x[wide] += high[:, 0]
        y[wide] += high[:, 1]
        return Tokens(np.repeat(np.arange(self.documents), self.counts), x, y, unpack_words(packed))

    def largest(self, documents: Starts) -> int:
        """The largest number of keypoints that one of some documents (K,) has."""
        return int((self.starts[documents + 1] - self.starts[documents]).max(initial=0))

    def text(self, document: int) -> Text:
        """The text of one document; a DamageError unless its words ascend, and are as many as its cells."""
        begin, end = self.starts[document : document + 2].tolist()
        x, y = (part[begin:end].astype(np.int16) for part in (self.x, self.y))
        first, last = self.wide_starts[document : document + 2].tolist()
        if last > first:
            high = self.high[2 * first : 2 * last].astype(np.int16).reshape(-1, 2) * 256
            x, y = x + high[:, 0], y + high[:, 1]
        first, last = self.run_starts[document : document + 2].tolist()
        packed = _pairs(self.runs[2 * first : 2 * last])
        if (packed % RUN + 1).sum(dtype=np.int64) != len(x) or (
            np.diff((packed // RUN).astype(np.int16)) < 0
        ).any():
            raise DamageError("the texts of the maps are damaged")
        return Text(x, y, unpack_words(packed))


def as_words(squares: FreeSquares) -> Text:
    """Squares in the form of a text, their sides being its words, to be packed like one."""
    return Text(squares.wx, squares.wy, squares.size)


def as_squares(text: Text) -> FreeSquares:
    """The squares that `as_words` made a text of. Raises DamageError if they are none."""
    squares = FreeSquares(text.wx, text.wy, text.wa)
    if not squares.valid:
        raise DamageError("the texts of the maps are damaged")
    return squares


def pack(text: Text) -> tuple[bytes, bytes, bytes, bytes]:
    """Its runs, x, y and high bytes."""
    if not len(text):
        return b"", b"", b"", b""
    x, y = text.wx.astype(np.int8), text.wy.astype(np.int8)  # keeps the low byte
    wide = b""
    if (x != text.wx).any() or (y != text.wy).any():
        high = np.stack([text.wx - x.astype(np.int32), text.wy - y.astype(np.int32)], axis=1) >> 8
        wide = high.astype(np.int8).tobytes()
    return pack_words(text.wa).tobytes(), x.tobytes(), y.tobytes(), wide


def _pairs(low_first: Bytes) -> NDArray[np.uint16]:
    """Numbers of two bytes each."""
    return np.frombuffer(low_first.tobytes(), "<u2").astype(np.uint16)


def pack_words(wa: NDArray[np.int16]) -> NDArray[np.uint16]:
    """Sorted words as runs of at most 64: word * 64 + length - 1."""
    if not len(wa):
        return np.zeros(0, "<u2")
    others = np.flatnonzero(wa[1:] != wa[:-1]) + 1  # where a word begins that is not the first
    begins = np.concatenate([[0], others])
    lengths = np.concatenate([others, [len(wa)]]) - begins
    if lengths.max() > RUN:
        runs = -(-lengths // RUN)
        first = np.cumsum(runs) - runs
        begins = np.repeat(begins - RUN * first, runs) + RUN * np.arange(runs.sum())
        lengths = np.concatenate([begins[1:], [len(wa)]]) - begins
    return (wa[begins].astype(np.int64) * RUN + lengths - 1).astype("<u2")


def unpack_words(runs: NDArray[Any]) -> NDArray[np.int16]:
    """The words that `pack_words` packed."""
    runs = runs.astype(np.uint16)
    return np.repeat((runs // RUN).astype(np.int16), (runs % RUN).astype(np.int64) + 1)
