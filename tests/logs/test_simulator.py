"""The simulator: a drive that a robot could make, errors like those of real robots, and its CARMEN log."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from m2t_text.errors import LogError
from m2t_text.logs import Log, read_log
from m2t_text.logs.beams import half_circle
from m2t_text.logs.simulation.building import build
from m2t_text.logs.simulation.raycast import cast
from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen
from m2t_text.mapping.scan_cloud import scan_points
from m2t_text.util.geometry import between, compose, transform, travel, wrap


@pytest.fixture(scope="module")
def drive() -> Log:
    return simulate(Simulation())


def test_the_drive_is_long_and_dense_and_hits_nothing(drive: Log) -> None:
    assert drive.ground_truth is not None
    assert 150 < travel(drive.ground_truth)[-1] < 200
    assert 700 < len(drive.scans) < 1200
    steps = between(drive.ground_truth[:-1], drive.ground_truth[1:])
    assert np.hypot(steps[:, 0], steps[:, 1]).max() < 0.21
    assert np.degrees(np.abs(steps[:, 2])).max() < 16
    for seed in range(3):
        log = simulate(Simulation(seed=seed, dropout=0.0, range_noise=0.0, beams=60, step=0.4))
        assert min(scan.ranges.min() for scan in log.scans) > 0.2  # half the width of a small robot


def test_places_are_visited_again_in_both_directions(drive: Log) -> None:
    poses = drive.ground_truth
    assert poses is not None
    place = travel(poses)
    near = np.hypot(*(poses[:, None, :2] - poses[None, :, :2]).transpose(2, 0, 1)) < 1.0
    near &= place[None, :] - place[:, None] > 15.0
    turned = np.abs(wrap(poses[:, None, 2] - poses[None, :, 2]))
    assert (near & (turned < 0.5)).any(axis=0).sum() > 50
    assert (near & (turned > np.pi - 0.5)).any(axis=0).sum() > 50


def test_odometry_drifts_like_that_of_real_robots(drive: Log) -> None:
    assert drive.ground_truth is not None
    place = travel(drive.ground_truth)
    end = np.searchsorted(place, place + 3.0)
    start = np.flatnonzero(end < len(place))
    true = between(drive.ground_truth[start], drive.ground_truth[end[start]])
    wheels = between(drive.odometry[start], drive.odometry[end[start]])
    assert 0.03 < np.median(np.hypot(*(true - wheels)[:, :2].T)) < 0.2
    assert 1.0 < np.degrees(np.median(np.abs(wrap(true[:, 2] - wheels[:, 2])))) < 3.5


def test_the_same_seed_makes_the_same_log_and_another_another() -> None:
    short = Simulation(travel=6.0)
    first, again, other = simulate(short), simulate(short), simulate(replace(short, seed=1))
    assert all(np.array_equal(a.ranges, b.ranges) for a, b in zip(first.scans, again.scans, strict=True))
    assert np.array_equal(first.odometry, again.odometry)
    assert not np.allclose(first.scans[0].ranges, other.scans[0].ranges)


def test_drives_differ_in_all_but_the_building() -> None:
    clean = Simulation(travel=30.0, range_noise=0.0, dropout=0.0, people=0, doors=0)
    one, other = simulate(clean), simulate(replace(clean, drive=1))
    assert one.ground_truth is not None and other.ground_truth is not None
    apart = np.hypot(*(one.ground_truth[:, None, :2] - other.ground_truth[:, :2]).transpose(2, 0, 1)).min(
        axis=1
    )
    assert apart.max() > 0.15 and np.median(apart) < 0.3
    turns = [np.abs(between(log.ground_truth[:-1], log.ground_truth[1:])[:, 2]).max() for log in (one, other)]
    assert abs(turns[0] - turns[1]) > 0.005
    seen = [hits(log) for log in (one, other)]
    assert distances(*seen).max() < 1.0 and (distances(*seen) < 0.1).mean() > 0.95


def hits(log: Log) -> np.ndarray:
    """(N, 2) what all beams of a drive truly met within 8 m."""
    lasers = compose(log.ground_truth, log.laser_pose)
    return np.concatenate(
        [
            transform(pose, scan_points(scan, np.zeros(3), 8.0))
            for pose, scan in zip(lasers, log.scans, strict=True)
        ]
    )


def distances(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    return cKDTree(others).query(points)[0]


def test_part_of_the_tour_can_be_driven_backwards() -> None:
    there = Simulation(start=20.0, travel=25.0, people=0)
    ways = [simulate(replace(there, backwards=back)).ground_truth for back in (False, True)]
    for way in ways:
        assert travel(way)[-1] == pytest.approx(25.0, abs=3.0)
    assert np.hypot(*(ways[0][0] - ways[1][-1])[:2]) < 1.0 and np.hypot(*(ways[0][-1] - ways[1][0])[:2]) < 1.0
    begin = simulate(Simulation(travel=20.0, people=0)).ground_truth
    assert np.hypot(*(begin[-1] - ways[0][0])[:2]) < 1.0


def test_doors_that_the_tour_passes_stay_open_and_others_change() -> None:
    for seed in range(3):
        building = build(np.random.default_rng(seed), 44.0)
        usual, other = building.doors.transpose(1, 0, 2)
        assert len(usual) > 5 and (np.abs(usual - other).max(axis=1) > 0.3).all()
        shut = simulate(
            Simulation(seed=seed, doors=99, people=0, range_noise=0.0, dropout=0.0, beams=30, step=0.5)
        )
        assert min(scan.ranges.min() for scan in shut.scans) > 0.2


def test_people_walk_about_but_not_into_the_robot() -> None:
    alone = Simulation(travel=40.0, range_noise=0.0, dropout=0.0)
    crowd = simulate(replace(alone, people=30))
    assert min(scan.ranges.min() for scan in crowd.scans) > 0.2
    same = [
        np.isclose(a.ranges, b.ranges)
        for a, b in zip(crowd.scans, simulate(replace(alone, people=0)).scans, strict=True)
    ]
    assert 0.02 < 1 - np.mean(same) < 0.6


def test_progress_is_told() -> None:
    told: list[tuple[int, int]] = []
    log = simulate(Simulation(travel=3.0, beams=4), lambda done, of: told.append((done, of)))
    assert told == [(n + 1, len(log.scans)) for n in range(len(log.scans))]


def test_beams_end_at_the_nearest_wall() -> None:
    """A robot 1 m from the wall on its right, 2 m from the one ahead, with a post between."""
    walls = np.array([[-5, -1, 5, -1], [2, -5, 2, 5], [1, -0.1, 1, 0.1], [-1, -5, -1, 5]], dtype=float)
    ranges = cast(np.zeros(3), half_circle(181), walls)
    assert ranges[0] == pytest.approx(1)
    assert ranges[90] == pytest.approx(1)
    assert ranges[45] == pytest.approx(np.sqrt(2))
    assert ranges[120] == pytest.approx(2 / np.cos(np.pi / 6))
    assert ranges[180] == np.inf
    turned = cast(np.array([0.5, 0.0, np.pi]), half_circle(181), walls)
    assert turned[90] == pytest.approx(1.5)


def test_noise_and_lost_beams_are_as_asked(drive: Log) -> None:
    clean = simulate(Simulation(range_noise=0.0, dropout=0.0))
    noisy = np.concatenate([scan.ranges for scan in drive.scans])
    true = np.concatenate([scan.ranges for scan in clean.scans])
    lost = np.isinf(noisy) & np.isfinite(true)
    assert lost.mean() == pytest.approx(0.01, rel=0.1)
    seen = np.isfinite(noisy) & np.isfinite(true)
    assert (noisy - true)[seen].std() == pytest.approx(0.015, rel=0.05)
    near = simulate(Simulation(travel=6.0, range_limit=5.0))
    ranges = np.concatenate([scan.ranges for scan in near.scans])
    assert ranges[np.isfinite(ranges)].max() < 5.0
    assert np.isinf(ranges).mean() > 0.05


@pytest.mark.parametrize("beams", [180, 181, 360])
@pytest.mark.parametrize("ending", [".log", ".log.gz"])
def test_a_written_log_reads_back_the_same(tmp_path: Path, beams: int, ending: str) -> None:
    log = simulate(Simulation(travel=8.0, beams=beams, laser_offset=0.17))
    path = tmp_path / f"{log.name}{ending}"
    write_carmen(log, path)
    again = read_log(path)
    assert again.name == log.name
    assert again.warnings == ()
    assert again.laser_pose == pytest.approx(log.laser_pose)
    assert log.ground_truth is not None
    assert np.abs(between(log.ground_truth, again.ground_truth)).max() < 2e-6
    assert np.abs(between(log.odometry, again.odometry)).max() < 2e-6
    for old, new in zip(log.scans, again.scans, strict=True):
        assert np.array_equal(np.isinf(old.ranges), np.isinf(new.ranges))
        back = np.isfinite(old.ranges)
        assert np.abs(old.ranges[back] - new.ranges[back]).max() < 0.0051
        assert new.angles == pytest.approx(old.angles)
        assert new.timestamp == pytest.approx(old.timestamp, abs=1e-6)


def test_a_written_log_is_byte_identical_and_appears_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = simulate(Simulation(travel=3.0, beams=4))
    first, second = tmp_path / "a.log.gz", tmp_path / "b.log.gz"
    write_carmen(log, first)
    write_carmen(log, second)
    assert first.read_bytes() == second.read_bytes()
    assert first.read_bytes()[4:8] == bytes(4)  # the gzip holds no time, so later it is the same, too

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(LogError, match="No space left"):
        write_carmen(log, tmp_path / "c.log")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.log.gz", "b.log.gz"]


def test_the_drive_is_judged_by_the_robot_and_scanned_from_the_laser() -> None:
    """With the laser's pose forgotten, two scans of one wall would not meet."""
    near, far = (
        simulate(Simulation(laser_offset=x, range_noise=0.0, dropout=0.0, travel=2.0)) for x in (0, 0.5)
    )
    assert near.ground_truth is not None
    assert np.array_equal(near.ground_truth, far.ground_truth)
    ahead = len(near.scans[0].ranges) // 2
    gap = near.scans[0].ranges[ahead] - far.scans[0].ranges[ahead]
    assert gap == pytest.approx(0.5, abs=1e-6)
    assert compose(far.ground_truth[0], far.laser_pose)[:2] != pytest.approx(far.ground_truth[0, :2])


@pytest.mark.parametrize("wrong", [Simulation(length=10.0), Simulation(beams=1), Simulation(start=999.0)])
def test_an_impossible_simulation_is_refused(wrong: Simulation) -> None:
    with pytest.raises(LogError, match=r"at least|the tour of the building ends after 2"):
        simulate(wrong)


@pytest.mark.parametrize("length", [24.0, 80.0])
def test_buildings_of_any_size_can_be_driven(length: float) -> None:
    log = simulate(Simulation(length=length, beams=20, step=0.5))
    assert log.ground_truth is not None
    assert travel(log.ground_truth)[-1] > 100
    assert min(scan.ranges.min() for scan in log.scans) > 0.1
