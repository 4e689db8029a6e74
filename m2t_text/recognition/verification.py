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
from m2t_text.index.search.weighting import OffsetAgreement, agreed_by_turn
from m2t_text.recognition.fit import Fit
from m2t_text.recognition.raster import Raster, refined
from m2t_text.util.geometry import compose, inverse
from m2t_text.util.types import Floats
from m2t_text.util.workers import together

WINDOW = 20  # cells by which the viewpoints may lie apart; from opposite sides a 180° laser sees other walls
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
    if not candidates:
        return []
    raster = Raster.of(query, cell)
    starts, agreements = _starts(query, candidates, cell)

    def aligned_with(k: int) -> list[Alignment]:
        some = aligned(raster, Raster.of(candidates[k], cell), starts[k], agreements[k])
        return sorted(some, key=lambda alignment: -alignment.fit.evidence)

    return together(aligned_with, range(len(candidates)))


def _starts(query: Text, candidates: Sequence[Text], cell: float) -> tuple[Floats, Floats]:
    """(K, STARTS, 3) the poses for which the words vote most, and (K, STARTS) the agreement there."""
    scores = agreed_by_turn(Texts.of(candidates), query, OffsetAgreement(WINDOW))
    agreements = np.stack([one.score for one in scores], axis=1)
    poses = np.stack([one.alignment for one in scores], axis=1) * [cell, cell, 1.0]
    chosen = np.argsort(-agreements, axis=1, kind="stable")[:, :STARTS]
    rows = np.arange(len(candidates))[:, None]
    return poses[rows, chosen], agreements[rows, chosen]


def aligned(query: Raster, found: Raster, starts: Floats, agreements: Floats) -> list[Alignment]:
    """A query aligned with a map from each of ``starts`` (S, 3) in its frame, where they had the agreements
    (S,)."""
    poses = refined(query, found, starts)
    fits = Fit.of_each(query, poses, found)
    return [Alignment(*one) for one in zip(poses, fits, agreements.tolist(), strict=True)]


def relative_pose(query: Document, found: Document, pose: Floats) -> Floats:
    """(3,) the query's first-scan robot frame in the found map's, given the alignment's ``pose`` (3,)."""
    return compose(compose(found.viewpoint, pose), inverse(query.viewpoint))
