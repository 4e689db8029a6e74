"""The certainty of an alignment: what holds it, and what lets it slide."""

import numpy as np
import pytest

from m2t_text.config import MappingParameters
from m2t_text.loops.lookup import QUERY_SPACING, alignment_covariance
from m2t_text.mapping.normals import cloud_normals
from m2t_text.recognition.covariance import REMAINDER
from m2t_text.recognition.raster import NORMAL_REACH, Shape
from m2t_text.util.geometry import compose, inverse, transform

MAPPING = MappingParameters()


def walls(*ends: tuple[float, float, float, float]) -> np.ndarray:
    """Points on straight walls ``x1 y1 x2 y2``, 0.1 m apart."""
    points = []
    for x1, y1, x2, y2 in ends:
        along = np.linspace(0, 1, round(np.hypot(x2 - x1, y2 - y1) / 0.1) + 1)[:, None]
        points.append(np.array([x1, y1]) + along * [x2 - x1, y2 - y1])
    return np.concatenate(points)


CORRIDOR = walls((-4, 1, 4, 1), (-4, -1, 4, -1), (4, -1, 4, 0.5))
ROOM = walls((-3, -3, 3, -3), (3, -3, 3, 3), (3, 3, -3, 3), (-3, 3, -3, -3))


def shapes(points: np.ndarray, pose: np.ndarray, misfit: float) -> tuple[Shape, Shape]:
    """A map, and it again from a frame that has this pose in its own, its points off their walls."""
    found = Shape(points, cloud_normals(points, NORMAL_REACH))
    away = points + misfit * np.random.default_rng(0).choice([-1, 1], (len(points), 1)) * found.normals
    back = inverse(pose)
    return Shape(transform(back, away), transform(np.array([0.0, 0.0, back[2]]), found.normals)), found


def covariance(points: np.ndarray, pose: np.ndarray, misfit: float = 0.03) -> np.ndarray:
    return alignment_covariance(*shapes(points, pose, misfit), pose, MAPPING)


def test_a_corridor_holds_less_along_than_across():
    along, across = np.sqrt(np.diag(covariance(CORRIDOR, np.zeros(3)))[:2])
    assert along > 1.2 * across


def test_a_room_holds_alike_and_no_better_than_what_remains():
    sigma = np.sqrt(np.diag(covariance(ROOM, np.zeros(3))))
    assert sigma[0] == pytest.approx(sigma[1], rel=0.05)
    assert (sigma >= REMAINDER).all() and (sigma < 4 * REMAINDER).all()


def test_it_is_given_in_the_querys_frame():
    sigma = np.sqrt(np.diag(covariance(CORRIDOR, np.array([0.4, -0.2, np.pi / 2])))[:2])
    assert sigma[1] > 1.2 * sigma[0]  # the corridor runs along the query's y axis


def test_misfits_count():
    sharp, blurred = (np.trace(covariance(ROOM, np.zeros(3), misfit)) for misfit in (0.01, 0.04))
    assert blurred > sharp


def test_the_fit_has_the_slopes_of_its_residuals():
    """Up to a factor, it inverts the sum of the residuals' squared slopes, which moving the query shows."""
    pose = np.array([0.3, 0.1, 0.2])
    query, found = shapes(CORRIDOR, pose, 0.03)
    residuals = [
        ((transform(compose(pose, step), query.points) - CORRIDOR) * found.normals).sum(axis=1)
        for step in (*np.eye(3) * 1e-6, *np.eye(3) * -1e-6)
    ]
    slopes = np.column_stack([(residuals[k] - residuals[k + 3]) / 2e-6 for k in range(3)])
    fit = covariance(CORRIDOR, pose) * QUERY_SPACING / MAPPING.run_length - np.diag(REMAINDER**2)
    expected = np.linalg.inv(slopes.T @ slopes)
    assert fit / np.trace(fit) == pytest.approx(expected / np.trace(expected), rel=0.02, abs=1e-3)


@pytest.mark.parametrize("across", [[0.0, 1.0], [0.0, 0.0]])
def test_a_direction_that_nothing_holds_is_loose_and_no_singular_matrix(across: list[float]) -> None:
    """A corridor without anything across it, and points of which no wall is known."""
    points = np.column_stack([np.arange(0.0, 6.0, 0.1), np.ones(60)])
    shape = Shape(points, np.tile(across, (60, 1)))
    covariance = alignment_covariance(shape, shape, np.zeros(3), MAPPING)
    sigma = np.sqrt(np.linalg.eigvalsh(covariance))
    assert np.isfinite(covariance).all() and sigma[0] > 0 and sigma[-1] > 5.0
    nothing = Shape(points + np.array([0.0, 50.0]), shape.normals)
    assert np.linalg.eigvalsh(alignment_covariance(nothing, shape, np.zeros(3), MappingParameters()))[0] > 0
