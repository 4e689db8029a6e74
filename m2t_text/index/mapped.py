"""Segments of an index as a memory map: what is read is not copied, and processes share its pages.

Whoosh maps a segment's file, but copies each part of it that it opens. The codec and segment here are Whoosh's
own in all but that.
"""

import io
from typing import Any

from whoosh.codec.whoosh3 import W3Codec, W3Segment
from whoosh.filedb.compound import CompoundStorage
from whoosh.filedb.structfile import BufferFile


class MapCodec(W3Codec):
    """Whoosh's format, read through `MappedStorage`."""

    def new_segment(self, storage: Any, indexname: str) -> "MapSegment":
        return MapSegment(self, indexname)


class MapSegment(W3Segment):
    """A segment whose file is mapped."""

    def open_compound_file(self, storage: Any) -> "MappedStorage":
        file = storage.open_file(self.make_filename(self.COMPOUND_EXT))
        return MappedStorage(file, use_mmap=storage.supports_mmap)


class MappedStorage(CompoundStorage):
    """The parts of a segment's file, as windows on its memory map."""

    def open_file(self, name: str, *args: Any, **kwargs: Any) -> Any:
        if self.is_closed or not self._source:
            return super().open_file(name, *args, **kwargs)
        offset, length = self.range(name)
        return MappedFile(memoryview(self._source)[offset : offset + length], name)


class MappedFile(BufferFile):
    """A part of a memory map. ``view`` gives bytes without copying them; the rest is as Whoosh has it."""

    def __init__(self, view: memoryview, name: str | None = None) -> None:
        self._buf = view
        self._name = name
        self.file = Window(view)
        self.onclose = None
        self.is_real = False
        self.is_closed = False

    def subset(self, position: int, length: int, name: str | None = None) -> "MappedFile":
        return MappedFile(self._buf[position : position + length], name or self._name)

    def view(self, position: int, length: int) -> memoryview:
        """The bytes from a position on; they stay valid as long as the view is held."""
        return self._buf[position : position + length]


class Window(io.RawIOBase):
    """A memoryview that is read like a file."""

    def __init__(self, view: memoryview) -> None:
        super().__init__()
        self._view = view
        self._place = 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        part = self._view[self._place : self._place + len(buffer)]
        buffer[: len(part)] = part
        self._place += len(part)
        return len(part)

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        begin = {io.SEEK_SET: 0, io.SEEK_CUR: self._place, io.SEEK_END: len(self._view)}[whence]
        self._place = max(0, begin + offset)
        return self._place

    def tell(self) -> int:
        return self._place


def view(file: Any, position: int, length: int) -> Any:
    """Bytes of a column's file: not copied where it is mapped."""
    return file.view(position, length) if isinstance(file, MappedFile) else file.get(position, length)
