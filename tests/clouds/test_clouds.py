"""Point clouds: the same points from all kinds of files, made into one map; and damaged files."""

import struct
from collections.abc import Callable
from pathlib import Path

import lzf
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from soundness import at_most

from m2t_text.clouds import READERS, read_cloud
from m2t_text.clouds.cloud import Cloud, occupied
from m2t_text.config import PROFILES
from m2t_text.errors import CloudError, M2TError
from m2t_text.logs import LogOptions
from m2t_text.mapping.local_map import occupied as dense
from m2t_text.pipeline import describe
from m2t_text.util.names import CLOUDS


def room(height: float = 0.0) -> np.ndarray:
    """Points (N, 3) on the walls of a room of 6 m by 4 m, on its floor and, 2.5 m above, on its ceiling."""
    rng = np.random.default_rng(0)
    x, y, z = rng.uniform(0, 6, 4000), rng.uniform(0, 4, 4000), rng.uniform(0, 2.5, 4000)
    walls = [np.stack([x, np.full(4000, side), z], axis=1) for side in (0.0, 4.0)]
    walls += [np.stack([np.full(4000, side), y, z], axis=1) for side in (0.0, 6.0)]
    flat = [np.stack([x, y, np.full(4000, level)], axis=1) for level in (0.0, 2.5)]
    return np.concatenate([*walls, *flat]) + np.array([0.0, 0.0, height])


# Seven digits are written and read the same by all kinds of files.
POINTS = np.round(np.random.default_rng(1).uniform(-5, 5, (40, 3)) * [1, 1, 0.02], 3).astype(np.float32)
HEAD = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS i x y z n\nSIZE 1 4 4 4 8\n"
HEAD += "TYPE U F F F F\nCOUNT 2 1 1 1 1\nWIDTH {0}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {0}\nDATA {1}\n"
RECORD = [("i", "u1", (2,)), ("x", "f4"), ("y", "f4"), ("z", "f4"), ("n", "f8")]
PLY = "ply\nformat {1} 1.0\ncomment made\nelement vertex {0}\nproperty uchar i\nproperty float x\n"
PLY += (
    "property float y\nproperty float32 z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
)


def lines(*columns: np.ndarray, mark: str = " ") -> str:
    return "".join(mark.join(f"{value:g}" for value in row) + "\n" for row in zip(*columns, strict=True))


def record(points: np.ndarray) -> np.ndarray:
    made = np.zeros(len(points), dtype=RECORD)
    made["x"], made["y"], made["z"] = points.T
    made["i"], made["n"] = 7, np.nan
    return made


def pcd_text(points: np.ndarray) -> bytes:
    some = np.ones(len(points))
    return (HEAD.format(len(points), "ascii") + lines(some, some, *points.T, some * np.nan)).encode()


def pcd_binary(points: np.ndarray) -> bytes:
    return HEAD.format(len(points), "binary").encode() + record(points).tobytes()


def pcd_packed(points: np.ndarray) -> bytes:
    made = record(points)
    content = b"".join(made[name].tobytes() for name in made.dtype.names)
    packed = lzf.compress(content)
    head = HEAD.format(len(points), "binary_compressed").encode()
    return head + struct.pack("<II", len(packed), len(content)) + packed


def ply_text(points: np.ndarray) -> bytes:
    return (PLY.format(len(points), "ascii") + lines(np.ones(len(points)), *points.T) + "3 0 1 2\n").encode()


def ply_binary(points: np.ndarray, order: str) -> bytes:
    kind = [("i", "u1"), *((axis, order + "f4") for axis in "xyz")]
    made = np.zeros(len(points), dtype=kind)
    made["x"], made["y"], made["z"] = points.T
    form = "binary_big_endian" if order == ">" else "binary_little_endian"
    return PLY.format(len(points), form).encode() + made.tobytes() + b"\x03" + bytes(12)


def ply_lists_in_text(points: np.ndarray) -> bytes:
    head = PLY.format(len(points), "ascii").replace(
        "element face", "property list uchar int view\nelement face"
    )
    body = "".join(f"1 {x:g} {y:g} {z:g} 2 1 2\n" for x, y, z in points)
    return (head + body + "3 0 1 2\n").encode()


