"""The files of an index: read with distrust, written to survive a loss of power."""

import errno
import hashlib
import mmap
import os
import shutil
import stat
from functools import partial
from io import BufferedReader
from pathlib import Path
from typing import Any

from whoosh.filedb.compound import CompoundStorage
from whoosh.filedb.filestore import FileStorage
from whoosh.filedb.structfile import BufferFile, StructFile
from whoosh.system import unpack_int, unpack_long

from m2t_text.errors import DamageError
from m2t_text.files import is_folder
from m2t_text.index.unpickling import load

HEAD = 12  # bytes before the parts of a segment file: where its directory begins, and its length
DIRECTORY = 1 << 20  # bytes of the directory of a segment file at most
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


class SegmentFile(CompoundStorage):
    """A segment's columns in one file that is mapped into memory, as Whoosh writes it."""

    def __init__(self, file: BufferedReader, name: str) -> None:
        """Raises DamageError unless all parts lie inside the file."""
        self.is_closed = False
        self._file = None
        self._locks: dict[str, Any] = {}
        size = os.fstat(file.fileno()).st_size
        if size <= HEAD:
            raise DamageError(f"{name} is too short")
        self._source = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        begin, length = unpack_long(self._source[:8])[0], unpack_int(self._source[8:HEAD])[0]
        if not (HEAD <= begin < size and 0 < length <= DIRECTORY and begin + length == size):
            raise DamageError(f"the directory of {name} lies outside it")
        self._dir, _ = load(self._source[begin:])
        if not isinstance(self._dir, dict) or not all(_inside(part, begin) for part in self._dir.values()):
            raise DamageError(f"a part of {name} lies outside it")

    def open_file(self, name: str, *arguments: Any, **options: Any) -> BufferFile:
        offset, length = self.range(name)
        return MappedFile(memoryview(self._source)[offset : offset + length], name)


class MappedFile(BufferFile):
    """A part of a mapped file; what is read of it is copied, the rest, unlike in Whoosh's own class, is not."""

    def __init__(self, buffer: memoryview, name: str) -> None:
        self.buffer = self._buf = buffer
        self._name = name
        self.file = self.onclose = None
        self.is_real = self.is_closed = False


def _inside(part: Any, end: int) -> bool:
    """Whether a directory's entry tells of bytes before ``end``."""
    if not isinstance(part, dict):
        return False
    offset, length = part.get("offset"), part.get("length")
    return type(offset) is int and type(length) is int and HEAD <= offset <= offset + length <= end
