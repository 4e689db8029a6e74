"""Places that a drive comes back to, found without any text."""

from dataclasses import replace

import numpy as np
import pytest

from m2t_text.evaluation.loops import trajectory_error
from m2t_text.logs import Log
from m2t_text.loops.detection import LoopDetection
from m2t_text.slam.closings import closings
from m2t_text.slam.correction import correct
from m2t_text.slam.key_scans import KeyScans, key_scans
from m2t_text.slam.optimisation import Constraints
from m2t_text.util.geometry import between, compose

NONE = Constraints(
    np.empty((0, 2), dtype=np.int64), np.empty((0, 3)), np.empty((0, 3, 3)), np.empty(0, dtype=bool)
)


@pytest.fixture(scope="module")
def keys(detection: LoopDetection) -> KeyScans:
    return key_scans(detection.log, detection.survey.trajectory)


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
    found = closings(keys, off(keys, drive, 1.5), NONE, 1, nobody)
    assert len(found) >= 3 and found.robust.all()
    errors = found.errors(drive.ground_truth[keys.numbers])
    assert np.hypot(errors[:, 0], errors[:, 1]).max() < 0.15 and np.abs(errors[:, 2]).max() < 0.03


def test_the_same_for_any_number_of_threads(keys: KeyScans, drive: Log):
    one, three = (closings(keys, off(keys, drive, 1.0), NONE, jobs, nobody) for jobs in (1, 3))
    assert (one.pairs == three.pairs).all() and (one.poses == three.poses).all()


def test_none_where_the_robot_was_never_near(keys: KeyScans, drive: Log):
    assert len(closings(keys, off(keys, drive, 100.0), NONE, 1, nobody)) == 0


def test_none_between_places_that_are_tied(keys: KeyScans, drive: Log):
    assert drive.ground_truth is not None
    true = drive.ground_truth[keys.numbers]
    late = np.flatnonzero(keys.way > keys.way[-1] / 2)
    early = np.array([np.argmin(np.hypot(*(true[: late[0]] - true[k]).T[:2])) for k in late])
    pairs = np.column_stack([early, late])
    information = np.tile(np.eye(3), (len(pairs), 1, 1))
    tied = Constraints(pairs, between(true[early], true[late]), information, np.ones(len(pairs), dtype=bool))
    found = closings(keys, off(keys, drive, 1.5), tied, 1, nobody)
    assert len(found) < len(closings(keys, off(keys, drive, 1.5), NONE, 1, nobody))


def test_a_drive_is_corrected_without_loops_found_by_text(detection: LoopDetection, drive: Log):
    assert drive.ground_truth is not None
    alone = correct(replace(detection, loops=[]))
    assert alone.count("loop") == 0 and alone.count("neighbour") > 500
    assert trajectory_error(alone.trajectory, drive.ground_truth) < 0.06