def ply_lists_first_in_text(points: np.ndarray) -> bytes:
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\nproperty list uchar int view\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    body = "".join(f"{k % 3} {'7 ' * (k % 3)}{x:g} {y:g} {z:g}\n" for k, (x, y, z) in enumerate(points))
    return (head + body).encode()


def ply_after_others(points: np.ndarray, order: str) -> bytes:
    """After a camera, and faces of different sizes, vertices with a list each."""
    form = "binary_big_endian" if order == ">" else "binary_little_endian"
    head = f"ply\nformat {form} 1.0\nelement camera 1\nproperty float view_px\nproperty double view_py\n"
    head += f"element face 2\nproperty list uchar int vertex_indices\nelement vertex {len(points)}\n"
    head += "property list ushort float near\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    body = struct.pack(f"{order}fd", 1.0, 2.0) + struct.pack(f"{order}B3iB2i", 3, 0, 1, 2, 2, 0, 1)
    for k, point in enumerate(points):
        body += struct.pack(f"{order}H{k % 3}f3f", k % 3, *[9.0] * (k % 3), *point)
    return (head + "end_header\n").encode() + body


def pcd_stored(points: np.ndarray) -> bytes:
    made = record(points)
    content = b"".join(made[name].tobytes() for name in made.dtype.names)
    head = HEAD.format(len(points), "binary_compressed").encode()
    return head + struct.pack("<II", len(content), len(content)) + content


def npy(array: np.ndarray) -> bytes:
    from io import BytesIO

    file = BytesIO()
    np.save(file, array)
    return file.getvalue()


WRITERS: dict[str, Callable[[np.ndarray], bytes]] = {
    "text.pcd": pcd_text,
    "binary.pcd": pcd_binary,
    "packed.pcd": pcd_packed,
    "text.ply": ply_text,
    "little.ply": lambda points: ply_binary(points, "<"),
    "big.ply": lambda points: ply_binary(points, ">"),
    "blanks.xyz": lambda points: lines(*points.T).encode(),
    "more.xyz": lambda points: ("# scanner 7\n\n" + lines(*points.T, points[:, 0])).encode(),
    "named.xyz": lambda points: ("//Z;Y;X\n" + lines(*points.T[::-1], mark=";")).encode(),
    "plain.csv": lambda points: lines(*points.T, mark=",").encode(),
    "named.csv": lambda points: (
        '\ufeff"n","Y","X","z"\r\n' + lines(points[:, 0], *points.T[[1, 0, 2]], mark=",")
    ).encode(),
    "count.xyz": lambda points: (f"{len(points)}\n" + lines(*points.T)).encode(),
    "colours.pts": lambda points: (
        f"{len(points)}\r\n" + lines(*points.T, points[:, 0], points[:, 1])
    ).encode(),
    "plain.asc": lambda points: lines(*points.T).encode(),
    "german.csv": lambda points: ("x;y;z\n" + lines(*points.T, mark=";")).replace(".", ",").encode(),
    "german.xyz": lambda points: lines(*points.T).replace(".", ",").encode(),
    "units.csv": lambda points: (
        "n,X [mm],Y (mm),Z [m]\n" + lines(points[:, 0], *(points * [1e3, 1e3, 1]).T, mark=",")
    ).encode(),
    "paraview.csv": lambda points: ('"Points:0","Points:1","Points:2"\n' + lines(*points.T, mark=",")).encode(),
    "lists.ply": ply_lists_in_text,
    "first.ply": ply_lists_first_in_text,
    "camera.ply": lambda points: ply_after_others(points, "<"),
    "mesh.ply": lambda points: ply_after_others(points, ">"),
    "stored.pcd": pcd_stored,
    "single.npy": npy,
    "columns.npy": lambda points: npy(np.asfortranarray(points.astype(np.float64))),
    "more.npy": lambda points: npy(np.column_stack([points, points])),
}


def written(folder: Path, name: str, content: bytes) -> Path:
    path = folder / name
    path.write_bytes(content)
    return path


# All kinds of files.


