"""Odometry that comes late, twice, with gaps, or leaps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from m2t_text.errors import LogError
from m2t_text.live.odometry import OdometryBuffer


def filled(*messages: tuple[float, float]) -> OdometryBuffer:
    odometry = OdometryBuffer()
    for time, x in messages:
        odometry.add(time, (x, 0.0, 0.0))
    return odometry


def test_between_two_messages() -> None:
    odometry = OdometryBuffer()
    odometry.add(0.0, (0.0, 0.0, 3.0))
    odometry.add(1.0, (1.0, 2.0, -3.0))  # on through pi
    placed = odometry.at(0.5)
    assert placed is not None
    assert placed.pose[:2].tolist() == [0.5, 1.0] and abs(abs(placed.pose[2]) - np.pi) < 1e-12


@given(st.permutations(range(8)))
def test_late_messages_are_put_in_their_place(order: list[int]) -> None:
    odometry = filled(*((0.1 * k, 0.01 * k) for k in order))
    for k in range(70):
        placed = odometry.at(0.01 * k)
        assert placed is not None and placed.pose[0] == pytest.approx(0.001 * k) and placed.drive == 0


def test_a_repeated_message_tells_nothing() -> None:
    odometry = filled((0.0, 0.0), (0.1, 0.05))
    assert not odometry.add(0.1, (0.07, 0.0, 0.0))
    placed = odometry.at(0.1)
    assert placed is not None and placed.pose[0] == 0.05


def test_nothing_is_known_before_after_and_over_gaps() -> None:
    odometry = filled((0.0, 0.0), (0.5, 0.1), (2.5, 0.2), (3.0, 0.3))
    assert [odometry.at(time) is None for time in (-0.1, 0.2, 1.0, 2.4, 2.7, 3.1)] == [
        True,
        False,
        True,
        True,
        False,
        True,
    ]
    assert OdometryBuffer().at(0.0) is None


@pytest.mark.parametrize("leap", [(60.0, 0.0, 0.0), (0.0, 0.0, 0.0)])
def test_a_leap_and_a_new_begin_are_new_drives(leap: tuple[float, float, float]) -> None:
    odometry = filled(*((0.1 * k, 5.0 + 0.05 * k) for k in range(5)))
    odometry.add(0.5, leap)
    odometry.add(0.6, (leap[0] + 0.05, 0.0, 0.0))
    drives = [placed.drive for time in (0.35, 0.45, 0.55) if (placed := odometry.at(time))]
    assert drives == [0, 0, 1]
    across = odometry.at(0.45)
    assert across is not None and across.pose[0] == pytest.approx(5.2)  # no robot was half way


def test_a_clock_that_begins_again_is_a_new_drive() -> None:
    odometry = filled((100.0, 0.0), (100.1, 0.1), (5.0, 0.1), (5.1, 0.2))
    placed = odometry.at(5.05)
    assert placed is not None and placed.drive == 1 and odometry.at(100.05) is None


def test_what_is_kept_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("m2t_text.live.odometry.MAX_MESSAGES", 300)
    odometry = filled(*((0.0001 * k, 0.0) for k in range(500)))
    assert len(odometry._times) == 300
    odometry = filled(*((0.1 * k, 0.0) for k in range(1000)))
    assert len(odometry._times) <= 102


@pytest.mark.parametrize("pose", [(0.0, 0.0), (0.0, np.inf, 0.0), (np.nan, 0.0, 0.0)])
def test_what_is_no_odometry(pose: tuple[float, ...]) -> None:
    with pytest.raises(LogError, match="odometry"):
        OdometryBuffer().add(0.0, pose)
    with pytest.raises(LogError, match="odometry"):
        OdometryBuffer().add(np.nan, (0.0, 0.0, 0.0))
