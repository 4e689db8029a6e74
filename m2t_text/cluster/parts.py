"""Describing many logs in any order and place: what each gives is kept as a part until all go into shards.

A part is an index of one dataset in a folder of its own, which appears as a whole or not at all. Its name tells
file, options and parameters: whoever begins anew takes what is there, and nothing is described twice or lost.
"""

import json
import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from hashlib import blake2b
from pathlib import Path
from secrets import token_hex
from time import perf_counter

from m2t_text.cluster.manifest import Manifest, Shard
from m2t_text.cluster.store import PARTS, Store
from m2t_text.cluster.writing import staged
from m2t_text.config import Parameters
from m2t_text.errors import ClusterError, SourceError
from m2t_text.index.map_index import MapIndex
from m2t_text.sources.indexing import Indexed
from m2t_text.sources.opening import SourceOptions, open_source

INDEX, REPORT = "index", "report.json"


@dataclass(frozen=True)
class Job:
    """A source to describe.

    Attributes:
        path: of the file, which all hosts can read.
        name: of the dataset.
    """

    path: Path
    name: str
    options: SourceOptions
    parameters: Parameters

    def key(self) -> str:
        """Another one for each state of the file, and each way to describe it. Raises SourceError."""
        try:
            status = self.path.stat()
        except OSError as error:
            raise SourceError(f"{self.path} cannot be read: {error.strerror or error}") from error
        told = (str(self.path.absolute()), self.name, status.st_size, status.st_mtime_ns)
        return blake2b(repr((told, self.options, self.parameters)).encode(), digest_size=16).hexdigest()


@dataclass(frozen=True)
class Part:
    """What a source gave, or why it gave nothing.

    Attributes:
        key: its folder; empty if the source cannot be read.
        maps: how many there are.
        seconds: that it took.
        failure: one line; empty if there is none.
    """

    key: str
    name: str
    maps: int
    scans: int
    travel: float
    seconds: float
    warnings: tuple[str, ...] = ()
    failure: str = ""

    @property
    def indexed(self) -> Indexed:
        """As the command line reports it."""
        return Indexed(self.name, self.scans, self.seconds, self.warnings)


def describe_part(root: str, job: Job) -> Part:
    """Reads and describes a source, and keeps what it gives, unless that was done before.

    Raises:
        ClusterError: if it cannot be kept.
    """
    begin = perf_counter()
    try:
        key = job.key()
        folder = Path(root) / PARTS / key
        kept = _kept(folder)
        if kept is not None:
            return kept
        source = open_source(job.path, replace(job.options, name=job.name))
        given = source.describe(job.parameters, 1, lambda stage, done, total: None)
        making = folder.with_name(f"{key}.{token_hex(4)}")
        making.mkdir(parents=True)
        index = MapIndex.create(making / INDEX, job.parameters)
        index.replace(job.name, given.documents, given.drive)
        scans, travel = given.drive
        seconds = perf_counter() - begin
        part = Part(key, job.name, len(index), scans, travel, seconds, source.warnings)
        (making / REPORT).write_text(json.dumps(asdict(part)))
    except SourceError as error:
        return Part("", job.name, 0, 0, 0.0, perf_counter() - begin, failure=str(error))
    except OSError as error:
        raise ClusterError(f"the maps of {job.path} cannot be kept in {root}: {error}") from error
    try:
        making.rename(folder)
    except OSError as error:  # another attempt at the same was quicker
        shutil.rmtree(making, ignore_errors=True)
        kept = _kept(folder)
        if kept is None:
            raise ClusterError(f"the maps of {job.path} cannot be kept in {folder}: {error}") from error
        return kept
    return part


def _kept(folder: Path) -> Part | None:
    try:
        fields = json.loads((folder / REPORT).read_text())
        return Part(**(fields | {"warnings": tuple(fields["warnings"])}))
    except (OSError, ValueError, TypeError, KeyError):
        return None


def build_shard(root: str, number: int, before: Manifest, parts: Sequence[Part]) -> Shard:
    """A new state of a shard, with the datasets of parts instead of what it had of those names."""
    store = Store(root)
    parts_folder = Path(root) / PARTS
    folder, index = staged(store, number, before)
    with index.writer() as writer:
        for part in parts:
            held = MapIndex.open(parts_folder / part.key / INDEX)
            writer.replace(part.name, held.documents(part.name), (part.scans, part.travel))
    return store.taken(folder)


def remove_parts(store: Store, parts: Sequence[Part]) -> None:
    """Removes parts that are in shards now, and what killed attempts left; the lock must be held."""
    done, held = {part.key for part in parts}, Path(store.path) / PARTS
    for folder in held.iterdir():
        if folder.name in done or "." in folder.name:
            shutil.rmtree(folder, ignore_errors=True)
    with suppress(OSError):  # others are left, of sources that another command is to index
        held.rmdir()