@pytest.mark.parametrize("name", WRITERS)
def test_every_kind_of_file_gives_the_same_points(tmp_path: Path, name: str) -> None:
    cloud = read_cloud(written(tmp_path, name, WRITERS[name](POINTS)))
    assert cloud.name == name.rpartition(".")[0] and cloud.warnings == ()
    assert cloud.points == pytest.approx(POINTS[:, :2].astype(np.float64), abs=1e-6)


@pytest.mark.parametrize("nothing", ["", "nan", "NULL", "n/a"])
def test_rows_without_values_are_left_out(tmp_path: Path, nothing: str) -> None:
    rows = [",".join(f"{value:g}" for value in point) for point in POINTS]
    rows[3] = rows[20] = ",".join([nothing] * 3)
    cloud = read_cloud(written(tmp_path, "a.csv", "\n".join(["x,y,z", *rows]).encode()))
    assert cloud.warnings == ("2 of 40 points are not finite, and left out",)
    assert cloud.points == pytest.approx(np.delete(POINTS, [3, 20], axis=0)[:, :2], abs=1e-6)


def test_every_scan_of_a_file_may_begin_with_its_count(tmp_path: Path) -> None:
    half = lines(*POINTS[:20].T)
    cloud = read_cloud(written(tmp_path, "a.pts", f"20\n{half}20\n{half}".encode()))
    assert cloud.points == pytest.approx(np.concatenate([POINTS[:20]] * 2)[:, :2], abs=1e-6)
    with pytest.raises(CloudError, match="cut off: 30 points are claimed, 20 are there"):
        read_cloud(written(tmp_path, "a.pts", f"30\n{half}".encode()))
    with pytest.raises(CloudError, match="its letters have 16 bits: save it as UTF-8"):
        read_cloud(written(tmp_path, "a.pts", half.encode("utf-16")))


@pytest.mark.parametrize("name", ["blanks.xyz", "plain.csv", "single.npy"])
def test_clouds_of_two_dimensions(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, name, WRITERS[name](POINTS[:, :2]))
    assert read_cloud(path, height=(0.2, 0.3)).points == pytest.approx(POINTS[:, :2], abs=1e-6)


def test_an_organised_cloud_has_a_width_and_a_height(tmp_path: Path) -> None:
    head = "FIELDS x y\nSIZE 8 8\nTYPE F F\nWIDTH 20\nHEIGHT 2\nDATA binary\n"
    content = head.encode() + POINTS[:, :2].astype("<f8").tobytes()
    assert len(read_cloud(written(tmp_path, "a.pcd", content)).points) == 40


def test_every_ending_has_a_reader() -> None:
    assert set(READERS) == set(CLOUDS)


# One map.


def cloud_of(folder: Path, points: np.ndarray, height: tuple[float, float] | None = None) -> Cloud:
    return read_cloud(written(folder, "room.npy", npy(points)), height=height)


def inside(points: np.ndarray) -> int:
    """How many points lie off the walls."""
    return int(((points > 0.01) & (points < [5.99, 3.99])).all(axis=1).sum())


@pytest.mark.parametrize("lift", [0.0, -1.7, 30.0])
def test_a_cloud_is_cut_above_its_floor_wherever_that_is(tmp_path: Path, lift: float) -> None:
    cloud = cloud_of(tmp_path, room(lift))
    assert len(cloud.points) > 5000 and inside(cloud.points) == 0
    assert cloud.warnings == (
        f"cut to heights of {lift + 0.3:.2f} to {lift + 1.5:.2f} m; --height names others",
    )


def test_a_cloud_is_cut_to_the_heights_that_are_named(tmp_path: Path) -> None:
    points = room()
    cloud = cloud_of(tmp_path, points, (2.4, 2.6))
    assert cloud.warnings == () and inside(cloud.points) > 3900
    assert len(cloud.points) == ((points[:, 2] >= 2.4) & (points[:, 2] <= 2.6)).sum()
    with pytest.raises(CloudError, match=r"no point at heights of 5 to 6 m; they are 0 to 2.5 m: name others"):
        cloud_of(tmp_path, points, (5.0, 6.0))


@pytest.mark.parametrize("height", [(1.0, 1.0), (2.0, 1.0), (float("nan"), 1.0)])
def test_heights_that_are_no_band_are_refused(height: tuple[float, float]) -> None:
    with pytest.raises(M2TError, match="--height takes two heights in metres, the lower one first"):
        LogOptions(height=height)


