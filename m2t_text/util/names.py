"""Names of sources: what the ending of a file says, and the dataset that it makes."""

from pathlib import Path

from m2t_text.errors import SourceError
from m2t_text.util.files import is_file, is_folder

LOGS = (".log", ".clf", ".gz")
BAGS = (".bag", ".db3", ".mcap")
CLOUDS = (".pcd", ".ply", ".xyz", ".csv", ".npy")
SAVED_MAPS = (".yaml", ".yml")
ENDINGS = (*LOGS, *BAGS, *CLOUDS, *SAVED_MAPS)
NAME_LENGTH = 200  # characters; leaves room for endings within a file system's usual 255


def known_endings() -> str:
    """All endings that are read, for a message."""
    return ", ".join(ENDINGS)


def is_bag(path: Path) -> bool:
    """Whether it is named as a ROS bag, or is the folder of one."""
    return is_file(path / "metadata.yaml") if is_folder(path) else path.suffix.lower() in BAGS


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
