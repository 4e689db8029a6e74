"""Files to read, which may be anything; files that appear whole or not at all, and folders to put them in."""

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

from m2t_text.errors import M2TError, SourceError


def shown(path: Path) -> str:
    """The path as it can stand in a one-line message."""
    text = str(path)
    return text if text.isprintable() else repr(text)


def is_file(path: Path) -> bool:
    """Whether there is a regular file."""
    return stat.S_ISREG(_mode(path))


def is_folder(path: Path) -> bool:
    """Whether there is a folder."""
    return stat.S_ISDIR(_mode(path))


def _mode(path: Path) -> int:
    """What there is, 0 for nothing: also where the system will not look, of which pathlib's own tests raise."""
    try:
        return path.stat().st_mode
    except (OSError, ValueError):
        return 0


@contextmanager
def opened(path: Path, failure: type[SourceError]) -> Iterator[BufferedReader]:
    """A regular file with something in it, open for reading.

    Raises a ``failure`` with one line if there is no such file, and if the system refuses to read on.
    """
    try:
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            raise failure(f"{shown(path)} is a directory: name a file in it")
        if not stat.S_ISREG(status.st_mode):
            raise failure(f"{shown(path)} is not a regular file: save it to a file first")
        if status.st_size == 0:
            raise failure(f"{shown(path)} is empty: fetch or record it again")
        with path.open("rb") as file:
            yield file
    except FileNotFoundError as error:
        raise failure(f"{shown(path)} does not exist: check the path") from error
    except PermissionError as error:
        raise failure(f"{shown(path)} may not be read: check its permissions") from error
    except (OSError, ValueError) as error:
        raise failure(f"{shown(path)} cannot be read: {error}") from error


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


def check_folder(path: Path) -> None:
    """Raises M2TError if no file can be written there; told before the work, not after it."""
    if not path.parent.is_dir() or path.is_dir():
        raise M2TError(f"cannot write {str(path)!r}: name a file in a folder that exists")


def make_folder(path: Path) -> None:
    """Makes a folder and those above it. Raises M2TError if it cannot be made."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise M2TError(f"cannot make the folder {str(path)!r}: {error.strerror or error}") from error
