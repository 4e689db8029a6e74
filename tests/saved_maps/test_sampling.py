"""Local maps sampled from drawn rooms, and maps drawn from simulated drives."""

import math

import numpy as np
import pytest
from drawings import drawn, room
from scipy.spatial import KDTree

from m2t_text.config import PROFILES
from m2t_text.errors import MapFileError
from m2t_text.logs.log import Log, Scan
from m2t_text.logs.simulation.building import box
from m2t_text.logs.simulation.raycast import cast
from m2t_text.mapping.local_map import LocalMap
from m2t_text.pipeline import describe
from m2t_text.saved_maps.grid import FREE, OCCUPIED, UNKNOWN, Grid
from m2t_text.saved_maps.occupancy_mapping import build_map
from m2t_text.saved_maps.sampling import ALIKE, CLEARANCE, NEAR, Sampler, distinct_views
from m2t_text.sources.saved_map import SavedMap
from m2t_text.util.geometry import compose, transform

DEFAULT = PROFILES["default"]


def sampled(grid: Grid) -> list[LocalMap]:
    """All local maps of a grid."""
    sampler = Sampler.of(grid, DEFAULT.mapping)
    views = distinct_views(sampler)
    return list(sampler.local_maps(views, np.arange(len(views))))


def test_a_robot_keeps_clear_of_walls() -> None:
    sampler = Sampler.of(room(1.0, 0.7), DEFAULT.mapping)
    rows, columns = np.nonzero(sampler.open)
    # The walls' cells have their middles 0.025 m behind the inner faces.
    assert (columns.min() * 0.05, rows.min() * 0.05) == pytest.approx((CLEARANCE, CLEARANCE))
    assert len(rows) == 10 * 4
    alone = Sampler.of(Grid(np.full((5, 5), FREE, dtype=np.int8), 0.05, np.zeros(3)), DEFAULT.mapping)
    assert alone.open.all()


@pytest.mark.parametrize("resolution", [0.025, 0.05, 0.1])
def test_what_is_seen_are_the_faces_of_the_walls(resolution: float) -> None:
    grid = room(6.0, 4.0, resolution)
    grid = Grid(np.pad(grid.states, 5, constant_values=OCCUPIED), resolution, grid.origin)  # thick walls
    inner = resolution * (6 + np.array([0.0, 6.0 / resolution, 0.0, 4.0 / resolution]))
    for one in sampled(grid):
        points = transform(one.pose, one.points)
        away = np.abs(points[:, [0, 0, 1, 1]] - inner).min(axis=1)
        assert away.max() <= resolution


def test_a_view_ahead_sees_what_is_ahead_and_one_around_all() -> None:
    sampler = Sampler.of(room(6.0, 4.0), DEFAULT.mapping)
    ahead = sampler.local_map(7, np.array([3.0, 2.0, math.pi / 2]), False)
    around = sampler.local_map(8, np.array([3.0, 2.0, math.pi / 2]), True)
    assert (ahead.first_scan, ahead.last_scan, ahead.travel.tolist()) == (7, 7, [0.0, 0.0])
    assert ahead.points[:, 0].min() > -0.1  # x is straight ahead
    assert around.points[:, 0].min() == pytest.approx(-2.0 + 0.025, abs=0.06)
    # It goes ahead for as long as it keeps clear of the wall, and sees no farther than from there.
    assert ahead.trajectory[:, 0] == pytest.approx(np.arange(8) * 0.25)
    assert len(around.trajectory) == 1


def test_the_range_is_limited() -> None:
    sampler = Sampler.of(room(30.0, 4.0), DEFAULT.mapping)
    seen = sampler.local_map(0, np.array([15.0, 2.0, 0.0]), True).points
    assert np.hypot(*seen.T).max() <= DEFAULT.mapping.range_limit + 1e-9


def test_a_map_turned_and_moved_as_a_whole_has_the_same_local_maps() -> None:
    plain, moved = (sampled(room(5.0, 3.0, origin=origin)) for origin in ((0.0, 0.0, 0.0), (7.0, -2.0, 2.5)))
    assert len(plain) == len(moved)
    for one, other in zip(plain, moved, strict=True):
        assert one.points == pytest.approx(other.points)
        assert compose([7.0, -2.0, 2.5], one.pose) == pytest.approx(other.pose)


def test_what_lies_behind_much_unknown_space_is_not_seen() -> None:
    grid = room(6.0, 4.0)
    grid.states[:, 70:75] = UNKNOWN  # 0.25 m
    view = (np.array([1.5, 2.0, 0.0]), True)
    assert Sampler.of(grid, DEFAULT.mapping).local_map(0, *view).points[:, 0].max() > 4.4
    grid.states[:, 55:80] = UNKNOWN
    assert Sampler.of(grid, DEFAULT.mapping).local_map(0, *view).points[:, 0].max() < 2.7


