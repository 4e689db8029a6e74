"""A segment's file: all its columns, mapped into memory."""

import mmap
import os
from io import BufferedReader
from typing import Any

from whoosh.filedb.compound import CompoundStorage
from whoosh.filedb.structfile import BufferFile
from whoosh.system import unpack_int, unpack_long

from m2t_text.errors import DamageError
from m2t_text.index.storage.safe_pickle import load

HEAD = 12  # bytes before the parts of a segment file: where its directory begins, and its length
DIRECTORY = 1 << 20  # bytes of the directory of a segment file at most


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
