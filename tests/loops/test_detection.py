"""Whole walks: what an optimiser makes of their graphs, and that they never look ahead."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import cut

from m2t_text.config import PROFILES
from m2t_text.errors import LogError
from m2t_text.evaluation.loops import assess, trajectory_error
from m2t_text.index.map_index import MapIndex
from m2t_text.logs import Log, read_log
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.loops.detection import MAP_SPACING, LoopDetection, detect_loops
from m2t_text.loops.gate import Loop
from m2t_text.loops.graph import pose_graph
from m2t_text.mapping.trajectory import survey
from m2t_text.pipeline import describe_survey
from m2t_text.util.geometry import between


def off(poses: np.ndarray, log: Log, loop: Loop) -> float:
    """Metres by which a loop from one of these true poses errs."""
    assert log.ground_truth is not None
    true = between(poses, log.ground_truth[loop.scan])
    return float(np.hypot(*between(true, loop.pose.pose)[:2]))


def test_loops_correct_a_simulated_drive(detection: LoopDetection):
    assessment = assess(detection)
    assert assessment.loops == len(detection.loops) >= 4 and assessment.wrong == 0
    errors = assessment.absolute
    assert errors["loops"] < 0.6 * errors["scan_matching"] < errors["odometry"]
    assert errors["map"] < errors["loops"]


@pytest.mark.long
def test_loops_correct_a_real_drive(radish: Path):
    """The first 200 scans of the Intel Research Lab."""
    assessment = assess(detect_loops(cut(read_log(radish / "intel-corrected.log.gz"), 200)))
    assert assessment.loops >= 30 and assessment.wrong == 0
    assert assessment.absolute["loops"] < 0.1 and assessment.absolute["scan_matching"] > 0.2
    assert assessment.absolute["map"] < 0.1


def test_no_loop_looks_ahead(drive: Log, detection: LoopDetection):
    """The walk of a log that ends earlier has the same loops, up to its end."""
    last = detection.loops[len(detection.loops) // 2].known
    earlier = detect_loops(cut(drive, last + 1))
    expected = [loop for loop in detection.loops if loop.known <= last]
    assert 0 < len(expected) < len(detection.loops)
    assert [(loop.scan, loop.place, loop.known) for loop in earlier.loops] == [
        (loop.scan, loop.place, loop.known) for loop in expected
    ]
    for one, other in zip(earlier.loops, expected, strict=True):
        assert (one.pose.pose == other.pose.pose).all() and (one.pose.covariance == other.pose.covariance).all()
        assert one.candidate.found.last_scan < one.candidate.query.first_scan


def test_an_index_of_the_drive_itself_shows_its_past(drive: Log, tmp_path: Path):
    detection = detect_loops(drive, indexed(drive, tmp_path / "index"))
    truth = drive.ground_truth
    assert truth is not None and len(detection.loops) >= 4 and detection.maps == {}
    assert max(off(truth[loop.place], drive, loop) for loop in detection.loops) < 0.3
    assert all(loop.candidate.found.last_scan < loop.candidate.query.first_scan for loop in detection.loops)


def test_places_of_another_drive_become_vertices(drive: Log, tmp_path: Path):
    drive = cut(drive, 130)
    other = replace(simulate(Simulation(seed=12, drive=1, length=24.0, travel=24.0, step=0.3)), name="other")
    detection = detect_loops(drive, indexed(other, tmp_path / "index"))
    graph = pose_graph(detection)
    assert len(detection.loops) >= 10 and graph.scans == len(drive.scans)
    assert other.ground_truth is not None
    firsts = [other.ground_truth[loop.candidate.found.first_scan] for loop in detection.loops]
    errors = [off(first, drive, loop) for first, loop in zip(firsts, detection.loops, strict=True)]
    assert max(errors) < 0.3
    # Both drives in one frame: each map lies where the loops that lead to it put it.
    assert len(graph.vertices) == graph.scans + len(graph.maps)
    for edge in graph.loops:
        assert graph.maps[edge.start - graph.scans].startswith("other/")
        away = between(between(graph.vertices[edge.start], graph.vertices[edge.end]), edge.pose.pose)
        assert np.hypot(*away[:2]) < 0.5
    assert {edge.end for edge in graph.steps} == set(range(1, len(graph.vertices))) - {graph.scans}


def test_another_log_of_the_same_name_is_told(drive: Log, tmp_path: Path):
    index = indexed(cut(drive, 50), tmp_path / "index")
    with pytest.raises(LogError, match=r"another log called 'circuit', of 50 scans .* --name"):
        detect_loops(drive, index)


def test_a_log_shorter_than_a_map_is_told(drive: Log):
    with pytest.raises(LogError, match="travels less than the 5 m of one map"):
        detect_loops(cut(drive, 10))


def test_a_log_without_ground_truth_is_not_judged(drive: Log, detection: LoopDetection):
    with pytest.raises(LogError, match="no ground truth"):
        assess(replace(detection, log=replace(drive, ground_truth=None)))


def test_trajectory_error_by_hand():
    truth = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    turned = np.array([[5.0, 5, 1], [5, 7, 1], [3, 7, 1], [3, 5, 1]])
    assert trajectory_error(turned, truth) == pytest.approx(0.0, abs=1e-12)
    wide = truth + np.array([[-0.1, 0, 0], [0.1, 0, 0], [0.1, 0, 0], [-0.1, 0, 0]])
    assert trajectory_error(wide, truth) == pytest.approx(0.1)


def indexed(log: Log, path: Path) -> MapIndex:
    """An index of every so many maps of one log."""
    index = MapIndex.create(path, PROFILES["default"])
    whole = survey(log, index.parameters.mapping)
    documents = describe_survey(whole, log.name, index.parameters, spacing=MAP_SPACING)
    index.replace(log.name, documents, (len(log.scans), float(whole.way[-1])))
    return index
