"""Writing alone in a folder, and leaving nothing there but the latest state."""

import logging
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import monotonic, sleep

from whoosh.util.filelock import FileLock

from m2t_text.errors import DamageError, MapIndexError
from m2t_text.index.storage.directory import MapStorage
from m2t_text.index.writing.toc import INDEX, SEGMENT, files_of, latest

LOCK = f"{INDEX}_WRITELOCK"
OURS = re.compile(  # what is or was a file of an index
    rf"{LOCK}|{INDEX}\.tmp|{INDEX}_{SEGMENT.pattern}\..+|_{INDEX}_[0-9]+\.(copy\.)?toc(\..+)?"
)
RETRY = 0.05  # s between two attempts to lock

log = logging.getLogger(__name__)


@contextmanager
def locked(folder: Path, seconds: float) -> Iterator[None]:
    """Lets no other writer in during the block, of this process or another. A lock ends with its process.

    Raises:
        MapIndexError: if another one keeps writing for so many seconds.
        OSError: if the folder cannot be written.
    """
    path = folder / LOCK
    if path.is_symlink():
        raise DamageError(f"{LOCK!r} in {folder} is a link; remove it")
    lock = FileLock(str(path))
    end = monotonic() + seconds
    told = False
    while not lock.acquire():
        if monotonic() >= end:
            raise MapIndexError(f"{folder} is being written by another process; try again later")
        if not told:
            log.warning("waiting up to %g s for another process that writes to %s", seconds, folder)
            told = True
        sleep(RETRY)
    try:
        yield
    finally:
        lock.release()


def clean(storage: MapStorage) -> None:
    """Closes and removes all that is not of the latest state. What cannot be removed stays for later."""
    storage.close_made()
    with suppress(OSError, DamageError):
        sweep(storage, files_of(latest(storage)))


def sweep(storage: MapStorage, kept: Iterable[str] = ()) -> None:
    """Removes all files of an index but those; the lock must be held. What cannot be removed, stays."""
    for name in leftovers(storage, kept):
        with suppress(OSError):
            storage.remove(name)


def leftovers(storage: MapStorage, kept: Iterable[str]) -> list[str]:
    """The files that are an index's, but neither its lock nor among those."""
    wanted = {LOCK, *kept}
    return [name for name in storage.list() if OURS.fullmatch(name) and name not in wanted]
