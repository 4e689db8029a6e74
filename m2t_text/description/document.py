"""A local map as a document: where it comes from, how it is seen, and its text."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.text import Text


def map_id_of(dataset: str, first_scan: int) -> str:
    """``<dataset>/<first scan, six digits>``."""
    return f"{dataset}/{first_scan:06d}"


@dataclass(frozen=True)
class Document:
    """What the index keeps of one local map. One that was not driven, as a point cloud, has only its own frame,
    which stands for that of its first scan.

    Attributes:
        dataset: name of the log or map source.
        first_scan, last_scan: indices of the scans of the run in their log; without a run both are the
            map's number in its dataset.
        travel: (2,) metres of travel at the run's begin and end; equal without a run.
        pose: (3,) of the first scan's robot frame in the frame of the dataset's trajectory.
        viewpoint: (3,) planned viewpoint and direction, in the first scan's robot frame.
        centre_of_gravity: (2,) of the map's occupied cells, in the first scan's robot frame.
        points: number of occupied cells.
        text: the description seen from the viewpoint.
    """

    dataset: str
    first_scan: int
    last_scan: int
    travel: NDArray[np.float64]
    pose: NDArray[np.float64]
    viewpoint: NDArray[np.float64]
    centre_of_gravity: NDArray[np.float64]
    points: int
    text: Text

    @property
    def map_id(self) -> str:
        """``<dataset>/<first scan, six digits>``."""
        return map_id_of(self.dataset, self.first_scan)

    @property
    def driven(self) -> bool:
        """Whether the map is that of a run, with scans."""
        return bool(self.travel[1] > self.travel[0])

    @property
    def middle(self) -> float:
        """Travel at the middle of the run, metres."""
        return float(self.travel.mean())
