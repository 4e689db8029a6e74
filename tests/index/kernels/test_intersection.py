"""The compiled intersection by hand, at its edges, and in parts."""

import numpy as np
import pytest
from map_oracle import random_documents, random_text, text_of

from m2t_text.config import MatchingParameters, Parameters
from m2t_text.description.text import Text
from m2t_text.index.kernels import intersection
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.views import views
from m2t_text.index.search.weighting import HistogramIntersection, MapWeighting, OffsetAgreement

ONES = np.ones(1024)
ALL_TURNS = np.ones(4, dtype=np.bool_)


def counted(query: Text, *maps: Text, window: int | None = 10) -> np.ndarray:
    """(maps, 4) numbers of matches under each turn; one column of bags of words."""
    texts, documents = Texts.of(maps), np.arange(len(maps))
    counts = np.bincount(query.wa, minlength=1024)
    if window is None:
        count, score = np.zeros(len(maps), dtype=np.int32), np.zeros(len(maps))
        intersection.bags(texts, documents, counts, ONES, count, score)
        assert np.array_equal(count, score)
        return count[:, None]
    count, score = np.zeros((len(maps), 4), dtype=np.int32), np.zeros((len(maps), 4))
    tables = intersection.IntersectionTables.of(query, window)
    intersection.intersect(texts, documents, tables, ONES, ALL_TURNS, np.zeros(len(maps)), count, score)
    assert np.array_equal(count, score)
    most = np.zeros(len(maps))
    intersection.bounds(texts, documents, counts, ONES, most)
    assert (count <= most[:, None]).all()
    return count


def matched(query: str, *maps: str, window: int | None = 10, turns: tuple[int, ...] = (0,)) -> list[list[int]]:
    return counted(text_of(query), *map(text_of, maps), window=window)[:, list(turns)].tolist()


def test_a_filtered_intersection_by_hand():
    """Word 7: two of the query's three are near a map's keypoint, three of the map's four are near one of
    the query's: 2. Word 8: one and one. Word 9: near in x but not in y. Word 3 only in the query."""
    query = "x0_y0_a7 x1_y1_a7 x50_y50_a7 x0_y0_a8 x0_y0_a9 x5_y5_a3"
    one = "x10_y10_a7 x0_y-9_a7 x-10_y0_a7 x-50_y0_a7 x3_y3_a8 x0_y11_a9 x0_y0_a4"
    assert matched(query, one) == [[3]]
    assert matched(query, one, window=None) == [[3 + 1 + 1]]


@pytest.mark.parametrize(
    "token, expected",
    [
        ("x10_y10_a5", 1), ("x11_y0_a5", 0), ("x0_y11_a5", 0), ("x-10_y-10_a5", 1), ("x-11_y0_a5", 0),
        ("x0_y-11_a5", 0), ("x0_y0_a6", 0), ("x32767_y0_a5", 0), ("x0_y-32767_a5", 0),
    ],
)  # fmt: skip
def test_the_edges_of_the_window(token, expected):
    assert matched("x0_y0_a5", token) == [[expected]]
    assert matched(token, "x0_y0_a5") == [[expected]]


def test_far_coordinates():
    assert matched("x32767_y-32767_a5", "x32757_y-32757_a5", "x32756_y-32757_a5") == [[1], [0]]
    assert matched("x32767_y-32767_a5", "x32766_y32767_a5", turns=(0, 1)) == [[0, 1]]


def test_keypoints_that_repeat_are_counted():
    assert matched("x0_y0_a5 x0_y0_a5 x0_y0_a5", "x0_y0_a5 x1_y0_a5", "x0_y0_a5", "") == [[2], [1], [0]]


@pytest.mark.parametrize("quarters", range(4))
def test_a_turned_map_is_found_at_its_turn(quarters):
    text = random_text(np.random.default_rng(quarters), 80, span=60)
    count = counted(text, text.turned(quarters))
    assert count[0].argmax() == quarters and count[0, quarters] == 80


def test_turned_coordinates_are_those_of_the_text():
    text = random_text(np.random.default_rng(0), 30)
    seen = views(text, (0, 1, 2, 3))
    x, y = seen.wx, seen.wy
    for turn in range(4):
        other, same = text.turned(turn), Text.of(x[turn], y[turn], text.wa, text.turned(turn).free)
        assert str(other) == str(same)


@pytest.mark.parametrize("needed", [0, 5, 20])
def test_what_is_needed_is_measured_whatever_else_is_left_out(needed):
    maps = [one.text for one in random_documents(0, "a", 60, keypoints=90)]
    whole = counted(maps[9], *maps)
    chosen = np.random.default_rng(0).permutation(60)[:40]
    count, score = np.zeros((40, 4), dtype=np.int32), np.zeros((40, 4))
    tables = intersection.IntersectionTables.of(maps[9], 10)
    intersection.intersect(
        Texts.of(maps), chosen, tables, ONES, ALL_TURNS, np.full(40, float(needed)), count, score
    )
    reaching = whole[chosen].max(axis=1) >= needed
    assert 0 < reaching.sum() < 40 or not needed
    assert np.array_equal(count[reaching], whole[chosen][reaching])
    assert (count[~reaching] == 0).all() or needed == 0


def test_weights_and_frequencies_are_of_live_documents():
    texts = Texts.of([text_of("x0_y0_a1 x0_y0_a1 x0_y0_a2"), text_of("x0_y0_a2"), text_of("x0_y0_a3")])
    frequency, total = np.zeros(1024, dtype=np.int64), np.zeros(3)
    intersection.document_frequency(texts, np.array([True, False, True]), frequency)
    assert frequency[:5].tolist() == [0, 1, 1, 1, 0]
    intersection.document_weight(texts, np.arange(1024.0), total)
    assert total.tolist() == [4.0, 2.0, 3.0]


def test_a_word_of_several_runs_is_one_word():
    many = Text.of(np.arange(200), np.zeros(200), np.full(200, 5))
    assert counted(many, many).tolist()[0][0] == 200
    assert counted(text_of("x0_y0_a5 x1_y0_a5"), many, window=None).tolist() == [[2]]
    frequency = np.zeros(1024, dtype=np.int64)
    intersection.document_frequency(Texts.of([many]), np.array([True]), frequency)
    assert frequency[5] == 1


def test_the_default_parameters_are_those_of_the_configuration():
    assert MapWeighting.of(MatchingParameters()) == OffsetAgreement()
    assert MapWeighting.of(MatchingParameters(score="intersection")) == HistogramIntersection()
    assert HistogramIntersection.of(Parameters().matching, "bow").window is None
