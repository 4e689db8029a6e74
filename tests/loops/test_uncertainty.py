"""Covariances of relative poses: by hand, by drawing errors, and by chaining a trajectory's steps."""

import numpy as np
import pytest

from m2t_text.loops.uncertainty import (
    BIAS,
    HEADING,
    MOVE,
    STILL,
    TURN_VARIANCE,
    Drift,
    PoseWithCovariance,
    adjoint,
    exact,
)
from m2t_text.util.geometry import between, compose, inverse

RNG = np.random.default_rng(4)
WINDING = np.cumsum(RNG.normal([0.4, 0.1, 0.0], [0.2, 0.3, 0.5], (40, 3)), axis=0)


def drawn(poses: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Covariance of poses (N, 3) about their mean, in its frame."""
    errors = between(mean, poses)
    return errors.T @ errors / len(errors)


def spread(covariance: np.ndarray, count: int = 200_000) -> np.ndarray:
    return RNG.multivariate_normal(np.zeros(3), covariance, count)


def test_adjoint_moves_a_small_motion_to_the_outer_frame():
    pose, motion = np.array([2.0, -1.0, 0.7]), np.array([1e-6, 2e-6, -3e-6])
    outer = compose(compose(pose, motion), inverse(pose))
    assert adjoint(pose) @ motion == pytest.approx(outer, abs=1e-11)


def test_chaining_and_inverting_agree_with_drawn_errors():
    a = PoseWithCovariance(np.array([3.0, 1.0, 0.5]), np.diag([4e-4, 1e-4, 9e-5]))
    b = PoseWithCovariance(np.array([-2.0, 4.0, 2.0]), np.diag([1e-4, 6e-4, 4e-5]))
    noisy = compose(compose(a.pose, spread(a.covariance)), compose(b.pose, spread(b.covariance)))
    assert drawn(noisy, a.compose(b).pose) == pytest.approx(a.compose(b).covariance, rel=0.03, abs=2e-5)
    back = inverse(compose(a.pose, spread(a.covariance)))
    assert drawn(back, a.inverse().pose) == pytest.approx(a.inverse().covariance, rel=0.03, abs=2e-6)


def test_a_straight_way_by_hand():
    # Two steps of 1 m: the first one's error of heading moves the end by 1 m times it, sideways.
    both = Drift(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])).relative(0, 2)
    move, heading = MOVE + STILL[0], HEADING + STILL[1]
    expected = np.array([[2 * move, 0, 0], [0, 2 * move + heading, heading], [0, heading, 2 * heading]])
    bias = np.array([0.0, 1.0, 2.0])  # of 1 rad per m: the same error at the end of both
    expected += BIAS * np.outer(bias, bias)
    assert both.pose.tolist() == [2, 0, 0]
    assert both.covariance == pytest.approx(expected)


def test_turning_on_the_spot_costs_heading():
    turned = Drift(np.array([[0.0, 0, 0], [0, 0, 1.5]])).relative(0, 1)
    assert turned.covariance[2, 2] == pytest.approx(1.5 * TURN_VARIANCE + STILL[1])


@pytest.mark.parametrize(("origin", "place"), [(0, 39), (7, 8), (12, 30), (30, 12), (39, 0), (5, 5)])
def test_drift_is_the_chain_of_its_steps(origin: int, place: int):
    drift = Drift(WINDING)
    chained = exact(np.zeros(3))
    first, last = min(origin, place), max(origin, place)
    bias = np.zeros(3)  # how 1 rad per m moves the last pose, in its own frame
    for k in range(first, last):
        move, heading = drift.steps[k]
        step = PoseWithCovariance(between(WINDING[k], WINDING[k + 1]), np.diag([move, move, heading]))
        chained = chained.compose(step)
        length = np.hypot(*step.pose[:2])
        bias = adjoint(inverse(step.pose)) @ bias + np.array([0.0, 0.0, length])
    chained = PoseWithCovariance(chained.pose, chained.covariance + BIAS * np.outer(bias, bias))
    expected = chained if place >= origin else chained.inverse()
    found = drift.relative(np.array([origin, 3]), np.array([place, 4]))
    assert between(found.pose[0], expected.pose) == pytest.approx(np.zeros(3), abs=1e-9)
    assert found.covariance[0] == pytest.approx(expected.covariance, rel=1e-6, abs=1e-12)


def test_distance_and_reach():
    one = PoseWithCovariance(np.array([[0.0, 0, 0]]), np.diag([0.04, 0.01, 0.01])[None])
    other = exact(np.array([[0.6, 0.0, 0.1]]))
    assert one.distance(other) == pytest.approx([0.36 / 0.04 + 0.01 / 0.01])
    assert one.reach == pytest.approx([0.2])


def test_nothing_is_known_across_a_cut() -> None:
    poses = np.stack([np.arange(6.0), np.zeros(6), np.zeros(6)], axis=1)
    whole, cut = Drift(poses), Drift(poses, [3])
    assert cut.relative(0, 2).covariance == pytest.approx(whole.relative(0, 2).covariance)
    assert cut.relative(3, 5).covariance == pytest.approx(whole.relative(3, 5).covariance)
    assert cut.relative(0, 5).reach > 100.0 > whole.relative(0, 5).reach
