"""What one map says of another's keypoints, against a slow and plain count."""

import numpy as np
import pytest

from m2t_text.description.free_squares import FreeSquares
from m2t_text.description.text import Text
from m2t_text.recognition.fit import Fit
from m2t_text.recognition.overlay import overlaid
from m2t_text.recognition.raster import INLIER, Raster, refined
from m2t_text.util.geometry import inverse, transform

CELL = 0.1


def room(*squares: tuple[int, int, int]) -> Text:
    """The four walls of a room of 6 x 4 m, and squares that are free."""
    x, y = np.arange(-30, 30), np.arange(-20, 20)
    cells = [(a, b) for a in x for b in (-20, 19)] + [(a, b) for a in (-30, 29) for b in y]
    return Text.of(
        *np.array(cells).T, np.zeros(len(cells)), FreeSquares.of(*np.array(squares).reshape(-1, 3).T)
    )


def counted(query: Text, pose: np.ndarray, found: Text) -> tuple[int, int, int]:
    """Inliers, conflicts and seen, keypoint by keypoint and square by square."""
    inliers, conflicts, seen = 0, 0, 0
    walls = found.positions() * CELL
    squares = list(zip(found.free.wx, found.free.wy, found.free.size, strict=True))
    for x, y in transform(pose, query.positions() * CELL):
        cell = np.floor(np.array([x, y]) / CELL)
        near = np.hypot(*(walls - [x, y]).T).min() < INLIER
        within = [
            [low_x - m <= cell[0] < low_x + f + m and low_y - m <= cell[1] < low_y + f + m for m in (0, 3)]
            for low_x, low_y, f in squares
        ]
        beside = (np.abs(found.positions() - 0.5 - cell).max(axis=1) <= 3).any()
        inliers += near
        conflicts += not near and any(inner for inner, _ in within)
        seen += beside or any(outer for _, outer in within)
    return inliers, conflicts, seen


@pytest.mark.parametrize(
    "pose", [(0.0, 0.0, 0.0), (0.31, -0.17, 0.2), (1.02, 0.93, np.pi / 2), (9.0, 0.0, 3.0)]
)
def test_the_count_is_that_of_a_plain_one(pose: tuple[float, float, float]) -> None:
    query, found = room((-10, -10, 12)), room((-27, -17, 34), (0, 0, 12), (20, -10, 4))
    where = np.array(pose)
    counts = overlaid(Raster.of(query, CELL), where[None], Raster.of(found, CELL))
    assert (counts.inliers, counts.conflicts, counts.seen) == counted(query, where, found)


def test_what_the_other_map_never_saw_says_nothing() -> None:
    """Half of a room, and all of it: what lies beyond the half's sight is neither for nor against."""
    whole, half = room((-27, -17, 34), (-7, -17, 34)), room((-27, -17, 34))
    left = half.wx < 5
    part = Text.of(half.wx[left], half.wy[left], half.wa[left], half.free)
    fit = Fit.of(Raster.of(part, CELL), np.zeros(3), Raster.of(whole, CELL))
    assert fit.inliers < 0.9 * fit.keypoints and fit.seen < fit.keypoints
    assert fit.seen_inliers > 0.95 and fit.conflict_ratio == 0.0


def test_a_wall_where_the_other_saw_nothing_is_a_conflict() -> None:
    found = room((-27, -17, 34), (-7, -17, 34))
    wall = Text.of(np.zeros(20), np.arange(-10, 10), np.zeros(20), FreeSquares.of([5], [-10], [4]))
    fit = Fit.of(Raster.of(wall, CELL), np.zeros(3), Raster.of(found, CELL))
    assert fit.conflicts == 20 and fit.conflict_ratio == pytest.approx(20 / fit.keypoints)


def test_the_largest_patch_of_misfits_is_a_wall_that_one_map_lacks() -> None:
    """A wall of 20 keypoints and a shorter one of 8, apart from it, where the room was seen to be free."""
    found = Raster.of(room((-27, -17, 34), (-7, -17, 34)), CELL)
    y = np.append(np.arange(-10, 10), np.arange(-16, -8))
    walls = Text.of(np.repeat([0, 8], [20, 8]), y, np.zeros(28))
    assert Fit.of(Raster.of(walls, CELL), np.zeros(3), found).patch == 20
    joined = Text.of(np.append(walls.wx, np.arange(2, 8, 2)), np.append(y, [-9, -9, -9]), np.zeros(31))
    assert Fit.of(Raster.of(joined, CELL), np.zeros(3), found).patch == 31
    assert Fit.of(found, np.zeros(3), found).patch == 0


def test_the_distance_is_that_of_the_inliers() -> None:
    raster = Raster.of(room((-27, -17, 34)), CELL)
    assert Fit.of(raster, np.zeros(3), raster).distance == 0.0
    wall = Raster.of(Text.of(np.arange(-10, 10), np.zeros(20), np.zeros(20)), CELL)
    assert Fit.of(wall, np.array([0.0, 0.04, 0.0]), wall).distance == pytest.approx(0.04)


def test_without_free_squares_no_conflict_is_known() -> None:
    fit = Fit.of(Raster.of(room(), CELL), np.zeros(3), Raster.of(room((0, 0, 4)), CELL))
    assert fit.conflict_ratio is None and fit.inlier_ratio == 1.0


def test_grip_is_the_share_of_walls_that_hold_the_loosest_direction() -> None:
    x = np.arange(-40, 40)
    corridor = Text.of(np.tile(x, 2), np.repeat([-10, 10], 80), np.zeros(160))
    square = Fit.of(Raster.of(room(), CELL), np.zeros(3), Raster.of(room(), CELL))
    assert Fit.of(Raster.of(corridor, CELL), np.zeros(3), Raster.of(corridor, CELL)).grip == pytest.approx(0.0)
    assert 0.3 < square.grip < 0.5
    far = np.array([60.0, 0.0, 0.0])
    assert Fit.of(Raster.of(corridor, CELL), far, Raster.of(corridor, CELL)).grip == 0.0


@pytest.mark.parametrize("off", [(0.2, -0.1, 0.05), (-0.25, 0.2, -0.08)])
def test_icp_finds_the_pose(off: tuple[float, float, float]) -> None:
    found = room()
    true = np.array([0.4, -0.3, 0.3])
    query = found.moved(inverse(true), CELL)
    pose = refined(Raster.of(query, CELL), Raster.of(found, CELL), true[None] + off)[0]
    assert pose[:2] == pytest.approx(true[:2], abs=0.02) and pose[2] == pytest.approx(true[2], abs=0.01)


def test_a_corridor_does_not_slide() -> None:
    x = np.arange(-60, 60)
    corridor = Text.of(np.tile(x, 2), np.repeat([-10, 10], 120), np.zeros(240))
    raster = Raster.of(corridor, CELL)
    pose = refined(raster, raster, np.array([[0.6, 0.1, 0.0]]))[0]
    assert pose[0] == pytest.approx(0.6, abs=0.05) and abs(pose[1]) < 0.01


def test_what_lies_far_away_costs_no_memory() -> None:
    far = Text.of([-32768, 0, 32767], [0, 0, 32767], [0, 0, 0])
    raster = Raster.of(far, CELL)
    assert max(raster.known.shape) <= 441
    assert overlaid(raster, np.zeros((1, 3)), raster).inliers == 1
