"""The compiled intersection by hand, at its edges, and in parts."""

import numpy as np
import pytest
from map_oracle import random_documents, random_text, text_of

from m2t_text.config import MatchingParameters, Parameters
from m2t_text.description.text import Text
from m2t_text.index import kernel
from m2t_text.index.postings import Postings
from m2t_text.index.views import views
from m2t_text.index.weighting import HistogramIntersection, MapWeighting, OffsetAgreement, intersect

ONES = np.ones(1024)


def postings_of(*texts: Text) -> Postings:
    doc = np.repeat(np.arange(len(texts), dtype=np.int32), [len(text) for text in texts])
    rows = np.concatenate([np.stack([text.wx, text.wy, text.wa]) for text in texts], axis=1)
    return Postings.of(len(texts), doc, Text(*rows))


def matched(query: str, *maps: str, window: int | None = 10, turns: tuple[int, ...] = (0,)) -> list[list[int]]:
    model = HistogramIntersection(window, turns, weighted=False)
    count, score = intersect(postings_of(*map(text_of, maps)), text_of(query), model, ONES)
    assert np.array_equal(count, score)
    return count[:, : len(turns)].tolist()


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
    count, _ = intersect(postings_of(text.turned(quarters)), text, HistogramIntersection(), ONES)
    assert count[0].argmax() == quarters and count[0, quarters] == 80


def test_turned_coordinates_are_those_of_the_text():
    text = random_text(np.random.default_rng(0), 30)
    seen = views(text, (0, 1, 2, 3))
    x, y = seen.wx, seen.wy
    for turn in range(4):
        other, same = text.turned(turn), Text.of(x[turn], y[turn], text.wa)
        assert str(other) == str(same)


def test_ranges_of_documents_add_up_to_the_whole():
    texts = [one.text for one in random_documents(0, "a", 30)]
    postings, query = postings_of(*texts), texts[9]
    whole, _ = intersect(postings, query, HistogramIntersection(), ONES)
    words, firsts = np.unique(query.wa, return_index=True)
    seen = views(query, (0, 1, 2, 3))
    x, y = seen.wx, seen.wy
    count, score = np.zeros((30, 4), dtype=np.int32), np.zeros((30, 4))
    for begin, end in ((20, 30), (0, 7), (7, 7), (7, 20)):
        kernel.filtered(
            postings.starts, postings.doc, postings.wx, postings.wy, words.astype(np.int64),
            np.append(firsts, len(query)), x, y, 10, ONES, begin, end, count, score,
        )  # fmt: skip
    assert np.array_equal(count, whole)


def test_postings_are_sorted_by_word_and_document():
    texts = [one.text for one in random_documents(1, "a", 20)]
    postings = postings_of(*texts)
    words = np.repeat(np.arange(1024), np.diff(postings.starts))
    assert np.array_equal(np.lexsort((postings.doc, words)), np.arange(len(words)))
    assert postings.starts[0] == 0 and postings.starts[-1] == sum(map(len, texts))


def test_weights_and_frequencies_are_of_live_documents():
    postings = postings_of(text_of("x0_y0_a1 x0_y0_a1 x0_y0_a2"), text_of("x0_y0_a2"), text_of("x0_y0_a3"))
    frequency, total = np.zeros(1024, dtype=np.int64), np.zeros(3)
    kernel.document_frequency(postings.starts, postings.doc, np.array([True, False, True]), frequency)
    assert frequency[:5].tolist() == [0, 1, 1, 1, 0]
    kernel.document_weight(postings.starts, postings.doc, np.arange(1024.0), total)
    assert total.tolist() == [4.0, 2.0, 3.0]


def test_the_default_parameters_are_those_of_the_configuration():
    assert MapWeighting.of(MatchingParameters()) == OffsetAgreement()
    assert MapWeighting.of(MatchingParameters(score="intersection")) == HistogramIntersection()
    assert HistogramIntersection.of(Parameters().matching, "bow").window is None
