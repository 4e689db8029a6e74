"""Local maps: which scans they hold, which cells they occupy; and the trajectory on real logs."""

from dataclasses import replace

import numpy as np
import pytest

from m2t_text.config import PROFILES, MappingParameters
from m2t_text.logs import read_log
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.mapping.local_map import Survey, local_maps, occupied, run_starts
from m2t_text.mapping.trajectory import refined_poses
from m2t_text.pipeline import describe, view_text
from m2t_text.util.geometry import between, compose, inverse, transform, travel

LOGS = {"freiburg-101": 0.10, "intel": 0.12, "csail": 0.12, "aces": 0.13}  # m, 90th percentile over 3 m


def survey_along(poses: np.ndarray, points: np.ndarray) -> Survey:
    """Every scan sees the same points, given in the world."""
    seen = [transform(inverse(pose), points) for pose in poses]
    starts = np.arange(len(poses) + 1) * len(points)
    return Survey(np.concatenate(seen), starts, poses)


def line(count: int, step: float) -> np.ndarray:
    return np.stack([np.arange(count) * step, np.zeros(count), np.zeros(count)], axis=1)


def test_a_run_holds_the_scans_of_the_next_metres():
    survey = survey_along(line(9, 1.0), np.array([[4.05, 2.05]]))
    parameters = MappingParameters(run_length=3.0)
    assert run_starts(survey, 3.0).tolist() == [0, 1, 2, 3, 4, 5]
    maps = list(local_maps(survey, parameters))
    assert [(m.first_scan, m.last_scan) for m in maps] == [(k, k + 3) for k in range(6)]
    assert maps[2].travel.tolist() == [2.0, 5.0]
    assert maps[2].trajectory[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0]
    assert maps[2].points == pytest.approx(np.array([[2.05, 2.05]]))


def test_a_robot_that_stands_still_adds_nothing():
    poses = np.concatenate([np.zeros((500, 3)), line(5, 1.0)])
    survey = survey_along(poses, np.array([[1.0, 2.0]]))
    first = next(iter(local_maps(survey, MappingParameters(run_length=3.0))))
    assert len(first.trajectory) == 4 and first.last_scan == 503


def test_no_run_spans_two_drives_or_a_leap():
    poses = line(12, 1.0)
    points = np.array([[4.05, 2.05]])
    parameters = MappingParameters(run_length=3.0)
    cut = replace(survey_along(poses, points), cuts=np.array([5]))
    assert run_starts(cut, 3.0).tolist() == [0, 1, 5, 6, 7, 8]
    assert [m.last_scan for m in local_maps(cut, parameters)] == [3, 4, 8, 9, 10, 11]
    # A run that is asked for at the end of a drive ends with it.
    assert [m.last_scan for m in local_maps(cut, parameters, np.array([3, 4]))] == [4, 4]
    poses[5:, 0] += 50.0
    assert run_starts(survey_along(poses, points), 3.0).tolist() == [0, 1, 5, 6, 7, 8]


def test_a_new_drive_begins_where_the_last_one_ends_and_matches_nothing_of_it():
    drive = simulate(Simulation(travel=8.0))
    half = len(drive.scans) // 2
    later = tuple(replace(scan, drive=1) for scan in drive.scans[half:])
    apart = replace(drive, scans=drive.scans[:half] + later)
    poses = np.array(list(refined_poses(apart)))
    alone = np.array(list(refined_poses(replace(drive, scans=later))))
    assert apart.cuts.tolist() == [half] and poses[half].tolist() == poses[half - 1].tolist()
    assert between(poses[half], poses[half:]) == pytest.approx(alone, abs=1e-9)


def test_cells_hold_the_mean_of_their_hits():
    points = np.array([[0.01, 0.01], [0.03, 0.05], [0.11, 0.01]])
    cells = occupied(points, np.array([0, 2, 3]), np.array([0, 1]), np.zeros((2, 3)), 0.1)
    assert cells == pytest.approx(np.array([[0.02, 0.03], [0.11, 0.01]]))
    assert occupied(points, np.array([0, 0]), np.array([0]), np.zeros((1, 3)), 0.1).shape == (0, 2)


OTHERS = [pytest.param(name, marks=pytest.mark.long) for name in ("freiburg-101", "intel", "csail")]


@pytest.mark.parametrize("name", ["aces", *OTHERS])
def test_scan_matching_beats_wheel_odometry_on_real_logs(radish, name):
    log = read_log(next(radish.glob(f"{name}*")))
    assert log.ground_truth is not None
    way = travel(log.odometry)
    last = np.searchsorted(way, way + 3.0)
    first = np.flatnonzero(last < len(way))
    true = between(log.ground_truth[first], log.ground_truth[last[first]])

    def errors(poses: np.ndarray) -> np.ndarray:
        return np.hypot(*between(true, between(poses[first], poses[last[first]]))[:, :2].T)

    refined = np.percentile(errors(np.array(list(refined_poses(log)))), 90)
    assert refined < LOGS[name]
    assert refined < 0.6 * np.percentile(errors(log.odometry), 90)


def overlap(one, other) -> float:
    """Share of keypoints of either text that the other one has within one cell."""
    a, b = one.positions(), other.positions()
    near = np.abs(a[:, None] - b[None]).max(axis=2) <= 1
    return float((near.any(axis=0).sum() + near.any(axis=1).sum()) / (len(a) + len(b)))


@pytest.mark.parametrize("profile", PROFILES)
def test_the_frame_of_the_input_does_not_matter(profile):
    rng = np.random.default_rng(3)
    x = np.arange(0, 7, 0.05)
    walls = np.concatenate(
        [np.stack([x, 0 * x], 1), np.stack([x[:60], 0 * x[:60] + 2.4], 1), np.stack([0 * x + 7, x], 1)]
    )
    walls += rng.normal(0, 0.01, walls.shape)
    base = line(13, 0.47) + np.array([0.0, 1.0, 0.1])
    parameters = PROFILES[profile]
    texts = []
    for frame in ([0.0, 0.0, 0.0], [13.2, -7.7, 0.7], [-3.3, 2.1, -2.9]):
        survey = survey_along(compose(np.array(frame), base), transform(frame, walls))
        first = next(iter(local_maps(survey, parameters.mapping)))
        texts.append(describe(first, "log", parameters).text)
    assert all(overlap(texts[0], other) > 0.97 for other in texts[1:])


def test_a_keypoint_is_a_cell_of_the_viewpoints_frame():
    parameters = PROFILES["paper"]
    text = view_text(np.array([[0.05, 0.05], [0.09, 0.01], [-0.01, 0.31]]), parameters.description, 0.1)
    assert sorted(zip(text.wx.tolist(), text.wy.tolist(), strict=True)) == [(-1, 3), (0, 0)]
