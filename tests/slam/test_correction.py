"""A drive corrected: it is not bent by a wrong loop, and several drives come into one frame."""

from dataclasses import replace

import numpy as np
import pytest
from drives import without_odometry

from m2t_text.evaluation.loops import trajectory_error
from m2t_text.logs import Log
from m2t_text.logs.joining import joined
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.loops.detection import LoopDetection
from m2t_text.mapping.scan_cloud import ScanCloud
from m2t_text.saved_maps.occupancy_mapping import build_map
from m2t_text.slam.correction import Correction, correct
from m2t_text.slam.files import corrected_graph
from m2t_text.slam.key_scans import KeyScans, key_scans, spread
from m2t_text.slam.mapping import MapOfLogs, map_logs
from m2t_text.util.geometry import between, compose, inverse


@pytest.fixture(scope="module")
def corrected(detection: LoopDetection) -> Correction:
    return correct(detection)


def test_the_same_for_any_number_of_threads(detection: LoopDetection, corrected: Correction):
    assert (correct(detection, 3).trajectory == corrected.trajectory).all()


def test_a_wrong_loop_is_left_out(detection: LoopDetection, drive: Log, corrected: Correction):
    """Put in as sure as the right ones are."""
    assert drive.ground_truth is not None
    right = detection.loops[0]
    wrong = replace(right, place=right.place + 30, scan=len(drive.scans) - 20)
    away = between(drive.ground_truth[wrong.place], drive.ground_truth[wrong.scan])
    assert np.hypot(*between(away, wrong.pose.pose)[:2]) > 3.0
    bent = correct(replace(detection, loops=[*detection.loops, wrong]))
    assert bent.dropped[0] == corrected.dropped[0] + 1
    assert bent.count("loop") == corrected.count("loop") == len(detection.loops)
    assert trajectory_error(bent.trajectory, drive.ground_truth) < 0.05
    assert np.abs(bent.trajectory - corrected.trajectory)[:, :2].max() < 0.03


def test_constraints_agree_with_the_truth(drive: Log, corrected: Correction):
    """Nearly all within three standard deviations, and none far off."""
    assert drive.ground_truth is not None
    poses = drive.ground_truth[corrected.keys.numbers]
    near = corrected.constraints.chosen(corrected.kinds == "neighbour")
    errors = near.errors(poses)
    assert len(near) > 300 and np.hypot(errors[:, 0], errors[:, 1]).max() < 0.3
    assert (near.squared_distances(poses) < 16.27).mean() > 0.95


def line(count: int) -> tuple[np.ndarray, KeyScans]:
    """A straight drive of 0.1 m steps whose every fourth scan is a key scan."""
    poses = np.column_stack([0.1 * np.arange(count), np.zeros((count, 2))])
    numbers = np.arange(0, count, 4)
    cloud = ScanCloud(np.empty((0, 2)), np.empty((0, 2)))
    drives = np.zeros(len(numbers), dtype=np.int64)
    return poses, KeyScans(numbers, [cloud] * len(numbers), 0.1 * numbers, drives)


def test_scans_between_key_scans_follow_both():
    poses, keys = line(9)
    moved = compose([1.0, 2.0, 0.5], poses)
    assert spread(poses, keys, moved[keys.numbers]) == pytest.approx(moved)
    stretched = poses[keys.numbers] * [2.0, 1.0, 1.0]
    found = spread(poses, keys, stretched)
    assert found == pytest.approx(poses * [2.0, 1.0, 1.0])


def test_key_scans_are_a_step_or_a_turn_apart(drive: Log):
    assert drive.ground_truth is not None
    keys = key_scans(drive, drive.ground_truth)
    steps = between(drive.ground_truth[keys.numbers[:-1]], drive.ground_truth[keys.numbers[1:]])
    assert keys.numbers[0] == 0 and 0.2 * len(drive.scans) < len(keys) <= len(drive.scans)
    assert ((np.hypot(steps[:, 0], steps[:, 1]) > 0.3) | (np.abs(steps[:, 2]) > np.radians(20))).all()


@pytest.fixture(scope="module")
def first() -> Log:
    """As much of a drive as another one needs to be joined to it."""
    return simulate(Simulation(seed=5, length=24.0, travel=35.0, step=0.35))


@pytest.fixture(scope="module")
def both(first: Log) -> tuple[Log, MapOfLogs]:
    """Another drive through the same building, and the map of both."""
    other = simulate(Simulation(seed=5, drive=1, length=24.0, travel=28.0, step=0.35, laser_offset=0.2))
    return other, map_logs([first, replace(other, name="other")], "both", resolution=0.1)


def test_two_drives_in_one_frame(first: Log, both: tuple[Log, MapOfLogs]):
    """Though the laser of one sits elsewhere."""
    other, made = both
    assert first.ground_truth is not None and other.ground_truth is not None
    assert made.left_out == [] and made.correction.joined.all()
    poses, later = made.trajectories()
    frame = compose(first.ground_truth[0], np.zeros(3))
    errors = between(compose(frame, later), robot_with_the_laser_of(first, other))
    assert np.hypot(errors[:, 0], errors[:, 1]).max() < 0.15 and np.abs(errors[:, 2]).max() < 0.03
    assert len(poses) == len(first.scans)


def robot_with_the_laser_of(drive: Log, other: Log) -> np.ndarray:
    """The true poses of the other robot's frame, moved so that its laser sits where the first robot's does."""
    assert other.ground_truth is not None
    return compose(other.ground_truth, compose(other.laser_pose, inverse(drive.laser_pose)))


def test_a_log_of_another_building_changes_nothing(drive: Log, detection: LoopDetection, corrected: Correction):
    """It is left out, and what is left is the map of the other log alone, to the bit."""
    elsewhere = replace(simulate(Simulation(seed=8, length=24.0, travel=8.0, step=0.25)), name="elsewhere")
    made = map_logs([drive, elsewhere], "both", resolution=0.1)
    assert made.left_out == ["elsewhere"] and len(detection.loops) > 0
    assert [one["joined"] for one in made.to_json()["datasets"]] == [True, False]
    assert (made.trajectories()[0] == corrected.trajectory).all()
    alone = build_map(drive, corrected.trajectory, np.flatnonzero(detection.survey.moved), 0.1)
    assert (made.grid.states == alone.states).all() and (made.grid.origin == alone.origin).all()


def test_the_graph_has_all_scans_and_no_step_between_drives(both: tuple[Log, MapOfLogs], first: Log):
    _, made = both
    graph = corrected_graph(made)
    count = len(made.detection.log.scans)
    assert graph.scans == len(graph.vertices) == count
    missing = set(range(count - 1)) - {edge.start for edge in graph.steps}
    assert missing == {len(first.scans) - 1}
    for edge in graph.loops:
        away = between(between(graph.vertices[edge.start], graph.vertices[edge.end]), edge.pose.pose)
        assert np.hypot(*away[:2]) < 0.5


def test_joined_logs_keep_their_scans(drive: Log):
    whole = joined([drive, without_odometry(drive)], "twice")
    assert len(whole.scans) == 2 * len(drive.scans) and whole.cuts.tolist() == [len(drive.scans)]
    assert not whole.has_odometry and not whole.odometry[len(drive.scans) :].any()
    assert joined([drive], "alone").ground_truth is drive.ground_truth
