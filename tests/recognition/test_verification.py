"""Verification on known transforms, and the verdict where the answer is known."""

import numpy as np
import pytest

from m2t_text.config import PROFILES
from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.index.results import Hit
from m2t_text.pipeline import view_text
from m2t_text.recognition.finding import Found, verdict
from m2t_text.recognition.verification import Alignment, align, grip, relative_pose
from m2t_text.util.geometry import between, compose, inverse, transform, wrap

CELL = 0.1


def hall(seed: int = 0) -> np.ndarray:
    """Walls, a niche and some furniture, sampled every 3 cm with 1 cm of noise."""
    rng = np.random.default_rng(seed)
    corners = [
        (-5, -2),
        (5, -2),
        (5, 0),
        (6, 0),
        (6, 1.5),
        (5, 1.5),
        (5, 3),
        (-1, 3),
        (-1, 2.4),
        (-5, 2.4),
        (-5, -2),
    ]
    sides = []
    for a, b in zip(np.array(corners), np.array(corners[1:]), strict=False):
        sides.append(a + np.linspace(0, 1, int(np.hypot(*(b - a)) / 0.03))[:, None] * (b - a))
    for centre in ((-3.0, -1.0), (2.2, 1.7)):
        angle = np.linspace(0, 2 * np.pi, 40)
        sides.append(np.array(centre) + 0.25 * np.stack([np.cos(angle), np.sin(angle)], 1))
    points = np.concatenate(sides)
    return points + rng.normal(0, 0.01, points.shape)


def seen_from(points: np.ndarray, pose) -> Text:
    return view_text(transform(inverse(pose), points), PROFILES["default"].description, CELL)


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
@pytest.mark.parametrize("off", [(0.0, 0.0, 0.0), (0.5, -0.3, 2.0), (-0.8, 0.6, -3.0)])
def test_a_known_transform_is_found(turn, off):
    here, there = np.array([0.2, 0.1, 0.0]), np.array([*off[:2], np.radians(turn + off[2])])
    query, found = seen_from(hall(1), there), seen_from(hall(2), here)
    (alignment,) = align(query, [found], CELL)
    error = between(between(here, there), alignment.pose)
    assert np.hypot(*error[:2]) < 0.05 and abs(np.degrees(wrap(error[2]))) < 0.6
    assert alignment.inlier_ratio > 0.9 and alignment.grip > 0.1


def test_another_place_fits_worse():
    query = seen_from(hall(1), np.zeros(3))
    other = seen_from(hall(2)[:300] * [1.0, -1.3] + [0.4, 0.2], np.zeros(3))
    same, different = align(query, [seen_from(hall(2), np.zeros(3)), other], CELL)
    assert same.inlier_ratio > different.inlier_ratio + 0.3


def test_two_parallel_walls_have_no_grip():
    assert grip(np.array([[0.0, 1.0]] * 9 + [[0.0, -1.0]] * 9)) == pytest.approx(0.0)
    assert grip(np.array([[0.0, 1.0], [1.0, 0.0]])) == pytest.approx(0.5)
    assert grip(np.empty((0, 2))) == 0.0


def test_nothing_to_align():
    empty, some = Text.of([], [], []), seen_from(hall(), np.zeros(3))
    assert align(some, [], CELL) == []
    assert [one.inlier_ratio for one in align(empty, [some], CELL)] == [0.0]
    assert [one.inlier_ratio for one in align(some, [empty], CELL)] == [0.0]


def document(number: int, place=(0.0, 0.0, 0.0), viewpoint=(0.0, 0.0, 0.0), dataset: str = "log") -> Document:
    travel = np.array([number, number + 5.0])
    empty = Text.of([], [], [])
    pose = np.array(place, dtype=float)
    return Document(dataset, number, number + 9, travel, pose, np.array(viewpoint), np.zeros(2), 9, empty)


def test_the_pose_is_that_of_the_first_scans():
    query = document(1, viewpoint=(1.0, 0.0, np.pi / 2))
    found = document(2, viewpoint=(0.0, 2.0, 0.0))
    between_views = np.array([0.5, 0.0, np.pi / 2])
    pose = relative_pose(query, found, between_views)
    # The query's viewpoint must come to lie where the found map's viewpoint sees it.
    assert compose(pose, query.viewpoint) == pytest.approx(compose(found.viewpoint, between_views))


def found(number: int, ratio: float, place=(0.0, 0.0, 0.0), grip: float = 0.3, dataset: str = "log") -> Found:
    one = document(number, place, dataset=dataset)
    return Found(Hit(one, ratio, 9, np.zeros(3)), None, ratio, Alignment(np.zeros(3), ratio, ratio, grip))


@pytest.mark.parametrize(
    ("results", "wanted"),
    [
        ([], "none"),
        ([found(0, 0.2)], "none"),
        ([found(0, 0.95)], "match"),
        ([found(0, 0.5)], "ambiguous"),
        ([found(0, 0.95, grip=0.0)], "ambiguous"),
        # A rival as good as the best, 30 m off after 20 m of travel.
        ([found(0, 0.95), found(20, 0.95, place=(30.0, 0.0, 0.0))], "ambiguous"),
        # The same place seen once more, as far as the trajectory can tell.
        ([found(0, 0.95), found(100, 0.95, place=(1.0, 0.0, 0.0))], "match"),
        ([found(0, 0.95), found(0, 0.95, dataset="another")], "ambiguous"),
        ([found(0, 0.95), found(20, 0.5, place=(30.0, 0.0, 0.0))], "match"),
    ],
)
def test_the_verdict(results, wanted):
    assert verdict(results) == wanted
