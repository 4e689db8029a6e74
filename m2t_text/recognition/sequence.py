"""The last metres of a drive as one query: earlier texts, whose hits must agree with an answer on one motion.

Places that look alike one by one are told apart by the way that led there: an earlier map's hit says where the
query must be, as the robot's motion between both is known.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from m2t_text.index.results import Hit
from m2t_text.recognition.earlier import Earlier
from m2t_text.recognition.found import SAME_DIRECTION, SAME_PLACE, Found
from m2t_text.recognition.verification import Alignment
from m2t_text.util.geometry import compose, wrap
from m2t_text.util.types import Floats

FURTHEST_BEHIND = 12.0  # of the evidence by which a text's best alignment there may be behind its best anywhere
SHARE = 0.5  # of an earlier text's evidence that counts, as overlapping runs repeat each other


@dataclass(frozen=True)
class _Said:
    """Where the alignments of an earlier text put the query.

    Attributes:
        datasets: (A,) of the hits.
        poses: (A, 3) the query's viewpoint in the frame of the hit's dataset.
        middles: (A,) travel at the middle of the hit's run.
        evidence: (A,) of the alignments.
        behind: metres of travel from the earlier map to the query.
    """

    datasets: list[str]
    poses: Floats
    middles: Floats
    evidence: Floats
    behind: float

    def support(self, dataset: str, pose: Floats, middle: float) -> float:
        """The evidence for a pose of the query beside the best that the text found anywhere: 0 or less."""
        gaps = np.abs(self.middles - middle) + self.behind
        away = np.hypot(*(self.poses - pose)[:, :2].T)
        turn = np.abs(wrap(self.poses[:, 2] - pose[2]))
        base, slope, most = SAME_DIRECTION
        agrees = (away <= SAME_PLACE[0] + SAME_PLACE[1] * gaps) & (
            turn <= np.minimum(base + slope * gaps, most)
        )
        agrees &= np.array([one == dataset for one in self.datasets])
        best = self.evidence[agrees].max() if agrees.any() else -np.inf
        return float(max(best - self.evidence.max(), -FURTHEST_BEHIND))


@dataclass(frozen=True)
class Trail:
    """What the earlier texts of a query say about its alignments; nothing if there are none."""

    said: tuple[_Said, ...]

    @classmethod
    def of(
        cls,
        earlier: Sequence[Earlier],
        search: Callable[[Earlier], list[Hit]],
        verify: Callable[[Earlier, Sequence[Hit]], list[Found]],
    ) -> "Trail":
        """Of the earlier texts, looked up as the query is."""
        said = []
        for one in earlier:
            hits = [hit for hit in search(one) if hit.score > 0]
            rows = [(found.hit, alignment) for found in verify(one, hits) for alignment in found.alignments]
            if rows:
                said.append(_said(one, rows))
        return cls(tuple(said))

    def supported(self, found: Found) -> Found:
        """A hit whose alignments have the evidence of the earlier texts, too, the best first."""
        if not self.said or found.alignment is None:
            return found
        document = found.hit.document
        ranked = []
        for one in found.alignments:
            place = compose(compose(document.pose, document.viewpoint), one.pose)
            support = sum(said.support(document.dataset, place, document.middle) for said in self.said)
            ranked.append(replace(one, support=SHARE * support))
        ranked.sort(key=lambda one: -one.evidence)
        return replace(found, alignment=ranked[0], others=tuple(ranked[1:]))


def _said(earlier: Earlier, rows: list[tuple[Hit, Alignment]]) -> _Said:
    poses = [
        compose(compose(compose(hit.document.pose, hit.document.viewpoint), one.pose), earlier.motion)
        for hit, one in rows
    ]
    return _Said(
        [hit.document.dataset for hit, _ in rows],
        np.array(poses),
        np.array([hit.document.middle for hit, _ in rows]),
        np.array([one.fit.evidence for _, one in rows]),
        earlier.behind,
    )
