"""The tokens of a segment as terms: which there are, in the order of bytes, and which documents have them.

Nothing is stored for it: all follows from the column of the texts, and is worked out when it is asked for. One
token is found by looking for its cell in all texts. Where more tokens of one x are wanted, as by a wildcard,
those of the whole x are gathered at once; and all tokens there are, where nearly all are wanted.
"""

import re
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import pairwise
from math import prod
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.text import POSES
from m2t_text.errors import DamageError
from m2t_text.index.kernels.packed import RUN, Texts, unpack_words

BLOCK = 1 << 18  # keypoints that are looked at together: their cells fit into the cache of a processor
DENSE = 1 << 28  # tokens that there may be, up to which each gets a byte of memory to say whether it is there
CELLS, COLUMNS = 64, 256  # whose documents are kept
REPEATED = 3  # tokens of one x that are looked up singly, before the whole x is gathered
NUMBERS = 1 << 10  # that a token may end in
POSE = r"x(0|-?[1-9]\d{0,4})_"
TOKEN = re.compile(rf"{POSE}y(0|-?[1-9]\d{{0,4}})_([a-z])(0|[1-9]\d{{0,3}})".encode())  # as texts are written
COLUMN = re.compile(POSE.encode())

Places = NDArray[np.int64]
Key = TypeVar("Key")


@dataclass(frozen=True)
class Postings:
    """Tokens that differ in y and number alone, and the documents that have them.

    Attributes:
        codes: (T,) int64 y and number of each, ascending; see `_code`.
        begins: (T + 1,) int64 where the documents of each begin.
        documents: (P,) int32; those of a token ascend, and are there as often as they have it.
    """

    codes: Places
    begins: Places
    documents: NDArray[np.int32]

    @classmethod
    def of(cls, codes: Places, documents: Places) -> "Postings":
        """Of the codes (P,) of some tokens in documents (P,)."""
        pairs = np.sort(codes << 32 | documents)
        begins = np.flatnonzero(np.diff(pairs >> 32, prepend=-1))
        found = (pairs & 0xFFFFFFFF).astype(np.int32)
        return cls(pairs[begins] >> 32, np.append(begins, len(pairs)), found)

    def find(self, code: int) -> NDArray[np.int32]:
        """The documents of a token."""
        k = int(np.searchsorted(self.codes, code))
        known = k < len(self.codes) and self.codes[k] == code
        return self.documents[self.begins[k] : self.begins[k + 1]] if known else self.documents[:0]


