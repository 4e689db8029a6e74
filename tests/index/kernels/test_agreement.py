"""Agreement on one offset: by hand, against a slow definition, and the views in which a query is tried."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from map_oracle import random_text, text_of

from m2t_text.description.text import Text
from m2t_text.index.kernels import agreement
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.kernels.scores import Scores
from m2t_text.index.kernels.views import views
from m2t_text.index.search.collection import Collection, SegmentTexts
from m2t_text.index.search.weighting import OffsetAgreement, agreed_by_turn

ONE_VIEW = OffsetAgreement(10, (0,), 1)


def texts_of(*texts: Text) -> Texts:
    return Texts.of(texts)


def agreed(texts: Texts, query: Text, model: OffsetAgreement) -> Scores:
    live = np.ones(texts.documents, dtype=bool)
    whole = Collection({"": SegmentTexts(texts, live)}, texts.documents)
    return model.text_scorer(query, whole).score("", np.arange(texts.documents))


def slow(query: Text, found: Text, window: int) -> tuple[int, int, tuple[int, int]]:
    """|Q'|, |M'| and the offset, for one view and few keypoints of a word, step by step."""
    q, m = (np.stack([t.wx, t.wy], 1).astype(int) for t in (query, found))
    pairs = m[None] - q[:, None]
    pairs = pairs[(query.wa[:, None] == found.wa[None]) & (np.abs(pairs).max(axis=2) <= window)]
    if not len(pairs):
        return 0, 0, (0, 0)
    offsets = [(x, y) for x in range(-window, window + 1) for y in range(-window, window + 1)]
    weight = {0: 2, 1: 1}
    votes = [
        sum(weight.get(abs(px - x), 0) * weight.get(abs(py - y), 0) for px, py in pairs.tolist())
        for x, y in offsets
    ]
    x, y = offsets[int(np.argmax(votes))]
    best = (0, 0, (0, 0))
    for k in (4, *range(9)):  # the peak itself first
        dx, dy = k // 3 - 1, k % 3 - 1
        near = np.abs(m[None] - (q + np.array([x + dx, y + dy]))[:, None]).max(axis=2) <= 1
        here, there = int(near.any(axis=1).sum()), int(near.any(axis=0).sum())
        if here + there > best[0] + best[1]:
            best = (here, there, (x + dx, y + dy))
    return best


def test_by_hand():
    query = text_of("x0_y0_a1 x5_y0_a2 x0_y9_a3")
    # Moved by (4, -3); the third keypoint is missing, and one is somewhere else.
    found = text_of("x4_y-3_a1 x9_y-3_a2 x-50_y-50_a7")
    scores = agreed(texts_of(found), query, ONE_VIEW)
    assert scores.alignment.tolist() == [[4.0, -3.0, 0.0]]
    assert scores.matched.tolist() == [2] and scores.score.tolist() == [4 / 6]


def test_words_vote_but_any_keypoint_counts():
    query = text_of("x0_y0_a1 x20_y0_a5")
    found = text_of("x0_y0_a1 x20_y0_a6")
    assert agreed(texts_of(found), query, ONE_VIEW).score.tolist() == [1.0]
    assert agreed(texts_of(text_of("x0_y0_a8 x20_y0_a6")), query, ONE_VIEW).score.tolist() == [0.0]


@pytest.mark.parametrize(("offset", "score"), [(10, 1.0), (11, 0.0)])
def test_the_window_bounds_the_offset(offset, score):
    query, found = text_of("x0_y0_a1"), text_of(f"x{offset}_y{-offset}_a1")
    assert agreed(texts_of(found), query, ONE_VIEW).score.tolist() == [score]


def test_an_offset_with_more_votes_than_are_counted_has_the_most():
    """Many keypoints in one cell, as no map has them."""
    often, seldom = agreement.FULL // agreement.VOTERS + 100, 200
    query = Text.of([0] * 48 + [40] * 48, [0] * 96, [1] * 48 + [2] * 48)
    found = Text.of([3] * often + [48] * seldom, [-2] * often + [5] * seldom, [1] * often + [2] * seldom)
    assert agreed(texts_of(found), query, ONE_VIEW).alignment.tolist() == [[3.0, -2.0, 0.0]]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, agreement.VOTERS), st.sampled_from([2, 10]))
def test_scores_are_those_of_the_definition(seed, size, window):
    rng = np.random.default_rng(seed)
    query = random_text(rng, size, span=25, words=4)
    stored = [random_text(rng, int(rng.integers(1, 30)), span=25, words=4) for _ in range(5)]
    scores = agreed(texts_of(*stored), query, OffsetAgreement(window, (0,), 1))
    for k, text in enumerate(stored):
        here, there, offset = slow(query, text, window)
        assert scores.matched[k] == min(here, there)
        assert scores.score[k] == (here + there) / (len(query) + len(text))
        if here:
            assert tuple(scores.alignment[k, :2].astype(int)) == offset


@pytest.mark.parametrize("turn", range(4))
def test_a_turned_and_moved_map_is_the_same_map(turn):
    query = random_text(np.random.default_rng(1), 200, span=60, words=9)
    found = query.turned(turn).moved([0.4, -0.7, 0.0], 0.1)
    scores = agreed(texts_of(found), query, OffsetAgreement())
    assert scores.score.tolist() == [1.0]
    assert scores.alignment[0] == pytest.approx([4.0, -7.0, turn * np.pi / 2])


def test_each_turn_alone_is_scored_as_if_it_were_the_only_one():
    rng = np.random.default_rng(3)
    stored, query = texts_of(*(random_text(rng, 60, span=30, words=6) for _ in range(9))), random_text(rng, 70)
    by_turn = agreed_by_turn(stored, query, OffsetAgreement(20))
    for turn, some in enumerate(by_turn):
        alone = agreed(stored, query, OffsetAgreement(20, (turn,)))
        assert np.array_equal(some.score, alone.score) and np.array_equal(some.alignment, alone.alignment)


def test_any_choice_of_documents_gives_what_all_give():
    rng = np.random.default_rng(2)
    stored = texts_of(*(random_text(rng, 40, span=30, words=6) for _ in range(300)))
    query = random_text(rng, 50, span=30, words=6)
    whole = agreed(stored, query, OffsetAgreement())
    board = agreement.AgreementTables.of(views(query, (0, 1, 2, 3), 3), 10)
    for chosen in (np.arange(120, 300), np.array([7]), rng.permutation(300)):
        both, matched = np.zeros(len(chosen), dtype=np.int32), np.zeros(len(chosen), dtype=np.int32)
        found = np.zeros((len(chosen), 3), dtype=np.int32)
        agreement.agree(stored, chosen, board, both, matched, found)
        assert np.array_equal(matched, whole.matched[chosen])
        assert np.array_equal(both / (len(query) + stored.counts[chosen]), whole.score[chosen])


def test_no_keypoints_no_match():
    nothing = Text.of([], [], [])
    some = text_of("x0_y0_a1")
    assert agreed(texts_of(some, nothing), nothing, ONE_VIEW).score.tolist() == [0.0, 0.0]
    assert agreed(texts_of(nothing, some), some, ONE_VIEW).score.tolist() == [0.0, 1.0]


def test_keypoints_far_outside_do_no_harm():
    query = text_of("x0_y0_a1 x3_y0_a1")
    found = text_of("x0_y0_a1 x3_y0_a1 x30000_y-30000_a1 x-32768_y0_a1")
    assert agreed(texts_of(found), query, ONE_VIEW).score.tolist() == [4 / 6]
    assert agreed(texts_of(query), found.moved([0, 0, 0], 0.1), ONE_VIEW).score.tolist() == [4 / 6]


def test_the_least_sum_that_reaches_a_score():
    starts, documents, own = np.array([0, 3, 3, 10, 50]), np.array([0, 1, 3]), 5
    for threshold in (0.0, 1 / 3, 0.3, 5 / 9, 0.8, 1.0, 1.1):
        needed = np.empty(3, dtype=np.int32)
        agreement.sums_needed(starts, documents, own, threshold, needed)
        for least, size in zip(needed.tolist(), (8, 5, 45), strict=True):
            reaching = [both for both in range(size + 1) if both / size >= threshold]
            assert least == (reaching[0] if reaching else size + 1)
