"""The files of an index: read with distrust, written to survive a loss of power."""

import errno
import hashlib
import os
import shutil
import stat
from functools import partial
from io import BufferedReader
from pathlib import Path
from typing import Any

from whoosh.filedb.filestore import FileStorage
from whoosh.filedb.structfile import StructFile

from m2t_text.errors import DamageError
from m2t_text.util.files import is_folder

PLAINLY = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)  # waits for no other end
BLAKE = partial(hashlib.blake2b, digest_size=16)


class MapStorage(FileStorage):
    """The folder of an index. It reads plain files alone, and makes only files that are not there yet."""

    def __init__(self, folder: Path, made: list[Any] | None = None) -> None:
        super().__init__(str(folder))
        self.path = folder
        self._made: list[Any] = [] if made is None else made

    def list(self) -> list[str]:
        """The names of all files, sorted; none if there is no such folder."""
        return sorted(file.name for file in self.path.iterdir()) if is_folder(self.path) else []

    def open_plain(self, name: str) -> BufferedReader:
        """A file to read. A link, a pipe or a device is a DamageError: it leads elsewhere, or never ends."""
        path = self.path / name
        if path.is_symlink():
            raise DamageError(f"{name!r} is a link")
        descriptor = os.open(path, PLAINLY)
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            os.close(descriptor)
            raise DamageError(f"{name!r} is not a plain file")
        return os.fdopen(descriptor, "rb")

    def open_file(self, name: str, **options: Any) -> StructFile:
        return StructFile(self.open_plain(name), name=name, **options)

    def create_file(self, name: str, excl: bool = True, mode: str = "wb", **options: Any) -> StructFile:
        """A file to write, which `close_made` closes if nobody else does."""
        file = StructFile((self.path / name).open(mode.replace("w", "x")), name=name, **options)
        self._made.append(file)
        return file

    def temp_storage(self, name: str | None = None) -> "MapStorage":
        """A folder for what is not committed yet."""
        folder = self.path / (name or "MAIN.tmp")
        folder.mkdir(exist_ok=True)
        return MapStorage(folder, self._made)

    def close_made(self) -> None:
        """Closes all files that were made and left open. Whoosh calls `close` for other reasons."""
        for made in self._made:
            try:
                made.raw_file().close()
            except OSError:  # what it still held does not fit on the disk, and is not wanted
                continue
        self._made.clear()

    def put(self, name: str, data: bytes) -> None:
        """Writes a file that has its name only when it is whole and on disk, whatever happens before.

        Raises:
            OSError: if the disk refuses; there is no such file then.
        """
        path, temporary = self.path / name, self.path / f"{name}.new"
        try:
            with temporary.open("xb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(path)
        except OSError:
            temporary.unlink(missing_ok=True)
            raise
        try:
            flush(self.path)
        except OSError:
            path.unlink()
            raise

    def remove(self, name: str) -> None:
        """Removes a file, or a folder with all that is in it; links are not followed."""
        path = self.path / name
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def flush(path: Path) -> None:
    """Waits until a file's contents, or the names in a folder, are on disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:  # a file system that knows no such thing for folders
            raise
    finally:
        os.close(descriptor)


def fingerprint(file: BufferedReader) -> str:
    """The checksum of a file's contents, 32 hexadecimal digits."""
    return hashlib.file_digest(file, BLAKE).hexdigest()