@pytest.mark.parametrize("profile", PROFILES)
def test_a_cloud_is_seen_from_its_centre_of_gravity(tmp_path: Path, profile: str) -> None:
    parameters = PROFILES[profile]
    turn = np.radians(20.0)
    walls = room() @ np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    cloud = cloud_of(tmp_path, walls)
    document = describe(cloud.local_map(parameters.mapping.cell), cloud.name, parameters)
    assert document.map_id == "room/000000" and not document.driven
    assert document.viewpoint[:2] == pytest.approx(document.centre_of_gravity)
    middle = [3 * np.cos(turn) - 2 * np.sin(turn), 3 * np.sin(turn) + 2 * np.cos(turn)]
    assert document.centre_of_gravity == pytest.approx(middle, abs=0.05)
    assert document.viewpoint[2] == pytest.approx(turn, abs=0.01)  # of the four directions, that nearest to +x
    assert document.points == len(occupied(cloud.points, 0.1)) and 150 < len(document.text) < 450


@pytest.mark.parametrize("seed", range(5))
def test_occupied_cells_are_those_of_local_maps(seed: int) -> None:
    points = np.random.default_rng(seed).normal(-3.0, 2.0, (500, 2))
    whole = dense(points, np.array([0, 500]), np.array([0]), np.zeros((1, 3)), 0.1)
    assert occupied(points, 0.1) == pytest.approx(whole, abs=1e-12)


def test_points_that_are_not_finite_are_left_out(tmp_path: Path) -> None:
    """An organised cloud has them where the sensor saw nothing."""
    points = POINTS.copy()
    points[3], points[5, 2], points[7, 0] = np.nan, np.inf, -np.inf
    cloud = cloud_of(tmp_path, points)
    assert len(cloud.points) == 37 and cloud.warnings == ("3 of 40 points are not finite, and left out",)
    with pytest.raises(CloudError, match="no point in it is finite"):
        cloud_of(tmp_path, points * np.nan)


def test_a_map_in_millimetres_is_told(tmp_path: Path) -> None:
    with pytest.raises(
        CloudError, match=r"it spans 6,000 by 4,000 m, a map at most 1,000: is it in millimetres\?"
    ):
        cloud_of(tmp_path, room() * 1000)


def test_a_map_that_is_hardly_one_is_told(tmp_path: Path) -> None:
    for points, message in ((room() / 1000, "room: 1 cells of 0.1 m"), (room()[:3], "room: 3 cells of 0.1 m")):
        with pytest.raises(CloudError, match=message + ".* in metres"):
            cloud_of(tmp_path, points, (-1.0, 9.0)).local_map(0.1)
    solid = np.random.default_rng(0).uniform(0, 300, (400_000, 2))
    cloud = cloud_of(tmp_path, solid)
    assert cloud.warnings == ("it spans 300 by 300 m, and hits are verified by the middle 44 m alone",)
    with pytest.raises(CloudError, match=r"cells of 0.1 m are occupied, and a map has 10 to 200,000"):
        cloud.local_map(0.1)


# Damage.


def replaced(old: str, new: str, content: bytes) -> bytes:
    assert old.encode() in content
    return content.replace(old.encode(), new.encode(), 1)


TEXT, BINARY, PACKED = pcd_text(POINTS), pcd_binary(POINTS), pcd_packed(POINTS)
LITTLE, LINES, ARRAY = ply_binary(POINTS, "<"), lines(*POINTS.T).encode(), npy(POINTS)
HUGE = 10**12

WRONG = {
    ".pcd": "no header that ends with 'DATA'",
    ".ply": "no PLY file",
    ".npy": "no NumPy array",
    **dict.fromkeys(
        (".xyz", ".csv", ".pts", ".asc"),
        "its columns are .*: name them x, y and z|cannot be read: 'utf-8' codec|its letters have 16 bits",
    ),
}

