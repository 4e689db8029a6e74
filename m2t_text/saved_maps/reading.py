"""Reading a map as ROS saves it: a YAML file that names an image (http://wiki.ros.org/map_server)."""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from m2t_text.errors import MapFileError
from m2t_text.saved_maps.grid import FREE, OCCUPIED, UNKNOWN, Grid, States
from m2t_text.saved_maps.header import Header, read_header
from m2t_text.util.files import opened, shown
from m2t_text.util.types import Floats

Values = NDArray[Any]

CELLS = 1 << 25  # cells of the largest map read; 290 m x 290 m at 0.05 m
BLOCK = 1 << 20  # cells that are worked on at once
FORMATS = ("PPM", "PNG", "BMP", "JPEG")  # of the images, as Pillow calls them
# What map_saver draws for occupied, unknown and free. Nav2's writes a free_thresh by which the second is free.
BLACK, GREY, WHITE = 0, 205, 254
RUN_LENGTHS = "bmp_rle"  # the decoder that Pillow has in Python alone: it fills a wide row cell by cell
BROKEN = (  # what Pillow raises on a damaged image
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    SyntaxError,
    SystemError,  # where memory ends
    TypeError,
    ValueError,
    struct.error,
    zlib.error,
)


def read_map(path: Path) -> tuple[Grid, tuple[str, ...]]:
    """The occupancy grid that a ``map.yaml`` stands for, and what is odd about it, one line for each.

    Raises:
        MapFileError: with one line that says what is wrong, where, and what to do.
    """
    header = read_header(path)
    with opened(header.image, MapFileError) as file:
        values = _values(file, header.image)
    states, odd = _states(values, header)
    return Grid(states[::-1].copy(), header.resolution, header.origin), header.warnings + odd


def _values(file: BinaryIO, path: Path) -> Values:
    """(rows, columns, channels) of each pixel, alpha as the fourth; 16 bits deep or 8."""
    try:
        with catch_warnings():
            simplefilter("ignore")  # of large images and odd headers; what matters is checked here
            image = Image.open(file, formats=FORMATS)
            columns, rows = image.size
            if columns * rows > CELLS:
                raise Image.DecompressionBombError  # as Pillow says of even larger ones
            if any(tile[0] == RUN_LENGTHS for tile in image.tile):
                raise MapFileError(f"{shown(path)} is a packed BMP, slow to read: save the map as PGM or PNG")
            return _channels(image)
    except UnidentifiedImageError as error:
        raise MapFileError(f"{shown(path)} is no image: save the map as PGM or PNG") from error
    except Image.DecompressionBombError as error:
        raise MapFileError(f"{shown(path)} has more than {CELLS:,} cells: save a part of the map") from error
    except BROKEN as error:
        reason = str(error) or type(error).__name__
        raise MapFileError(f"{shown(path)} is a damaged image ({reason}): save the map again") from error


def _channels(image: Image.Image) -> Values:
    if not image.mode.startswith("I"):  # those are 16 bits deep
        wanted = "RGBA" if image.has_transparency_data else "L" if image.mode == "L" else "RGB"
        image = image if image.mode == wanted else image.convert(wanted)
    return np.atleast_3d(np.asarray(image))


def _states(values: Values, header: Header) -> tuple[States, tuple[str, ...]]:
    """What map_server makes of the pixels, and a warning where its rule cannot be meant."""
    rows, columns, channels = values.shape
    cells = values.reshape(-1, channels)
    states = np.empty(len(cells), dtype=np.int8)
    grey = _means_unknown_by_grey(cells, header)
    for block in _blocks(cells):
        states[block] = _judged(*_shades(cells[block]), header, grey)
    odd = f"pixels of {GREY} are taken as unknown; free_thresh {header.free:g} would make them free"
    return states.reshape(rows, columns), (odd,) if grey else ()


def _blocks(cells: Values) -> Iterator[slice]:
    """Cells that are worked on at once; all of them would take sixteen times the memory of the image."""
    for low in range(0, len(cells), BLOCK):
        yield slice(low, low + BLOCK)


def _shades(cells: Values) -> tuple[Floats, NDArray[np.bool_]]:
    """(N,) each cell's mean over its channels with alpha, 0...255, and whether it is opaque."""
    mean = cells.mean(axis=1)
    opaque = cells[:, 3] == 255 if cells.shape[1] == 4 else np.ones(len(cells), dtype=np.bool_)
    return (mean if cells.dtype == np.uint8 else mean / 257.0), opaque


def _means_unknown_by_grey(cells: Values, header: Header) -> bool:
    """Whether the pixels are map_saver's three shades, and the thresholds make free of its unknown."""
    if header.mode != "trinary" or header.negate or header.free <= (255 - GREY) / 255:
        return False
    shades: set[float] = set()
    for block in _blocks(cells):
        shades.update(np.unique(_shades(cells[block])[0]).tolist())
    return shades == {BLACK, GREY, WHITE}


def _judged(pixels: Floats, opaque: NDArray[np.bool_], header: Header, grey: bool) -> States:
    """The states of some cells; where ``grey``, pixels of that shade are unknown."""
    occupancy = (pixels if header.negate else 255 - pixels) / 255
    unknown = np.zeros(pixels.shape, dtype=np.bool_)
    if header.mode == "raw":
        occupancy, unknown = pixels / 100, pixels > 100
    elif header.mode == "scale":
        unknown = ~opaque
    elif grey:
        unknown = pixels == GREY
    states = np.full(pixels.shape, UNKNOWN, dtype=np.int8)
    states[(occupancy > header.occupied) & ~unknown] = OCCUPIED
    states[(occupancy < header.free) & ~unknown] = FREE
    return states
