"""Two maps side by side: where one lies on the other, and what each of their keypoints has to say about it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from m2t_text.description.text import Text
from m2t_text.recognition.raster import INLIER
from m2t_text.recognition.verification import Alignment, align
from m2t_text.util.geometry import inverse, transform
from m2t_text.util.types import Floats

ALONE, FITS, SHARED, CONFLICTS = 0, 1, 2, 3  # what became of a keypoint


@dataclass(frozen=True)
class Comparison:
    """A query laid on another map.

    Attributes:
        alignment: the pose of the query's frame in the other map's, both at their viewpoints, and how it fits.
        query, found: of the keypoints of each, in the order of its text, (N,) uint8: ALONE, FITS (the other map
            has one within INLIER), SHARED (it is the same word, too), or CONFLICTS (it lies where the other map
            was seen to be free).
    """

    alignment: Alignment
    query: NDArray[np.uint8]
    found: NDArray[np.uint8]

    def to_json(self) -> dict[str, Any]:
        """The document of `/api/compare`; keypoints as a string of digits, one each."""
        keypoints = np.concatenate([self.query, self.found])
        return {
            "laid": self.alignment.pose.tolist(),
            "inlier_ratio": self.alignment.inlier_ratio,
            "agreement": self.alignment.agreement,
            "grip": self.alignment.fit.grip,
            "conflict_ratio": self.alignment.conflict_ratio,
            "shared": int((self.query == SHARED).sum()),
            "keypoints": len(keypoints),
            "query_keypoints": "".join(map(str, self.query.tolist())),
            "found_keypoints": "".join(map(str, self.found.tolist())),
        }


def compare(query: Text, found: Text, cell: float, alignment: Alignment | None = None) -> Comparison:
    """The query laid on another map, at an ``alignment`` that is known or else where it fits best."""
    laid = alignment or align(query, [found], cell)[0]
    here = _judged(transform(laid.pose, query.positions() * cell), query, found.positions() * cell, found, cell)
    back = inverse(laid.pose)
    there = _judged(transform(back, found.positions() * cell), found, query.positions() * cell, query, cell)
    return Comparison(laid, here, there)


def _judged(points: Floats, text: Text, others: Floats, other: Text, cell: float) -> NDArray[np.uint8]:
    """What becomes of the keypoints of a text, laid at ``points`` (N, 2) in the other's frame; metres."""
    judged = np.full(len(points), ALONE, dtype=np.uint8)
    judged[other.free.covers(points / cell)] = CONFLICTS
    if not len(points) or not len(others):
        return judged
    apart = 1.0 + INLIER  # metres on a third axis, so that only equal words are in reach
    near = KDTree(others).query(points, distance_upper_bound=INLIER)[0]
    judged[np.isfinite(near)] = FITS
    placed, place = (np.column_stack([p, t.wa * apart]) for p, t in ((points, text), (others, other)))
    judged[np.isfinite(KDTree(place).query(placed, distance_upper_bound=INLIER)[0])] = SHARED
    return judged
