"""Where a robot is, from call to call: alone, with what earlier answers add, and carried away."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from calling import Call

from m2t_text.description.document import Document
from m2t_text.index.map_index import MapIndex, open_index
from m2t_text.live.continuity import Continuity
from m2t_text.live.evidence import DRIFT, SAME, Answer, Candidate, agree, independent, joint_lead
from m2t_text.live.localizer import Localizer
from m2t_text.live.messages import Swept
from m2t_text.live.place import Place
from m2t_text.live.session import Session
from m2t_text.live.survey import LiveSurvey
from m2t_text.logs.log import Log
from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen
from m2t_text.recognition.fit import Fit
from m2t_text.recognition.verdict import Assessment, Reason
from m2t_text.sources.opening import LogSource
from m2t_text.util.geometry import between, compose, inverse, travel, wrap

UNSURE = Assessment("ambiguous", 0.5, Reason("elsewhere", "another place fits about as well"))


@pytest.fixture(scope="module")
def drives() -> tuple[Log, Log]:
    """Two days in one building."""
    base = Simulation(seed=3, length=24.0, travel=40.0, beams=120)
    return simulate(base), simulate(replace(base, drive=1))


@pytest.fixture(scope="module")
def index(drives: tuple[Log, Log], tmp_path_factory: pytest.TempPathFactory) -> MapIndex:
    index = open_index(tmp_path_factory.mktemp("index") / "first")
    index.add(LogSource(drives[0]))
    return index


def true_pose(drives: tuple[Log, Log], scan: int) -> np.ndarray:
    """The robot's on the second day, in the frame of the first day's trajectory."""
    first, second = (one.ground_truth for one in drives)
    assert first is not None and second is not None
    return between(first[0], second[scan])


def follow(index: MapIndex, log: Log, every: float = 3.0) -> list[tuple[int, Place]]:
    survey, localizer, asked, places = LiveSurvey(index.parameters, log.laser_pose), Localizer(index), 0.0, []
    for k, scan in enumerate(log.scans):
        pose, run = survey.add(scan), survey.last_run()
        if run is not None and survey.travel >= asked + every:
            asked = survey.travel
            places.append((k, localizer.locate(run, pose)))
    return places


def test_a_match_is_right_and_says_how_sure_it_is(drives: tuple[Log, Log], index: MapIndex) -> None:
    places = follow(index, drives[1])
    matches = [(k, place) for k, place in places if place.verdict == "match"]
    assert len(matches) >= 5
    for k, place in matches:
        assert place.pose is not None and place.covariance is not None
        error = compose(inverse(true_pose(drives, k)), place.pose)
        assert np.hypot(*error[:2]) < 0.5 and abs(wrap(error[2])) < np.radians(10)
        assert np.allclose(place.covariance, place.covariance.T)
        assert 1e-6 < np.linalg.eigvalsh(place.covariance).min() < 0.1
        assert place.dataset == drives[0].name and place.state == "tracked"
        json.dumps(place.to_json(), allow_nan=False)
    before = [place for k, place in places if k < matches[0][0]]
    assert {place.state for place in before} <= {"unknown"}


def test_the_pose_is_that_of_the_robot_now(index: MapIndex) -> None:
    """A document of the index lies on itself; the robot has moved on since its run began."""
    document = index.document(index.ids[40])
    motion = np.array([1.0, 0.5, 0.3])
    place = Localizer(index).locate(document, compose(document.pose, motion))
    assert place.pose is not None and np.allclose(place.pose, compose(document.pose, motion), atol=0.2)


def test_nothing_to_see(index: MapIndex) -> None:
    document = index.document(index.ids[0])
    nothing = replace(document, text=type(document.text).of([], [], []))
    place = Localizer(index).locate(nothing)
    assert (place.verdict, place.pose, place.dataset) == ("none", None, None)


def answer(travel: float, *candidates: tuple[float, float, float]) -> Answer:
    """Of a robot that drives along x; each candidate is x, y, and its evidence, all of which look along x."""
    made = [Candidate("a", np.array([x, y, 0.0]), evidence) for x, y, evidence in candidates]
    ends = np.array([travel - 5.0, travel])
    return Answer(made[0], lambda: made[1:], np.array([travel, 0.0, 0.0]), ends, UNSURE)


def test_the_evidence_of_two_answers_is_added() -> None:
    one = answer(5.0, (5.0, 0.0, 30.0), (90.0, 0.0, 29.5), (40.0, 9.0, 20.0))
    # 6 m on, the first best fits again, 0.2 m beside; its rival is gone, another has come:
    two = answer(11.0, (11.0, 0.2, 31.0), (70.0, 0.0, 30.0), (11.1, 0.0, 29.0))
    assert joint_lead(two, one) == pytest.approx((30.0 + 31.0) - (29.5 + 29.0))
    # In a building that looks the same twice both have both:
    alike = answer(11.0, (11.0, 0.0, 31.0), (96.0, 0.0, 30.8))
    assert joint_lead(alike, one) == pytest.approx((30.0 + 31.0) - (29.5 + 30.8))
    # They do not agree:
    assert joint_lead(answer(11.0, (14.0, 0.0, 31.0), (96.0, 0.0, 30.8)), one) is None


def test_only_answers_of_other_scans_count() -> None:
    one = answer(5.0, (5.0, 0.0, 30.0))
    assert not independent(answer(9.0, (9.0, 0.0, 30.0)), one)
    assert independent(answer(10.0, (10.0, 0.0, 30.0)), one)
    assert not independent(answer(40.0, (40.0, 0.0, 30.0)), one)


def test_whatagrees() -> None:
    here = Candidate("a", np.array([1.0, 2.0, np.pi - 0.01]), 1.0)
    near = replace(here, pose=np.array([1.0 + 0.9 * SAME[0], 2.0, -np.pi + 0.01]))
    assert agree(here, near, 0.0)
    assert not agree(here, replace(near, dataset="b"), 0.0)
    assert not agree(here, replace(here, pose=here.pose + np.array([0.0, 0.0, 0.3])), 0.0)
    away = replace(here, pose=here.pose + np.array([SAME[0] + 0.1, 0.0, 0.0]))
    assert not agree(here, away, 0.0) and agree(here, away, 0.2 / DRIFT)


@pytest.fixture(scope="module")
def places(index: MapIndex) -> tuple[Document, Document]:
    """Two maps that are sure by themselves, far from each other."""
    maps = (index.document(map_id) for map_id in index.ids[::4])
    sure = (one for one in maps if Localizer(index).locate(one).verdict == "match")
    first = next(sure)
    return first, next(one for one in sure if np.hypot(*(one.pose - first.pose)[:2]) > 5.0)


def test_a_robot_that_is_carried_away_is_found_with_the_second_match(
    index: MapIndex, places: tuple[Document, Document]
) -> None:
    """Odometry does not tell. The first match that contradicts the last one is doubted."""
    first, far = places
    localizer = Localizer(index)
    tracked = [localizer.locate(first) for _ in range(2)]
    assert [one.state for one in tracked] == ["tracked"] * 2 and [one.first for one in tracked] == [True, False]
    doubted = localizer.locate(replace(far, travel=first.travel + 1.0, pose=first.pose))
    assert (doubted.verdict, doubted.state) == ("ambiguous", "lost") and "contradicts" in doubted.reason.text
    again = localizer.locate(replace(far, travel=first.travel + 1.2, pose=first.pose))
    assert (again.verdict, again.state, again.first) == ("match", "tracked", True)
    assert again.pose is not None and np.allclose(again.pose, far.pose, atol=0.2)


def test_where_scans_show_that_it_was_carried_away_the_first_match_counts(
    index: MapIndex, places: tuple[Document, Document]
) -> None:
    first, far = places
    localizer, noticed = Localizer(index), Continuity(carried=first.travel[1])  # while it stood
    localizer.locate(first)
    nothing = replace(first, text=type(first.text).of([], [], []))
    assert localizer.locate(nothing, continuity=noticed).state == "lost"
    found = localizer.locate(replace(far, travel=first.travel + 5.2, pose=first.pose), continuity=noticed)
    assert (found.verdict, found.state, found.first) == ("match", "tracked", True)


def test_an_earlier_match_says_nothing_across_a_scan_that_hardly_fitted() -> None:
    """Where the robot was leads to one of two places that look the same, if it is sure how it came there."""
    localizer = Localizer.__new__(Localizer)
    localizer.reset()
    fit = Fit(keypoints=700, seen=600, inliers=540, conflicts=5, free_known=True, grip=0.3)
    best: Any = SimpleNamespace(alignment=SimpleNamespace(fit=fit), hit=SimpleNamespace(map_id="a/000000"))
    sure = Assessment("match", 0.99, Reason("fits", ""))
    localizer._follow(replace(answer(5.0, (5.0, 0.0, 30.0)), assessment=sure))
    later = answer(7.0, (7.0, 0.0, 30.0), (50.0, 0.0, 30.0))
    assert localizer._weighed(later, best).assessment.verdict == "match"
    for doubtful, verdict in ((4.9, "match"), (5.0, "ambiguous")):
        localizer._continuity = Continuity(doubtful=doubtful)
        assert localizer._weighed(later, best).assessment.verdict == verdict


@pytest.mark.parametrize(("before", "after"), [(8.0, 25.0), (30.0, 6.0)])
def test_a_robot_that_is_carried_away_while_it_drives(
    drives: tuple[Log, Log], index: MapIndex, before: float, after: float
) -> None:
    """Its drive is cut and glued elsewhere, and odometry does not tell: it is noticed at once, and the robot is
    found within 4 m, and never elsewhere."""
    log = drives[1]
    way = travel(log.odometry)
    first, then = (np.flatnonzero((way >= at) & (way < at + 9.0)).tolist() for at in (before, after))
    frame = compose(log.scans[first[-1]].odometry, inverse(log.scans[then[0]].odometry))
    session = Session(index.parameters, Localizer(index), 1.5, poses=False, laser_pose=log.laser_pose)
    carried, found, noticed = 0.0, [], list[int]()
    for k in (*first, *then):
        scan = log.scans[k]
        if k in then:
            scan = replace(scan, odometry=compose(frame, scan.odometry))
        for place in session.take(Swept(scan, True)):
            if place["type"] == "warning":
                noticed.append(k)
            elif place["verdict"] == "match":
                error = compose(inverse(true_pose(drives, k)), np.array(place["pose"]))
                assert np.hypot(*error[:2]) < 0.5 and abs(wrap(error[2])) < np.radians(10)
                found.append((k in then, session.survey.travel - carried))
        carried = session.survey.travel if k == first[-1] else carried
    assert any(not there for there, _ in found)
    assert min(metres for there, metres in found if there) < 4.0
    assert noticed == [then[0]]


def test_what_was_seen_last_must_fit(index: MapIndex, drives: tuple[Log, Log]) -> None:
    survey = LiveSurvey(index.parameters, drives[0].laser_pose)
    for scan in drives[0].scans[:60]:
        survey.add(scan)
    seen, latest = survey.last_run(), survey.last_run(0.2)
    assert seen is not None and latest is not None
    place = Localizer(index).locate(seen, survey.pose, latest=latest)
    assert place.verdict == "match"
    elsewhere = replace(latest, pose=compose(latest.pose, [1.5, 1.0, 1.0]))
    place = Localizer(index).locate(seen, survey.pose, latest=elsewhere)
    assert (place.verdict, place.reason.code) == ("none", "conflict") and "saw last" in place.reason.text
    half = survey.last_run(2.5)
    assert half is not None
    nothing = replace(seen, points=seen.points[:0])
    assert Localizer(index).locate(nothing, survey.pose).verdict == "none"
    assert Localizer(index).locate(nothing, survey.pose, [half], latest).verdict == "match"


def test_in_a_pipe(call: Call, drives: tuple[Log, Log], index: MapIndex, tmp_path: Path) -> None:
    path = tmp_path / "second.log"
    write_carmen(drives[1], path)
    _, lines, _ = call("replay", path, "--speed", "0")
    robot, *scans = lines.splitlines()[:100]
    ask, ask_too_much = '{"type": "locate"}', '{"type": "locate", "run": 99}'
    stdin = "\n".join([robot, ask, *scans, ask, ask_too_much])
    status, out, err = call("live", "-", "--index", index.path, "--no-poses", stdin=stdin)
    assert (status, err) == (0, "")
    warning, place, error = (json.loads(line) for line in out.splitlines())
    assert warning["type"] == "warning" and "just begun" in warning["text"]
    assert (
        place["type"] == "place"
        and place["scan"] == len(scans) - 1
        and place["verdict"] in ("match", "ambiguous", "none")
    )
    assert len(place["covariance"]) == 3 and place["state"] in ("unknown", "tracked")
    assert error["type"] == "error" and "not kept" in error["text"]
    status, out, _ = call("live", "-", "--index", index.path, "--no-poses", "--every", "2", stdin=stdin)
    answers = [json.loads(line) for line in out.splitlines()]
    travels = [one["travel"] for one in answers if one["type"] == "place"][:-1]
    assert len(travels) >= 3 and (np.diff(travels) >= 2.0).all() and travels[0] < 3.0
    assert call("live", "-", "--index", tmp_path / "none")[0] == 2
    assert call("live", "-", "--index", index.path, "--profile", "paper")[0] == 2
