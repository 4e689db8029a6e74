"""What has been compiled on this machine: groups of kernels, each compiled by one process at a time."""

import sys
import zlib
from collections.abc import Callable, Iterable, Sequence
from enum import StrEnum
from functools import cache
from pathlib import Path
from time import sleep

import numba
from llvmlite.binding import get_host_cpu_features, get_host_cpu_name
from whoosh.util.filelock import FileLock

from m2t_text.util.compiling import kernel_folder

RETRY = 0.1  # s between two looks at what another process compiles


class Group(StrEnum):
    """The kernels that serve one purpose."""

    DESCRIBING = "describing"
    BOUNDS = "bounds"  # of the agreement
    AGREEMENT = "agreement"
    INTERSECTION = "intersection"
    VERIFICATION = "verification"
    SIEVING = "sieving"  # from the fourth search of a process on, among many maps
    MAPPING = "mapping"  # of whole drives, from and to saved maps, and of scans between which odometry leaps

    @classmethod
    def of_search(cls, score: str) -> "list[Group]":
        """What a search by this score of `MatchingParameters` needs, and the verification of its hits; what
        takes longest comes first."""
        bounds = [cls.BOUNDS] if score == cls.AGREEMENT else []
        return [*bounds, cls(score), cls.VERIFICATION]


def missing(groups: Iterable[Group]) -> list[Group]:
    """The groups that have not been compiled on this machine."""
    return [group for group in groups if not _ready(group).exists()]


def compile_once(group: Group, steps: Sequence[Callable[[], object]], tell: Callable[[int], None]) -> None:
    """Runs steps that compile a group, or waits until another process that is at it has run them.

    ``tell`` is called with the number of steps done.
    """
    folder = kernel_folder()
    folder.mkdir(parents=True, exist_ok=True)
    told, lock = folder / f"{group}.steps", FileLock(str(folder / f"{group}.lock"))
    tell(0)
    while not lock.acquire():
        tell(_number(told))
        sleep(RETRY)
    try:
        for number, step in enumerate(steps if missing([group]) else (), start=1):
            step()
            told.write_text(str(number))
            tell(number)
        _ready(group).touch()
    finally:
        told.unlink(missing_ok=True)
        lock.release()
    tell(len(steps))


def _number(told: Path) -> int:
    try:
        return int(told.read_text())
    except (OSError, ValueError):  # nothing is written yet, or it is being written
        return 0


def _ready(group: Group) -> Path:
    """The file that says that a group is compiled for this processor, Python and Numba."""
    return kernel_folder() / f"{group}-{_machine():08x}.ready"


@cache
def _machine() -> int:
    processor = get_host_cpu_name() + get_host_cpu_features().flatten()
    return zlib.crc32(f"{processor} {sys.version} {numba.__version__}".encode())
