"""Verification on known transforms."""

import numpy as np
import pytest

from m2t_text.config import PROFILES
from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.pipeline import view_text
from m2t_text.recognition.verification import align, align_variously, relative_pose
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
    assert alignment.inlier_ratio > 0.9 and alignment.fit.grip > 0.1


def test_another_place_fits_worse():
    query = seen_from(hall(1), np.zeros(3))
    other = seen_from(hall(2)[:300] * [1.0, -1.3] + [0.4, 0.2], np.zeros(3))
    same, different = align(query, [seen_from(hall(2), np.zeros(3)), other], CELL)
    assert same.inlier_ratio > different.inlier_ratio + 0.3


def test_a_candidate_is_aligned_from_several_directions_and_the_best_comes_first():
    query, found = seen_from(hall(1), np.array([0.0, 0.0, np.pi])), seen_from(hall(2), np.zeros(3))
    (alignments,) = align_variously(query, [found], CELL)
    turns = [round(np.degrees(wrap(one.pose[2]))) % 360 for one in alignments]
    assert turns[0] == 180 and len(turns) == len(set(turns)) > 1
    evidence = [one.fit.evidence for one in alignments]
    assert evidence == sorted(evidence, reverse=True)


def test_candidates_are_aligned_as_if_each_were_alone():
    query = seen_from(hall(1), np.array([0.3, 0.1, 0.5]))
    candidates = [seen_from(hall(k)[: 900 - 60 * k], np.array([0.1 * k, 0.0, 0.3 * k])) for k in range(12)]
    together = align_variously(query, [*candidates[:6], Text.of([], [], []), *candidates[6:]], CELL)
    alone = [align_variously(query, [one], CELL)[0] for one in candidates]
    for some, others in zip(together[:6] + together[7:], alone, strict=True):
        assert [one.fit for one in some] == [one.fit for one in others]
        assert np.array_equal([one.pose for one in some], [one.pose for one in others])


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
