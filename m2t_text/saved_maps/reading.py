"""Reading a map as ROS saves it: a YAML file that names an image (http://wiki.ros.org/map_server)."""

import math
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal, get_args
from warnings import catch_warnings, simplefilter

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from m2t_text.errors import MapFileError
from m2t_text.files import opened, shown
from m2t_text.saved_maps.grid import FREE, OCCUPIED, UNKNOWN, Floats, Grid, States

Mode = Literal["trinary", "scale", "raw"]

YAML_LIMIT = 1 << 16  # bytes; an honest file has some hundred
CELLS = 1 << 25  # cells of the largest map read; 290 m x 290 m at 0.05 m
RESOLUTIONS = (0.005, 0.5)  # m; finer ones are a slip of units, coarser ones show no walls
POSE_LIMIT = 1e6  # m and rad; of the origin
FORMATS = ("PPM", "PNG", "BMP", "JPEG")  # of the images, as Pillow calls them
USUAL = {"occupied_thresh": 0.65, "free_thresh": 0.196}  # what map_saver writes
# What map_saver draws for occupied, unknown and free. Nav2's writes a free_thresh by which the second is free.
BLACK, GREY, WHITE = 0, 205, 254
BROKEN = (  # what Pillow raises on a damaged image
    EOFError,
    IndexError,
    KeyError,
    MemoryError,
    OSError,
    OverflowError,
    SyntaxError,
    TypeError,
    ValueError,
    struct.error,
    zlib.error,
)


@dataclass(frozen=True)
class Header:
    """What the YAML file says.

    Attributes:
        image: path of the image, as the file gives it or beside the file.
        resolution: metres, side of a pixel.
        origin: (3,) pose of the image's lower left corner in the map's frame, metres and radians.
        occupied, free: occupancies above and below which a cell is so, 0...1.
        negate: whether white is occupied instead of black.
        mode: how pixels are read.
        warnings: what the file leaves out.
    """

    image: Path
    resolution: float
    origin: Floats
    occupied: float
    free: float
    negate: bool
    mode: Mode
    warnings: tuple[str, ...] = ()


def read_map(path: Path) -> tuple[Grid, tuple[str, ...]]:
    """The occupancy grid that a ``map.yaml`` stands for, and what is odd about it, one line for each.

    Raises:
        MapFileError: with one line that says what is wrong, where, and what to do.
    """
    header = read_header(path)
    with opened(header.image, MapFileError) as file:
        pixels, opaque = _pixels(file, header.image)
    states, odd = _states(pixels, opaque, header)
    return Grid(states[::-1].copy(), header.resolution, header.origin), header.warnings + odd


def read_header(path: Path) -> Header:
    """What a ``map.yaml`` says, checked. Raises MapFileError."""
    with opened(path, MapFileError) as file:
        text = file.read(YAML_LIMIT + 1)
    if len(text) > YAML_LIMIT:
        raise MapFileError(f"{shown(path)} is longer than {YAML_LIMIT >> 10} kB: not the YAML file of a map")
    try:
        values = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = getattr(error, "problem", None) or "it is not YAML"
        mark = getattr(error, "problem_mark", None)
        where = f":{mark.line + 1}" if mark else ""
        raise MapFileError(f"{shown(path)}{where} is not the YAML file of a map: {reason}") from error
    if not isinstance(values, dict) or "image" not in values:
        raise MapFileError(f"{shown(path)} is not the YAML file of a map: it names no `image`")
    read = _Values(path, values)
    image = values["image"]
    if not isinstance(image, str) or not image or "\0" in image:
        raise read.wrong("image", "the path of a PGM or PNG file")
    missing = [name for name in USUAL if name not in values]
    occupied, free = (read.number(name, 0.0, 1.0, default) for name, default in USUAL.items())
    if not free < occupied:
        raise read.wrong("free_thresh", f"less than occupied_thresh, {occupied:g}")
    mode = values.get("mode", "trinary")
    if mode not in get_args(Mode):
        raise read.wrong("mode", " or ".join(get_args(Mode)))
    return Header(
        image=path.parent / image,
        resolution=read.number("resolution", *RESOLUTIONS),
        origin=read.origin(),
        occupied=occupied,
        free=free,
        negate=bool(read.number("negate", 0, 1, 0)),
        mode=mode,
        warnings=tuple(f"no {name}: taken as {USUAL[name]:g}" for name in missing),
    )


