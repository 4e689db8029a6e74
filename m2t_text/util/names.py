"""Names of sources: what the ending of a file says, and the dataset that it makes."""

import re
from pathlib import Path

from m2t_text.errors import SourceError
from m2t_text.util.files import is_file, is_folder

LOGS = (".log", ".clf")
BAGS = (".bag", ".db3", ".mcap")
PACKED = (".gz", ".bz2", ".xz", ".zst", ".zstd")  # of logs and bags that are compressed as files
CLOUDS = (".pcd", ".ply", ".xyz", ".pts", ".asc", ".csv", ".npy")
SAVED_MAPS = (".yaml", ".yml")
ENDINGS = (*LOGS, *BAGS, *PACKED, *CLOUDS, *SAVED_MAPS)
NAME_LENGTH = 200  # characters; leaves room for endings within a file system's usual 255


def known_endings() -> str:
    """All endings that are read, for a message."""
    return ", ".join(ENDINGS)


def is_saved_map(path: Path) -> bool:
    """Whether it is named as the description of a map that another program drew."""
    return path.suffix.lower() in SAVED_MAPS


def is_bag(path: Path) -> bool:
    """Whether it is named as a ROS bag, or is the folder of one, or of the files of one."""
    if is_folder(path):
        return is_file(path / "metadata.yaml") or bool(bag_files(path))
    return bag_ending(path) in BAGS


def bag_ending(path: Path) -> str:
    """The ending of a file, before that of a compression."""
    ending = path.suffix.lower()
    return Path(path.stem).suffix.lower() if ending in PACKED else ending


def bag_files(folder: Path) -> list[Path]:
    """The bags in a folder, in the order of their names, numbers in that of their values."""
    try:
        held = [path for path in folder.iterdir() if bag_ending(path) in BAGS and is_file(path)]
    except OSError:
        return []
    return sorted(held, key=lambda path: [int(n) if n.isdigit() else n for n in re.split(r"(\d+)", path.name)])


def alike(one: Path, other: Path) -> bool:
    """Whether the names of two files differ in numbers alone, as those of the parts of a recording."""
    return re.sub(r"\d+", "0", one.name) == re.sub(r"\d+", "0", other.name)


def dataset_name(path: Path | str) -> str:
    """The file's name without its endings: ``a/fr079.log.gz`` -> ``fr079``. Raises SourceError if unsafe."""
    name = Path(path).absolute().name
    while name.lower().endswith(ENDINGS):
        name = name[: name.rindex(".")]
    return checked_name(name)


def checked_name(name: str) -> str:
    """The name itself if it can name a dataset; raises SourceError if not."""
    safe = name.isprintable() and "/" not in name and name.strip() not in ("", ".", "..")
    if not safe or len(name) > NAME_LENGTH:
        shown = repr(name if len(name) <= 60 else name[:60] + "...")
        raise SourceError(
            f"{shown} cannot name a dataset: give a name of 1 to {NAME_LENGTH} printable characters without '/'"
        )
    return name
