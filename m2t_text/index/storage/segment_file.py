"""A segment's file: all its columns, one behind the other, mapped into memory."""

import mmap
import os
from collections.abc import Mapping
from io import BufferedReader
from typing import Any

from whoosh.filedb.compound import CompoundStorage
from whoosh.filedb.structfile import BufferFile

from m2t_text.errors import DamageError

Part = tuple[int, int]  # where a column begins in the file of its segment, and its length, in bytes


class SegmentFile(CompoundStorage):
    """The columns of a segment in one file that is mapped into memory."""

    def __init__(self, file: BufferedReader, name: str, parts: Mapping[str, Part]) -> None:
        """Raises DamageError unless all parts lie inside the file."""
        self.is_closed = False
        self._file = None
        self._locks: dict[str, Any] = {}
        size = os.fstat(file.fileno()).st_size
        if not size or any(begin + length > size for begin, length in parts.values()):
            raise DamageError(f"{name} is too short")
        self._source = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self._dir = {part: {"offset": begin, "length": length} for part, (begin, length) in parts.items()}

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
