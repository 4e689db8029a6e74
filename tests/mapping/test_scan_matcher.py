"""Scan matching without wheels, and where a direction is not held."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from drives import without_odometry

from m2t_text.logs import Log
from m2t_text.logs.joining import joined
from m2t_text.logs.log import Scan
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.mapping.normals import normals
from m2t_text.mapping.scan_cloud import ScanCloud, scan_cloud
from m2t_text.mapping.scan_matcher import ScanMatcher, _as_held
from m2t_text.mapping.trajectory import refined_poses
from m2t_text.mapping.wide_search import register_widely
from m2t_text.util.geometry import between, inverse, transform


def room(step: float) -> np.ndarray:
    """The walls of an L-shaped room, in order, as a laser sees them."""
    corners = np.array([[-2, -3], [4, -3], [4, 1], [1, 1], [1, 3], [-2, 3], [-2, -3]], dtype=float)
    sides = []
    for a, b in pairwise(corners):
        count = int(np.hypot(*(b - a)) / step)
        sides.append(a + np.linspace(0, 1, count, endpoint=False)[:, None] * (b - a))
    return np.concatenate(sides)


@pytest.mark.parametrize("motion", [(0.0, 0.0, 0.0), (1.4, -1.1, 1.2), (-1.9, 0.3, -1.7), (0.2, 1.7, 2.0)])
def test_a_motion_far_from_the_guess_is_found(motion: tuple[float, float, float]) -> None:
    reference = room(0.05)
    rng = np.random.default_rng(0)
    scan = transform(inverse(motion), room(0.07)) + rng.normal(0, 0.01, (len(room(0.07)), 2))
    sigma = np.array([1.5, 1.5])
    found, inliers = register_widely(reference, normals(reference, 0.3), scan, 2.0, 2.1, sigma)
    assert np.abs(found - motion).max() < 0.02 and inliers > 0.95


def test_nothing_to_search_for_leaves_the_guess() -> None:
    nothing = np.empty((0, 2))
    for reference, scan in ((nothing, room(0.1)), (room(0.1), nothing), (nothing, nothing)):
        found, inliers = register_widely(reference, reference, scan, 1.0, 1.0, np.array([0.5, 0.5]))
        assert np.abs(found).max() < 1e-6 and inliers == 0


def thinned(log: Log, every: int) -> Log:
    assert log.ground_truth is not None
    return replace(log, scans=log.scans[::every], ground_truth=log.ground_truth[::every])


@pytest.mark.parametrize("every", [1, 5])
def test_a_drive_without_wheels(every: int) -> None:
    """A scan every 0.2 m, and every metre with turns of up to 70°."""
    log = thinned(simulate(Simulation(seed=5, length=24.0, travel=25.0)), every)
    assert log.ground_truth is not None
    found = np.array(list(refined_poses(without_odometry(log))))
    errors = between(between(log.ground_truth[0], log.ground_truth), found)
    assert np.hypot(errors[:, 0], errors[:, 1]).max() < 0.3 and np.abs(errors[:, 2]).max() < 0.05


def test_each_drive_has_wheels_or_not() -> None:
    log = simulate(Simulation(seed=5, length=24.0, travel=10.0))
    both = np.array(list(refined_poses(joined([log, without_odometry(log)], "both"))))
    alone = list(refined_poses(without_odometry(log)))
    count = len(log.scans)
    assert both[:count] == pytest.approx(np.array(list(refined_poses(log))))
    assert between(both[count], both[count:]) == pytest.approx(np.array(alone), abs=1e-9)


def corridor(noise: float, seed: int) -> Scan:
    """One scan of two endless walls, 2 m apart."""
    angles = np.radians(np.arange(-90.0, 91.0))
    with np.errstate(divide="ignore"):
        ranges = 1.0 / np.abs(np.sin(angles))
    ranges = ranges + np.random.default_rng(seed).normal(0, noise, len(angles))
    return Scan(np.where(ranges < 30, ranges, np.inf), angles, np.zeros(3))


def test_in_a_corridor_without_ends_the_wheels_hold() -> None:
    """The scans show a robot that stands; its wheels say that it moves."""
    matcher = ScanMatcher(np.zeros(3))
    for k in range(40):
        pose = matcher.add(replace(corridor(0.01, k), odometry=np.array([0.1 * k, 0.0, 0.0])))
    assert pose == pytest.approx([3.9, 0.0, 0.0], abs=0.05)


def walked_ahead(k: int, pace: float) -> Scan:
    """The scan of a robot that has gone k times 2 cm along it, 1.6 m behind a person of this pace."""
    scan = corridor(0.01, k)
    person = np.abs(np.tan(scan.angles)) * (1.6 + (pace - 0.02) * k) < 0.25
    ahead = (1.6 + (pace - 0.02) * k) / np.cos(np.where(person, scan.angles, 0.0))
    ranges = np.where(person & (ahead < scan.ranges), ahead, scan.ranges)
    return replace(scan, ranges=ranges, odometry=np.array([0.02 * k, 0.0, 0.0]))


def test_a_person_who_walks_ahead_does_not_hold_the_robot() -> None:
    """Scan for scan the person is all that stands across; the wheels know how far the robot went."""
    matcher = ScanMatcher(np.zeros(3))
    for k in range(200):
        pose = matcher.add(walked_ahead(k, 0.02))
    assert pose[0] == pytest.approx(200 * 0.02, abs=0.6) and abs(pose[1]) < 0.1


def test_a_slip_of_the_wheels_is_no_motion() -> None:
    """They turn on for a metre while the robot stands in a room."""
    walls = room(0.05)
    angles = np.arctan2(walls[:, 1], walls[:, 0])
    order = np.argsort(angles)
    scan = Scan(np.hypot(*walls.T)[order], angles[order], np.zeros(3))
    matcher = ScanMatcher(np.zeros(3))
    for k in range(60):
        pose = matcher.add(replace(scan, odometry=np.array([0.02 * k, 0.0, 0.0])))
    assert np.abs(pose).max() < 0.05


def test_a_correction_is_held_by_what_stands_across() -> None:
    hall = scan_cloud(corridor(0.0, 0), np.zeros(3))
    shift = np.array([0.3, 0.02, 0.0])
    assert _as_held(hall, hall, shift) == pytest.approx([0.0, 0.02, 0.0], abs=0.01)
    walls = room(0.05)
    cloud = ScanCloud(walls, normals(walls, 0.3))
    assert (_as_held(cloud, cloud, shift / 10) == shift / 10).all()
    nothing = ScanCloud(np.empty((0, 2)), np.empty((0, 2)))
    assert (_as_held(nothing, cloud, shift) == shift).all()


def test_a_solid_cloud_fills_walls_and_no_gaps() -> None:
    wall = np.column_stack([np.arange(0.0, 12.0, 2.0), np.zeros(6)])  # of grazing beams
    away = np.array([[12.0, 3.0], [14.0, 9.0]])
    points = np.concatenate([wall, away])
    solid = ScanCloud(points, np.zeros_like(points)).solid
    on_wall = solid.points[solid.points[:, 1] == 0.0]
    assert np.diff(on_wall[:, 0]).max() == pytest.approx(0.1) and on_wall[-1, 0] == 10.0
    assert solid.points[len(on_wall) :].tolist() == away.tolist()
    filled = solid.normals[: len(on_wall)].any(axis=1)
    assert filled.sum() == 5 * 19 and (np.abs(solid.normals[: len(on_wall)][filled]) == [0.0, 1.0]).all()
    assert len(ScanCloud(points[:1], points[:1]).solid.points) == 1
    assert len(ScanCloud(points[:0], points[:0]).solid.points) == 0