HOPELESS: dict[str, tuple[str, bytes, str]] = {
    "PCD claims too much": ("a.pcd", replaced("POINTS 40", f"POINTS {HUGE}", BINARY), "cut off"),
    "PCD text claims too much": ("a.pcd", replaced("POINTS 40", f"POINTS {HUGE}", TEXT), "cut off"),
    "packed PCD claims too much": (
        "a.pcd",
        replaced("POINTS 40", f"POINTS {HUGE}", PACKED),
        "do not come from",
    ),
    "packed PCD claims a bomb": (
        "a.pcd",
        HEAD.format(10**8, "binary_compressed").encode() + struct.pack("<II", 30, 22 * 10**8) + bytes(30),
        "do not come from 30 bytes",
    ),
    "packed PCD is cut": ("a.pcd", PACKED[:-9], "cut off"),
    "packed PCD ends at once": ("a.pcd", PACKED[: PACKED.index(b"compressed\n") + 13], "cut off before"),
    "packed PCD is damaged": ("a.pcd", PACKED[:-200] + b"\xff" * 200, "damaged|cannot be read"),
    "PCD is cut": ("a.pcd", BINARY[:-9], "cut off: 40 points of 22 bytes are claimed, 871 bytes are there"),
    "PCD text is cut": ("a.pcd", TEXT[: TEXT.rindex(b"\n", 0, -2) + 1], "40 points are claimed, 39 are there"),
    "PCD has no points": ("a.pcd", HEAD.format(0, "binary").encode(), "no point in it"),
    "PCD text has no points": ("a.pcd", HEAD.format(0, "ascii").encode(), "no point in it"),
    "PCD has no data": ("a.pcd", BINARY[:60], "no header that ends with 'DATA'"),
    "PCD has no fields": ("a.pcd", replaced("FIELDS", "FELDS", BINARY), "no PCD header"),
    "PCD has other fields": ("a.pcd", replaced("i x y z", "i u v w", BINARY), "its fields are i u v w n"),
    "PCD has odd sizes": ("a.pcd", replaced("SIZE 1 4", "SIZE 1 3", BINARY), "no number of TYPE F and SIZE 3"),
    "PCD has odd counts": ("a.pcd", replaced("COUNT 2", "COUNT -2", BINARY), "'-2' where a count should be"),
    "PCD has huge counts": ("a.pcd", replaced("COUNT 2", f"COUNT {HUGE}", BINARY), "cut off"),
    "PCD has another encoding": ("a.pcd", replaced("DATA binary", "DATA zip", BINARY), "its DATA is not ascii"),
    "PCD text has words": (
        "a.pcd",
        replaced("ascii\n1 1 ", "ascii\n1 1 x", TEXT),
        "cannot be read: could not convert",
    ),
    "PCD of another format": ("a.pcd", ARRAY, "no header that ends with 'DATA'"),
    "PLY claims too much": ("a.ply", replaced("vertex 40", f"vertex {HUGE}", LITTLE), "cut off"),
    "PLY is cut": ("a.ply", LITTLE[:-40], "cut off: 40 points of 13 bytes are claimed"),
    "PLY is none": ("a.ply", BINARY, "no PLY file"),
    "PLY has no end": ("a.ply", LITTLE[:90], "no header that ends with 'end_header'"),
    "PLY has another format": (
        "a.ply",
        replaced("binary_little", "binary_middle", LITTLE),
        "no format of ascii",
    ),
    "PLY has faces first": (
        "a.ply",
        replaced("element vertex", "element face", LITTLE),
        "it has no vertices, but face face",
    ),
    "PLY has lists": (
        "a.ply",
        replaced("property uchar i", "property list float int i", LITTLE),
        "no such property",
    ),
    "PLY has other numbers": ("a.ply", replaced("float x", "float u", LITTLE), "its vertices have i u y z"),
    "PLY has no count": ("a.ply", replaced("vertex 40", "vertex forty", LITTLE), "'forty' where a count"),
    "XYZ has words": ("a.xyz", LINES + b"1 two 3\n", "cannot be read: could not convert string 'two'"),
    "XYZ has short lines": ("a.xyz", LINES + b"1 2\n", "cannot be read: invalid column index"),
    "XYZ has one column": ("a.xyz", b"1\n2\n", "one number each"),
    "XYZ has only comments": ("a.xyz", b"# nothing\n", "no line of numbers"),
    "CSV has only names": ("a.csv", b"x,y,z\n", "no line of numbers"),
    "CSV has other names": (
        "a.csv",
        b"east,north\n1,2\n",
        "its columns are 'east north': name them x, y and z",
    ),
    "CSV has names twice": ("a.csv", b"x,y\nx,y\n1,2\n", "its columns are 'x y'"),
    "CSV is not UTF-8": ("a.csv", b"x,y,z\n1,\xff\xfe,2\n", "cannot be read: 'utf-8' codec can't decode"),
    "NPY claims too much": ("a.npy", replaced("(40, 3), }       ", "(9999999, 3), }  ", ARRAY), "cut off"),
    "NPY claims far too much": (
        "a.npy",
        replaced("40, 3), }" + " " * 12, f"{HUGE}, 3), }} ", ARRAY),
        "cut off",
    ),
    "NPY claims less than nothing": ("a.npy", replaced("(40, 3)", "(-4, 3)", ARRAY), "no array of points"),
    "NPY claims a long header": ("a.npy", ARRAY[:8] + b"\xff\xff" + ARRAY[10:], "no array of points"),
    "NPY is cut": ("a.npy", ARRAY[:-1], "cut off: 480 bytes are claimed, 479 are there"),
    "NPY is another file": ("a.npy", LINES, "no NumPy array"),
    "NPY ends at once": ("a.npy", ARRAY[:7], "no NumPy array"),
    "NPY has no header": ("a.npy", ARRAY[:40], "no array of points"),
    "NPY holds objects": ("a.npy", npy(np.array([[1, 2], [3, "x"]], dtype=object)), "no array of points"),
    "NPY holds words": ("a.npy", npy(np.array([["a", "b"]])), "no array of points: save one of numbers"),
    "NPY holds a volume": ("a.npy", npy(np.zeros((3, 3, 3))), r"save one of numbers, \(points, 2\)"),
    "NPY holds one column": ("a.npy", npy(np.zeros((3, 1))), "save one of numbers"),
    **{f"{ending} is empty": (f"a{ending}", b"", "is empty") for ending in CLOUDS},
    **{f"{ending} is zeros": (f"a{ending}", bytes(9999), WRONG[ending]) for ending in CLOUDS},
    **{f"{ending} is not UTF-8": (f"a{ending}", b"\xff\xfe\n" * 999, WRONG[ending]) for ending in CLOUDS},
    **{f"{ending} is a letter": (f"a{ending}", b"Dear Sir,\nno points.\n", WRONG[ending]) for ending in CLOUDS},
}


