"""Searching only as far as bounds demand: nothing is missed, and the order is that of all scores."""

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from map_oracle import document, random_text

from m2t_text.config import MatchingParameters, Parameters
from m2t_text.description.text import Text
from m2t_text.index.kernels import agreement, bit_sums, bound_tables, bounds, simd
from m2t_text.index.kernels.bitmaps import COARSE, FINE
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.views import views
from m2t_text.index.map_index import MapIndex
from m2t_text.index.ranking import Recent
from m2t_text.index.search import collection, top_k
from m2t_text.index.segment import Address

pytestmark = pytest.mark.usefixtures("two_threads")

U = np.uint64
DIGITS = 24  # of a sum


def walls(rng: np.random.Generator, keypoints: int, span: int, words: int = 40) -> Text:
    """Keypoints along a few lines, as maps have them."""
    lines = rng.integers(-span, span, (4, 2)), rng.choice([(1, 0), (0, 1), (1, 1)], 4)
    line = rng.integers(0, 4, keypoints)
    along = rng.integers(0, span, keypoints)
    cells = np.unique(lines[0][line] + along[:, None] * lines[1][line], axis=0)
    return Text.of(cells[:, 0], cells[:, 1], (cells[:, 0] // 9 * 7 + cells[:, 1] // 9) % words)


def measured(query: Text, maps: list[Text], turns: tuple[int, ...], directions: int):
    """|Q'| + |M'| of each map, and its bounds: the coarse one, the larger of both tighter ones, and the fine
    one where the coarse one reaches the median."""
    texts, documents = Texts.of(maps), np.arange(len(maps))
    seen = views(query, turns, directions)
    both, matched = np.zeros(len(maps), dtype=np.int32), np.zeros(len(maps), dtype=np.int32)
    found = np.zeros((len(maps), 3), dtype=np.int32)
    agreement.agree(texts, documents, agreement.AgreementTables.of(seen, 10), both, matched, found)
    bounder = bound_tables.CoarseTables.of(seen)
    tables = texts, documents, bounder, bound_tables.FineTables.of(seen, bounder)
    look = bounds.Look(COARSE.scratch(), FINE.scratch(), few=0)
    coarse = bounds.coarse_bounds(*tables, np.zeros_like(both), look)
    early = bounds.coarse_bounds(*tables, both + 1, look)
    assert ((early == coarse) | (early == 0)).all()
    tighter = bounds.coarse_bounds(*tables, np.maximum(both, 1), look._replace(few=16))
    assert (tighter >= both).all()
    needed = np.maximum(np.full(len(maps), int(np.median(both)), dtype=np.int32), 1)
    fine = bounds.fine_bounds(*tables, needed, look)
    return both, coarse, np.maximum(tighter, fine), fine, needed


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([30, 90, 140, 300]), st.sampled_from([1, 3]))
def test_no_score_exceeds_its_bounds(seed, span, directions):
    rng = np.random.default_rng(seed)
    query = walls(rng, 150, span)
    copies = [query.turned(k).moved([*rng.uniform(-1.2, 1.2, 2), 0.0], 0.1) for k in range(4)]
    maps = copies + [walls(rng, int(rng.integers(1, 300)), span) for _ in range(8)]
    both, coarse, tighter, fine, needed = measured(query, maps, (0, 1, 2, 3), directions)
    assert (coarse >= both).all()
    if max(np.abs(query.wx).max(), np.abs(query.wy).max()) < bound_tables.LIMIT / 1.5:  # in each direction
        assert (tighter <= coarse).all()
    assert (fine[both >= needed] >= both[both >= needed]).all()


def test_keypoints_that_repeat_and_maps_without_any():
    query = Text.of(np.zeros(50), np.zeros(50), np.full(50, 3))
    both, coarse, _, fine, _ = measured(query, [query, Text.of([], [], []), Text.of([3], [0], [3])], (0, 1), 1)
    assert both.tolist() == [100, 0, 51] and (coarse >= both).all()
    assert fine[0] == 100 and fine[2] in (0, 51)


def test_the_fine_bound_is_the_largest_overlap_of_all_offsets():
    rng = np.random.default_rng(5)
    query, found = walls(rng, 200, 60), walls(rng, 200, 60)
    both, _, _, fine, needed = measured(query, [found], (0,), 1)
    q, m = (np.stack([t.wx, t.wy], 1).astype(int) for t in (query, found))
    most = 0
    for dx in range(bound_tables.FIRST, bound_tables.FIRST + 26):
        for dy in range(bound_tables.FIRST, bound_tables.FIRST + 26):
            near = np.abs(q[:, None] + [dx, dy] - m[None]).max(axis=2) <= 1
            most = max(most, int(near.any(axis=0).sum() + near.any(axis=1).sum()))
    assert both[0] <= fine[0] <= most
    assert needed[0] <= fine[0]


@given(
    st.lists(st.tuples(*[st.integers(0, 2**64 - 1)] * 4), max_size=90), st.integers(0, 3), st.integers(0, 200)
)
def test_sums_of_bits(masks, digit, number):
    filled = np.array([*masks, *[(0, 0, 0, 0)] * (-len(masks) % 8)], dtype=np.uint64).reshape(-1, 4)
    sums = np.zeros((DIGITS, 4), dtype=np.uint64)
    add_masks(filled, len(filled), sums, 0)
    add_masks(filled, len(filled), sums, digit)
    reaching = np.zeros((1, 4), dtype=np.uint64)
    written_at_least(sums, number, reaching)
    wanted = np.zeros((4, 64), dtype=int)
    for lane in range(4):
        wanted[lane] = [(1 + 2**digit) * sum(mask[lane] >> bit & 1 for mask in masks) for bit in range(64)]
        column = [int(plane) for plane in sums[:, lane]]
        got = [sum((plane >> bit & 1) << place for place, plane in enumerate(column)) for bit in range(64)]
        assert got == wanted[lane].tolist()
        told = [bool(int(reaching[0, lane]) >> bit & 1) for bit in range(64)]
        assert told == (wanted[lane] >= number).tolist()
    assert largest(sums, ~U(0)) == wanted.max()
    assert largest(sums, U(0b1010)) == wanted[:, [1, 3]].max()


@numba.njit
def add_masks(masks, count, sums, digit):
    bytes_of_all = masks.reshape(-1).view(np.uint8)
    bit_sums.add_masks((bytes_of_all, 0), 8 * np.arange(4 * count).reshape(-1, 4), 0, count, sums, digit)


@numba.njit
def largest(sums, among):
    return bit_sums.largest(sums, among)


@numba.njit
def written_at_least(sums, number, rows):
    simd.put(rows, U(0), bit_sums.at_least(sums, number))


def test_sums_that_need_many_digits():
    masks = np.full((6000, 4), ~U(0))
    sums = np.zeros((DIGITS, 4), dtype=np.uint64)
    add_masks(masks, 6000, sums, 3)
    assert largest(sums, ~U(0)) == 48_000


@numba.njit
def written(bits, places, move, rows):
    """What the operations on lanes give, a row each."""
    a, b = simd.at(rows, U(0)), simd.at(rows, U(1))
    simd.put(rows, U(2), a & b)
    simd.put(rows, U(3), a | b)
    simd.put(rows, U(4), a ^ b)
    simd.put(rows, U(5), ~a)
    simd.put(rows, U(6), simd.every(U(7)))
    simd.put(rows, U(7), simd.gathered(bits, places, U(1), move))
    return simd.some(a & b)


def test_lanes_are_four_words():
    rng = np.random.default_rng(2)
    rows = rng.integers(0, 2**64, (8, 4), dtype=np.uint64)
    rows[1] = [0, 0, 1 << 63, 0]
    rows[0, 2] |= U(1 << 63)
    bits, places = rng.integers(0, 256, 100, dtype=np.uint8), np.array([[0, 0, 0, 0], [0, 13, 60, 85]])
    a, b = rows[0].copy(), rows[1].copy()
    assert written(bits, places, 7, rows)
    assert rows[2:7].tolist() == [(a & b).tolist(), (a | b).tolist(), (a ^ b).tolist(), (~a).tolist(), [7] * 4]
    assert rows[7].tolist() == [int.from_bytes(bits[p + 7 : p + 15].tobytes(), "little") for p in places[1]]
    rows[0, 2] = 0
    assert not written(bits, places, 0, rows)


@pytest.mark.parametrize("score", ["agreement", "intersection"])
@pytest.mark.parametrize("weighted", [True, False])
@pytest.mark.parametrize(
    ("loose", "sample", "likely"), [(0.0, 40, 7), (1.0, 40, 7), (1.0, 40, 1000), (0.0, 1000, 7), (1.0, 1000, 7)]
)
def test_the_best_are_the_first_of_all(tmp_path, monkeypatch, score, weighted, loose, sample, likely):
    """Also with ties, which go by the map id, and across segments with deletions; sieved or not."""
    small = {"SIEVED": 2, "SAMPLES": (sample // 2, sample), "FEW": 10, "LOOSE": loose, "LIKELY": likely}
    for name, value in small.items():
        monkeypatch.setattr(top_k, name, value)
    monkeypatch.setattr(collection, "ALONE", 2)
    rng = np.random.default_rng(3)
    parameters = Parameters(matching=MatchingParameters(score=score, weighted=weighted))
    index = MapIndex.create(tmp_path / "index", parameters)
    texts = [walls(rng, int(rng.integers(20, 120)), 40) for _ in range(40)]
    for name in ("b", "c", "a", "b"):  # the second b replaces the first
        index.replace(name, [document(name, n, text) for n, text in enumerate(texts)])
    for query in (texts[7], walls(rng, 90, 40), random_text(rng, 30)):
        everything = index.search(query, top=0)
        for top in (1, 2, 10, 50, 1000):
            best = index.search(query, top)
            wanted = [hit for hit in everything if hit.score > 0][:top]
            assert [(h.map_id, h.score, h.matched) for h in best] == [
                (h.map_id, h.score, h.matched) for h in wanted
            ]
            assert all(np.array_equal(a.alignment, b.alignment) for a, b in zip(best, wanted, strict=True))


def two_datasets(path, rng, maps):
    """An index of so many maps in each of two datasets, and the texts of the last."""
    index = MapIndex.create(path, Parameters(matching=MatchingParameters(score="agreement")))
    for name in ("b", "a"):
        texts = [walls(rng, int(rng.integers(20, 120)), 40) for _ in range(maps)]
        index.replace(name, [document(name, n, text) for n, text in enumerate(texts)])
    return index, texts


@pytest.mark.parametrize(("sieved", "sample"), [(2, 40), (2, 1000), (10**9, 40)])
def test_a_bounded_question_is_answered_as_if_all_maps_were_looked_through(
    tmp_path, monkeypatch, sieved, sample
):
    """The best hits above a score that a caller wants, wherever they stand among the others."""
    samples = {"SAMPLES": (sample // 2, sample), "FEW": 10, "LIKELY": 7 if sample > 40 else 100}
    for name, value in {"SIEVED": sieved, "LOOSE": 1.0, **samples}.items():
        monkeypatch.setattr(top_k, name, value)
    monkeypatch.setattr(collection, "ALONE", 0)
    rng = np.random.default_rng(4)
    index, texts = two_datasets(tmp_path / "index", rng, 80)
    asked = 0

    def turned(hit):
        nonlocal asked
        asked += 1
        return abs(hit.alignment[2]) > 1.0 and hit.document.first_scan % 3 > 0

    for query in (texts[7], walls(rng, 90, 40)):
        everything = index.search(query, top=0)
        for least in (0.0, 0.2, everything[40].score, 2.0):
            for top in (1, 3, 20):
                wanted = [hit for hit in everything if hit.score >= max(least, 1e-9) and turned(hit)][:top]
                asked = 0
                found = index.search(query, top, least=least, wanted=turned)
                assert [(h.map_id, h.score) for h in found] == [(h.map_id, h.score) for h in wanted]
                assert asked <= 2 * len(everything)  # some of a sample, and then of all
                plain = [hit.map_id for hit in everything if hit.score >= max(least, 1e-9)][:top]
                assert [hit.map_id for hit in index.search(query, top, least=least)] == plain


@pytest.mark.parametrize(("size", "spared"), [(3, False), (60, True)])  # of a sample
def test_what_searches_found_before_is_looked_at_first_and_changes_no_answer(
    tmp_path, monkeypatch, size, spared
):
    small = {"SIEVED": 2, "SAMPLES": (size, 80), "GLANCED": 30, "BLOCK": 4, "AROUND": 1, "FEW": 10}
    for name, value in small.items():
        monkeypatch.setattr(top_k, name, value)
    monkeypatch.setattr(collection, "ALONE", 0)
    rng = np.random.default_rng(6)
    index, texts = two_datasets(tmp_path / "index", rng, 40)
    looked: list[int] = []
    original, sampled = top_k.TopK.promising, top_k.TopK._sampled
    samples: list[int] = []

    def counted(self, found):
        samples.append(found.samples)
        return sampled(self, found)

    monkeypatch.setattr(top_k.TopK, "_sampled", counted)

    def promising(self, top, least, wanted, likely, parts):
        looked.append(-1 if likely is None else len(likely))
        return original(self, top, least, wanted, likely, parts)

    monkeypatch.setattr(top_k.TopK, "promising", promising)
    expected = [index.search(text, 5, exclude=("a", 9.0, 8.0)) for text in texts]
    assert samples.count(0) == len(texts) == len(looked)
    samples.clear()
    pinned = index.pinned()
    found = [pinned.search(text, 5, exclude=("a", 9.0, 8.0)) for text in texts]
    assert [[(h.map_id, h.score) for h in hits] for hits in found] == [
        [(h.map_id, h.score) for h in hits] for hits in expected
    ]
    assert looked[:42] == [-1] * 40 + [0, 0] and max(looked[42:]) > 30
    assert (samples.count(0) < len(texts)) == spared


def test_what_was_found_is_looked_at_only_while_searches_follow_each_other(tmp_path):
    index, _ = two_datasets(tmp_path / "index", np.random.default_rng(7), 12)
    segments, recent = index.snapshot().segments, Recent()
    first, second = ([Address(segments[0], k) for k in some] for some in ((1, 5), (3, 5)))
    every = [np.arange(len(segment.live)) for segment in segments]
    recent.add(first)
    assert not len(recent.places(segments, every))
    recent.add(second)  # one of them was found before
    assert recent.places(segments, every).tolist() == [1, 3, 5]
    assert recent.places(segments, [np.array([0, 3, 5]), *every[1:]]).tolist() == [1, 2]
    for k in range(4):
        assert len(recent.places(segments, every))
        recent.add([Address(segments[0], 6 + k)])
    assert not len(recent.places(segments, every))
