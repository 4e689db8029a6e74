"""Putting datasets into a sharded index: each into one shard, all of them visible at once."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from m2t_text.cluster.manifest import MOST_SHARDS, Manifest, Shard
from m2t_text.cluster.store import Store
from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.errors import ClusterError, MapIndexError
from m2t_text.index.map_index import MapIndex
from m2t_text.index.writing.map_writer import MapWriter, other_parameters


class ShardedWriter:
    """Collects changes to a sharded index for one generation; `sharded_writer` makes one."""

    def __init__(self, store: Store, before: Manifest, blocks: ExitStack) -> None:
        self._store = store
        self._before = before
        self._blocks = blocks
        self._maps = [shard.maps for shard in before.shards]
        self._places = dict(before.places)
        self._writers: dict[int, MapWriter] = {}
        self._folders: dict[int, Path] = {}

    def place(self, name: str) -> int:
        """The shard of a dataset: the one that has it, else the one with the fewest maps."""
        if name not in self._places:
            self._places[name] = place(self._maps)
        return self._places[name]

    def replace(self, name: str, documents: Iterable[Document], drive: tuple[int, float] | None = None) -> None:
        """These documents instead of all that the dataset had; see `MapWriter.replace`."""
        number = self.place(name)

        def counted() -> Iterator[Document]:
            for document in documents:
                self._maps[number] += 1
                yield document

        self._writer(number).replace(name, counted(), drive)

    def remove(self, name: str) -> None:
        """Removes all maps of a dataset. Raises MapIndexError if there is none."""
        if name not in self._places:
            raise MapIndexError(f"no dataset {name!r} in {self._store.path}")
        self._writer(self._places.pop(name)).remove(name)

    def _writer(self, number: int) -> MapWriter:
        if number not in self._writers:
            folder, index = staged(self._store, number, self._before)
            self._folders[number] = folder
            self._writers[number] = self._blocks.enter_context(index.writer())
        return self._writers[number]

    def changed(self) -> dict[int, Shard]:
        """The new states of the shards that were changed, once all their writers have committed."""
        return {number: self._store.taken(folder) for number, folder in self._folders.items()}


def place(maps: Sequence[int]) -> int:
    """The number of the shard that has the fewest maps."""
    return min(range(len(maps)), key=lambda number: (maps[number], number))


@dataclass(frozen=True)
class Target:
    """A sharded index that `index_sources` writes to; with ``shards`` None it has as many as before, or one."""

    store: Store
    shards: int | None = None

    def parameters(self, wanted: Parameters | None) -> Parameters | None:
        """Of what is there, which must be those that are wanted, if any are; None if nothing is there."""
        if self.store.generation < 0:
            return None
        stored = self.store.manifest().parameters
        if wanted is not None and wanted != stored:
            raise other_parameters(self.store.path, stored, wanted)
        return stored

    def writer(self, parameters: Parameters) -> AbstractContextManager[ShardedWriter]:
        """Changes that make one generation."""
        return sharded_writer(self.store, parameters, self.shards)


@contextmanager
def sharded_writer(store: Store, parameters: Parameters, shards: int | None = None) -> Iterator[ShardedWriter]:
    """Changes to a sharded index that make one generation when the block ends, or none if it raises.

    Args:
        store: where it lies; it is made if there is none.
        parameters: of the index.
        shards: how many there are to be, at least as many as before; None for as many as before, or one.

    Raises:
        MapIndexError: if it has other parameters, another process keeps writing, or the disk refuses.
    """
    store.check_new()
    with store.locked():
        before = at_least(store, parameters, shards)
        with ExitStack() as blocks:
            writer = ShardedWriter(store, before, blocks)
            yield writer
        store.publish(following(before, writer.changed()))


def at_least(store: Store, parameters: Parameters, shards: int | None) -> Manifest:
    """The latest generation, or one that is not published yet and has more shards; the lock must be held."""
    if store.generation < 0:
        before = Manifest(-1, parameters, ())
        shards = shards or 1
    else:
        before = store.manifest()
        if before.parameters != parameters:
            raise other_parameters(store.path, before.parameters, parameters)
    have = len(before.shards)
    wanted = have if shards is None else shards
    if not 0 < wanted <= MOST_SHARDS:
        raise ClusterError(f"{wanted} shards cannot be made; choose 1 to {MOST_SHARDS}")
    if wanted < have:
        raise ClusterError(f"{store.path} has {have} shards, and cannot have fewer; choose a new folder")
    added = tuple(_empty(store, number, parameters) for number in range(have, wanted))
    return Manifest(before.generation, before.parameters, before.shards + added)


def _empty(store: Store, number: int, parameters: Parameters) -> Shard:
    folder = store.stage(number, None)
    MapIndex.create(folder, parameters)
    return store.taken(folder)


def staged(store: Store, number: int, before: Manifest) -> tuple[Path, MapIndex]:
    """A copy of a shard, in a folder that no manifest names yet, and the index in it, to be written to."""
    folder = store.stage(number, before.shards[number])
    return folder, MapIndex.open(folder)


def following(before: Manifest, changed: dict[int, Shard]) -> Manifest:
    """The next generation."""
    shards = tuple(changed.get(number, shard) for number, shard in enumerate(before.shards))
    return Manifest(before.generation + 1, before.parameters, shards)
