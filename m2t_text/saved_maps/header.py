"""What the YAML file of a saved map says (http://wiki.ros.org/map_server)."""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np
import yaml

from m2t_text.errors import MapFileError
from m2t_text.util.files import is_file, opened, shown
from m2t_text.util.types import Floats

Mode = Literal["trinary", "scale", "raw"]

YAML_LIMIT = 1 << 16  # bytes; an honest file has some hundred
RESOLUTIONS = (0.005, 0.5)  # m; finer ones are a slip of units, coarser ones show no walls
POSE_LIMIT = 1e6  # m and rad; of the origin
USUAL = {"occupied_thresh": 0.65, "free_thresh": 0.196}  # what map_saver writes
BROKEN = (  # what PyYAML raises on text that is no YAML, or on values that are not what their tags say
    yaml.YAMLError,
    ArithmeticError,
    AttributeError,
    LookupError,
    RecursionError,
    TypeError,
    ValueError,
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


class _Loader(yaml.SafeLoader):
    """Reads plain values, without aliases: with them a short text stands for more than memory holds."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            alias = self.peek_event()
            raise yaml.MarkedYAMLError(problem="it holds an alias", problem_mark=alias.start_mark)
        return super().compose_node(parent, index)


def read_header(path: Path) -> Header:
    """What a ``map.yaml`` says, checked. Raises MapFileError."""
    with opened(path, MapFileError) as file:
        text = file.read(YAML_LIMIT + 1)
    if len(text) > YAML_LIMIT:
        raise MapFileError(f"{shown(path)} is longer than {YAML_LIMIT >> 10} kB: not the YAML file of a map")
    try:
        values = yaml.load(text, Loader=_Loader)
    except BROKEN as error:
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
    mode = str(values.get("mode") or "trinary").lower()  # as Nav2 reads it, in any case
    if mode not in get_args(Mode):
        raise read.wrong("mode", " or ".join(get_args(Mode)))
    found, odd = _image(path, image)
    return Header(
        image=found,
        resolution=read.number("resolution", *RESOLUTIONS),
        origin=read.origin(),
        occupied=occupied,
        free=free,
        negate=bool(read.number("negate", 0, 1, 0)),
        mode=cast(Mode, mode),
        warnings=(*(f"no {name}: taken as {USUAL[name]:g}" for name in missing), *odd),
    )


def _image(path: Path, image: str) -> tuple[Path, list[str]]:
    """The image that a file names; if that is a path of another computer, the one that lies beside the file."""
    try:
        named = path.parent / Path(image).expanduser()
    except RuntimeError:  # "~somebody", whom nobody knows here
        named = path.parent / image
    last = re.split(r"[/\\\\]", image.removeprefix("file://"))[-1]
    beside = path.parent / last
    if is_file(named) or not last or not is_file(beside):
        return named, []
    return beside, [f"image {image!r} is not there: the {last!r} that lies beside the file is read"]


@dataclass(frozen=True)
class _Values:
    """The values of a YAML file, looked up by name. Each method raises MapFileError for what it cannot take."""

    path: Path
    values: dict[Any, Any]

    def wrong(self, name: str, wanted: str) -> MapFileError:
        try:
            found = repr(self.values[name]) if name in self.values else "missing"
        except ValueError:  # Python does not write out whole numbers of thousands of digits
            found = "endless"
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
