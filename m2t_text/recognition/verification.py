"""Relative pose and fit of two maps, from their texts alone.

The words vote for an offset between the viewpoints, in each direction along the walls (as in ``agreement``).
From the best of these starts the pose words, which are the maps' geometry, cell by cell, are aligned by
point-to-line ICP, and how well they fit is counted among what both have seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.search.weighting import OffsetAgreement, agreed
from m2t_text.recognition.fit import Fit
from m2t_text.recognition.raster import Raster, refined
from m2t_text.util.geometry import compose, inverse
from m2t_text.util.types import Floats
from m2t_text.util.workers import threaded

WINDOW = 20  # cells by which the viewpoints may lie apart; from opposite sides a 180° laser sees other walls
QUARTER_TURNS = 4  # quarter turns, each of which is a start
STARTS = 2  # of them are aligned, those that agree best: the place, and often the place turned by 180°


@dataclass(frozen=True)
class Alignment:
    """How a query lies on a map.

    Attributes:
        pose: (3,) the query's frame in the map's frame (both at their viewpoints), metres and radians.
        fit: of both maps there.
        agreement: share of keypoints that matched at the offset for which the words voted, before that.
        support: what the hits of earlier maps of the query's drive add to the evidence; see `sequence`.
    """

    pose: Floats
    fit: Fit
    agreement: float
    support: float = 0.0

    @property
    def evidence(self) -> float:
        """How much speaks for the pose: differences of it compare poses of one query."""
        return self.fit.evidence + self.support

    @property
    def inlier_ratio(self) -> float:
        """Share of the keypoints of both maps that have one of the other map within INLIER."""
        return self.fit.inlier_ratio

    @property
    def conflict_ratio(self) -> float | None:
        """Share of the keypoints of both maps that lie where the other was seen to be free; None if unknown."""
        return self.fit.conflict_ratio


def align(query: Text, candidates: Sequence[Text], cell: float) -> list[Alignment]:
    """The query aligned with each of the candidates; ``cell`` is the pose words' step, metres.

    Examples:
        >>> import m2t_text as m2t
        >>> text = m2t.MapIndex.open("indexes/default").document("drive/000040").text
        >>> alignment = m2t.align(text.moved([0.5, 0.0, 0.0], 0.1), [text], 0.1)[0]
        >>> bool(abs(alignment.pose - [-0.5, 0.0, 0.0]).max() < 0.01), alignment.inlier_ratio
        (True, 1.0)
    """
    return [alignments[0] for alignments in align_variously(query, candidates, cell)]


def align_variously(query: Text, candidates: Sequence[Text], cell: float) -> list[list[Alignment]]:
    """The query aligned with each of the candidates from STARTS directions, that of the best fit first."""
    raster = Raster.of(query, cell)
    if not candidates or not len(query):
        nothing = np.zeros(3)
        return [[Alignment(nothing, Fit.of(raster, nothing, Raster.of(c, cell)), 0.0)] for c in candidates]
    packed = Texts.of(candidates)
    scores = [agreed(packed, query, OffsetAgreement(WINDOW, (turn,))) for turn in range(QUARTER_TURNS)]
    agreements = np.array([one.score for one in scores])
    starts = np.array([one.alignment for one in scores]) * [cell, cell, 1.0]

    def aligned(k: int) -> list[Alignment]:
        found = Raster.of(candidates[k], cell)
        chosen = np.argsort(-agreements[:, k], kind="stable")[:STARTS]
        found_there = [aligned_from(raster, found, starts[t, k], float(agreements[t, k])) for t in chosen]
        return sorted(found_there, key=lambda alignment: -alignment.fit.evidence)

    return list(threaded(aligned, range(len(candidates))))


def aligned_from(query: Raster, found: Raster, start: Floats, agreement: float) -> Alignment:
    """A query aligned with a map from a ``start`` pose (3,) in its frame, where they had the ``agreement``."""
    pose = refined(query, found, start)
    return Alignment(pose, Fit.of(query, pose, found), agreement)


def relative_pose(query: Document, found: Document, pose: Floats) -> Floats:
    """(3,) the query's first-scan robot frame in the found map's, given the alignment's ``pose`` (3,)."""
    return compose(compose(found.viewpoint, pose), inverse(query.viewpoint))