def test_every_view_is_kept_or_has_one_kept_that_is_like_it() -> None:
    grid = room(5.0, 4.0)
    grid.states[40:60, 60:64] = grid.states[10:14, 20:60] = OCCUPIED
    sampler = Sampler.of(grid, DEFAULT.mapping)
    every, kept = sampler.views(), distinct_views(sampler)
    assert 5 < len(kept) < len(every) / 4
    assert {tuple(pose) for pose in kept.poses} <= {tuple(pose) for pose in every.poses}
    cells = [set(sampler.cells(*view).tolist()) for view in every.of(np.arange(len(every)))]
    of_kept = [set(sampler.cells(*view).tolist()) for view in kept.of(np.arange(len(kept)))]

    def likeness(one: set[int], other: set[int]) -> float:
        return len(one & other) / len(one | other)

    def centre(one: set[int]) -> complex:
        return sum(complex(cell % sampler.columns, cell // sampler.columns) for cell in one) / len(one) * 0.1

    for k, one in enumerate(of_kept):
        near = [other for other in of_kept[:k] if abs(centre(one) - centre(other)) <= NEAR]
        assert all(likeness(one, other) < ALIKE for other in near)
    for one in filter(None, cells):
        assert one in of_kept or any(
            likeness(one, other) >= ALIKE and abs(centre(one) - centre(other)) <= NEAR for other in of_kept
        )


def test_threads_and_processes_change_nothing() -> None:
    source = SavedMap("room", room(9.0, 3.0))
    told: list[tuple[str, int, int]] = []
    alone, shared = (
        list(source.describe(DEFAULT, jobs, lambda *step: told.append(step)).documents) for jobs in (1, 2)
    )
    assert [str(document.text) for document in alone] == [str(document.text) for document in shared]
    assert [document.map_id for document in alone] == [f"room/{k:06d}" for k in range(len(alone))]
    assert {stage for stage, _, _ in told} == {"views", "maps"}
    assert all(done == of for stage, done, of in told if (stage, done) == ("maps", len(alone)))


@pytest.mark.parametrize("states", [drawn("   "), drawn("###"), np.full((30, 30), FREE, dtype=np.int8)])
def test_a_map_from_which_nothing_is_to_be_seen_is_refused(states: np.ndarray) -> None:
    source = SavedMap("empty", Grid(states, 0.05, np.zeros(3)))
    with pytest.raises(MapFileError, match="empty: no wall is to be seen from any free cell"):
        source.describe(DEFAULT, 1, lambda *step: None)


# --- Drawing


def test_a_drawn_map_has_walls_where_they_are_and_space_before_them() -> None:
    walls = np.array([*box(3.0, 2.0, 6.0, 4.0), *box(4.0, 3.0, 0.4, 0.4)])
    truth = np.array([[1.0, 1.0, 0.3], [2.0, 1.0, 0.8], [2.5, 1.5, 2.0], [2.0, 3.0, -2.4]])
    laser = np.array([0.2, 0.0, 0.0])
    angles = np.radians(np.arange(-90.0, 90.0, 0.25))
    scans = [Scan(cast(pose, angles, walls), angles, pose) for pose in compose(truth, laser)]
    grid = build_map(Log("box", tuple(scans), laser), truth, np.arange(3))
    away, _ = KDTree(walls_as_points(walls)).query(grid.centres(OCCUPIED))
    assert away.max() < 0.05
    assert len(grid.centres(OCCUPIED)) > 200
    free = grid.centres(FREE)
    assert KDTree(free).query(truth[:3, :2])[0].max() < 0.05  # of the last scan, which was not drawn, nothing
    assert ((free > [-0.05, -0.05]) & (free < [6.05, 4.05])).all()
    behind = (np.abs(free - [4.0, 3.0]) < 0.15).all(axis=1)
    assert not behind.any()  # within the box in the room nothing was seen
    outside = grid.centres(UNKNOWN)
    assert KDTree(outside).query([[4.0, 3.0]])[0].max() < 0.05


def walls_as_points(walls: np.ndarray) -> np.ndarray:
    """(N, 2) points 1 cm apart on segments (W, 4)."""
    share = np.linspace(0.0, 1.0, 601)[:, None, None]
    return ((1 - share) * walls[None, :, :2] + share * walls[None, :, 2:]).reshape(-1, 2)


def test_a_beam_through_what_moved_away_clears_it() -> None:
    angles = np.array([-0.1, 0.0, 0.1])
    person, wall = (
        Scan(np.array([1.0, 1.0, 1.0]), angles, np.zeros(3)),
        Scan(np.full(3, 3.0), angles, np.zeros(3)),
    )
    grid = build_map(Log("x", (person, *[wall] * 4)), np.zeros((5, 3)), np.arange(5))
    assert np.hypot(*grid.centres(OCCUPIED).T).min() > 2.9
    only = build_map(Log("x", (person, wall)), np.zeros((2, 3)), np.arange(2))
    assert np.hypot(*only.centres(OCCUPIED).T).min() < 1.1


def test_a_view_knows_what_is_free_in_it() -> None:
    """A room with an unknown corner: its free cells lie within it, and none where it is unknown or occupied."""
    grid = room(6.0, 4.0, origin=(1.0, 2.0, 0.7))
    grid.states[1:31, 1:31] = UNKNOWN  # 1.5 m of it
    counts = []
    for one in sampled(grid):
        assert one.free is not None
        places = np.argwhere(one.free.cells) + 0.5
        states = grid.to_cells(transform(one.pose, transform(one.free.pose, places * one.free.cell)))
        columns, rows = np.floor(states).astype(int).T
        assert len(places) and (grid.states[rows, columns] == FREE).all()
        document = describe(one, "room", DEFAULT)
        covered = document.text.free
        middles = (np.argwhere(covered.grid.cells) + [covered.grid.x, covered.grid.y] + 0.5) * 0.1
        columns, rows = (
            np.floor(grid.to_cells(transform(compose(one.pose, document.viewpoint), middles))).astype(int).T
        )
        assert (grid.states[rows, columns] == FREE).all()
        counts.append(len(middles))
    assert max(counts) > 1000 and np.median(counts) > 100  # some views see hardly a square metre


def test_a_view_ahead_knows_nothing_of_what_lies_behind() -> None:
    sampler = Sampler.of(room(6.0, 4.0), DEFAULT.mapping)
    for around in (False, True):
        free = sampler.local_map(7, np.array([3.0, 2.0, 0.0]), around).free
        assert free is not None
        behind = transform(free.pose, (np.argwhere(free.cells) + 0.5) * free.cell)[:, 0] < -0.1
        assert behind.any() == around
