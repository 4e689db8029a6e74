"""Maps on tiles of six by six cells, on which `sieve` leaves most of them out.

The offsets of the viewpoints, -11 to 12 in x and in y, fall into four by four groups of six by six. In each
group a map's keypoint may lie near one of the query's only if its tile holds a cell that one of the query's
comes near; and a keypoint of the query near one of the map's only if a keypoint of the map lies in the thirteen
by thirteen cells from the tile on where the least offset of the group takes it. What the first needs of a map
are its entries, what the second needs its cover.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from m2t_text.index.kernels.bound_tables import FIRST, WINDOW
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.tile_tables import BEFORE, GROUPS, MIDDLE, OUTSIDE, SIDE, TILE
from m2t_text.index.kernels.unpacking import cells_of
from m2t_text.index.kernels.wide import LANES, WORDS
from m2t_text.util.compiling import inner, kernel

U = np.uint64
FULL = 64  # keypoints that an entry counts at most
WORD = 64  # bits
RANKS = 64  # of entries
ORIGIN = 6000 * TILE  # cells, added to make those of any map positive
BEYOND = ORIGIN // TILE - MIDDLE  # tiles from where they begin to the grid

assert SIDE * SIDE == WORD * WORDS and LANES == WORD == 2 * SIDE
assert FIRST == -BEFORE * TILE + 1 and FIRST + GROUPS * TILE > WINDOW + 1


def _distance() -> NDArray[np.int64]:
    """(SIDE²,) of each tile from the viewpoint, in tiles."""
    along = np.arange(SIDE) + 0.5 - MIDDLE
    return np.rint(np.hypot(along[:, None], along)).astype(np.int64).ravel()


DISTANCE = _distance()


class Tiles(NamedTuple):
    """The maps of a segment on tiles.

    Attributes:
        starts: (D + 1,) where each map's entries begin.
        entries: (T,) uint16 tile * 64 + keypoints in it - 1; first those with many keypoints far out.
        sizes: (D,) int32 keypoints of each map, also those outside the grid.
        cover: (D, WORDS) uint64: whether there is a keypoint in the thirteen by thirteen cells from a tile on;
            bit SIDE · x + y of all.
        bare: (⌈D / LANES⌉, OUTSIDE + 1) uint64: whether a tile and its next ones in x, in y and in both are all
            without cover; a bit for each of LANES maps that follow each other. 0 if not all lie in the grid.
    """

    starts: NDArray[np.int64]
    entries: NDArray[np.uint16]
    sizes: NDArray[np.int32]
    cover: NDArray[np.uint64]
    bare: NDArray[np.uint64]

    @classmethod
    def of(cls, texts: Texts, first: int, last: int) -> "Tiles":
        """Of the documents first...last of a segment, which are numbered from 0 on here."""
        return cls.joined([TilesPart.of(texts, first, last)])

    @classmethod
    def joined(cls, parts: "list[TilesPart]") -> "Tiles":
        """Those of all parts, one after the other."""
        lengths, entries, sizes, cover = (np.concatenate(column) for column in zip(*parts, strict=True))
        return cls(np.append(0, np.cumsum(lengths)), entries, sizes, cover, _bare(cover))


class TilesPart(NamedTuple):
    """A part of the `Tiles` of a segment; the lengths (D,) of entries stand for where they start."""

    lengths: NDArray[np.int64]
    entries: NDArray[np.uint16]
    sizes: NDArray[np.int32]
    cover: NDArray[np.uint64]

    @classmethod
    def of(cls, texts: Texts, first: int, last: int) -> "TilesPart":
        """Of the documents first...last of a segment."""
        documents = np.arange(first, last)
        room = int(texts.starts[last] - texts.starts[first])
        largest, count = texts.largest(documents), len(documents)
        entries, lengths = np.empty(room, np.uint16), np.zeros(count, np.int64)
        sizes, cover = np.zeros(count, np.int32), np.zeros((count, SIDE), np.uint32)
        _fill(texts, documents, Room.of(largest), entries, lengths, sizes, cover)
        return cls(lengths, entries[: lengths.sum()].copy(), sizes, cover.astype("<u4", copy=False).view("<u8"))


class Room(NamedTuple):
    """What tiles are made in.

    Attributes:
        x, y: (N,) int32 cells of a map.
        keypoints: (SIDE²,) in each tile, 0 between two maps.
        places, ordered: see `_order`.
    """

    x: NDArray[np.int32]
    y: NDArray[np.int32]
    keypoints: NDArray[np.int64]
    places: NDArray[np.int64]
    ordered: NDArray[np.uint16]

    @classmethod
    def of(cls, size: int) -> "Room":
        """Enough for maps of so many keypoints."""
        x, y = np.empty((2, size), np.int32)
        tiles, places = np.zeros(SIDE * SIDE, np.int64), np.zeros(RANKS + 1, np.int64)
        return cls(x, y, tiles, places, np.empty(SIDE * SIDE, np.uint16))


@kernel
def _fill(texts: Any, documents: Any, room: Any, entries: Any, lengths: Any, sizes: Any, cover: Any) -> None:
    """Fills the fields of `TilesPart`."""
    x, y, keypoints, places, ordered = room
    kept: Any = U(0)
    for k in range(len(documents)):
        size = cells_of(texts, documents[k], x, y)
        begin, rows = kept, cover[k]
        for point in range(U(size)):
            i, j = np.uint32(x[point] + ORIGIN), np.uint32(y[point] + ORIGIN)
            tile_x, tile_y = np.uint32(i // np.uint32(TILE)), np.uint32(j // np.uint32(TILE))
            first_x, first_y = i == tile_x * np.uint32(TILE), j == tile_y * np.uint32(TILE)
            row: Any = np.int64(tile_x) - BEYOND
            column: Any = np.int64(tile_y) - BEYOND
            if -1 < column < SIDE + 2:  # it lies in the cells from two or three tiles on
                bits = (U(7) << U(column + 2) if first_y else U(3) << U(column + 3)) >> U(4)
                for a in range(max(row - (2 if first_x else 1), 0), min(row + 1, SIDE)):
                    rows[a] |= np.uint32(bits)
            if -1 < row < SIDE and -1 < column < SIDE:
                tile = row * SIDE + column
                if keypoints[tile] == 0:
                    entries[kept] = tile
                    kept += U(1)
                keypoints[tile] += 1
        _order(entries, begin, kept, keypoints, places, ordered)
        lengths[k], sizes[k] = kept - begin, size


@inner
def _order(entries: Any, begin: Any, end: Any, count: Any, places: Any, ordered: Any) -> None:
    """Makes entries of tiles, and clears the counts.

    What is farther from the viewpoint is missed more often, about in proportion, so tiles come in the order of
    their keypoints times their distance. Those with more keypoints than an entry counts are cut to that: the
    rest lie near one of the query's. The ``places`` (RANKS + 1,) int64 and ``ordered`` (SIDE²,) uint16 are room
    to work in.
    """
    for rank in range(RANKS + 1):
        places[rank] = 0
    for k in range(begin, end):
        places[_rank(entries[k], count) + 1] += 1  # behind which place those of a later rank begin
    for rank in range(RANKS):
        places[rank + 1] += places[rank]
    for k in range(begin, end):
        tile = U(entries[k])
        rank = _rank(tile, count)
        ordered[places[rank]] = tile * U(FULL) + U(min(count[tile], FULL) - 1)
        places[rank] += 1
    for k in range(begin, end):
        count[entries[k]] = 0
        entries[k] = ordered[k - begin]


@inner
def _rank(tile: Any, count: Any) -> Any:
    """A rank of a tile, 0 for those that are worth most."""
    return RANKS - 1 - min(min(count[tile], FULL) * DISTANCE[tile] // 2, RANKS - 1)


def _bare(cover: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """See `Tiles`."""
    bare = np.zeros((-(-len(cover) // LANES), OUTSIDE + 1), dtype=np.uint64)
    _turn(cover, bare, np.empty(LANES, dtype=np.uint64))
    return bare


@kernel
def _turn(cover: Any, bare: Any, rows: Any) -> None:
    """Fills in what is bare, with the maps of a block as bits of a word."""
    for block in range(len(bare)):
        maps = min(len(cover) - LANES * block, LANES)
        for word in range(WORDS):
            for k in range(LANES):
                rows[k] = _squares(cover[LANES * block + k], word) if k < maps else ~U(0)
            _transpose(rows)
            for tile in range(WORD):
                bare[block, WORD * word + tile] = ~rows[tile]


@inner
def _squares(cover: Any, word: Any) -> Any:
    """A word of a map's cover in which a tile also has the bits of its next ones; those beyond are covered."""
    following = cover[word + 1] if word < WORDS - 1 else ~U(0)
    both = cover[word] | (cover[word] >> U(SIDE)) | (following << U(SIDE))
    return both | (both >> U(1)) | U(1 << (SIDE - 1)) | U(1 << (WORD - 1))


@inner
def _transpose(rows: Any) -> None:
    """Transposes (64,) words as 64 by 64 bits: halves of halves change places."""
    width, mask = U(32), U(0xFFFFFFFF)
    while width:
        for k in range(U(WORD)):
            if not k & width:
                change = ((rows[k] >> width) ^ rows[k + width]) & mask
                rows[k] ^= change << width
                rows[k + width] ^= change
        width >>= U(1)
        mask ^= mask << width
