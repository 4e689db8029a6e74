"""The protocol and its metrics on cases whose figures are computed by hand."""

import numpy as np
import pytest

from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.evaluation.metrics import best, median, normalised_ranks, pose_error, recall, verdicts
from m2t_text.evaluation.protocol import GroundTruth, draw


def masks(relevant: str) -> tuple[np.ndarray, np.ndarray]:
    """``r`` relevant, ``i`` irrelevant, ``-`` left out."""
    letters = np.array(list(relevant))
    return letters == "r", letters == "i"


def truth(places: list[tuple[float, float]], travel: list[float]) -> GroundTruth:
    return GroundTruth(np.zeros((len(travel), 3)), np.array(places), np.array(travel))


# --- Ranks


@pytest.mark.parametrize(
    ("scores", "kinds", "expected"),
    [
        ([9, 1, 2, 3], "riii", [1 / 4]),  # best of four
        ([0, 1, 2, 3], "riii", [4 / 4]),  # worst of four
        ([2.5, 1, 2, 3], "riii", [2 / 4]),
        ([2, 1, 2, 3], "riii", [2.5 / 4]),  # one better, one equal
        ([0, 0, 0, 0], "riii", [2.5 / 4]),  # all equal: the middle
        ([9, 8, 1, 2], "rrii", [1 / 3, 1 / 3]),  # relevant maps do not compete with each other
        ([5, 9, 9, 1], "r--i", [1 / 2]),  # those left out do not compete either
        ([5, 9], "r-", [1.0]),  # nothing to compete with
    ],
)
def test_normalised_ranks(scores: list[float], kinds: str, expected: list[float]) -> None:
    assert normalised_ranks(np.array(scores, dtype=float), *masks(kinds)) == pytest.approx(expected)


def test_anr_of_a_case_computed_by_hand() -> None:
    """Two queries: the mean over each one's relevant maps comes first, the mean over queries after it."""
    first = normalised_ranks(np.array([4.0, 1.0, 3.0, 2.0, 0.0]), *masks("rriii"))
    second = normalised_ranks(np.array([1.0, 1.0, 3.0]), *masks("rii"))
    # first: rank 1 of 4 and rank 3 of 4, mean 1/2; second: one better, one equal: 2.5 of 3
    assert np.mean([first.mean(), second.mean()]) == pytest.approx((1 / 2 + 5 / 6) / 2)
    # not the mean over pairs
    assert np.mean([*first, *second]) != pytest.approx((1 / 2 + 5 / 6) / 2)


def test_best_hit() -> None:
    allowed = np.array([True, True, True, False])
    assert best(np.array([1.0, 2.0, 2.0, 9.0]), allowed) == 1  # the first of equals, in the order of ids
    assert best(np.array([0.0, 0.0, 0.0, 9.0]), allowed) is None  # as a search: no hit without a match
    assert best(np.ones(4), np.zeros(4, dtype=bool)) is None


# --- Hits


def test_recall_counts_the_limit_itself() -> None:
    distances = np.array([0.5, 1.0, 2.0, 3.0, 3.001, np.inf])
    assert recall(distances, 1.0) == pytest.approx(2 / 6)
    assert recall(distances, 3.0) == pytest.approx(4 / 6)


def test_verdicts() -> None:
    distances = np.array([0.1, 5.0, 0.1, 0.1, np.inf])
    match = np.array([True, True, True, False, False])
    assert verdicts(distances, match, 3.0) == pytest.approx((2 / 3, 2 / 5))
    assert verdicts(distances, np.zeros(5, dtype=bool), 3.0) == (None, 0.0)


def test_pose_error() -> None:
    way, turn = pose_error(np.array([1.0, 2.0, np.pi - 0.1]), np.array([4.0, 6.0, 0.1 - np.pi]))
    assert (way, turn) == pytest.approx((5.0, 0.2))


