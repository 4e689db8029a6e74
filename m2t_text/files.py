"""Files that appear whole or not at all, and folders to put them in."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from m2t_text.errors import M2TError


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A file to write beside ``path``, with its ending; it takes the path's place when the block ends.

    Nothing is left of it if the block raises. An OSError is the caller's to explain.
    """
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=path.suffix.lower())
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o644)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def make_folder(path: Path) -> None:
    """Makes a folder and those above it. Raises M2TError if it cannot be made."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise M2TError(f"cannot make the folder {str(path)!r}: {error.strerror or error}") from error
