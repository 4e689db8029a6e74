"""Degenerate maps: nearly nothing to see, the same from all sides, far away, or of robots that hardly move."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from likeness import alike
from soundness import at_most

from m2t_text.config import PROFILES
from m2t_text.description.document import Document
from m2t_text.description.text import parse
from m2t_text.errors import CloudError, LogError, QueryError
from m2t_text.index.map_index import MapIndex
from m2t_text.logs import Log, Scan, read_log
from m2t_text.logs.beams import half_circle
from m2t_text.logs.simulation.raycast import cast
from m2t_text.logs.simulation.simulator import write_carmen
from m2t_text.mapping.normals import cloud_normals
from m2t_text.pipeline import describe_at, describe_log
from m2t_text.recognition.finding import Finding, find
from m2t_text.recognition.queries import Context, Query, resolve
from m2t_text.recognition.raster import EXTENT, Raster, Shape
from m2t_text.recognition.symmetry import GRID, meetings, other_poses
from m2t_text.sources.opening import LogSource, open_source
from m2t_text.util.geometry import compose, wrap

PARAMETERS = PROFILES["default"]
BEAMS = half_circle(180)


def outline(*corners: tuple[float, float]) -> np.ndarray:
    """Walls (W, 4) from corner to corner and back to the first."""
    points = np.array(corners, dtype=float)
    return np.hstack([points, np.roll(points, -1, axis=0)])


def polygon(sides: int, radius: float) -> np.ndarray:
    angles = 2 * np.pi * (np.arange(sides) + 0.5) / sides
    return outline(*(radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)))


def box(x: float, y: float, half_x: float, half_y: float) -> np.ndarray:
    return outline(
        (x - half_x, y - half_y), (x + half_x, y - half_y), (x + half_x, y + half_y), (x - half_x, y + half_y)
    )


def joined(*walls: np.ndarray) -> np.ndarray:
    return np.concatenate(walls)


WALLS = {
    "nothing": np.empty((0, 4)),
    "one point": box(0.0, 1.5, 0.01, 0.01),
    "a straight wall": np.array([[-40.0, 2.0, 40.0, 2.0]]),
    "a corridor": np.array([[-40.0, -1.2, 40.0, -1.2], [-40.0, 1.2, 40.0, 1.2]]),
    "a square room": polygon(4, 5.0),
    "a hexagon": polygon(6, 4.5),
    "a circle": polygon(180, 4.0),
    "a rectangle": box(0, 0, 5.0, 3.0),
    "a room": joined(
        box(0, 0, 5.0, 3.0), box(-3.5, 2.0, 0.4, 1.0), box(2.5, -2.3, 1.2, 0.3), box(4.2, 1.4, 0.3, 0.3)
    ),
}
WAY = [(0.0, 0.0, turn) for turn in np.linspace(0, 2 * np.pi, 24)] + [
    (x, 0.0, 0.0) for x in (*np.arange(0.0, 1.6, 0.2), *np.arange(1.6, -2.2, -0.2), *np.arange(-2.2, 0.0, 0.2))
]


def log_of(walls: np.ndarray, way: list[tuple[float, float, float]], name: str, seed: int = 0) -> Log:
    """What a laser sees along a way; odometry is without error, readings have one of 1 cm."""
    rng = np.random.default_rng(seed)
    scans = []
    for number, pose in enumerate(way):
        ranges = cast(np.array(pose), BEAMS, walls) + rng.normal(0, 0.01, len(BEAMS))
        scans.append(Scan(np.where(ranges > 0.05, ranges, np.inf), BEAMS, np.array(pose), float(number)))
    return Log(name, tuple(scans))


def entered(way: list[tuple[float, float, float]], degrees: float) -> list[tuple[float, float, float]]:
    """The same way from another side of the origin."""
    return [tuple(compose([0.0, 0.0, np.radians(degrees)], pose)) for pose in way]


def first_map(log: Log) -> Document:
    return next(iter(describe_log(log, PARAMETERS)))


def indexed(folder: Path, *logs: Log) -> MapIndex:
    index = MapIndex.create(folder / "index", PARAMETERS)
    for log in logs:
        index.add(LogSource(log))
    return index


def looked_up(folder: Path, walls: np.ndarray, degrees: float) -> Finding:
    """A drive indexed, and another through the same place, from another side, looked up."""
    index = indexed(folder, log_of(walls, WAY, "first"))
    return find(index, Query.of(first_map(log_of(walls, entered(WAY, degrees), "second", seed=1))))


@pytest.mark.parametrize(
    ("place", "degrees", "wanted"),
    [
        ("nothing", 0, "none"),
        ("one point", 0, "ambiguous"),
        ("a straight wall", 0, "ambiguous"),
        ("a corridor", 0, "ambiguous"),
        ("a square room", 0, "ambiguous"),
        ("a square room", 90, "ambiguous"),
        ("a hexagon", 120, "ambiguous"),
        ("a circle", 0, "ambiguous"),
        ("a circle", 77, "ambiguous"),
        ("a rectangle", 180, "ambiguous"),
        ("a room", 0, "match"),
        ("a room", 180, "match"),
    ],
)
def test_a_place_that_looks_the_same_from_several_sides_is_ambiguous(
    tmp_path: Path, place: str, degrees: float, wanted: str
) -> None:
    finding = looked_up(tmp_path, WALLS[place], degrees)
    assert finding.verdict == wanted


def shifted(way: list[tuple[float, float, float]], x: float) -> list[tuple[float, float, float]]:
    return [(pose[0] + x, *pose[1:]) for pose in way]


@pytest.mark.parametrize("laps", [1, 2])
def test_two_rooms_alike_are_ambiguous_however_often_each_was_seen(tmp_path: Path, laps: int) -> None:
    """Also where more maps show one of them than are verified."""
    room, far = WALLS["a room"], 24.0
    walls = joined(room, room + np.array([far, 0.0, far, 0.0]))
    between = [(x, 0.0, 0.0) for x in np.arange(0.2, far, 0.2)]
    way = WAY * laps + between + shifted(WAY * laps, far)
    index = indexed(tmp_path, log_of(walls, way, "both"))
    query = Query.of(first_map(log_of(walls, WAY, "again", seed=1)))
    assert find(index, query).verdict == "ambiguous"


# Robots that hardly move, or leap, or are far away.


@pytest.mark.parametrize("way", [[(1.0, 2.0, 0.5)] * 30, entered(WAY[:24], 10)], ids=["stands", "turns"])
def test_a_robot_that_does_not_travel_makes_no_map(
    tmp_path: Path, way: list[tuple[float, float, float]]
) -> None:
    write_carmen(log_of(WALLS["a room"], way, "still"), tmp_path / "still.log")
    with pytest.raises(LogError, match=r"travels less than the 5 m of one map; record a longer log"):
        MapIndex.create(tmp_path / "index", PARAMETERS).add(open_source(tmp_path / "still.log"))
    with pytest.raises(QueryError, match=r"a map takes 5 m of travel, and the log ends 0\.00 m after scan #0"):
        resolve(str(tmp_path / "still.log#0"), Context(PARAMETERS))


def test_a_map_does_not_change_with_the_place_of_the_frame(tmp_path: Path) -> None:
    """Nearly a thousand kilometres away from the origin, through a file."""
    texts = []
    for x in (0.0, 999_000.0):
        log = log_of(WALLS["a room"], WAY, "log")
        moved = tuple(replace(scan, odometry=compose([x, -x, 0.0], scan.odometry)) for scan in log.scans)
        write_carmen(replace(log, scans=moved, laser_pose=np.zeros(3)), tmp_path / "far.log")
        texts.append(str(first_map(read_log(tmp_path / "far.log")).text))
    assert texts[0] == texts[1]


def test_duplicated_scans_change_next_to_nothing(tmp_path: Path) -> None:
    log = log_of(WALLS["a room"], WAY, "log")
    doubled = replace(log, name="doubled", scans=tuple(scan for scan in log.scans for _ in range(2)))
    index = indexed(tmp_path, doubled)
    for once in list(describe_log(log, PARAMETERS))[::5]:
        finding = find(index, Query.of(once))
        assert alike(once.text, index.document(f"doubled/{2 * once.first_scan:06d}").text) > 0.8
        assert finding.verdict == "match" and finding.results[0].inlier_ratio > 0.9


@pytest.mark.parametrize("leap", [50.0, 900_000.0])
def test_a_leap_of_odometry_is_no_drive(tmp_path: Path, leap: float) -> None:
    """No map spans it, and nothing as large as it is allocated or searched."""
    log = log_of(WALLS["a room"], WAY, "log")
    there = [replace(scan, odometry=compose([leap, 0.0, 0.0], scan.odometry)) for scan in log.scans]
    leaping = replace(log, scans=(*log.scans, *there))
    with at_most(memory=200e6):
        maps = list(describe_log(leaping, PARAMETERS))
    once = list(describe_log(log, PARAMETERS))
    assert [one.first_scan for one in maps[: len(once)]] == [one.first_scan for one in once]
    assert all(one.last_scan < len(log.scans) or one.first_scan >= len(log.scans) for one in maps)
    assert len(maps) >= 2 * len(once) and max(len(one.text) for one in maps) < 1000
    assert describe_at(leaping, len(log.scans) - 3, PARAMETERS).last_scan == len(log.scans) - 1


def test_only_leaps_make_no_map() -> None:
    way = [(100.0 * k, 0.0, 0.0) for k in range(5)]
    with pytest.raises(LogError, match="travels less than the 5 m of one map"):
        LogSource(log_of(WALLS["nothing"], way, "leaps")).describe(PARAMETERS, 1, lambda stage, done, of: None)


# Point clouds.


def sampled(walls: np.ndarray, seed: int) -> np.ndarray:
    """Points every 4 cm on walls, with 1 cm of noise."""
    parts = [
        wall[:2]
        + np.linspace(0, 1, max(2, int(np.hypot(*(wall[2:] - wall[:2])) / 0.04)))[:, None]
        * (wall[2:] - wall[:2])
        for wall in walls
    ]
    points = np.concatenate(parts)
    return points + np.random.default_rng(seed).normal(0, 0.01, points.shape)


def cloud(folder: Path, name: str, points: np.ndarray) -> Path:
    np.save(folder / f"{name}.npy", points)
    return folder / f"{name}.npy"


@pytest.mark.parametrize(
    ("place", "wanted"),
    [
        ("a straight wall", "ambiguous"),
        ("a corridor", "ambiguous"),
        ("a square room", "ambiguous"),
        ("a circle", "ambiguous"),
        ("a rectangle", "ambiguous"),
        ("a room", "match"),
    ],
)
@pytest.mark.parametrize("far", [0.0, 1e6])
def test_clouds_that_look_the_same_from_several_sides(
    tmp_path: Path, place: str, far: float, wanted: str
) -> None:
    index = MapIndex.create(tmp_path / "index", PARAMETERS)
    index.add(open_source(cloud(tmp_path, "map", sampled(WALLS[place], 0) + far)))
    query = resolve(str(cloud(tmp_path, "query", sampled(WALLS[place], 1) + far)), Context(PARAMETERS, index))
    assert find(index, query).verdict == wanted


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.empty((0, 2)), "no point in it"),
        (np.full((5, 2), np.nan), "no point in it is finite"),
        (np.zeros((1, 2)), "1 cells of 0.1 m are occupied"),
        (np.zeros((1000, 2)), "1 cells of 0.1 m are occupied"),
        (np.array([[0.0, 0.0], [1e6, 0.0]]), "in millimetres"),
    ],
    ids=["empty", "not finite", "one point", "one point, often", "two points far apart"],
)
def test_clouds_that_are_no_map_are_refused(tmp_path: Path, points: np.ndarray, message: str) -> None:
    with pytest.raises(CloudError, match=message):
        open_source(cloud(tmp_path, "a", points)).describe(PARAMETERS, 1, lambda stage, done, of: None)


# Texts.


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> MapIndex:
    return indexed(tmp_path_factory.mktemp("room"), log_of(WALLS["a room"], WAY, "log"))


@pytest.mark.parametrize(
    "tokens", ["x0_y0_a0", "x32767_y-32768_a1023", "x-32768_y0_a5 x32767_y0_a5", "x0_y0_a5 " * 3000]
)
def test_texts_of_next_to_nothing_match_nothing(room: MapIndex, tokens: str) -> None:
    """Also where they would be kilometres wide."""
    with at_most(memory=200e6):
        assert find(room, Query(parse(tokens))).verdict in ("none", "ambiguous")


def test_a_map_without_points_has_an_empty_text(tmp_path: Path) -> None:
    document = first_map(log_of(WALLS["nothing"], WAY, "log"))
    assert len(document.text) == 0 and document.points == 0
    assert np.array_equal(document.viewpoint[:2], document.centre_of_gravity)


# Other poses of equal fit, by themselves.


def raster(points: np.ndarray) -> Raster:
    return Raster.drawn(Shape(points, cloud_normals(points, 0.3)), np.empty((0, 3), dtype=np.int64), 0.1)


@pytest.mark.parametrize(("place", "turns"), [("a square room", {90, 180, 270}), ("a rectangle", {180})])
def test_the_other_poses_of_a_symmetric_place(place: str, turns: set[int]) -> None:
    points = sampled(WALLS[place], 0)
    shape = raster(points)
    fitting = [one for one in other_poses(shape, shape, np.zeros(3)) if one.inlier_ratio > 0.9]
    assert {round(np.degrees(one.pose[2])) % 360 for one in fitting} == turns
    assert all(np.hypot(*one.pose[:2]) < 0.1 for one in fitting)


def test_a_place_that_repeats_itself_may_be_shifted() -> None:
    """Niches every 3 m along a wall; at their ends the two do not overlap, so that the fit is a little less."""
    niches = joined(*(box(x, 0.0, 0.4, 0.8) for x in np.arange(-12.0, 12.1, 3.0)))
    points = sampled(niches, 0)
    shape = raster(points)
    best = max(other_poses(shape, shape, np.zeros(3)), key=lambda one: one.agreement)
    assert best.inlier_ratio > 0.85
    assert abs(best.pose[0]) == pytest.approx(3.0, abs=0.1) or abs(wrap(best.pose[2])) > 3.0


def test_themeetings_are_those_of_a_plain_count() -> None:
    rng = np.random.default_rng(5)
    fixed, moved = rng.uniform(-4, 4, (60, 2)), rng.uniform(-25, 25, (3, 40, 2))
    moved[0] = fixed[:40] + np.array([2.1, -3.0])
    most, shifts = meetings(fixed, moved)
    cells = {tuple(c) for c in np.floor(fixed / GRID).astype(int)}
    grown = {(x + a, y + b) for x, y in cells for a in (-1, 0, 1) for b in (-1, 0, 1)}
    for number, points in enumerate(moved):
        occupied = {tuple(c) for c in np.floor(points[np.abs(points).max(axis=1) < EXTENT] / GRID).astype(int)}
        counts = Counter((x - a, y - b) for x, y in grown for a, b in occupied)
        allowed = {shift: n for shift, n in counts.items() if number or max(map(abs, shift)) > 3}
        assert most[number] == max(allowed.values())
        assert allowed[tuple(np.rint(shifts[number] / GRID).astype(int))] == most[number]
    assert shifts[0] == pytest.approx([-2.1, 3.0], abs=0.31)


def test_what_is_not_there_has_no_other_pose() -> None:
    empty, some, far = raster(np.empty((0, 2))), raster(np.zeros((1, 2))), raster(np.full((9, 2), 1e3))
    for query, found in ((empty, some), (some, empty), (far, some), (some, far)):
        assert other_poses(query, found, np.zeros(3)) == []
