"""Reading map.yaml and its image as map_server does, by hand; damage and hostile files get one line."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from drawings import drawn
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image
from soundness import at_most

from m2t_text.errors import MapFileError
from m2t_text.saved_maps.grid import FREE, OCCUPIED, Grid
from m2t_text.saved_maps.reading import read_map
from m2t_text.saved_maps.writing import write_map

HEADER = {
    "image": "map.png",
    "resolution": 0.05,
    "origin": [-1.0, 2.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}
PIXELS = np.array([[254, 0, 205], [0, 254, 254]], dtype=np.uint8)  # the first row is the top
STATES = drawn(".# ", "#..")


def saved(folder: Path, pixels: NDArray[Any] = PIXELS, image: str = "map.png", **changes: object) -> Path:
    """A map.yaml with its image; a value None leaves the key out."""
    Image.fromarray(pixels).save(folder / image)
    header = {key: value for key, value in {**HEADER, "image": image, **changes}.items() if value is not None}
    path = folder / "map.yaml"
    path.write_text(yaml.safe_dump(header))
    return path


@pytest.mark.parametrize("image", ["map.png", "map.pgm", "map.bmp"])
def test_white_is_free_black_is_occupied_and_grey_unknown(tmp_path: Path, image: str) -> None:
    grid, warnings = read_map(saved(tmp_path, image=image))
    assert grid.states.tolist() == STATES.tolist()
    assert (grid.resolution, grid.origin.tolist(), warnings) == (0.05, [-1.0, 2.0, 0.0], ())


def test_the_origin_is_the_pose_of_the_lower_left_corner(tmp_path: Path) -> None:
    grid, _ = read_map(saved(tmp_path, resolution=0.5, origin=[1.0, 2.0, np.pi / 2]))
    # The occupied cells are (column, row) = (1, 1) and (0, 0); the columns run along the map's y axis.
    assert grid.centres(OCCUPIED) == pytest.approx(np.array([[1 - 0.25, 2 + 0.25], [1 - 0.75, 2 + 0.75]]))
    assert grid.to_cells(grid.to_map([[0.3, 1.4]])) == pytest.approx(np.array([[0.3, 1.4]]))


def test_negate_turns_black_and_white(tmp_path: Path) -> None:
    for negate in (1, True, "1"):
        grid, _ = read_map(saved(tmp_path, pixels=255 - PIXELS, negate=negate))
        assert grid.states.tolist() == STATES.tolist()


def test_thresholds_are_exclusive(tmp_path: Path) -> None:
    pixels = np.array([[255 - 51, 255 - 102, 255 - 50, 255 - 103]], dtype=np.uint8)  # 0.2, 0.4 and beyond
    grid, _ = read_map(saved(tmp_path, pixels=pixels, free_thresh=0.2, occupied_thresh=0.4))
    assert grid.states.tolist() == drawn("  .#").tolist()


def test_raw_pixels_are_percents_and_none_beyond_100(tmp_path: Path) -> None:
    pixels = np.array([[0, 19, 30, 66, 100, 101, 255]], dtype=np.uint8)
    grid, _ = read_map(saved(tmp_path, pixels=pixels, mode="raw"))
    assert grid.states.tolist() == drawn(".. ##  ").tolist()


@pytest.mark.parametrize("mode", ["scale", "trinary"])
def test_transparent_pixels_are_unknown(tmp_path: Path, mode: str) -> None:
    shades = np.array([[0, 0, 255, 255, 205]], dtype=np.uint8)
    alpha = np.array([[255, 0, 255, 100, 255]], dtype=np.uint8)
    grid, warnings = read_map(saved(tmp_path, np.dstack([shades] * 3 + [alpha]), mode=mode))
    assert grid.states.tolist() == drawn("# .  ").tolist()
    # map_server averages alpha with the colours of trinary maps: 63.75, 0, 255, 216.25 and 217.5 of 255.
    told = "map_server would average the transparency in, and read 3 otherwise"
    assert [told in one for one in warnings] == ([True] if mode == "trinary" else [])
    (tmp_path / "plain").mkdir()
    black = np.dstack([PIXELS.clip(0, 0)] * 3 + [np.full_like(PIXELS, 255)])
    assert read_map(saved(tmp_path / "plain", black))[1] == ()


def test_a_map_of_opaque_colours_is_read_as_one_without(tmp_path: Path) -> None:
    grid, warnings = read_map(saved(tmp_path, np.dstack([PIXELS] * 3 + [np.full_like(PIXELS, 255)])))
    assert grid.states.tolist() == STATES.tolist()
    assert len(warnings) == 1 and "read 1 otherwise" in warnings[0]  # 205 would become free


def test_pixels_of_16_bits_may_hold_shades_of_8(tmp_path: Path) -> None:
    grid, warnings = read_map(saved(tmp_path, PIXELS.astype(np.uint16)))
    assert grid.states.tolist() == STATES.tolist()
    assert warnings == ("its pixels have 16 bits and are 255 at the most: read as those of 8 bits",)


def room(unknown: int, free: int = 254, occupied: int = 0) -> NDArray[np.uint8]:
    """A room of 40 x 40 cells in unknown space."""
    made = np.full((60, 60), unknown, dtype=np.uint8)
    made[10:50, 10:50] = occupied
    made[11:49, 11:49] = free
    return made


# How mapping programs save: shades of unknown, free and occupied, the thresholds that they write beside them,
# and whether these make free or occupied of unknown.
SAVED = {
    "map_saver of ROS 1, gmapping, hector": (room(205), {}, None),
    "Nav2 and slam_toolbox": (room(205), {"mode": "trinary", "free_thresh": 0.25}, "free_thresh 0.25"),
    "Nav2, from YAML with capitals": (room(205), {"mode": "Trinary", "free_thresh": 0.25}, "free_thresh 0.25"),
    "Cartographer": (room(128), {}, None),
    "Cartographer, thresholds narrowed": (
        room(128),
        {"occupied_thresh": 0.45, "free_thresh": 0.4},
        "occupied_thresh 0.45",
    ),
    "foreign thresholds": (room(205), {"occupied_thresh": 0.5, "free_thresh": 0.49}, "free_thresh 0.49"),
    "negated": (room(50, 1, 255), {"negate": 1, "free_thresh": 0.25}, "free_thresh 0.25"),
}


@pytest.mark.parametrize("touch", ["not", "brush", "JPEG"])
@pytest.mark.parametrize("program", SAVED)
def test_maps_are_read_as_the_programs_that_saved_them_meant(tmp_path: Path, program: str, touch: str) -> None:
    pixels, header, told = SAVED[program]
    wanted = np.full((60, 60), -1)
    wanted[10:50, 10:50] = OCCUPIED
    wanted[11:49, 11:49] = FREE
    touched = pixels.copy()
    if touch == "brush":  # an eraser and a pencil, used where it changes nothing
        touched[20:30, 20:30] = 0 if header.get("negate") else 255
        touched[10, 20:30] = 250 if header.get("negate") else 5
    image = "map.jpg" if touch == "JPEG" else "map.png"
    path = saved(tmp_path, touched, image, **header)
    if touch == "JPEG":
        Image.fromarray(touched).save(tmp_path / image, quality=95)
    grid, warnings = read_map(path)
    assert (grid.states[::-1] != wanted).mean() < (0.025 if touch == "JPEG" else 1e-9)
    assert [told in one for one in warnings if told] == ([True] if told else [])
    assert told or warnings == ()


def test_probabilities_in_shades_are_read_by_the_thresholds(tmp_path: Path) -> None:
    """As Cartographer paints them: many greys, of which none is more frequent than the others."""
    shades = np.tile(np.arange(0, 256, dtype=np.uint8), (8, 1))
    grid, warnings = read_map(saved(tmp_path, shades))
    occupancy = (255 - shades[0].astype(float)) / 255
    assert grid.states[0].tolist() == np.where(occupancy > 0.65, 1, np.where(occupancy < 0.196, 0, -1)).tolist()
    assert warnings == ()


def test_free_space_of_another_shade_than_white_stays_free(tmp_path: Path) -> None:
    grid, warnings = read_map(saved(tmp_path, room(128, free=230)))
    assert (grid.states[12:48, 12:48] == FREE).all() and warnings == ()


@pytest.mark.parametrize(
    "named", ["/home/turtle/maps/{}", "~/maps/{}", "~nobody-here/{}", "C:\\maps\\{}", "maps/{}", "file:///a/{}"]
)
def test_the_image_may_be_named_by_a_path_of_another_computer(tmp_path: Path, named: str) -> None:
    path = saved(tmp_path)
    path.write_text(path.read_text().replace("image: map.png", f"image: '{named.format('map.png')}'"))
    grid, warnings = read_map(path)
    assert grid.states.tolist() == STATES.tolist()
    assert len(warnings) == 1 and "is not there: the 'map.png' that lies beside the file is read" in warnings[0]
    (tmp_path / "map.png").unlink()
    with pytest.raises(MapFileError, match="does not exist"):
        read_map(path)


@pytest.mark.parametrize("kind", ["colour", "palette", "bits", "16 bits"])
def test_any_kind_of_image_is_read(tmp_path: Path, kind: str) -> None:
    pixels = np.where(PIXELS == 205, 0, PIXELS).astype(np.uint8) // 254 * 255
    image = Image.fromarray(pixels)
    changed = {
        "colour": lambda: image.convert("RGB"),
        "palette": lambda: image.convert("P"),
        "bits": lambda: image.convert("1"),
        "16 bits": lambda: Image.fromarray(pixels.astype(np.uint16) * 257),
    }[kind]()
    path = saved(tmp_path)
    changed.save(tmp_path / "map.png")
    assert read_map(path)[0].states.tolist() == drawn(".##", "#..").tolist()


def test_what_map_saver_calls_unknown_is_unknown_whatever_it_writes_beside_it(tmp_path: Path) -> None:
    grid, warnings = read_map(saved(tmp_path, free_thresh=0.25))
    assert grid.states.tolist() == STATES.tolist()
    assert warnings == ("pixels of 205 are taken as unknown; free_thresh 0.25 would make them free",)


def test_thresholds_may_be_missing(tmp_path: Path) -> None:
    grid, warnings = read_map(saved(tmp_path, free_thresh=None, occupied_thresh=None, negate=None))
    assert grid.states.tolist() == STATES.tolist()
    assert warnings == ("no occupied_thresh: taken as 0.65", "no free_thresh: taken as 0.196")


def test_the_image_may_lie_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    path = saved(tmp_path, image="images/floor 1.png")
    assert read_map(path)[0].states.tolist() == STATES.tolist()
    path.write_text(path.read_text().replace("images/floor 1.png", str(tmp_path / "images" / "floor 1.png")))
    assert read_map(path)[0].states.tolist() == STATES.tolist()


def test_what_is_written_is_read(tmp_path: Path) -> None:
    grid = Grid(np.tile(STATES, (5, 4)), 0.05, np.array([-3.15, 0.1 + 0.2, 1e-17]))
    write_map(grid, tmp_path / "floor.yaml")
    again, warnings = read_map(tmp_path / "floor.yaml")
    assert (again.states == grid.states).all() and (again.origin == grid.origin).all()
    assert (again.resolution, warnings) == (0.05, ())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["floor.pgm", "floor.yaml"]
    with pytest.raises(MapFileError, match="cannot be written"):
        write_map(grid, tmp_path / "missing" / "floor.yaml")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"image": None}, "names no `image`"),
        ({"image": 3}, "`image` is 3; it must be the path of a PGM or PNG file"),
        ({"image": "nowhere.pgm"}, "nowhere.pgm does not exist"),
        ({"image": "."}, "is a directory"),
        ({"image": "map.yaml"}, "map.yaml is no image"),
        ({"image": "/dev/zero"}, "is not a regular file"),
        ({"image": "a\0b"}, "`image` is"),
        ({"resolution": None}, "`resolution` is missing; it must be a number of 0.005 to 0.5"),
        ({"resolution": 50}, "`resolution` is 50"),
        ({"resolution": 0}, "`resolution` is 0"),
        ({"resolution": float("nan")}, "`resolution` is nan"),
        ({"resolution": [0.05]}, "`resolution` is \\[0.05\\]"),
        ({"origin": None}, "`origin` is missing; it must be \\[x, y, yaw\\]"),
        ({"origin": [1, 2]}, "`origin` is \\[1, 2\\]"),
        ({"origin": [0, 0, float("inf")]}, "`origin` is"),
        ({"origin": [0, 0, 10**400]}, "`origin` is"),
        ({"origin": "0 0 0"}, "`origin` is '0 0 0'"),
        ({"occupied_thresh": 65}, "`occupied_thresh` is 65; it must be a number of 0 to 1"),
        ({"free_thresh": 0.7}, "`free_thresh` is 0.7; it must be less than occupied_thresh, 0.65"),
        ({"negate": "maybe"}, "`negate` is 'maybe'"),
        ({"mode": "ternary"}, "`mode` is 'ternary'; it must be trinary or scale or raw"),
        ({"mode": ["raw"]}, "`mode` is \\['raw'\\]"),
    ],
)
def test_a_wrong_header_gets_one_line(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    path = saved(tmp_path)
    header = {key: value for key, value in {**HEADER, **changes}.items() if value is not None}
    path.write_text(yaml.safe_dump(header))
    with pytest.raises(MapFileError, match=message) as caught:
        read_map(path)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"", "is empty"),
        (b"- 1\n- 2\n", "names no `image`"),
        (b"image: map.png\nresolution: [0.05\n", "is not the YAML file of a map: expected ','"),
        (b"\xff\xfe\x00", "is not the YAML file of a map"),
        (
            b"image: !!python/object/apply:os.system [ls]\n",
            "is not the YAML file of a map: could not determine",
        ),
        (b"[" * 5000, "is not the YAML file of a map"),
        (b"date: 2001-99-99\n", "is not the YAML file of a map"),
        (b"date: !!timestamp tomorrow\n", "is not the YAML file of a map"),
        (b"negate: !!bool perhaps\n", "is not the YAML file of a map"),
        (b"resolution: !!float ''\n", "is not the YAML file of a map"),
        (b"resolution: " + b"1:" * 400 + b"1.5\n", "is not the YAML file of a map"),
        (b"image: map.png\nresolution: 0x" + b"f" * 9000, "`resolution` is endless; it must be a number"),
        (b"a: &a [1]\nimage: [*a, *a]\n", "map.yaml:2 is not the YAML file of a map: it holds an alias"),
        (b"#" * 70000, "is longer than 64 kB"),
    ],
)
def test_what_is_no_header_gets_one_line(tmp_path: Path, text: bytes, message: str) -> None:
    (tmp_path / "map.yaml").write_bytes(text)
    with pytest.raises(MapFileError, match=message) as caught:
        read_map(tmp_path / "map.yaml")
    assert str(caught.value).isprintable()


def test_an_image_that_claims_too_much_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    path = saved(tmp_path, image="map.pgm")
    for size in (b"6000 6000", b"60000 60000", b"99999999999 1"):
        (tmp_path / "map.pgm").write_bytes(b"P5 " + size + b" 255\n")
        with pytest.raises(MapFileError, match=r"has more than 33,554,432 cells|is a damaged image"):
            read_map(path)


@pytest.mark.parametrize("shape", [(2000, 2000), (2, 2_000_000), (2_000_000, 2)])
def test_a_large_image_takes_little_memory_whatever_its_shape(tmp_path: Path, shape: tuple[int, int]) -> None:
    path = saved(tmp_path, np.full((*shape, 3), 254, dtype=np.uint8), image="map.pgm")
    with at_most(memory=90e6):
        grid, _ = read_map(path)
    assert (grid.states == FREE).all() and grid.states.shape == shape


def test_a_cut_off_image_is_refused(tmp_path: Path) -> None:
    for image in ("map.png", "map.pgm"):
        path = saved(tmp_path, pixels=np.tile(PIXELS, (40, 40)), image=image)
        contents = (tmp_path / image).read_bytes()
        for length in (1, 9, len(contents) // 2):
            (tmp_path / image).write_bytes(contents[:length])
            with pytest.raises(MapFileError, match=r"is no image|is a damaged image"):
                read_map(path)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_mutated_map_is_read_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    path = saved(tmp_path, image=data.draw(st.sampled_from(["map.png", "map.pgm"])))
    for file in tmp_path.iterdir():
        content = bytearray(file.read_bytes())
        for _ in range(data.draw(st.integers(0, 3))):
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
        file.write_bytes(content)
    try:
        grid, _ = read_map(path)
    except MapFileError as error:
        assert str(error).isprintable()
        return
    assert np.isfinite(grid.origin).all() and 0.005 <= grid.resolution <= 0.5
    assert set(np.unique(grid.states)) <= {-1, 0, 1}
