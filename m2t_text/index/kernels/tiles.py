"""A bound of the agreement that costs a tenth of the others: maps and query on tiles of six by six cells.

The offsets of the viewpoints, -11 to 12 in x and in y, fall into four by four groups of six by six. In each
group a map's keypoint may lie near one of the query's only if its tile holds a cell that one of the query's
comes near; and a keypoint of the query near one of the map's only if a keypoint of the map lies in the thirteen
by thirteen cells from the tile on where the least offset of the group takes it. The first is looked up tile by
tile of the map, in masks made of the query, of all groups and four views at once, a lane each; see `wide`. Few
lanes are left then. Of these the second is counted, each by itself, in bits made of the map.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from m2t_text.index.kernels.bound_tables import FIRST, WINDOW
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.tile_tables import BEFORE, DIGITS, GROUPS, MIDDLE, SIDE, TILE, TileTables
from m2t_text.index.kernels.unpacking import cells_of
from m2t_text.index.kernels.wide import (
    LANES,
    WORDS,
    added,
    byte_of,
    bytes_at,
    every_byte,
    lowest,
    no_words,
    sum_of,
    twice_plus_common,
    up_to,
    words_at,
)
from m2t_text.util.compiling import inner, kernel

U = np.uint64
FULL = 64  # keypoints that an entry counts at most
STOP = 16  # entries between two looks at whether a map can still reach what is needed
ORIGIN = 6000 * TILE  # cells, added to make those of any map positive
BEYOND = ORIGIN // TILE - MIDDLE  # tiles from where they begin to the grid

assert SIDE * SIDE == 64 * WORDS
assert FIRST == -BEFORE * TILE + 1 and FIRST + GROUPS * TILE > WINDOW + 1


class Tiles(NamedTuple):
    """The maps of a segment on tiles.

    Attributes:
        starts: (D + 1,) where each map's entries begin.
        entries: (T,) uint16 tile * 64 + keypoints in it - 1; those with most keypoints first.
        sizes: (D,) int32 keypoints of each map, also those outside the grid.
        cover: (D, WORDS) uint64: whether there is a keypoint in the thirteen by thirteen cells from a tile on;
            bit SIDE · x + y of all.
    """

    starts: NDArray[np.int64]
    entries: NDArray[np.uint16]
    sizes: NDArray[np.int32]
    cover: NDArray[np.uint64]

    @classmethod
    def of(cls, texts: Texts, first: int, last: int) -> "Tiles":
        """Of the documents first...last of a segment, which are numbered from 0 on here."""
        documents = np.arange(first, last)
        room = int(texts.starts[last] - texts.starts[first])
        largest, count = texts.largest(documents), len(documents)
        entries, lengths = np.empty(room, np.uint16), np.zeros(count, np.int64)
        sizes, cover = np.zeros(count, np.int32), np.zeros((count, SIDE), np.uint32)
        _fill(texts, documents, Room.of(largest), entries, lengths, sizes, cover)
        starts = np.append(0, np.cumsum(lengths))
        return cls(starts, entries[: starts[-1]].copy(), sizes, cover.astype("<u4", copy=False).view("<u8"))

    @classmethod
    def joined(cls, parts: "list[Tiles]") -> "Tiles":
        """Those of all parts, one after the other."""
        begins = np.cumsum([0, *(part.starts[-1] for part in parts)])
        starts = [part.starts[:-1] + begin for part, begin in zip(parts, begins[:-1], strict=True)]
        rest = (np.concatenate([getattr(part, name) for part in parts]) for name in cls._fields[1:])
        return cls(np.concatenate([*starts, begins[-1:]]), *rest)


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
        tiles, places = np.zeros(SIDE * SIDE, np.int64), np.zeros(FULL + 1, np.int64)
        return cls(x, y, tiles, places, np.empty(SIDE * SIDE, np.uint16))


@kernel
def _fill(texts: Any, documents: Any, room: Any, entries: Any, lengths: Any, sizes: Any, cover: Any) -> None:
    """Fills the fields of `Tiles`, with the lengths (D,) of entries in place of where they start."""
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
    """Makes entries of tiles, those with most keypoints first, and clears the counts.

    Tiles with more keypoints than an entry counts are cut to that: the rest lie near one of the query's. The
    ``places`` (FULL + 1,) int64 and ``ordered`` (SIDE²,) uint16 are room to work in.
    """
    for keypoints in range(FULL + 1):
        places[keypoints] = 0
    for k in range(begin, end):
        places[FULL - min(count[entries[k]], FULL) + 1] += 1  # behind which place those with fewer begin
    for keypoints in range(FULL):
        places[keypoints + 1] += places[keypoints]
    for k in range(begin, end):
        tile = U(entries[k])
        keypoints = min(count[tile], FULL)
        ordered[places[FULL - keypoints]] = tile * U(FULL) + U(keypoints - 1)
        places[FULL - keypoints] += 1
        count[tile] = 0
    for k in range(begin, end):
        entries[k] = ordered[k - begin]


def _amounts() -> NDArray[np.uint8]:
    """(2 FULL, LANES) how many keypoints an entry counts, in all lanes; in the second half half as many.

    Rows lie where lines of the processor's cache begin: across two of them a row takes longer to load than to
    make of a number.
    """
    room = np.empty((2 * FULL + 1) * LANES, dtype=np.uint8)
    begin = -room.ctypes.data % LANES
    rows = room[begin : begin + 2 * FULL * LANES].reshape(-1, LANES)
    keypoints = np.arange(1, FULL + 1)[:, None]
    rows[:FULL], rows[FULL:] = keypoints, keypoints // 2
    return rows


AMOUNTS = _amounts()


def may_reach(
    tiles: Tiles,
    documents: NDArray[np.int64],
    tables: TileTables,
    needed: NDArray[np.int32],
    result: NDArray[np.bool_],
) -> None:
    """Writes whether documents (K,) may have |Q'| + |M'| >= ``needed`` (K,) to ``result`` (K,)."""
    _may_reach(tiles, documents, tables, AMOUNTS, needed, result)


@kernel
def _may_reach(tiles: Any, documents: Any, tables: Any, amounts: Any, needed: Any, result: Any) -> None:
    for k in range(len(documents)):
        document = documents[k]
        size = np.int64(tiles.sizes[document])
        spare = size + tables.size - needed[k]  # keypoints that may be missed
        shift = U(0) if spare < 255 else U(1)
        result[k] = spare >= 0
        if 0 <= spare < 510:
            result[k], others = False, np.int64(needed[k]) - size
            for g in range(U(len(tables.missed))):
                if _group_may_reach(tiles, document, tables, g, amounts, shift, U(spare), others):
                    result[k] = True
                    break


@inner
def _group_may_reach(
    tiles: Any, document: Any, tables: Any, g: Any, amounts: Any, shift: Any, spare: Any, needed: Any
) -> Any:
    """Whether |Q'| less the map's keypoints that are missed may be what is needed, in any lane."""
    missed, entries = every_byte(U(0)), tiles.entries
    place, end = U(tiles.starts[document]), U(tiles.starts[document + 1])
    table, limit, half = tables.missed[g], spare >> shift, U(FULL) * shift
    lanes = ~U(0)
    while place < end and lanes:
        stop = min(place + U(STOP), end)
        while place < stop:
            entry = U(entries[place])
            keypoints = bytes_at(amounts, half + (entry & U(FULL - 1)))
            missed = added(missed, keypoints, table[entry >> U(6)])
            place += U(1)
        lanes = up_to(missed, limit)
    counts, beyond, low = tables.counts[g], tables.beyond[g], tables.low[g]
    cover = words_at(tiles.cover, U(document))
    while lanes:
        lane = lowest(lanes)
        lanes &= lanes - U(1)
        others = needed + np.int64(byte_of(missed, lane) << shift)
        row = lane * U(DIGITS)
        covered = twice_plus_common(no_words(), words_at(counts, row), cover)
        covered = twice_plus_common(covered, words_at(counts, row + U(1)), cover)
        if 4 * np.int64(sum_of(covered)) + low[lane] >= others:  # as few do, even with all of the lower digits
            covered = twice_plus_common(covered, words_at(counts, row + U(2)), cover)
            covered = twice_plus_common(covered, words_at(counts, row + U(3)), cover)
            if np.int64(sum_of(covered)) + beyond[lane] >= others:
                return True
    return False
