"""Saved maps as targets: a YAML file and the image that it names, one of both damaged."""

from io import BytesIO
from pathlib import Path
from zlib import crc32

import numpy as np
from PIL import Image

from m2t_text.description.source import Source
from m2t_text.saved_maps.reading import BLACK, GREY, WHITE
from m2t_text.sources.opening import open_source
from m2t_text.sources.saved_map import SavedMap

RESOLUTION = 0.2  # m
HEADER = f"image: map.image\nresolution: {RESOLUTION}\norigin: [-1.5, 2, 0.1]\n"
USUAL = "mode: trinary\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
AREA = 5.0  # m² of the largest map that is described: a short file may tell of 80,000, looked at for an hour
PNG_HEAD = 8  # bytes before the first chunk
MODES = {
    "PPM": ("L", "1", "RGB"),
    "PNG": ("L", "1", "P", "LA", "I;16"),
    "BMP": ("L", "1", "RGB"),
    "JPEG": ("L", "RGB"),
}

Seeds = dict[str, bytes]


def pixels() -> np.ndarray:
    """A room of 1 m by 1 m, and around it what nobody saw."""
    made = np.full((9, 9), GREY, dtype=np.uint8)
    made[1:-1, 1:-1] = BLACK
    made[2:-2, 2:-2] = WHITE
    return made


def drawn(format: str, mode: str) -> bytes:
    """The room as an image of a format and mode of Pillow's."""
    image = Image.fromarray(pixels().astype(np.uint16) * 257 if mode == "I;16" else pixels())
    file = BytesIO()
    (image if image.mode == mode else image.convert(mode)).save(file, format)
    return file.getvalue()


def images(folder: Path, format: str) -> Seeds:
    return {mode: drawn(format, mode) for mode in MODES[format]}


def headers(folder: Path) -> Seeds:
    bare = HEADER.replace("[-1.5, 2, 0.1]", "\n  - 1e0\n  - .5\n  - 0").replace("map.image", "'map.image'")
    raw = HEADER + "mode: raw\nnegate: yes\noccupied_thresh: 1.0\n"
    return {"usual": (HEADER + USUAL).encode(), "bare": bare.encode(), "raw": raw.encode()}


def read(header: bytes, image: bytes, folder: Path) -> Source | None:
    """The map of such files, or None if it is too large to be described for every input."""
    (folder / "map.image").write_bytes(image)
    path = folder / "fuzzed.yaml"
    path.write_bytes(header)
    source = open_source(path)
    assert isinstance(source, SavedMap)
    return source if source.grid.states.size * source.grid.resolution**2 <= AREA else None


def sealed(png: bytes) -> bytes:
    """The same with checksums that fit, or nothing behind the first damage would ever be read."""
    made, at = png[:PNG_HEAD], PNG_HEAD
    while at + 12 <= len(png):  # of a chunk: the length of its contents, its kind, they, and the checksum
        end = at + 8 + int.from_bytes(png[at : at + 4])
        made += png[at:end] + crc32(png[at + 4 : end]).to_bytes(4)
        at = end + 4
    return made + png[at:]
