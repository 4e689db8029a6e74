"""Which maps may agree with a query, as far as tiles tell: most are left out in a tenth of a bound's time.

In each lane, which is a group of offsets of one view (see `tiles`), a map may reach what is needed only if few
enough keypoints are missed, of the map and of the query. They are counted in three steps, each of which most
lanes do not outlive:

1. the query's keypoints in a few tiles that are likely to be missed, for a block of LANES maps side by side and
   four lanes, a quad, at once: missed is what all four miss;
2. the map's keypoints, tile by tile, in all lanes of a group at once;
3. all of the query's keypoints, in the lanes that are left.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from m2t_text.index.kernels.tile_tables import DIGITS, OUTSIDE, QUADS, TRIED, VIEWS, TileTables
from m2t_text.index.kernels.tiles import FULL, Tiles
from m2t_text.index.kernels.wide import (
    LANES,
    added,
    byte_of,
    bytes_at,
    every_byte,
    fetch,
    first_halves,
    lowest,
    no_words,
    put_bytes,
    quads_at,
    second_halves,
    shifted,
    smaller,
    sum_of,
    twice_plus_common,
    up_to,
    words_at,
)
from m2t_text.util.compiling import inlined, inner, kernel

U = np.uint64
STOP = 24  # entries between two looks at whether a map can still reach what is needed
AHEAD = 16  # maps; what is read of the one so far on is loaded beforehand: waiting takes longer than the work
LINES = 4  # of the processor's cache, about what the entries of a map take,
LINE = 64  # bytes of a line
AT_A_GLANCE = 16  # tiles of the query that are looked at in a glance
SIZE = 8  # keypoints by which sizes differ that count as much as one that is missed
FEW = 8  # maps of a block for which its first step is not worth while
DOUBLINGS = 4  # of rows, until there are QUADS
MOST = 254  # keypoints that a lane counts, exactly, or in pairs

assert 1 << DOUBLINGS == QUADS


def _rows(count: int) -> NDArray[np.uint8]:
    """(count, LANES) zeros, in rows that lie where lines of the processor's cache begin: across two of them a
    row takes longer to load than to make of a number."""
    room = np.zeros((count + 1) * LANES, dtype=np.uint8)
    begin = -room.ctypes.data % LANES
    return room[begin : begin + count * LANES].reshape(-1, LANES)


def _amounts() -> NDArray[np.uint8]:
    """(2 FULL, LANES) how many keypoints an entry counts, in all lanes; in the second half half as many."""
    rows, keypoints = _rows(2 * FULL), np.arange(1, FULL + 1)[:, None]
    rows[:FULL], rows[FULL:] = keypoints, keypoints // 2
    return rows


AMOUNTS = _amounts()


def may_reach(
    tiles: Tiles,
    documents: NDArray[np.int64],
    tables: TileTables,
    needed: NDArray[np.int32],
    result: NDArray[np.int32],
) -> None:
    """Writes 0 to ``result`` (K,) for documents (K,), in ascending order, that cannot have |Q'| + |M'| >=
    ``needed`` (K,), else how far they may exceed it in one of the lanes, and 1."""
    tried = _rows(QUADS + 1)  # the last one is of a map for which nothing is tried first
    _may_reach(tiles, documents, tables, AMOUNTS, tried, _rows(QUADS), needed, result)


def unlikeness(
    tiles: Tiles, documents: NDArray[np.int64], tables: TileTables, result: NDArray[np.int32]
) -> None:
    """Writes how little documents (K,), in ascending order, look like the query at a glance to ``result`` (K,):
    how many of its keypoints in a few tiles they miss at least, and how far the sizes of both maps differ."""
    _unlikeness(tiles, documents, tables, AMOUNTS, _rows(1), result)


@kernel
def _unlikeness(tiles: Any, documents: Any, tables: Any, amounts: Any, least: Any, result: Any) -> None:
    first, end = 0, len(documents)
    while first < end:
        block = U(documents[first] // LANES)
        fewest = every_byte(U(255))
        for g in range(U(len(tables.missed))):
            for quad in range(QUADS):
                if g == U(0):
                    _fetch_bare(tiles, block + U(1), U(quad), U(QUADS))
                fewest = smaller(fewest, _missed(tiles, block, tables, g, quad, amounts, AT_A_GLANCE))
        put_bytes(least, U(0), fewest)
        while first < end and U(documents[first] // LANES) == block:
            document = documents[first]
            differs = abs(np.int64(tiles.sizes[document]) - tables.size)
            result[first] = np.int64(least[0, document % LANES]) + differs // SIZE
            first += 1


@kernel
def _may_reach(
    tiles: Any,
    documents: Any,
    tables: Any,
    amounts: Any,
    tried: Any,
    room: Any,
    needed: Any,
    result: Any,
) -> None:
    first, end = 0, len(documents)
    while first < end:
        block, last = documents[first] // LANES, first
        while last < end and documents[last] // LANES == block:
            result[last] = 0
            last += 1
        many = last - first > FEW
        for g in range(U(len(tables.missed))):
            if many:
                _try_block(tiles, U(block), tables, g, amounts, tried, room)
            for k in range(first, last):
                if g == U(0):
                    _fetch_ahead(tiles, documents, k, first)
                if result[k] == 0:
                    size = np.int64(tiles.sizes[documents[k]])
                    spare, others = size + tables.size - needed[k], np.int64(needed[k]) - size
                    if spare > 2 * MOST + 1:
                        result[k] = 1
                    elif spare >= 0:
                        row = U(documents[k] % LANES) if many else U(LANES)
                        result[k] = _group_may_reach(
                            tiles, documents[k], tables, g, amounts, tried, row, U(spare), others
                        )
        first = last


@inner
def _fetch_ahead(tiles: Any, documents: Any, k: Any, first: Any) -> None:
    """Has entries loaded of a map some way on, and a part of what is bare in the next block: the share of the
    ``k``-th map, in a block that begins with the ``first``."""
    if k + AHEAD < len(documents):
        entries = U(tiles.starts[documents[k + AHEAD]])
        for line in range(U(LINES)):
            fetch(tiles.entries, entries + line * U(LINE // 2))
    _fetch_bare(tiles, U(documents[k] // LANES + 1), U(k - first), U(LANES))


@inner
def _fetch_bare(tiles: Any, block: Any, part: Any, parts: Any) -> None:
    """Has one of some parts of what is bare in a block loaded."""
    if block < U(len(tiles.bare)):
        share = U(OUTSIDE) // parts
        for word in range(U(0), share, U(LINE // 8)):
            fetch(tiles.bare, block * U(OUTSIDE + 1) + part * share + word)


@inner
def _try_block(tiles: Any, block: Any, tables: Any, g: Any, amounts: Any, tried: Any, room: Any) -> None:
    """Writes how many of the query's keypoints that are tried first a map misses in each quad: QUADS bytes for
    each of LANES maps, one after the other."""
    for quad in range(QUADS):
        put_bytes(tried, U(quad), _missed(tiles, block, tables, g, quad, amounts, TRIED))
    _transpose(tried, room)


@inlined
def _missed(tiles: Any, block: Any, tables: Any, g: Any, quad: Any, amounts: Any, count: Any) -> Any:
    """How many of the query's keypoints in so many tiles each map of a block misses in a quad."""
    places, weights, bare = tables.places[g, quad], tables.weights[g], tiles.bare[block]
    missed, weight = every_byte(U(0)), weights[quad // (QUADS // VIEWS)]
    for n in range(count):
        missed = added(missed, bytes_at(amounts, U(weight[n]) - U(1)), bare[places[n]])
    return missed


@inner
def _transpose(rows: Any, room: Any) -> None:
    """Transposes (QUADS, LANES) bytes: mixing the first half of the rows with the second moves a bit of a row's
    number to the place in a row."""
    for doubling in range(DOUBLINGS):
        old, new = (rows, room) if doubling % 2 == 0 else (room, rows)
        for row in range(U(QUADS // 2)):
            a, b = bytes_at(old, row), bytes_at(old, row + U(QUADS // 2))
            put_bytes(new, U(2) * row, first_halves(a, b))
            put_bytes(new, U(2) * row + U(1), second_halves(a, b))


@inner
def _group_may_reach(
    tiles: Any,
    document: Any,
    tables: Any,
    g: Any,
    amounts: Any,
    tried: Any,
    row: Any,
    spare: Any,
    needed: Any,
) -> Any:
    """By how much |Q'| less the map's keypoints that are missed may exceed what is needed, and 1, in the first
    lane in which it may reach that; else 0.

    ``spare`` keypoints may be missed in all; of the query those in a row of ``tried`` are.
    """
    shift = U(0) if spare <= U(MOST) else U(1)  # counted in pairs
    before, entries = shifted(quads_at(tried, row), shift), tiles.entries
    missed = before
    place, end = U(tiles.starts[document]), U(tiles.starts[document + 1])
    table, limit, half = tables.missed[g], spare >> shift, U(FULL) * shift
    lanes = up_to(missed, limit)
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
        own = byte_of(missed, lane) - byte_of(before, lane)
        others = needed + np.int64(own << shift)
        digits = lane * U(DIGITS)
        covered = twice_plus_common(no_words(), words_at(counts, digits), cover)
        covered = twice_plus_common(covered, words_at(counts, digits + U(1)), cover)
        if 4 * np.int64(sum_of(covered)) + low[lane] >= others:  # as few do, even with all of the lower digits
            covered = twice_plus_common(covered, words_at(counts, digits + U(2)), cover)
            covered = twice_plus_common(covered, words_at(counts, digits + U(3)), cover)
            more = np.int64(sum_of(covered)) + beyond[lane] - others
            if more >= 0:
                return more + 1
    return np.int64(0)
