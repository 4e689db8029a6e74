"""Places that a drive comes back to, found without any text."""

import numpy as np
import pytest

from m2t_text.config import PROFILES
from m2t_text.evaluation.loops import trajectory_error
from m2t_text.logs import Log
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.loops.detection import LoopDetection
from m2t_text.loops.uncertainty import Drift
from m2t_text.mapping.local_map import Survey
from m2t_text.mapping.scan_cloud import ScanCloud
from m2t_text.mapping.trajectory import survey
from m2t_text.slam.closings import _back_to_back, closings
from m2t_text.slam.correction import correct
from m2t_text.slam.key_scans import KeyScans, key_scans
from m2t_text.slam.optimisation import Constraints
from m2t_text.slam.reach import reached
from m2t_text.util.geometry import between, compose

NONE = Constraints(
    np.empty((0, 2), dtype=np.int64), np.empty((0, 3)), np.empty((0, 3, 3)), np.empty(0, dtype=bool)
)


@pytest.fixture(scope="module")
def drive() -> Log:
    """A drive that comes back to places where it was long before."""
    return simulate(Simulation(seed=5, length=24.0, travel=75.0, step=0.25))


@pytest.fixture(scope="module")
def followed(drive: Log) -> Survey:
    return survey(drive, PROFILES["default"].mapping)


@pytest.fixture(scope="module")
def keys(drive: Log, followed: Survey) -> KeyScans:
    return key_scans(drive, followed.trajectory)


def surely(keys: KeyScans) -> np.ndarray:
    """Variances of steps that scans hold well in every direction, m²."""
    return np.full(len(keys) - 1, 0.01**2)


def nobody(done: int, of: int) -> None:
    """Progress that nobody watches."""


def off(keys: KeyScans, drive: Log, shift: float) -> np.ndarray:
    """The key scans' true poses, but for the second half of the drive, which is off by so many metres."""
    assert drive.ground_truth is not None
    poses = drive.ground_truth[keys.numbers].copy()
    late = keys.way > keys.way[-1] / 2
    poses[late] = compose([shift, -shift / 2, 0.02], poses[late])
    return poses


def test_they_are_right_though_the_trajectory_is_not(keys: KeyScans, drive: Log):
    assert drive.ground_truth is not None
    found = closings(keys, off(keys, drive, 1.5), surely(keys), NONE, 1, nobody)
    assert len(found) >= 3 and found.robust.all()
    errors = found.errors(drive.ground_truth[keys.numbers])
    assert np.hypot(errors[:, 0], errors[:, 1]).max() < 0.15 and np.abs(errors[:, 2]).max() < 0.03


def test_the_same_for_any_number_of_threads(keys: KeyScans, drive: Log):
    one, three = (closings(keys, off(keys, drive, 1.0), surely(keys), NONE, jobs, nobody) for jobs in (1, 3))
    assert (one.pairs == three.pairs).all() and (one.poses == three.poses).all()


def test_none_where_the_robot_was_never_near(keys: KeyScans, drive: Log):
    assert len(closings(keys, off(keys, drive, 100.0), surely(keys), NONE, 1, nobody)) == 0


def test_none_between_places_that_are_tied(keys: KeyScans, drive: Log):
    assert drive.ground_truth is not None
    true = drive.ground_truth[keys.numbers]
    late = np.flatnonzero(keys.way > keys.way[-1] / 2)
    early = np.array([np.argmin(np.hypot(*(true[: late[0]] - true[k]).T[:2])) for k in late])
    pairs = np.column_stack([early, late])
    information = np.tile(np.eye(3) * 1e4, (len(pairs), 1, 1))
    tied = Constraints(pairs, between(true[early], true[late]), information, np.ones(len(pairs), dtype=bool))
    found = closings(keys, off(keys, drive, 1.5), surely(keys), tied, 1, nobody)
    assert len(found) < len(closings(keys, off(keys, drive, 1.5), surely(keys), NONE, 1, nobody))


def test_a_place_is_not_tied_by_what_leaves_a_direction_open(keys: KeyScans):
    """Two passes through a corridor without anything across, joined across it only."""
    ends = np.array([[0, len(keys) - 1]])
    across = np.diag([0.0, 1e4, 1e4])[None]
    for information, near in ((np.eye(3)[None] * 1e4, True), (across, False)):
        known = Constraints(ends, np.zeros((1, 3)), information, np.ones(1, dtype=bool))
        first = next(iter(reached(keys, surely(keys), known, 0.05)))
        assert first[:20].all() and not first[40 : len(keys) - 40].any() and first[-1] == near


def test_a_wall_seen_from_behind_is_another_wall():
    """A corridor that branches off between two walls: from the left its right wall is seen, and the reverse."""
    wall = np.column_stack([np.arange(-10, 10, 0.05), np.full(400, 1.0)])
    branch = np.column_stack([np.full(120, 1.2), np.arange(1.0, 7.0, 0.05)])
    normals = np.repeat([[0.0, -1.0], [1.0, 0.0]], [400, 120], axis=0)
    cloud = ScanCloud(np.concatenate([wall, branch]), normals)
    left, right = cloud.facing(np.array([-3.0, 0.0])), cloud.facing(np.array([5.0, 0.0]))
    assert _back_to_back(left, left) == 0.0
    assert _back_to_back(left, right) == pytest.approx(120 / 520, abs=0.02)


def test_a_drive_is_corrected_without_loops_found_by_text(followed: Survey, drive: Log):
    assert drive.ground_truth is not None
    drifts = {drive.name: Drift(followed.trajectory)}
    alone = correct(LoopDetection(drive, followed, None, 0, [], [], [], drifts, {}))
    assert alone.count("loop") == 0 and alone.count("neighbour") > 500
    assert trajectory_error(alone.trajectory, drive.ground_truth) < 0.06