@pytest.mark.parametrize("kind", HOPELESS)
def test_a_hopeless_file_gets_one_clear_line(tmp_path: Path, kind: str) -> None:
    name, content, message = HOPELESS[kind]
    path = written(tmp_path, name, content)
    with at_most(memory=5e6), pytest.raises(CloudError, match=message) as caught:
        read_cloud(path)
    assert str(path) in str(caught.value) and str(caught.value).isprintable()


def test_a_missing_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "lzf", None)
    with pytest.raises(CloudError, match=r"pip install 'm2t-text\[pcd\]', or save it uncompressed"):
        read_cloud(written(tmp_path, "a.pcd", PACKED))


@pytest.mark.parametrize("name", WRITERS)
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_mutated_cloud_is_read_or_refused(tmp_path: Path, name: str, data: st.DataObject) -> None:
    content = bytearray(WRITERS[name](POINTS))
    for _ in range(data.draw(st.integers(1, 6))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = written(tmp_path, name, bytes(content[: data.draw(st.integers(1, len(content)))]))
    try:
        cloud = read_cloud(path)
    except CloudError as error:
        assert str(error).isprintable()
    else:
        assert np.isfinite(cloud.points).all() and len(cloud.points)


def test_progress_counts_the_bytes_of_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, "a.xyz", LINES * 500)
    calls: list[tuple[int, int]] = []
    read_cloud(path, progress=lambda done, total: calls.append((done, total)))
    size = path.stat().st_size
    assert len(calls) == 4 and calls == sorted(calls)
    assert all(done <= total == size for done, total in calls)
