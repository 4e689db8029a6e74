"""Where a sharded index lies: its manifests, and beside them a folder for each state of a shard."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from secrets import token_hex
from time import time

from m2t_text.cluster.manifest import SHARD, Manifest, Shard, generation_of
from m2t_text.errors import ClusterError, DamageError, MapIndexError
from m2t_text.index.map_index import LOCK_SECONDS, MapIndex
from m2t_text.index.storage.directory import MapStorage, fingerprint, flush
from m2t_text.index.writing.folder import check_new
from m2t_text.index.writing.lock import locked
from m2t_text.index.writing.toc import LIMIT, contents_name, files_of, generation, latest
from m2t_text.util.files import make_folder

KEPT = 600.0  # s for which a generation that was replaced is kept: searches that began with it go on
PARTS = "parts"  # what is described and not in a shard yet
MANIFEST_LIMIT = 64 * LIMIT  # bytes


class Store:
    """A sharded index in a folder, which all machines that serve it can read.

    Args:
        folder: it need not exist before `publish`.
    """

    def __init__(self, folder: str | Path) -> None:
        self._folder = Path(folder)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({str(self.path)!r})"

    @property
    def path(self) -> Path | str:
        """Where it lies, for messages, and for `open_store`."""
        return self._folder

    @property
    def generation(self) -> int:
        """The latest; -1 if there is no sharded index."""
        return max(self._generations(), default=-1)

    def _generations(self) -> list[int]:
        numbers = (generation_of(name) for name in self._names())
        return sorted(number for number in numbers if number is not None)

    def manifest(self, number: int | None = None) -> Manifest:
        """That of a generation, or of the latest.

        Raises:
            ClusterError: if there is none.
            DamageError: if it is not as it was written.
        """
        wanted = self.generation if number is None else number
        if wanted < 0:
            raise ClusterError(f"no sharded index in {self.path}; make one with `m2t-text index --shards N`")
        name = f"manifest-{wanted:08d}.json"
        try:
            data = self._read(name)
        except FileNotFoundError as error:
            if number is None and self.generation > wanted:
                return self.manifest()  # it was replaced meanwhile
            raise ClusterError(
                f"generation {wanted} of {self.path} is gone: it was written to meanwhile; ask again"
            ) from error
        except OSError as error:
            raise ClusterError(f"{name} in {self.path} cannot be read: {error.strerror or error}") from error
        return _parsed(data, str(self.path))

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lets nobody else write during the block."""
        make_folder(self._folder)
        try:
            with locked(self._folder, LOCK_SECONDS):
                yield
        except OSError as error:
            raise ClusterError(f"cannot write to {self.path}: {error.strerror or error}") from error

    def check_new(self) -> None:
        """Raises MapIndexError unless a sharded index can be made in the folder."""
        if generation(MapStorage(self._folder)) >= 0:
            raise MapIndexError(f"{self.path} holds an index without shards; choose another folder")
        if self.generation < 0 and self._folder.is_dir():
            own = (file for file in self._folder.iterdir() if SHARD.fullmatch(file.name) or file.name == PARTS)
            if not any(own):  # else it was left half made
                check_new(self._folder)

    def publish(self, manifest: Manifest) -> None:
        """Makes a generation the latest, in one step, and removes what is not needed any more.

        The lock must be held.

        Raises:
            ClusterError: if the disk refuses; nothing has changed then.
        """
        try:
            self._put(manifest.name, manifest.to_bytes())
        except OSError as error:
            raise ClusterError(f"cannot write to {self.path}: {error.strerror or error}") from error
        self.sweep()

    def sweep(self) -> None:
        """Removes all but the latest generation and those that were replaced lately; the lock must be held."""
        names = {number: f"manifest-{number:08d}.json" for number in self._generations()}
        kept = list(names)[-1:]
        for number, follower in pairwise(names):
            if self._age(names[follower]) <= KEPT:
                kept.append(number)
            else:
                self._remove(names[number])
        folders = {shard.folder for number in kept for shard in self.manifest(number).shards}
        for name in self._names():
            if SHARD.fullmatch(name) and name not in folders:
                self._remove(name)

    def stage(self, number: int, shard: Shard | None) -> Path:
        """A new folder with the files of a state of a shard, to be changed; empty without a state.

        Files of an index never change, so they are linked where the file system can.
        """
        folder = self._staging() / f"shard-{number:04d}-{token_hex(8)}"
        folder.mkdir(parents=True)
        for source in () if shard is None else map(self.fetched(shard).joinpath, shard.files):
            try:
                os.link(source, folder / source.name)
            except OSError:
                shutil.copyfile(source, folder / source.name)
        return folder

    def taken(self, folder: Path) -> Shard:
        """The state of a shard that was written to a staged folder; it can be read from now on."""
        return described(folder)

    def opened(self, shard: Shard) -> MapIndex:
        """The index of one state of a shard, pinned.

        Raises:
            DamageError: if it is not what the manifest says.
            MapIndexError: if it cannot be read.
        """
        folder = self.fetched(shard)
        check(folder, shard)
        index = MapIndex.open(folder).pinned()
        if len(index) != shard.maps:
            raise DamageError(f"{folder} holds {len(index):,} maps, not {shard.maps:,} as its manifest says")
        return index

    def fetched(self, shard: Shard) -> Path:
        """The folder of a state of a shard, on this machine."""
        return self._folder / shard.folder

    # What differs where files lie elsewhere:

    def _staging(self) -> Path:
        return self._folder

    def _names(self) -> list[str]:
        return MapStorage(self._folder).list()

    def _read(self, name: str) -> bytes:
        with MapStorage(self._folder).open_plain(name) as file:
            return file.read(MANIFEST_LIMIT + 1)

    def _put(self, name: str, data: bytes) -> None:
        MapStorage(self._folder).put(name, data)

    def _age(self, name: str) -> float:
        """Seconds since a file was written."""
        return time() - (self._folder / name).stat().st_mtime

    def _remove(self, name: str) -> None:
        """Removes a file or folder; what cannot be removed, stays."""
        with suppress(OSError):
            MapStorage(self._folder).remove(name)


def check(folder: Path, shard: Shard) -> None:
    """Raises DamageError unless the files in a folder are those of a state of a shard."""
    try:
        sizes = {name: (folder / name).stat().st_size for name in shard.files}
        digest = _digest(folder)
    except OSError as error:
        raise DamageError(f"{folder} lacks a file of its shard: {error.strerror or error}") from error
    if sizes != dict(shard.files) or digest != shard.digest:
        raise DamageError(f"{folder} is not the shard that its manifest names")


def described(folder: Path) -> Shard:
    """What a manifest says of an index, once it has been written as a whole."""
    storage = MapStorage(folder)
    files = {name: (folder / name).stat().st_size for name in files_of(latest(storage))}
    flush(folder)
    index = MapIndex.open(folder).pinned()
    return Shard(
        folder.name,
        len(index),
        index.keypoints(),
        _digest(folder),
        files,
        tuple(index.statistics().frequency.tolist()),
        {dataset.name: dataset for dataset in index.datasets()},
    )


def _digest(folder: Path) -> str:
    """The checksum of a table of contents."""
    storage = MapStorage(folder)
    with storage.open_plain(contents_name(generation(storage))) as file:
        return fingerprint(file)


@lru_cache(maxsize=4)
def _parsed(data: bytes, where: str) -> Manifest:
    """A manifest, which is read again for every search and hardly ever another one."""
    return Manifest.from_bytes(data, where)
