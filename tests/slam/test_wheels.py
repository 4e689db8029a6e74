"""Wheels count as far as they agree with the trajectory."""

import numpy as np
import pytest

from m2t_text.logs.odometry import chain
from m2t_text.mapping.scan_cloud import ScanCloud
from m2t_text.slam.key_scans import KeyScans
from m2t_text.slam.wheels import wheel_steps
from m2t_text.util.geometry import between, travel

COUNT = 400
RNG = np.random.default_rng(2)
STEPS = np.column_stack([np.full(COUNT, 0.3), np.zeros(COUNT), RNG.normal(0, 0.1, COUNT)])
ROBOT = chain(np.zeros(3), STEPS)
HELD = np.full(COUNT, 0.01**2)  # m², of steps by scan matching alone


def keys(drives: np.ndarray | None = None) -> KeyScans:
    nothing = ScanCloud(np.empty((0, 2)), np.empty((0, 2)))
    count = COUNT + 1
    of = np.zeros(count, dtype=np.int64) if drives is None else drives
    return KeyScans(np.arange(count), [nothing] * count, travel(ROBOT), of)


def noisy(scale: float, turn: float) -> np.ndarray:
    """What wheels say that err by this much, m and rad per square root of m."""
    errors = RNG.normal(0, 1, (COUNT, 3)) * np.sqrt(0.3) * [scale, scale, turn]
    return chain(np.zeros(3), STEPS + errors)


def test_the_noise_of_wheels_is_found() -> None:
    wheels = noisy(0.02, 0.01)
    found = wheel_steps(wheels, ROBOT, keys(), HELD)
    assert len(found) == COUNT and found.pairs[:2].tolist() == [[0, 1], [1, 2]]
    assert found.poses == pytest.approx(between(wheels[:-1], wheels[1:]), abs=0.01)
    sigma = 1 / np.sqrt(found.information[:, [0, 2], [0, 2]].mean(axis=0))
    assert 0.02 < sigma[0] / np.sqrt(0.3) < 0.1 and 0.01 < sigma[1] / np.sqrt(0.3) < 0.02


def test_systematic_errors_are_taken_out() -> None:
    """2 % in length and in turning, and 1 degree a metre."""
    errors = np.array([1.02, 1.0, 1.02])
    wheels = chain(np.zeros(3), STEPS * errors + [0.0, 0.0, 0.3 * np.radians(1.0)])
    found = wheel_steps(wheels, ROBOT, keys(), HELD)
    assert found.poses[:, 0] == pytest.approx(STEPS[:, 0], abs=1e-3)
    left, before = found.poses[:, 2] - STEPS[:, 2], between(wheels[:-1], wheels[1:])[:, 2] - STEPS[:, 2]
    assert np.abs(left).mean() < 0.2 * np.abs(before).mean()
    honest = wheel_steps(noisy(0.01, 0.005), ROBOT, keys(), HELD)
    assert (found.information[0].diagonal() > honest.information[0].diagonal()).all()


def test_where_scans_hold_nothing_they_say_nothing_of_the_wheels() -> None:
    """In most of the drive the robot is where the wheels put it, which are 2 % too long."""
    loose = np.arange(COUNT) % 100 >= 30
    wheels = chain(np.zeros(3), STEPS * np.array([1.02, 1.0, 1.0]))
    robot = chain(np.zeros(3), STEPS * np.column_stack([np.where(loose, 1.02, 1.0), np.ones((COUNT, 2))]))
    found = {
        told: wheel_steps(wheels, robot, keys(), np.where(told & loose, 1.0, 0.01**2)).poses[:, 0].mean()
        for told in (False, True)
    }
    assert abs(found[True] - 0.3) < 0.001 and abs(found[False] - 0.3) > 0.004


def test_wheels_that_change_say_little() -> None:
    """Their length is off by 5 %, now this way and now that: no error that all of a drive has."""
    lengths = np.where(np.arange(COUNT) // 100 % 2, 1.05, 0.95)
    changing = wheel_steps(
        chain(np.zeros(3), STEPS * np.column_stack([lengths, lengths, lengths])), ROBOT, keys(), HELD
    )
    honest = wheel_steps(noisy(0.01, 0.001), ROBOT, keys(), HELD)
    assert changing.information[0, 0, 0] < honest.information[0, 0, 0] / 4


def test_drives_without_wheels_have_no_steps() -> None:
    drives = np.repeat([0, 1], [200, COUNT + 1 - 200])
    wheels = noisy(0.01, 0.001)
    wheels[200:] = wheels[200]
    found = wheel_steps(wheels, ROBOT, keys(drives), HELD)
    assert found.pairs.max() == 199 and len(found) == 199
    assert len(wheel_steps(np.zeros_like(ROBOT), ROBOT, keys(), HELD)) == 0
