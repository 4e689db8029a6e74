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
DARK, BRIGHT = 30, 250  # shades below and from there on are black and white
ALIKE = 2  # shades by which pixels of one grey differ, as JPEG and editors change them
GREY_SHARE, GREY_ALONE = 0.02, 0.8  # of all pixels, and of those between black and white, that are of one grey
ALPHA = 3  # the channel of transparency
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
    """What the pixels stand for, and a warning wherever map_server's rule cannot be meant."""
    rows, columns, channels = values.shape
    cells = values.reshape(-1, channels)
    depth, odd = _depth(cells)
    grey = _unknown_shade(cells, depth, header) if header.mode == "trinary" else None
    states = np.empty(len(cells), dtype=np.int8)
    averaged = 0
    for block in _blocks(cells):
        shades, opaque = _shades(cells[block], depth)
        states[block] = _judged(shades, opaque, header, grey)
        if header.mode == "trinary" and channels == ALPHA + 1:
            served = _judged(cells[block].mean(axis=1), np.ones_like(opaque), header, None)
            averaged += int((served != states[block]).sum())
    if grey is not None:
        state = _judged(np.array([float(grey)]), np.array([True]), header, None)[0]
        told = f"free_thresh {header.free:g} would make them free"
        if state == OCCUPIED:
            told = f"occupied_thresh {header.occupied:g} would make them occupied"
        odd.append(f"pixels of {grey} are taken as unknown; {told}")
    if averaged:
        odd.append(
            f"transparent pixels are taken as unknown, others by their colours; map_server would average the "
            f"transparency in, and read {averaged:,} otherwise"
        )
    return states.reshape(rows, columns), tuple(odd)


def _blocks(cells: Values) -> Iterator[slice]:
    """Cells that are worked on at once; all of them would take sixteen times the memory of the image."""
    for low in range(0, len(cells), BLOCK):
        yield slice(low, low + BLOCK)


def _depth(cells: Values) -> tuple[float, list[str]]:
    """What a pixel's number is divided by to lie in 0...255, and a warning if that is not as its depth says."""
    if cells.dtype == np.uint8:
        return 1.0, []
    if cells.max(initial=0) <= 255:
        return 1.0, ["its pixels have 16 bits and are 255 at the most: read as those of 8 bits"]
    return 257.0, []


def _shades(cells: Values, depth: float) -> tuple[Floats, NDArray[np.bool_]]:
    """(N,) each cell's mean over its colours, 0...255, and whether it is opaque."""
    mean = cells[:, :ALPHA].mean(axis=1) / depth
    opaque = cells[:, ALPHA] == 255 if cells.shape[1] > ALPHA else np.ones(len(cells), dtype=np.bool_)
    return mean, opaque


def _unknown_shade(cells: Values, depth: float, header: Header) -> int | None:
    """A grey that must be meant as unknown, though the thresholds make it free or occupied.

    That is the one grey between black and white that an image has, but for few touched-up or blurred pixels.
    """
    counts = np.zeros(256, dtype=np.int64)
    for block in _blocks(cells):
        shades, opaque = _shades(cells[block], depth)
        counts += np.bincount(np.rint(shades[opaque]).astype(np.int64).clip(0, 255), minlength=256)
    greys = counts.copy()
    greys[:DARK], greys[BRIGHT:] = 0, 0
    grey = int(greys.argmax())
    alike = greys[max(0, grey - ALIKE) : grey + ALIKE + 1].sum()
    total, ends = counts.sum(), min(counts[:DARK].sum(), counts[BRIGHT:].sum())
    if not (alike >= GREY_SHARE * total and alike >= GREY_ALONE * greys.sum() and ends > 0):
        return None
    state = _judged(np.array([float(grey)]), np.array([True]), header, None)[0]
    return None if state == UNKNOWN else grey


def _judged(pixels: Floats, opaque: NDArray[np.bool_], header: Header, grey: int | None) -> States:
    """The states of some cells; pixels about the shade ``grey``, if any, are unknown."""
    occupancy = (pixels if header.negate else 255 - pixels) / 255
    unknown = ~opaque
    if header.mode == "raw":
        occupancy, unknown = pixels / 100, pixels > 100
    if grey is not None:
        unknown = unknown | (np.abs(pixels - grey) <= ALIKE)
    states = np.full(pixels.shape, UNKNOWN, dtype=np.int8)
    states[(occupancy > header.occupied) & ~unknown] = OCCUPIED
    states[(occupancy < header.free) & ~unknown] = FREE
    return states
