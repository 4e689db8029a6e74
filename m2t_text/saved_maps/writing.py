"""Writing a map as ROS saves it."""

from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from m2t_text.errors import MapFileError
from m2t_text.saved_maps.grid import FREE, OCCUPIED, UNKNOWN, Grid
from m2t_text.saved_maps.reading import BLACK, GREY, WHITE
from m2t_text.util.files import shown, written_whole

SHADES = {FREE: WHITE, OCCUPIED: BLACK, UNKNOWN: GREY}


def write_map(grid: Grid, path: Path) -> None:
    """Write ``path``, a YAML file, and beside it the image of the same name that ends in ``.pgm``.

    Both appear whole or not at all. Raises MapFileError if they cannot be written.
    """
    shades = np.full(grid.states.shape, SHADES[UNKNOWN], dtype=np.uint8)
    for state, shade in SHADES.items():
        shades[grid.states == state] = shade
    image = path.with_suffix(".pgm")
    header = {
        "image": image.name,
        "mode": "trinary",
        "resolution": grid.resolution,
        "origin": grid.origin.tolist(),
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    try:
        with written_whole(image) as temporary:
            Image.fromarray(shades[::-1]).save(temporary, format="PPM")
        with written_whole(path) as temporary:
            temporary.write_text(yaml.safe_dump(header, sort_keys=False), encoding="utf-8")
    except OSError as error:
        raise MapFileError(f"{shown(path)} cannot be written: {error.strerror or error}") from error
