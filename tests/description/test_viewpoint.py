"""Viewpoint planning by hand: the centre of gravity, the nearest pose, and the direction of least entropy."""

import numpy as np
import pytest

from m2t_text.description.viewpoint import (
    dominant_direction,
    likely_directions,
    plan_viewpoint,
    projection_entropies,
)


def turned(points: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def corridor(length: float = 8.0, width: float = 2.0) -> np.ndarray:
    x = np.arange(0, length, 0.1)
    return np.concatenate([np.stack([x, np.zeros_like(x)], 1), np.stack([x, np.full_like(x, width)], 1)])


def test_entropy_by_hand():
    # Four points: two places in x with two each, so ln 2; one place in y, so 0.
    points = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    # Seen at 90 degrees the axes change places.
    assert projection_entropies(points, np.array([0.0, np.pi / 2])) == pytest.approx([np.log(2), np.log(2)])


@pytest.mark.parametrize("degrees", [0, 7, 30, 44, 46, 60, 89])
def test_the_direction_is_that_of_the_walls(degrees):
    found = np.degrees(dominant_direction(turned(corridor(), np.radians(degrees))))
    assert abs((found - degrees + 45) % 90 - 45) <= 0.5


def test_directions_of_degenerate_maps_are_defined():
    assert dominant_direction(np.empty((0, 2))) == 0.0
    assert dominant_direction(np.zeros((1, 2))) == 0.0
    assert 0 <= dominant_direction(np.zeros((5, 2))) < np.pi / 2


def test_the_viewpoint_is_the_nearest_pose_or_the_centre_itself():
    points = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]])
    trajectory = np.array([[0.0, 1.2, 0.1], [1.8, 1.3, 0.1], [5.0, 1.0, 0.1]])
    on_trajectory, centre = plan_viewpoint(points, trajectory, on_trajectory=True)
    assert centre.tolist() == [2.0, 1.0]
    assert on_trajectory[:2].tolist() == [1.8, 1.3]
    at_centre, _ = plan_viewpoint(points, trajectory, on_trajectory=False)
    assert at_centre[:2].tolist() == [2.0, 1.0]


@pytest.mark.parametrize("heading", [0.0, 1.7, 3.1, -1.4])
def test_of_the_four_directions_the_robots_is_taken(heading):
    trajectory = np.array([[4.0, 1.0, heading]])
    viewpoint, _ = plan_viewpoint(corridor(), trajectory, on_trajectory=True)
    assert abs((viewpoint[2] - heading + np.pi) % (2 * np.pi) - np.pi) <= np.pi / 4 + 1e-9
    assert abs((viewpoint[2] + np.pi / 4) % (np.pi / 2) - np.pi / 4) < np.radians(0.5)


def test_a_map_without_points_is_seen_from_its_first_pose():
    viewpoint, centre = plan_viewpoint(np.empty((0, 2)), np.array([[1.0, 2.0, 0.3]]), on_trajectory=False)
    assert viewpoint[:2].tolist() == centre.tolist() == [1.0, 2.0]


def test_likely_directions_of_one_and_of_two_wings():
    one = corridor() / 0.1
    assert likely_directions(one, 3) == [0.0]
    wing = np.concatenate([one, turned(one, np.radians(30)) + np.array([200.0, 0.0])])
    directions = np.degrees(likely_directions(wing, 3))
    assert directions[0] == 0 and any(abs(d - 30) <= 2 for d in directions[1:])
    assert likely_directions(wing, 1) == [0.0]
    assert likely_directions(np.empty((0, 2)), 3) == [0.0]
