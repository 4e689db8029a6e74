"""The text of a map: tokens ``x<int>_y<int>_a<int>`` and the arrays they stand for (paper, IV-C, eq. 1).

After them come free tokens, ``x<int>_y<int>_f<int>``, where it is known what is free; see `FreeSquares`.
"""

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m2t_text.description.free_squares import CELL_RANGE, MAX_SIDE, MIN_SIDE, NO_SQUARES, FreeSquares
from m2t_text.errors import TextError
from m2t_text.util.geometry import transform

WORDS = 1024  # size of the appearance vocabulary, K = 2^D with D = 10 rings (paper, III-B)
POSES = range(-32768, 32768)  # of the pose words, in cells: what an int16 holds; a quarter turn keeps it
TOKEN = re.compile(r"x(-?\d{1,5})_y(-?\d{1,5})_([af])(\d{1,4})", re.ASCII)


@dataclass(frozen=True)
class Text:
    """Visual words ``<w_x, w_y, w_a>``, one a keypoint, ordered by (w_a, w_x, w_y).

    Attributes:
        wx, wy: (N,) int16, pose words: floor(coordinate / cell) in the map's own frame, of 0.1 m by default.
        wa: (N,) int16, appearance words, 0..1023.
        free: squares that were seen to be free: no keypoint lies in one.
    """

    wx: NDArray[np.int16]
    wy: NDArray[np.int16]
    wa: NDArray[np.int16]
    free: FreeSquares = NO_SQUARES

    @classmethod
    def of(cls, wx: ArrayLike, wy: ArrayLike, wa: ArrayLike, free: FreeSquares = NO_SQUARES) -> "Text":
        """A text of these words in the fixed order. Words out of range or in a free square are a TextError."""
        x, y, a = (np.atleast_1d(np.asarray(w, dtype=np.int64)) for w in (wx, wy, wa))
        if x.size and not (min(x.min(), y.min()) >= POSES[0] and max(x.max(), y.max()) <= POSES[-1]):
            raise TextError(f"a pose word is not within {POSES[0]}…{POSES[-1]} cells; are the units metres?")
        if a.size and not (a.min() >= 0 and a.max() < WORDS):
            raise TextError(f"an appearance word is outside 0…{WORDS - 1}")
        order = np.lexsort((y, x, a))
        x, y, a = x[order], y[order], a[order]
        text = cls(x.astype(np.int16), y.astype(np.int16), a.astype(np.int16), free)
        if text.contradicts_itself:
            k = int(np.argmax(free.covers(text.positions())))
            raise TextError(f"the keypoint x{text.wx[k]}_y{text.wy[k]}_a{text.wa[k]} lies in a free square")
        return text

    def __len__(self) -> int:
        """How many keypoints it has."""
        return len(self.wa)

    def __str__(self) -> str:
        words = [f"x{x}_y{y}_a{a}" for x, y, a in zip(self.wx, self.wy, self.wa, strict=True)]
        return " ".join([*words, *([str(self.free)] if len(self.free) else [])])

    @property
    def contradicts_itself(self) -> bool:
        """Whether a keypoint lies in a free square."""
        return bool(len(self.free)) and bool(self.free.covers(self.positions()).any())

    @property
    def words(self) -> int:
        """How many different appearance words the text has."""
        return len(np.unique(self.wa))

    def turned(self, quarters: int) -> "Text":
        """The same map described with its viewing direction turned clockwise by so many quarter turns, so
        that its keypoints turn counter-clockwise. Exact: cells map onto cells."""
        x, y = quarter_turned(self.wx.astype(np.int64), self.wy.astype(np.int64), quarters)
        return Text.of(x, y, self.wa, self.free.turned(quarters))

    def moved(self, pose: ArrayLike, cell: float) -> "Text":
        """The same keypoints in a frame in which their own frame has the ``pose`` (3,), metres and radians.

        Nearly the same is free, covered by other squares.
        """
        moved = np.floor(transform(pose, self.positions() * cell) / cell).astype(np.int64)
        return Text.of(moved[:, 0], moved[:, 1], self.wa, self._moved_free(pose, moved, cell))

    def _moved_free(self, pose: ArrayLike, occupied: NDArray[np.int64], cell: float) -> FreeSquares:
        if not len(self.free):
            return NO_SQUARES
        from m2t_text.description.free_cells import moved_squares  # compiled code, slow to import

        return moved_squares(self.free, pose, occupied, cell)

    def positions(self) -> NDArray[np.float64]:
        """(N, 2) cell centres in units of cells, in the map's own frame."""
        return np.stack([self.wx, self.wy], axis=1).astype(np.float64) + 0.5


def quarter_turned(
    x: NDArray[np.int64], y: NDArray[np.int64], quarters: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Cells (N,) turned counter-clockwise about the origin by so many quarter turns."""
    for _ in range(quarters % 4):
        x, y = -y - 1, x
    return x, y


def parse(string: str) -> Text:
    """The text that a string of tokens stands for: lossless, ``str(parse(str(text))) == str(text)``.

    Raises:
        TextError: naming the first broken token and its position, counted from 1, or a keypoint in a free
            square.

    Examples:
        >>> import m2t_text as m2t
        >>> text = m2t.parse("x12_y-3_a517 x0_y4_a9")
        >>> str(text), len(text), text.wa.tolist()
        ('x0_y4_a9 x12_y-3_a517', 2, [9, 517])
    """
    tokens = string.split()
    numbers = np.empty((len(tokens), 3), dtype=np.int64)
    free = np.zeros(len(tokens), dtype=np.bool_)
    for position, token in enumerate(tokens):
        match = TOKEN.fullmatch(token)
        if match is None or not _possible(match[3], int(match[1]), int(match[2]), int(match[4])):
            shown = token if len(token) <= 40 else token[:37] + "..."
            raise TextError(
                f"token {position + 1} is {shown!r}, neither x<int>_y<int>_a<int> with a word of 0…{WORDS - 1} "
                f"and positions of {POSES[0]}…{POSES[-1]} cells, nor x<int>_y<int>_f<int> with a side of "
                f"{MIN_SIDE}…{MAX_SIDE} cells, all within {CELL_RANGE[0]}…{CELL_RANGE[-1]}"
            )
        numbers[position], free[position] = (match[1], match[2], match[4]), match[3] == "f"
    wx, wy, wa = numbers[~free].T
    return Text.of(wx, wy, wa, FreeSquares.of(*numbers[free].T))


def _possible(kind: str, x: int, y: int, number: int) -> bool:
    """Whether a token's numbers are in range: those of a keypoint (``a``), or of a free square (``f``)."""
    if kind == "a":
        return number < WORDS and x in POSES and y in POSES
    return (
        number in range(MIN_SIDE, MAX_SIDE + 1)
        and min(x, y) >= CELL_RANGE[0]
        and max(x, y) + number <= CELL_RANGE.stop
    )
