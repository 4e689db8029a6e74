"""How far two maps agree about what both have seen, once one is laid on the other."""

from dataclasses import dataclass
from math import log

import numpy as np

from m2t_text.recognition.overlay import overlaid
from m2t_text.recognition.raster import Raster
from m2t_text.util.geometry import inverse
from m2t_text.util.types import Floats

# Evidence for a pose, on a logarithmic scale: a handful of figures, the same for all maps (`make calibrate`).
SEEN, INLIERS, CONFLICTS = 7.78, 33.94, -59.69  # for the logarithm of what both saw, and for two shares of it
DISTANCE = -8.47  # for the mean distance of the inliers, metres: the most exact of what else fits alike


@dataclass(frozen=True)
class Fit:
    """Counts of the keypoints of two maps, each judged by what the other one shows.

    Attributes:
        keypoints: all of them.
        seen: those that lie where the other map's laser looked. What it never saw says nothing.
        inliers: those that have a keypoint of the other map within INLIER.
        conflicts: those that lie where the other map was seen to be free.
        free_known: whether both texts tell what is free.
        grip: 0...0.5, the share of the inliers' walls that hold the pose in its loosest direction: 0 between
            two parallel walls, along which the query may slide.
        distance: metres, the mean distance of the inliers from the keypoints that they lie near.
        patch: keypoints in the largest patch of misfits of either map, as of a wall that the other one lacks.
    """

    keypoints: int
    seen: int
    inliers: int
    conflicts: int
    free_known: bool
    grip: float
    distance: float = 0.0
    patch: int = 0

    @classmethod
    def of(cls, query: Raster, pose: Floats, found: Raster) -> "Fit":
        """Of a query whose frame has the ``pose`` (3,) in the found map's frame."""
        return cls.of_each(query, np.reshape(pose, (1, 3)), found)[0]

    @classmethod
    def of_each(cls, query: Raster, poses: Floats, found: Raster) -> "list[Fit]":
        """Of a query whose frame has each of the ``poses`` (S, 3) in the found map's frame."""
        here, there = overlaid(query, poses, found), overlaid(found, inverse(poses), query)
        inliers = here.inliers + there.inliers
        figures = (
            here.seen + there.seen,
            inliers,
            here.conflicts + there.conflicts,
            here.grip,
            (here.apart + there.apart) / np.maximum(inliers, 1),
            np.maximum(here.patch, there.patch),
        )
        keypoints = len(query.points) + len(found.points)
        free_known = query.complete and found.complete
        return [
            cls(keypoints, seen, inliers, conflicts, free_known, *others)
            for seen, inliers, conflicts, *others in zip(*(some.tolist() for some in figures), strict=True)
        ]

    @property
    def inlier_ratio(self) -> float:
        """Share of all keypoints that are inliers."""
        return self.inliers / max(self.keypoints, 1)

    @property
    def conflict_ratio(self) -> float | None:
        """Share of all keypoints that are in conflict; None where a text does not tell what is free."""
        return self.conflicts / max(self.keypoints, 1) if self.free_known else None

    @property
    def seen_inliers(self) -> float:
        """Share of the seen keypoints that are inliers."""
        return self.inliers / max(self.seen, 1)

    @property
    def seen_conflicts(self) -> float:
        """Share of the seen keypoints that are in conflict."""
        return self.conflicts / max(self.seen, 1)

    @property
    def exact(self) -> bool:
        """Whether each keypoint of either map lies on one of the other."""
        return self.inliers == self.keypoints and self.distance == 0.0

    @property
    def evidence(self) -> float:
        """How much speaks for this pose: differences of it compare poses of one query."""
        shares = INLIERS * self.seen_inliers + CONFLICTS * self.seen_conflicts
        return SEEN * log(1 + self.seen) + shares + DISTANCE * self.distance
