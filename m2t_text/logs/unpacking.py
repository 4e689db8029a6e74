"""Files that are compressed as a whole: read as streams, or unpacked for readers that must seek."""

import bz2
import gzip
import lzma
import shutil
import sys
import tempfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from m2t_text.errors import PartError
from m2t_text.util.files import shown

MAGIC = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ\x00": "xz", b"\x28\xb5\x2f\xfd": "zstd"}
LONGEST = max(map(len, MAGIC))
BLOCK = 1 << 20  # bytes unpacked at once
SPARE = 0.5  # of the free room on the disk that is not filled
UNPACKING_ERRORS: tuple[type[Exception], ...] = (
    EOFError,
    gzip.BadGzipFile,
    lzma.LZMAError,
    zlib.error,
    ValueError,
)


def packing(file: BinaryIO) -> str | None:
    """How a file that is open at its begin is compressed, by its first bytes; it is left where it was."""
    first = file.read(LONGEST)
    file.seek(0)
    return next((name for magic, name in MAGIC.items() if first.startswith(magic)), None)


def unpacked(file: BinaryIO, how: str) -> BinaryIO:
    """The contents of a compressed file, as a stream, whose errors `is_broken` tells from those of a disk."""
    readers: dict[str, Callable[[BinaryIO], object]] = {
        "gzip": lambda raw: gzip.GzipFile(fileobj=raw),
        "bzip2": bz2.BZ2File,
        "xz": lzma.LZMAFile,
        "zstd": _zstd,
    }
    return readers[how](file)  # type: ignore[return-value]


def is_broken(error: Exception) -> bool:
    """Whether an error that reading raised says that compressed data are damaged or cut off."""
    damaged = (
        isinstance(error, OSError) and error.errno is None
    )  # as bz2 says of damage; a disk's have a number
    return isinstance(error, UNPACKING_ERRORS) or damaged or type(error).__name__ == "ZstdError"


@contextmanager
def unpacked_file(path: Path) -> Iterator[Path]:
    """The contents of a compressed file, as a file for as long as it is needed; others are given as they are.

    Raises PartError if it is damaged, or too large for the disk.
    """
    with path.open("rb") as file:
        how = packing(file)
        if how is None:
            yield path
            return
        with tempfile.TemporaryDirectory(prefix="m2t-text-") as folder:
            made = Path(folder) / path.stem
            room = shutil.disk_usage(folder).free * SPARE
            try:
                with made.open("wb") as out:
                    stream = unpacked(file, how)
                    while block := stream.read(BLOCK):
                        room -= len(block)
                        if room < 0:
                            raise PartError(
                                f"it takes more room to unpack than {folder} has: unpack it elsewhere"
                            )
                        out.write(block)
            except Exception as error:
                if not is_broken(error):
                    raise
                raise PartError(f"the {how} data is cut off or corrupt: fetch {shown(path)} again") from error
            yield made


def _zstd(file: BinaryIO) -> object:
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd.ZstdFile(file)
