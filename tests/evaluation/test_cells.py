"""A map's occupied cells against those at the true poses, and the alignment of a trajectory."""

import numpy as np
import pytest

from m2t_text.evaluation.cells import cell_agreement
from m2t_text.evaluation.loops import aligned, trajectory_error
from m2t_text.logs import Log
from m2t_text.loops.detection import LoopDetection
from m2t_text.util.geometry import compose


def test_true_poses_draw_the_true_map(drive: Log, detection: LoopDetection):
    truth = drive.ground_truth
    assert truth is not None
    same = cell_agreement(drive, detection.survey, truth, truth)
    assert set(same.to_json().values()) == {1.0}


def test_a_cell_beside_counts_as_near_alone(drive: Log, detection: LoopDetection):
    truth = drive.ground_truth
    assert truth is not None
    beside = cell_agreement(drive, detection.survey, truth + np.array([0.1, 0.0, 0.0]), truth)
    assert beside.near_precision > 0.99 and beside.near_recall > 0.99
    assert 0.2 < beside.precision < 0.8
    away = cell_agreement(drive, detection.survey, truth + np.array([0.5, 0.4, 0.0]), truth)
    assert away.near_precision < 0.5 and away.near_recall < 0.5


def test_a_rigid_motion_is_taken_out():
    truth = np.array([[0.0, 0.0, 0.1], [2.0, 0.0, 0.2], [2.0, 1.0, -3.0], [0.5, 1.5, 0.0]])
    moved = compose(np.array([3.0, -4.0, 2.0]), truth)
    assert aligned(moved, truth)[:, :2] == pytest.approx(truth[:, :2])
    assert np.cos(aligned(moved, truth)[:, 2] - truth[:, 2]) == pytest.approx(1.0)
    assert trajectory_error(moved, truth) == pytest.approx(0.0, abs=1e-9)
    shifted = truth + np.array([[0.1], [-0.1], [0.1], [-0.1]]) * [0.0, 1.0, 0.0]
    assert 0.0 < trajectory_error(shifted, truth) <= 0.1
