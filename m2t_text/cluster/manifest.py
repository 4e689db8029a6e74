"""What a sharded index consists of: sealed JSON, against which every answer is checked for completeness.

A generation of the manifest names one folder for each shard. Such a folder is an ordinary index that is never
changed: what is added to a shard goes into a copy, and the next generation names that.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from m2t_text.config import Parameters, check_parameters, from_dict
from m2t_text.description.text import WORDS
from m2t_text.errors import ClusterError, DamageError, MapIndexError, SourceError
from m2t_text.index.results import DatasetSummary
from m2t_text.index.search.collection import Statistics
from m2t_text.index.writing.toc import MALFORMED, sealed, unsealed
from m2t_text.util.names import checked_name

FORMAT = 1
NAME = re.compile(r"manifest-([0-9]{8})\.json")
SHARD = re.compile(r"shard-[0-9]{4}-[0-9a-z]{1,32}")
FILE = re.compile(r"[0-9A-Za-z_.]{1,100}")
MOST_SHARDS = 10_000


@dataclass(frozen=True)
class Shard:
    """One state of a part of the maps, an index in a folder of its own.

    Attributes:
        folder: its name, which no other state has.
        maps, keypoints: how many it holds.
        digest: of its table of contents, which holds those of its other files.
        files: the bytes of each of its files.
        frequency: (1024,) how many of its maps have each word.
        datasets: by name, in alphabetical order; each lies in one shard as a whole.
    """

    folder: str
    maps: int
    keypoints: int
    digest: str
    files: Mapping[str, int]
    frequency: tuple[int, ...]
    datasets: Mapping[str, DatasetSummary]

    @property
    def bytes(self) -> int:
        """Of all its files."""
        return sum(self.files.values())


@dataclass(frozen=True)
class Manifest:
    """All shards of one generation. The place of a shard is its number."""

    generation: int
    parameters: Parameters
    shards: tuple[Shard, ...] = field(repr=False)

    @cached_property
    def maps(self) -> int:
        """Of all shards."""
        return sum(shard.maps for shard in self.shards)

    @cached_property
    def statistics(self) -> Statistics:
        """What words are weighted by, summed over all shards."""
        frequency = np.zeros(WORDS, dtype=np.int64)
        for shard in self.shards:
            frequency += np.array(shard.frequency, dtype=np.int64)
        return Statistics(self.maps, frequency)

    @cached_property
    def places(self) -> dict[str, int]:
        """The number of the shard that holds each dataset."""
        return {name: number for number, shard in enumerate(self.shards) for name in shard.datasets}

    @cached_property
    def datasets(self) -> list[DatasetSummary]:
        """Of all shards, ordered by name."""
        held = [dataset for shard in self.shards for dataset in shard.datasets.values()]
        return sorted(held, key=lambda dataset: dataset.name)

    @property
    def name(self) -> str:
        """Of its file."""
        return f"manifest-{self.generation:08d}.json"

    def to_bytes(self) -> bytes:
        """The contents of its file."""
        entries = {
            "format": FORMAT,
            "generation": self.generation,
            "parameters": asdict(self.parameters),
            "shards": [_entry(shard) for shard in self.shards],
        }
        return sealed(b"", json.dumps(entries, sort_keys=True).encode())

    @classmethod
    def from_bytes(cls, data: bytes, where: str) -> "Manifest":
        """The manifest in a file; ``where`` it lies is for messages.

        Raises:
            DamageError: if it is not as it was written.
            ClusterError: if it is of another version.
        """
        try:
            entries = json.loads(unsealed(data, where))
            if entries["format"] != FORMAT:
                raise ClusterError(
                    f"the sharded index in {where} has format {entries['format']}, this program reads {FORMAT}"
                )
            shards = tuple(_shard(entry) for entry in entries["shards"])
            parameters = check_parameters(from_dict(entries["parameters"]))
            manifest = cls(_count(entries["generation"]), parameters, shards)
        except ClusterError:
            raise
        except (SourceError, *MALFORMED) as error:
            raise DamageError(f"the manifest in {where} is malformed") from error
        except MapIndexError as error:
            raise DamageError(f"the manifest in {where} cannot be read: {error}") from error
        if len({shard.folder for shard in shards}) < len(shards) or not 0 < len(shards) <= MOST_SHARDS:
            raise DamageError(f"the manifest in {where} names no shards, or one twice")
        if len(manifest.places) < len(manifest.datasets):
            raise DamageError(f"the manifest in {where} has a dataset in two shards")
        return manifest


def generation_of(name: str) -> int | None:
    """The generation of a manifest's file, None for any other file."""
    match = NAME.fullmatch(name)
    return int(match[1]) if match else None


def _entry(shard: Shard) -> dict[str, Any]:
    datasets = {name: [one.maps, one.scans, one.travel] for name, one in shard.datasets.items()}
    return {
        "folder": shard.folder,
        "maps": shard.maps,
        "keypoints": shard.keypoints,
        "digest": shard.digest,
        "files": dict(shard.files),
        "frequency": shard.frequency,
        "datasets": datasets,
    }


def _shard(entry: dict[str, Any]) -> Shard:
    datasets = {
        checked_name(name): DatasetSummary(name, _count(maps), _count(scans), float(travel))
        for name, (maps, scans, travel) in entry["datasets"].items()
    }
    files = {name: _count(size) for name, size in entry["files"].items()}
    frequency = tuple(_count(number) for number in entry["frequency"])
    maps = _count(entry["maps"])
    sound = (
        SHARD.fullmatch(entry["folder"])
        and all(FILE.fullmatch(name) for name in files)
        and len(frequency) == WORDS
        and maps == sum(one.maps for one in datasets.values())
        and re.fullmatch(r"[0-9a-f]{32}", entry["digest"])
    )
    if not sound:
        raise DamageError("a shard in it cannot be right")
    return Shard(entry["folder"], maps, _count(entry["keypoints"]), entry["digest"], files, frequency, datasets)


def _count(value: Any) -> int:
    if type(value) is not int or not 0 <= value < 2**62:
        raise DamageError("a number in it cannot be right")
    return value