@dataclass(frozen=True)
class _Values:
    """The values of a YAML file, looked up by name. Each method raises MapFileError for what it cannot take."""

    path: Path
    values: dict[Any, Any]

    def wrong(self, name: str, wanted: str) -> MapFileError:
        found = repr(self.values[name]) if name in self.values else "missing"
        cut = found if len(found) <= 40 else found[:37] + "..."
        return MapFileError(f"{shown(self.path)}: `{name}` is {cut}; it must be {wanted}")

    def number(self, name: str, low: float, high: float, default: float | None = None) -> float:
        value = _number(self.values.get(name, default))
        if not low <= value <= high:
            raise self.wrong(name, f"a number of {low:g} to {high:g}")
        return value

    def origin(self) -> Floats:
        value = self.values.get("origin")
        numbers = [_number(part) for part in value] if isinstance(value, list) else []
        if len(numbers) != 3 or not all(abs(number) <= POSE_LIMIT for number in numbers):
            raise self.wrong("origin", "[x, y, yaw] in metres and radians")
        return np.array(numbers)


def _number(value: Any) -> float:
    """A YAML number, or one that PyYAML takes for a string, as 5e-2; else not a number."""
    try:
        return float(value) if isinstance(value, int | float | str) else math.nan
    except (ValueError, OverflowError):
        return math.nan


def _pixels(file: BinaryIO, path: Path) -> tuple[Floats, NDArray[np.bool_]]:
    """(rows, columns) each pixel's mean over its channels with alpha, 0...255, and whether it is opaque."""
    try:
        with catch_warnings():
            simplefilter("ignore")  # of large images and odd headers; what matters is checked here
            image = Image.open(file, formats=FORMATS)
            columns, rows = image.size
            if columns * rows > CELLS:
                raise Image.DecompressionBombError  # as Pillow says of even larger ones
            return _channels(image)
    except UnidentifiedImageError as error:
        raise MapFileError(f"{shown(path)} is no image: save the map as PGM or PNG") from error
    except Image.DecompressionBombError as error:
        raise MapFileError(f"{shown(path)} has more than {CELLS:,} cells: save a part of the map") from error
    except BROKEN as error:
        reason = str(error) or type(error).__name__
        raise MapFileError(f"{shown(path)} is a damaged image ({reason}): save the map again") from error


def _channels(image: Image.Image) -> tuple[Floats, NDArray[np.bool_]]:
    if image.mode.startswith("I"):  # 16 bits
        deep = np.asarray(image, dtype=np.float64) / 257.0
        return deep, np.ones(deep.shape, dtype=np.bool_)
    if image.has_transparency_data:
        image = image.convert("RGBA")
    elif image.mode != "L":
        image = image.convert("RGB")
    values = np.atleast_3d(np.asarray(image))
    opaque = values[..., 3] == 255 if values.shape[2] == 4 else np.ones(values.shape[:2], dtype=np.bool_)
    return values.mean(axis=2), opaque


def _states(pixels: Floats, opaque: NDArray[np.bool_], header: Header) -> tuple[States, tuple[str, ...]]:
    """What map_server makes of the pixels, and a warning where its rule cannot be meant."""
    occupancy = (pixels if header.negate else 255 - pixels) / 255
    unknown = np.zeros(pixels.shape, dtype=np.bool_)
    odd: tuple[str, ...] = ()
    if header.mode == "raw":
        occupancy, unknown = pixels / 100, pixels > 100
    elif header.mode == "scale":
        unknown = ~opaque
    elif (
        not header.negate
        and header.free > (255 - GREY) / 255
        and set(np.unique(pixels)) == {BLACK, GREY, WHITE}
    ):
        unknown = pixels == GREY
        odd = (f"pixels of {GREY} are taken as unknown; free_thresh {header.free:g} would make them free",)
    states = np.full(pixels.shape, UNKNOWN, dtype=np.int8)
    states[(occupancy > header.occupied) & ~unknown] = OCCUPIED
    states[(occupancy < header.free) & ~unknown] = FREE
    return states, odd
