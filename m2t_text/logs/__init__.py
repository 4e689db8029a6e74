"""Laser logs: one reader for all of them, and the name a dataset gets from its file."""

from collections.abc import Callable
from pathlib import Path

from m2t_text.errors import LogError
from m2t_text.logs.log import Log, Scan, Topics

__all__ = ["BAGS", "SAVED_MAPS", "Log", "Scan", "Topics", "dataset_name", "is_bag", "read_log"]

BAGS = (".bag", ".db3", ".mcap")
SAVED_MAPS = (".yaml", ".yml")
ENDINGS = (".log", ".clf", ".gz", *BAGS, *SAVED_MAPS)
NAME_LENGTH = 200  # characters; leaves room for endings within a file system's usual 255


def read_log(
    path: str | Path,
    name: str | None = None,
    progress: Callable[[int, int], None] | None = None,
    topics: Topics | None = None,
) -> Log:
    """Read a laser log, CARMEN's or a ROS bag; ``name`` defaults to ``dataset_name(path)``.

    ``progress`` is called with how much was read so far and how much there is: bytes, or messages of a bag.
    ``topics`` of a bag are found by their types where they are not named.
    Raises LogError with one line that says what is wrong, where, and what to do.
    """
    file = Path(path)
    if is_bag(file):
        from m2t_text.logs.bag import read_bag

        return read_bag(file, name, progress, topics)
    from m2t_text.logs.carmen import read_carmen

    return read_carmen(file, name, progress)


def is_bag(path: Path) -> bool:
    """Whether it is named as a ROS bag, or is the folder of one."""
    return (path / "metadata.yaml").is_file() if path.is_dir() else path.suffix.lower() in BAGS


def dataset_name(path: Path | str) -> str:
    """The file's name without its endings: ``a/fr079.log.gz`` -> ``fr079``. Raises LogError if it is unsafe."""
    name = Path(path).absolute().name
    while name.lower().endswith(ENDINGS):
        name = name[: name.rindex(".")]
    return checked_name(name)


def checked_name(name: str) -> str:
    """The name itself if it can name a dataset; raises LogError if not."""
    safe = name.isprintable() and "/" not in name and name.strip() not in ("", ".", "..")
    if not safe or len(name) > NAME_LENGTH:
        shown = repr(name if len(name) <= 60 else name[:60] + "...")
        raise LogError(
            f"{shown} cannot name a dataset: give a name of 1 to {NAME_LENGTH} printable characters without '/'"
        )
    return name
