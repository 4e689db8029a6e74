"""What an index answers: hits, and summaries of what it holds."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from m2t_text.config import Parameters
from m2t_text.description.document import Document


@dataclass(frozen=True)
class Hit:
    """A map that a search found.

    Attributes:
        document: without its text, which ``MapIndex.document`` reads.
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


@dataclass(frozen=True)
class DatasetSummary:
    """Of one dataset: number of maps; scans and metres of travel of its whole log."""

    name: str
    maps: int
    scans: int
    travel: float


@dataclass(frozen=True)
class IndexInfo:
    """Of a whole index; `bytes` is all that its folder holds."""

    path: Path
    parameters: Parameters
    maps: int
    keypoints: int
    bytes: int
    datasets: list[DatasetSummary]
