"""A sharded index in an object store, or wherever else fsspec reads and writes: ``s3://…``, ``gs://…``, ``sftp://…``.

Files are copied to this host when a shard is opened, and kept: they never change.
"""

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import blake2b
from pathlib import Path
from secrets import token_hex
from time import time
from typing import Any

import platformdirs

from m2t_text.cluster.manifest import Manifest, Shard
from m2t_text.cluster.store import MANIFEST_LIMIT, Store, described
from m2t_text.errors import ClusterError, DamageError
from m2t_text.index.map_index import MapIndex
from m2t_text.util.files import make_folder

CACHE = "M2T_SHARD_CACHE"  # the variable that names another folder for copies
URL = re.compile(r"([a-z][a-z0-9+.-]+):/+(.*)", re.DOTALL)  # as a path, a URL has lost one of its slashes


class RemoteStore(Store):
    """A sharded index at a URL.

    One host at a time may write: an object store has no locks. Two that do at once may be told so, or not.
    """

    def __init__(self, url: str) -> None:
        try:
            import fsspec

            self._files, self._root = fsspec.core.url_to_fs(url)
        except ImportError as error:
            raise ClusterError(
                f"{url} takes further packages ({error}): 'm2t-text[cluster]' and those"
            ) from error
        except ValueError as error:
            raise ClusterError(f"{url} cannot be opened: {error}") from error
        self._url = url
        own = blake2b(url.encode(), digest_size=8).hexdigest()
        named = os.environ.get(CACHE)
        base = Path(named) if named else Path(platformdirs.user_cache_dir("m2t-text")) / "shards"
        super().__init__(base / own)  # where copies lie, and the lock of this host
        self._expected: int | None = None

    @property
    def path(self) -> Path | str:
        return self._url

    def check_new(self) -> None:
        """Raises nothing: other files in the same place do not matter."""

    @contextmanager
    def locked(self) -> Iterator[None]:
        with super().locked():
            self._expected = self.generation
            yield

    def publish(self, manifest: Manifest) -> None:
        if self.generation != self._expected:
            raise ClusterError(f"{self._url} was written to by another host meanwhile; try again")
        super().publish(manifest)
        self._expected = manifest.generation

    def opened(self, shard: Shard) -> MapIndex:
        try:
            return super().opened(shard)
        except DamageError:  # of the copy, maybe
            shutil.rmtree(self._folder / shard.folder, ignore_errors=True)
            return super().opened(shard)

    def fetched(self, shard: Shard) -> Path:
        folder = self._folder / shard.folder
        if not folder.is_dir():
            making = self._folder / f"{shard.folder}.{token_hex(4)}"
            make_folder(making)
            try:
                for name in shard.files:
                    self._files.get_file(f"{self._root}/{shard.folder}/{name}", str(making / name))
                making.rename(folder)
            except OSError as error:
                shutil.rmtree(making, ignore_errors=True)
                if not folder.is_dir():  # else another process was quicker
                    raise ClusterError(f"{shard.folder} of {self._url} cannot be copied: {error}") from error
        return folder

    def taken(self, folder: Path) -> Shard:
        shard = described(folder)
        try:
            for name in shard.files:
                self._files.makedirs(f"{self._root}/{folder.name}", exist_ok=True)
                self._files.put_file(str(folder / name), f"{self._root}/{folder.name}/{name}")
        except OSError as error:
            raise ClusterError(f"cannot write to {self._url}: {error}") from error
        return shard

    def _names(self) -> list[str]:
        try:
            found: list[Any] = self._files.ls(self._root, detail=False, refresh=True)
        except FileNotFoundError:
            return []
        except OSError as error:
            raise ClusterError(f"{self._url} cannot be read: {error}") from error
        return sorted(str(name).rstrip("/").rpartition("/")[2] for name in found)

    def _read(self, name: str) -> bytes:
        data: bytes = self._files.cat_file(f"{self._root}/{name}", end=MANIFEST_LIMIT + 1)
        return data

    def _put(self, name: str, data: bytes) -> None:
        self._files.makedirs(self._root, exist_ok=True)
        self._files.pipe_file(f"{self._root}/{name}", data)

    def _age(self, name: str) -> float:
        modified = self._files.modified(f"{self._root}/{name}")
        return time() - float(modified.timestamp())

    def _remove(self, name: str) -> None:
        shutil.rmtree(self._folder / name, ignore_errors=True)
        try:
            self._files.rm(f"{self._root}/{name}", recursive=True)
        except OSError:  # it stays for later
            return


def open_store(where: str | Path) -> Store:
    """The store in a folder, or at a URL, which may have been taken for a path."""
    match = URL.fullmatch(str(where))
    if match is None or len(match[1]) < 2:
        return Store(where)
    return RemoteStore(f"{match[1]}://{'/' if match[1] == 'file' else ''}{match[2]}")


def holds_shards(where: str | Path) -> bool:
    """Whether there is a sharded index in a folder, or at a URL."""
    return open_store(where).generation >= 0
