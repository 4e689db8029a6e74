"""What an index answers: hits, and summaries of what it holds."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from m2t_text.config import Parameters
from m2t_text.description.document import Document


@dataclass(frozen=True)
class Hit:
    """A map that a search found.

    Attributes:
        document: without its text, which ``MapIndex.document`` reads, unless the search was asked for texts.
        score: of the profile's matching.
        matched: the smaller of both maps' numbers of matched keypoints.
        alignment: (3,) pose of the query's frame in the map's frame that gave the score, metres and radians.
    """

    document: Document
    score: float
    matched: int
    alignment: NDArray[np.float64]

    @property
    def map_id(self) -> str:
        return self.document.map_id


def best_first(hits: Iterable[Hit], top: int = 0) -> list[Hit]:
    """Hits in the order of their scores, equal ones by map id; the first ``top``, 0 for all."""
    return sorted(hits, key=lambda hit: (-hit.score, hit.map_id))[: top or None]


@dataclass(frozen=True)
class DatasetSummary:
    """Of one dataset: number of maps; scans and metres of travel of its whole log."""

    name: str
    maps: int
    scans: int
    travel: float


@dataclass(frozen=True)
class IndexInfo:
    """Of a whole index; `bytes` is all that its folder holds. One with shards may lie at a URL."""

    path: Path | str
    parameters: Parameters
    maps: int
    keypoints: int
    bytes: int
    datasets: list[DatasetSummary]

    def to_json(self) -> dict[str, Any]:
        """The document of ``info --json``."""
        return {
            "path": str(self.path),
            "profile": self.parameters.profile,
            "parameters": asdict(self.parameters),
            "maps": self.maps,
            "keypoints": self.keypoints,
            "bytes": self.bytes,
            "datasets": [asdict(dataset) for dataset in self.datasets],
        }


@dataclass(frozen=True)
class Overview:
    """All maps of one committed state without their texts, as arrays: by dataset, then by first scan.

    Attributes:
        names: of the datasets, in alphabetical order.
        codes: (M,) each map's dataset, as an index into ``names``.
        records: (M,) of each map what its document holds but for dataset and text, under the same names.
        numbers: (M,) of each map among the documents of all segments.
    """

    names: list[str]
    codes: NDArray[np.int64]
    records: NDArray[Any]
    numbers: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.codes)