def test_median_of_nothing() -> None:
    assert median(np.array([9.0, 1.0, 3.0])) == 3.0
    assert median(np.zeros(0)) is None


# --- Relevance


def test_relevance() -> None:
    places = [(0, 0), (1.0, 0), (1.001, 0), (0, 0), (0, 0), (50, 0), (50, 0)]
    travel = [0.0, 20.0, 20.0, 10.0, 10.001, 9.0, 90.0]
    relevant, irrelevant = truth(places, travel).relevance(0)
    # itself and all on 10 m of travel are left out, be they near or far; 1 m is near, more is not
    assert relevant.tolist() == [False, True, False, False, True, False, False]
    assert irrelevant.tolist() == [False, False, True, False, False, False, True]


def test_relevance_goes_both_ways() -> None:
    rng = np.random.default_rng(0)
    known = truth(list(map(tuple, rng.uniform(0, 4, (40, 2)))), list(rng.uniform(0, 40, 40)))
    relevant = np.array([known.relevance(i)[0] for i in range(40)])
    assert relevant.any() and (relevant == relevant.T).all()


def test_queries_are_the_maps_with_a_relevant_map() -> None:
    assert truth([(0, 0), (30, 0), (0.5, 0), (9, 9)], [0, 20, 40, 60]).queries().tolist() == [0, 2]
    assert not len(truth([(0, 0), (0, 0)], [0, 5]).queries())
    assert not len(GroundTruth.of([], np.zeros((5, 3))).queries())


def test_unvisited_maps_lie_far_from_all_maps_of_other_visits() -> None:
    places, travel = [(0, 0), (0, 1), (6.0, 0), (20, 0), (26.001, 0)], [0.0, 9.0, 40.0, 60.0, 80.0]
    # the first is 6 m from the third, and the second more; near maps of the same visit do not count
    assert truth(places, travel).unvisited().tolist() == [1, 3, 4]


def test_a_relative_pose_is_right_within_a_metre_and_ten_degrees() -> None:
    poses = np.array([[5.0, 5.0, np.pi / 2], [5.0, 7.0, np.pi / 2]])  # the second is 2 m ahead of the first
    known = GroundTruth(poses, np.zeros((2, 2)), np.zeros(2))
    for pose, right in [
        ([2.0, 0.0, 0.0], True),
        ([2.7, 0.7, np.radians(-9.9)], True),
        ([3.01, 0.0, 0.0], False),
        ([2.0, 0.0, np.radians(10.1)], False),
        ([2.0, 0.0, np.pi], False),  # a flip
    ]:
        assert known.right(query=1, hit=0, pose=np.array(pose)) is right


def test_a_place_is_the_centre_of_gravity_carried_by_the_first_scans_true_pose() -> None:
    document = Document(
        dataset="a",
        first_scan=2,
        last_scan=5,
        travel=np.array([4.0, 7.0]),
        pose=np.array([100.0, 100.0, 1.0]),  # of the trajectory, which is not the truth
        viewpoint=np.zeros(3),
        centre_of_gravity=np.array([2.0, 1.0]),
        points=1,
        text=Text.of([], [], []),
    )
    known = GroundTruth.of([document], np.array([[0, 0, 0], [0, 0, 0], [10.0, 20.0, np.pi / 2]]))
    assert known.places == pytest.approx(np.array([[9.0, 22.0]]))
    assert known.travel.tolist() == [5.5] and known.poses.tolist() == [[10.0, 20.0, np.pi / 2]]


def test_a_draw_of_queries() -> None:
    queries = np.arange(100, 200)
    drawn = draw(queries, 20, seed=1)
    assert len(set(drawn.tolist())) == 20 and set(drawn) <= set(queries) and (np.diff(drawn) > 0).all()
    assert draw(queries, 20, seed=1).tolist() == drawn.tolist() != draw(queries, 20, seed=2).tolist()
    for count in (None, 100, 101):
        assert draw(queries, count, seed=1).tolist() == queries.tolist()
