"""The sieve: no map that reaches what is needed is left out, by its definition and against scores."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from map_oracle import random_text

from m2t_text.description.text import Text
from m2t_text.index.kernels import agreement
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.sieve import AT_A_GLANCE, FEW, SIZE, may_reach, unlikeness
from m2t_text.index.kernels.tile_tables import MIDDLE, OUTSIDE, SIDE, TILE, TileTables
from m2t_text.index.kernels.tiles import FULL, Tiles, TilesPart
from m2t_text.index.kernels.views import views


def reaching(query: Text, maps: list[Text], turns: tuple[int, ...], directions: int, more: int):
    """The true |Q'| + |M'| of each map, and whether the sieve lets it through if so much and more is needed."""
    texts, documents, seen = Texts.of(maps), np.arange(len(maps)), views(query, turns, directions)
    both, matched = np.zeros(len(maps), dtype=np.int32), np.zeros(len(maps), dtype=np.int32)
    found, promise = np.zeros((len(maps), 3), dtype=np.int32), np.zeros(len(maps), dtype=np.int32)
    agreement.agree(texts, documents, agreement.AgreementTables.of(seen, 10), both, matched, found)
    tiles = Tiles.of(texts, 0, len(maps))
    may_reach(tiles, documents, TileTables.of(seen), (both + more).astype(np.int32), promise)
    return both, promise > 0


@settings(max_examples=30, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([3, 30, 90, 200]),
    st.sampled_from([(0,), (0, 1, 2, 3)]),
    st.sampled_from([1, 3]),
)
def test_what_reaches_is_let_through(seed, span, turns, directions):
    rng = np.random.default_rng(seed)
    query = random_text(rng, int(rng.integers(1, 300)), span=span, words=5)
    copies = [query.turned(k).moved([*rng.uniform(-1.1, 1.1, 2), 0.0], 0.1) for k in range(4)]
    maps = copies + [random_text(rng, int(rng.integers(0, 300)), span=span, words=5) for _ in range(8)]
    both, through = reaching(query, maps, turns, directions, 0)
    assert through.all() or not both[~through].any()


def bound_by_definition(x, y, text: Text) -> int:
    """The largest |Q'| + |M'| under any group of offsets of one view (N,), as far as tiles tell."""
    i, j = text.wx // TILE + MIDDLE, text.wy // TILE + MIDDLE
    kept = (i >= 0) & (i < SIDE) & (j >= 0) & (j < SIDE)
    best = 0
    for least_x in range(-11, 13, TILE):
        for least_y in range(-11, 13, TILE):
            there = ~kept
            for k in np.flatnonzero(
                kept
            ):  # any offset takes a keypoint of the query next to a cell of its tile
                low_x, low_y = TILE * (i[k] - MIDDLE) - 6 - least_x, TILE * (j[k] - MIDDLE) - 6 - least_y
                there[k] = ((x >= low_x) & (x <= low_x + 12) & (y >= low_y) & (y <= low_y + 12)).any()
            here = 0
            for q_x, q_y in zip(x, y, strict=True):
                low_x, low_y = q_x // TILE * TILE + least_x - 1, q_y // TILE * TILE + least_y - 1
                inside = max(abs(low_x // TILE + 0.5), abs(low_y // TILE + 0.5)) < MIDDLE
                near_x = (text.wx >= low_x) & (text.wx <= low_x + 12)
                here += not inside or (near_x & (text.wy >= low_y) & (text.wy <= low_y + 12)).any()
            best = max(best, here + int(there.sum()))
    return best


@pytest.mark.parametrize("span", [20, 60, 110])
def test_it_is_as_tight_as_by_its_definition(span):
    rng = np.random.default_rng(span)
    query = random_text(rng, 60, span=span)
    maps = [random_text(rng, int(rng.integers(20, 60)), span=span) for _ in range(5)]
    maps.append(query.moved([0.4, -0.7, 0.0], 0.1))
    seen, tiles = views(query, (0, 1, 2, 3), 2), Tiles.of(Texts.of(maps * 30), 0, 180)
    bounds = [
        max(bound_by_definition(x, y, one) for x, y in zip(seen.wx, seen.wy, strict=True)) for one in maps
    ]
    assert (np.array(bounds) > [len(one) for one in maps]).all()
    all_of_three_blocks, few_of_each = np.arange(180), np.arange(0, 180, 64 // FEW)
    for documents in (all_of_three_blocks, few_of_each):
        for more in (0, 1):
            needed = np.array(bounds, dtype=np.int32)[documents % 6] + more
            promise = np.zeros(len(documents), dtype=np.int32)
            may_reach(tiles, documents, TileTables.of(seen), needed.astype(np.int32), promise)
            assert (promise == (more == 0)).all()  # and 1 more than is needed, where it is just reached


def test_what_cannot_reach_is_left_out():
    along = np.arange(40)
    query = Text.of(along, 0 * along, along % 5)
    across = Text.of(0 * along, along, along % 5)
    copy, far = query.moved([0.3, -0.5, 0.0], 0.1), query.moved([0.0, 6.0, 0.0], 0.1)
    both, through = reaching(query, [copy, across, far], (0,), 1, 0)
    assert both[0] == 80 and through[0]
    assert not reaching(query, [copy], (0,), 1, 1)[1].any()  # more keypoints than there are
    tiles, needed = Tiles.of(Texts.of([copy, across, far]), 0, 3), np.full(3, 60, np.int32)
    promise = np.zeros(3, dtype=np.int32)
    may_reach(tiles, np.arange(3), TileTables.of(views(query, (0,), 1)), needed, promise)
    assert promise[0] > 0 and promise[1:].tolist() == [0, 0]
    assert reaching(query, [across], (0, 1), 1, 0)[1].all()  # turned it is the same


def glance(query: Text, maps: list[Text]) -> list[int]:
    """How unlike each of the maps is, which are all there are of many in three blocks."""
    tiles, documents = Tiles.of(Texts.of(maps * 30), 0, 30 * len(maps)), np.arange(0, 30 * len(maps), 7)
    unlike = np.zeros(len(documents), dtype=np.int32)
    unlikeness(tiles, documents, TileTables.of(views(query, (0, 1, 2, 3), 1)), unlike)
    by_map = [set(unlike[documents % len(maps) == k].tolist()) for k in range(len(maps))]
    assert all(len(one) == 1 for one in by_map)
    return [one.pop() for one in by_map]


def test_a_glance_counts_what_is_missed_and_how_sizes_differ():
    rng = np.random.default_rng(3)
    query = random_text(rng, 300, span=60)
    same, half = query.turned(1).moved([0.9, -1.0, 0.0], 0.1), random_text(rng, 150, span=10)
    alike, unlike, nothing = glance(query, [same, half, Text.of([], [], [])])
    assert alike == 0
    tiles, counts = np.unique(
        (query.wx // TILE + MIDDLE) * SIDE + query.wy // TILE + MIDDLE, return_counts=True
    )
    away = np.hypot(tiles // SIDE - MIDDLE + 0.5, tiles % SIDE - MIDDLE + 0.5)
    most = counts[np.argsort(-counts * away, kind="stable")[:AT_A_GLANCE]].sum()
    assert 0 < unlike - 150 // SIZE <= most and nothing == 300 // SIZE + most


def test_tiles_by_their_definition():
    text = random_text(np.random.default_rng(0), 250, span=110, words=3)
    tiles = Tiles.of(Texts.of([Text.of([], [], []), text]), 0, 2)
    x, y = text.wx.astype(int), text.wy.astype(int)
    a, b = x // TILE + MIDDLE, y // TILE + MIDDLE
    inside = (a >= 0) & (a < SIDE) & (b >= 0) & (b < SIDE)
    assert 0 < inside.sum() < 250
    counts = np.bincount(a[inside] * SIDE + b[inside], minlength=SIDE * SIDE)
    entries = tiles.entries.astype(int)
    assert tiles.starts.tolist() == [0, 0, (counts > 0).sum()] and tiles.sizes.tolist() == [0, 250]
    assert dict(zip(entries // FULL, entries % FULL + 1, strict=True)) == {
        int(tile): counts[tile] for tile in np.flatnonzero(counts)
    }
    tile, keypoints = np.divmod(entries, FULL)
    along_x, along_y = tile // SIDE + 0.5 - MIDDLE, tile % SIDE + 0.5 - MIDDLE
    worth = (keypoints + 1) * np.rint(np.hypot(along_x, along_y))
    assert (np.diff(np.minimum(worth // 2, 63)) <= 0).all()
    for row in range(SIDE):
        for column in range(SIDE):
            low_x, low_y = TILE * (row - MIDDLE), TILE * (column - MIDDLE)
            taken = (x >= low_x) & (x <= low_x + 12) & (y >= low_y) & (y <= low_y + 12)
            word, bit = divmod(row * SIDE + column, 64)
            assert bool(int(tiles.cover[1, word]) >> bit & 1) == taken.any()
            low, high = (x >= low_x, y >= low_y), (x <= low_x + 18, y <= low_y + 18)
            empty = not np.all([*low, *high], axis=0).any()
            bare = int(tiles.bare[0, row * SIDE + column])
            assert bool(bare >> 1 & 1) == (empty and max(row, column) < SIDE - 1)
            assert bare & 1 == (max(row, column) < SIDE - 1)  # the first map is empty
    assert tiles.bare.shape == (1, OUTSIDE + 1) and tiles.bare[0, OUTSIDE] == 0


def test_tiles_made_in_parts_are_those_of_the_whole():
    rng = np.random.default_rng(1)
    texts = Texts.of([random_text(rng, int(rng.integers(0, 80)), span=60) for _ in range(30)])
    parts = Tiles.joined([TilesPart.of(texts, *part) for part in ((0, 11), (11, 12), (12, 30))])
    for part, whole in zip(parts, Tiles.of(texts, 0, 30), strict=True):
        assert np.array_equal(part, whole)


def test_many_keypoints_in_a_tile_or_in_all_are_let_through_rather_than_counted_wrong():
    many = Text.of(np.zeros(900), np.zeros(900), np.zeros(900))
    huge = Text.of(np.arange(30_000) % 200 - 100, np.arange(30_000) // 200 - 75, np.zeros(30_000))
    for query, found in ((many, many), (many, huge), (huge, many)):
        assert reaching(query, [found], (0,), 1, 0)[1].all()