class TokenTerms:
    """The tokens of a segment that have one letter before their number.

    Args:
        texts: the cells and numbers of the tokens.
        letter: ``a`` for appearance words, ``f`` for the sides of free squares.
    """

    def __init__(self, texts: Texts, letter: str) -> None:
        self._texts = texts
        self._letter = letter
        self._columns: dict[int, Postings] = {}
        self._cells: dict[tuple[int, int], Postings] = {}
        self._asked = Counter[int]()  # for how many cells of each x

    def documents(self, token: bytes) -> NDArray[np.int32]:
        """The documents with a token, ascending, each as often as it has the token."""
        match = TOKEN.fullmatch(token)
        if match is None or match[3] != self._letter.encode():
            return np.zeros(0, dtype=np.int32)
        x, y, number = int(match[1]), int(match[2]), int(match[4])
        if x not in POSES or y not in POSES or number >= NUMBERS:
            return np.zeros(0, dtype=np.int32)
        return self._postings(x, y).find(_code(y, number))

    def _postings(self, x: int, y: int) -> Postings:
        """The tokens of this cell, or of the whole x where more than a few of its cells are asked for."""
        found = self._columns.get(x) or self._cells.get((x, y))
        if found is None:
            self._asked[x] += 1
            if self._asked[x] > REPEATED:
                return self._column(x)
            found = _kept(self._cells, (x, y), _gather(self._texts, x, y), CELLS)
        return found

    def names(self, prefix: bytes) -> Iterator[bytes]:
        """All tokens from the prefix on, in the order of their bytes."""
        if not self._texts.starts[-1]:
            return
        match = COLUMN.match(prefix)
        if match is not None:  # few tokens may be wanted: those of this x, and one more to see that it ends
            xs = self._values[0]
            for x in xs[bisect_left(xs, _before_y(int(match[1])), key=_before_y) :][:2]:
                for name in self._names_at(x):
                    if name >= prefix:
                        yield name
                        prefix = name + b"\0"
        yield from map(self._name, self._all[bisect_left(self._all, prefix, key=self._name) :].tolist())

    @cached_property
    def _values(self) -> tuple[list[int], list[int], list[int]]:
        """Each x, y and number that there is, in the order of terms."""
        there = np.zeros((2, len(POSES)), dtype=np.bool_)
        for part in self._parts():
            for seen, own in zip(there, _cells(self._texts, *part), strict=True):
                seen[own.view(np.uint16)] = True
        xs, ys = (np.flatnonzero(seen).astype(np.uint16).view(np.int16).tolist() for seen in there)
        numbers = np.unique(self._texts.runs.view("<u2") // RUN).tolist()
        return sorted(xs, key=_before_y), sorted(ys, key=_before_y), sorted(numbers, key=str)

    def _parts(self) -> Iterator[tuple[int, int]]:
        """First and last of some documents, so that all have their turn; without those that have no token."""
        starts = self._texts.starts
        ends = np.searchsorted(starts, np.arange(0, starts[-1] + BLOCK, BLOCK)).clip(max=len(starts) - 1)
        for first, last in pairwise(ends.tolist()):
            if starts[last] > starts[first]:
                yield first, last

    def _column(self, x: int) -> Postings:
        """The tokens with this x."""
        found = self._columns.get(x)
        return _kept(self._columns, x, _gather(self._texts, x), COLUMNS) if found is None else found

    def _names_at(self, x: int) -> list[bytes]:
        codes = self._column(x).codes
        ys, numbers = (codes // NUMBERS + POSES[0]).tolist(), (codes % NUMBERS).tolist()
        return sorted(f"x{x}_y{y}_{self._letter}{n}".encode() for y, n in zip(ys, numbers, strict=True))

    @cached_property
    def _strings(self) -> tuple[list[bytes], list[bytes], list[bytes]]:
        """What tokens are put together of, in the order of terms."""
        xs, ys, numbers = self._values
        ends = [f"y{y}_{self._letter}".encode() for y in ys], [str(n).encode() for n in numbers]
        return [f"x{x}_".encode() for x in xs], *ends

    @cached_property
    def _all(self) -> Places:
        """All tokens, as numbers in the order of terms: of the ranks of x, y and number."""
        ranks = [_ranks(values) for values in self._values]
        _, many_ys, many_numbers = map(len, self._values)

        def coded(part: tuple[int, int]) -> Places:
            columns = (*_cells(self._texts, *part), _numbers(self._texts, *part))
            x, y, number = (rank[own.view(np.uint16)] for rank, own in zip(ranks, columns, strict=True))
            return (x * many_ys + y) * many_numbers + number

        possible = prod(map(len, self._values))
        if possible > DENSE:
            return reduce(np.union1d, map(coded, self._parts()), np.zeros(0, dtype=np.int64))
        there = np.zeros(possible, dtype=np.bool_)
        for part in self._parts():
            there[coded(part)] = True
        return np.flatnonzero(there)

    def _name(self, code: int) -> bytes:
        xs, ys, numbers = self._strings
        rest, number = divmod(code, len(numbers))
        return xs[rest // len(ys)] + ys[rest % len(ys)] + numbers[number]


def _kept(known: dict[Key, Postings], key: Key, found: Postings, most: int) -> Postings:
    """What was found, kept with the ``most`` latest."""
    while len(known) >= most:
        known.pop(next(iter(known)), None)
    known[key] = found
    return found


def _code(y: int, number: int) -> int:
    return (y - POSES[0]) * NUMBERS + number


def _before_y(x: int) -> str:
    """What x is in a token, up to the y: the underscore comes after all digits."""
    return f"{x}_"


def _ranks(values: list[int]) -> Places:
    """(65536,) the place of each value among all, by the value's low 16 bits."""
    ranks = np.zeros(len(POSES), dtype=np.int64)
    ranks[values] = np.arange(len(values))  # negative ones count from the end
    return ranks


def _cells(texts: Texts, first: int, last: int) -> list[NDArray[np.int16]]:
    """The x and the y of documents first...last - 1."""
    begin, end = texts.starts[first], texts.starts[last]
    cells = [part[begin:end].astype(np.int16) for part in (texts.x, texts.y)]
    wide_starts = texts.wide_starts[first : last + 1]
    if wide_starts[-1] > wide_starts[0]:
        wide = np.repeat(np.diff(wide_starts) > 0, np.diff(texts.starts[first : last + 1]))
        high = texts.high[2 * wide_starts[0] : 2 * wide_starts[-1]].astype(np.int16).reshape(-1, 2)
        for cell, own in zip(cells, high.T, strict=True):
            cell[wide] += own * 256
    return cells


def _numbers(texts: Texts, first: int, last: int) -> NDArray[np.int16]:
    """The numbers of documents first...last - 1."""
    numbers = unpack_words(texts.runs.view("<u2")[texts.run_starts[first] : texts.run_starts[last]])
    if len(numbers) != texts.starts[last] - texts.starts[first]:
        raise DamageError("the keypoints of the maps are damaged")
    return numbers


def _gather(texts: Texts, x: int, y: int | None = None) -> Postings:
    """The tokens with this x, or in this cell."""
    low_x, low_y = (None if w is None else (w + 128) % 256 - 128 for w in (x, y))
    found = [np.zeros(0, dtype=np.int64)]
    for begin in range(0, len(texts.x), BLOCK):
        near = texts.x[begin : begin + BLOCK] == low_x
        if y is not None:
            near &= texts.y[begin : begin + BLOCK] == low_y
        found.append(np.flatnonzero(near) + begin)
    places = np.concatenate(found)
    documents = np.searchsorted(texts.starts, places, side="right") - 1
    cells = [part[places].astype(np.int16) for part in (texts.x, texts.y)]
    wide = np.flatnonzero(texts.wide_starts[documents + 1] > texts.wide_starts[documents])
    at = 2 * (texts.wide_starts[documents[wide]] + places[wide] - texts.starts[documents[wide]])
    for offset, cell in enumerate(cells):
        cell[wide] += texts.high[at + offset].astype(np.int16) * 256
    right = (cells[0] == x) & (True if y is None else cells[1] == y)
    places, documents, ys = places[right], documents[right], cells[1][right].astype(np.int64)
    return Postings.of((ys - POSES[0]) * NUMBERS + _numbers_at(texts, places, documents), documents)


def _numbers_at(texts: Texts, places: Places, documents: Places) -> Places:
    """The numbers of keypoints, which lie at these places in these documents; both ascend."""
    new = np.diff(documents, prepend=-1) != 0
    own, which = documents[new], np.cumsum(new) - 1
    counts = np.diff(texts.run_starts)[own]
    before = np.cumsum(counts) - counts
    runs = texts.runs.view("<u2")[np.arange(counts.sum()) + np.repeat(texts.run_starts[own] - before, counts)]
    ends, sizes = np.cumsum(runs % RUN + 1, dtype=np.int64), texts.counts[own]
    if len(ends) and ends[-1] != sizes.sum():
        raise DamageError("the keypoints of the maps are damaged")
    begins = np.cumsum(sizes) - sizes
    at = begins[which] + places - texts.starts[documents]
    return (runs[np.searchsorted(ends, at, side="right")] // RUN).astype(np.int64)
