"""What an index must hold: sequences of changes, and the state after each of them."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from map_oracle import random_documents

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.index.map_index import MapIndex

State = dict[str, int]  # dataset -> the seed of its maps
Contents = dict[str, tuple[object, ...]]

MAPS = 6  # of a dataset, at most


@dataclass(frozen=True)
class Change:
    """One commit.

    Attributes:
        replaced: dataset -> seed of its new maps, or None where it is removed.
        optimize: whether all segments are merged.
        after: the state that it leads to.
    """

    replaced: dict[str, int | None]
    optimize: bool
    after: State

    def apply(self, index: MapIndex) -> None:
        with index.writer() as writer:
            for name, seed in self.replaced.items():
                if seed is None:
                    writer.remove(name)
                else:
                    writer.replace(name, maps(seed, name))
            writer.optimize = self.optimize


def changes(seed: int, state: State, prefix: str = "") -> Iterator[Change]:
    """Changes without end; the datasets' names begin with the prefix."""
    rng = np.random.default_rng(seed)
    while True:
        replaced: dict[str, int | None] = {}
        for number in rng.permutation(6)[: rng.integers(0, 3)].tolist():
            gone = rng.random() < 0.3
            replaced[f"{prefix}{number}"] = None if gone else int(rng.integers(1000))
        state = {name: kept for name, kept in (state | replaced).items() if kept is not None}
        yield Change(replaced, bool(rng.random() < 0.2), dict(state))


@lru_cache(maxsize=10_000)
def maps(seed: int, name: str) -> tuple[Document, ...]:
    """The maps of a dataset: one at least, so that there is a dataset."""
    return tuple(random_documents(seed, name, 1 + seed % MAPS, 20))


def expected(state: State) -> Contents:
    """All that an index in this state gives back."""
    return {one.map_id: whole(one) for name, seed in state.items() for one in maps(seed, name)}


def contents(index: MapIndex) -> Contents:
    """All that an index gives back."""
    return {one.map_id: whole(one) for one in index.documents()}


def whole(one: Document) -> tuple[object, ...]:
    """All that a document holds."""
    numbers = (*one.travel, *one.pose, *one.viewpoint, *one.centre_of_gravity)
    return (one.dataset, one.first_scan, one.last_scan, one.points, str(one.text), *(float(n) for n in numbers))


def built(path: Path, state: State) -> MapIndex:
    """A new index in this state, in several segments."""
    shutil.rmtree(path, ignore_errors=True)
    index = MapIndex.create(path, Parameters())
    for name, seed in sorted(state.items()):
        index.replace(name, maps(seed, name))
    return index


def copied(index: MapIndex, path: Path) -> MapIndex:
    """The same index in another folder, in which there may be one already."""
    shutil.rmtree(path, ignore_errors=True)
    shutil.copytree(index.path, path)
    return MapIndex.open(path)


def litter(path: Path) -> list[str]:
    """The files in an index's folder that its latest state does not need."""
    index = MapIndex.open(path)
    number = index.whoosh.latest_generation()
    segments = {f"MAIN_{segment.segid}.seg" for segment in index.whoosh._segments()}
    needed = {"MAIN_WRITELOCK", f"_MAIN_{number}.toc", f"_MAIN_{number}.copy.toc"} | segments
    present = {file.name for file in path.iterdir()}
    assert needed <= present, f"{needed - present} missing"
    return sorted(present - needed)
