"""A query with the maps that lead to it: which they are, and how their hits tell look-alikes apart."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from m2t_text.config import PROFILES
from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.index.map_index import MapIndex
from m2t_text.index.results import Hit
from m2t_text.logs import read_log
from m2t_text.pipeline import describe_before
from m2t_text.recognition.earlier import Earlier, distances, earlier_maps, indexed_before
from m2t_text.recognition.fit import Fit
from m2t_text.recognition.found import Found
from m2t_text.recognition.queries import Query
from m2t_text.recognition.sequence import FURTHEST_BEHIND, SHARE, Trail
from m2t_text.recognition.verification import Alignment
from m2t_text.util.geometry import between, compose

Call = Callable[..., tuple[int, str, str]]
GOOD = Fit(keypoints=900, seen=800, inliers=760, conflicts=2, free_known=True, grip=0.3)


def document(begin: float, pose=(0.0, 0.0, 0.0), dataset: str = "log") -> Document:
    travel, empty = np.array([begin, begin + 5.0]), Text.of([], [], [])
    return Document(
        dataset, int(begin), int(begin) + 9, travel, np.array(pose), np.zeros(3), np.zeros(2), 9, empty
    )


def found(
    place: tuple[float, float, float], fit: Fit = GOOD, begin: float = 100.0, dataset: str = "log"
) -> Found:
    """A hit that puts what was looked up at a place of its dataset."""
    return Found(
        Hit(document(begin, place, dataset), 0.9, 9, np.zeros(3)), None, Alignment(np.zeros(3), fit, 0.9)
    )


def test_earlier_maps_overlap_by_half() -> None:
    assert distances(20.0, 5.0) == [2.5, 5.0, 7.5, 10.0, 12.5, 15.0]
    assert distances(5.0, 5.0) == distances(3.0, 5.0) == distances(20.0, 0.0) == []


def test_the_motion_is_that_between_the_viewpoints() -> None:
    before = replace(document(10.0, (1.0, 2.0, 0.3)), viewpoint=np.array([0.5, 0.0, 1.0]))
    query = replace(document(15.0, (4.0, 1.0, -0.4)), viewpoint=np.array([0.0, 0.2, 2.0]))
    (earlier,) = earlier_maps([before], query)
    assert earlier.behind == 5.0
    there = compose(compose(before.pose, before.viewpoint), earlier.motion)
    assert there == pytest.approx(compose(query.pose, query.viewpoint))


def trail(*hits: Found) -> Trail:
    """What one earlier text says, 5 m behind the query, whose hits are these."""
    earlier = Earlier(Text.of([], [], []), 5.0, np.array([5.0, 0.0, 0.0]))
    return Trail.of([earlier], lambda one: [hit.hit for hit in hits], lambda one, all_hits: list(hits))


def support(of: Trail, place: tuple[float, float, float], dataset: str = "log") -> float:
    alignment = of.supported(found(place, begin=105.0, dataset=dataset)).alignment
    assert alignment is not None
    return alignment.support


def test_hits_that_agree_on_one_motion_support_an_answer() -> None:
    poorer = replace(GOOD, inliers=700)
    behind = SHARE * (poorer.evidence - GOOD.evidence)
    said = trail(found((0.0, 0.0, 0.0)), found((30.0, 0.0, 0.0), poorer))
    assert support(said, (5.2, -0.1, 0.05)) == 0.0
    assert support(said, (35.0, 0.0, 0.0)) == pytest.approx(behind)
    for elsewhere in ((5.0, 0.0, np.pi), (10.0, 0.0, 0.0), (-5.0, 0.0, np.pi)):
        assert support(said, elsewhere) == pytest.approx(-SHARE * FURTHEST_BEHIND)
    assert support(said, (5.0, 0.0, 0.0), "another") == pytest.approx(-SHARE * FURTHEST_BEHIND)


def test_without_earlier_texts_nothing_changes() -> None:
    one = found((5.0, 0.0, 0.0))
    assert Trail.of([], lambda one: [], lambda one, hits: []).supported(one) is one


def test_the_best_alignment_of_a_hit_may_become_another() -> None:
    turned = Alignment(np.array([0.0, 0.0, np.pi]), replace(GOOD, inliers=750), 0.8)
    flipped = replace(found((5.0, 0.0, np.pi)), others=(turned,))  # better, but against the way
    supported = trail(found((0.0, 0.0, 0.0))).supported(flipped)
    assert supported.alignment is not None and supported.alignment.pose[2] == np.pi
    assert supported.alignment.support == 0.0 > supported.others[0].support


def test_the_maps_of_an_index_that_lead_to_one(simulated_index: Path) -> None:
    index = MapIndex.open(simulated_index)
    query = next(one for one in index.documents() if one.travel[0] >= 17.0)
    earlier = indexed_before(index, query, 20.0)
    assert len(earlier) == 6
    assert [one.behind for one in earlier] == pytest.approx(distances(20.0, 5.0), abs=0.4)
    start = next(iter(index.documents()))
    assert indexed_before(index, start, 20.0) == ()


def test_a_log_that_is_not_indexed_gives_nearly_the_same(simulated: Path, simulated_index: Path) -> None:
    index, log = MapIndex.open(simulated_index), read_log(simulated)
    query = next(one for one in index.documents() if one.travel[0] >= 17.0)
    ways = distances(20.0, 5.0)
    described = earlier_maps(*describe_before(log, query.first_scan, ways, PROFILES["default"]))
    for one, other in zip(described, indexed_before(index, query, 20.0), strict=True):
        away = between(one.motion, other.motion)
        assert np.hypot(*away[:2]) < 0.6 and abs(one.behind - other.behind) < 0.5


def test_search_with_a_sequence(call: Call, simulated: Path, simulated_index: Path) -> None:
    for query in ("drive/000100", f"{simulated}#100"):
        status, out, err = call("search", query, "--index", simulated_index, "--sequence", 12, "--json")
        answer = json.loads(out)
        said = set(err.splitlines()) - {"compiling once for this machine"}  # by whichever test comes first
        assert (status, said) == (0, set()) and answer["results"][0]["map_id"] == "drive/000100"
        assert answer["results"][0]["pose"] == pytest.approx([0.0, 0.0, 0.0], abs=0.05)
    status, out, err = call("search", "-", "--index", simulated_index, "--sequence", 12, stdin="x1_y2_a3")
    assert (status, out) == (2, "") and "which a sequence takes" in err


def test_a_query_alone_has_no_earlier_maps(simulated_index: Path) -> None:
    assert Query.of(MapIndex.open(simulated_index).document("drive/000040")).earlier == ()
