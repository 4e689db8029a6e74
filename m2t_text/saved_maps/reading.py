"""Reading a map as ROS saves it: a YAML file that names an image (http://wiki.ros.org/map_server)."""

import struct
import zlib
from pathlib import Path
from typing import BinaryIO
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from m2t_text.errors import MapFileError
from m2t_text.files import opened, shown
from m2t_text.saved_maps.grid import FREE, OCCUPIED, UNKNOWN, Floats, Grid, States
from m2t_text.saved_maps.header import Header, read_header

CELLS = 1 << 25  # cells of the largest map read; 290 m x 290 m at 0.05 m
FORMATS = ("PPM", "PNG", "BMP", "JPEG")  # of the images, as Pillow calls them
# What map_saver draws for occupied, unknown and free. Nav2's writes a free_thresh by which the second is free.
BLACK, GREY, WHITE = 0, 205, 254
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
        pixels, opaque = _pixels(file, header.image)
    states, odd = _states(pixels, opaque, header)
    return Grid(states[::-1].copy(), header.resolution, header.origin), header.warnings + odd


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
