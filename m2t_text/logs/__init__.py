"""Laser logs: one reader for all of them, and the name a dataset gets from its file."""

from collections.abc import Callable
from pathlib import Path

from m2t_text.errors import LogError
from m2t_text.logs.log import Log, Scan

__all__ = ["Log", "Scan", "dataset_name", "read_log"]

ENDINGS = (".log", ".clf", ".gz")
NAME_LENGTH = 200  # characters; leaves room for endings within a file system's usual 255


def read_log(
    path: str | Path, name: str | None = None, progress: Callable[[int, int], None] | None = None
) -> Log:
    """Read a laser log; ``name`` defaults to ``dataset_name(path)``.

    ``progress`` is called with the bytes of the file read so far and its size.
    Raises LogError with one line that says what is wrong, where, and what to do.

    Examples:
        >>> import m2t_text as m2t
        >>> log = m2t.read_log("drive.log")
        >>> log.name, len(log.scans), log.odometry.shape
        ('drive', 242, (242, 3))
    """
    from m2t_text.logs.carmen import read_carmen

    return read_carmen(Path(path), name, progress)


def dataset_name(path: Path | str) -> str:
    """The file's name without its endings: ``a/fr079.log.gz`` -> ``fr079``. Raises LogError if it is unsafe."""
    name = Path(path).name
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
