"""Which maps show the same place, by the ground truth, which nothing but the judge may read (paper, V-B)."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.document import Document
from m2t_text.evaluation.metrics import Booleans, pose_error
from m2t_text.util.geometry import between, transform
from m2t_text.util.types import Floats

RELEVANT_DISTANCE = 1.0  # m between the places of maps that are relevant to each other
MIN_TRAVEL_APART = 10.0  # m of travel between them at least, so that they belong to different visits
LIMITS = (1.0, 3.0)  # m; a best hit is right if its place is so near
RIGHT_DISTANCE = 3.0  # m; the limit at which verdicts and relative poses are judged
POSE_RIGHT = (1.0, np.radians(10.0))  # m and rad by which a hit's relative pose may err and be right
UNVISITED = 6.0  # m; a map without another visit's map so near shows a place that was never seen before


@dataclass(frozen=True)
class GroundTruth:
    """Where the N maps of one dataset truly lie, in the order of their ids.

    Attributes:
        poses: (N, 3) ground-truth robot pose of each map's first scan.
        places: (N, 2) its centre of gravity in the ground truth's frame.
        travel: (N,) metres of travel at the middle of its run.
    """

    poses: Floats
    places: Floats
    travel: Floats

    @classmethod
    def of(cls, documents: Iterable[Document], poses: Floats) -> "GroundTruth":
        """The truth about maps, from the ground-truth poses (S, 3) of all scans of their log."""
        firsts, places, travel = [], [], []
        for document in documents:
            first = poses[document.first_scan]
            firsts.append(first)
            places.append(transform(first, document.centre_of_gravity[None])[0])
            travel.append(document.middle)
        return cls(np.array(firsts).reshape(-1, 3), np.array(places).reshape(-1, 2), np.array(travel))

    def __len__(self) -> int:
        return len(self.travel)

    def distances(self, query: int) -> Floats:
        """(N,) metres from the query's place to that of each map."""
        return np.hypot(*(self.places - self.places[query]).T)

    def relevance(self, query: int) -> tuple[Booleans, Booleans]:
        """(N,) which maps are relevant to a query, and which irrelevant; those of one visit are neither."""
        apart = self._other_visits(query)
        near = self.distances(query) <= RELEVANT_DISTANCE
        return apart & near, apart & ~near

    def queries(self) -> NDArray[np.int64]:
        """(Q,) the maps that have a relevant map."""
        return np.array([i for i in range(len(self)) if self.relevance(i)[0].any()], dtype=np.int64)

    def unvisited(self) -> NDArray[np.int64]:
        """(U,) the maps of places that no other visit came near to."""
        lonely = [
            i for i in range(len(self)) if not self._other_visits(i)[self.distances(i) <= UNVISITED].any()
        ]
        return np.array(lonely, dtype=np.int64)

    def right(self, query: int, hit: int, pose: Floats) -> bool:
        """Whether the relative ``pose`` (3,) of a query's first scan, as seen from a hit's, is right."""
        away, turn = pose_error(pose, between(self.poses[hit], self.poses[query]))
        return bool(away <= POSE_RIGHT[0] and turn <= POSE_RIGHT[1])

    def _other_visits(self, query: int) -> Booleans:
        return np.asarray(np.abs(self.travel - self.travel[query]) > MIN_TRAVEL_APART)


def draw(queries: NDArray[np.int64], count: int | None, seed: int) -> NDArray[np.int64]:
    """So many of the queries at random, in their order; all of them if None or if there are not more."""
    if count is None or count >= len(queries):
        return queries
    return np.sort(np.random.default_rng(seed).choice(queries, count, replace=False))
