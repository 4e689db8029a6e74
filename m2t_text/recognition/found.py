"""A hit and how the query lies on it; and which hits are other answers than the best, its rivals."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from m2t_text.index.results import Hit
from m2t_text.recognition.verdict import Rival
from m2t_text.recognition.verification import Alignment
from m2t_text.util.geometry import compose, wrap
from m2t_text.util.types import Floats

# Two poses of one trajectory nearer than this in place and in direction may be one: drift accounts for it.
SAME_PLACE = (1.0, 0.04)  # m, and m per metre of travel between both maps
SAME_DIRECTION = (np.radians(10.0), 0.01, np.radians(45.0))  # rad, rad per metre of travel, and rad at most
TURNED = np.radians(45.0)  # from here on a rival at the same place is another direction, not a shift


@dataclass(frozen=True)
class Found:
    """A hit, and once it is verified how the query lies on it.

    Attributes:
        hit: as the index found it.
        pose: (3,) the query's first-scan robot frame in the hit's first-scan robot frame, or in each case the
            frame of a map that was not driven; None where it was not verified, or where the query is a text.
        alignment: of the two texts, None where it was not verified.
        others: alignments from other directions, that of the best fit first.
    """

    hit: Hit
    pose: Floats | None = None
    alignment: Alignment | None = None
    others: tuple[Alignment, ...] = ()

    @property
    def alignments(self) -> tuple[Alignment, ...]:
        """All of them, the best first; none where it was not verified."""
        return (self.alignment, *self.others) if self.alignment else ()

    @property
    def inlier_ratio(self) -> float | None:
        """Share of both maps' keypoints that have one of the other map near; None where it was not verified."""
        return self.alignment.fit.inlier_ratio if self.alignment else None

    @property
    def conflict_ratio(self) -> float | None:
        """Share of both maps' keypoints that lie where the other map was seen to be free; None where it was not
        verified, or a text does not tell what is free."""
        return self.alignment.fit.conflict_ratio if self.alignment else None

    @property
    def laid(self) -> Floats:
        """(3,) pose of the query's frame in the hit's: verified, or else as the score found it."""
        return self.alignment.pose if self.alignment else self.hit.alignment

    @property
    def dataset_pose(self) -> Floats | None:
        """(3,) the query's first-scan robot frame in the frame of the hit's dataset, that of its trajectory or
        map; None where ``pose`` is."""
        return None if self.pose is None else compose(self.hit.document.pose, self.pose)


@dataclass(frozen=True)
class Difference:
    """From one answer to another: metres, radians, and the direction of the shift in the first one's map."""

    away: float
    turn: float
    direction: float


def differs(best: Found, other: Found) -> bool:
    """Whether another hit is another answer."""
    return difference(best, other, other.laid) is not None


def difference(best: Found, other: Found, pose: Floats) -> Difference | None:
    """How the query at a ``pose`` (3,) on another hit differs from the best answer; None if it is the same."""
    if best.hit.document.dataset != other.hit.document.dataset:
        return Difference(np.inf, 0.0, 0.0)
    here, there = _placed(best, best.laid), _placed(other, pose)
    gap = abs(best.hit.document.middle - other.hit.document.middle)
    shift = there[:2] - here[:2]
    away, turn = float(np.hypot(*shift)), float(abs(wrap(there[2] - here[2])))
    base, slope, most = SAME_DIRECTION
    if away <= SAME_PLACE[0] + SAME_PLACE[1] * gap and turn <= min(base + slope * gap, most):
        return None
    frame = compose(best.hit.document.pose, best.hit.document.viewpoint)
    return Difference(away, turn, float(np.arctan2(shift[1], shift[0]) - frame[2]))


def _placed(found: Found, pose: Floats) -> Floats:
    """(3,) the query's viewpoint in the frame of the hit's dataset, given its ``pose`` (3,) in the hit's."""
    document = found.hit.document
    return compose(document.pose, compose(document.viewpoint, pose))


def strongest(best: Found, others: Iterable[Found], known: Rival | None = None) -> Rival | None:
    """The other answer for which most speaks; None if there is none.

    Looked at are other alignments of the best hit, those of other hits, and the rival that is known already.
    """
    assert best.alignment is not None
    strongest = known
    for other in [best, *others]:
        for alignment in other.alignments:
            lead = best.alignment.evidence - alignment.evidence
            if strongest is not None and lead >= strongest.lead:
                continue
            apart = difference(best, other, alignment.pose)
            if apart is not None:
                strongest = _rival(other.hit.map_id, best, apart, lead)
    return strongest


def _rival(map_id: str, best: Found, apart: Difference, lead: float) -> Rival:
    gap = SAME_PLACE[0]
    if apart.turn > TURNED and apart.away <= 3 * gap:
        return Rival("turned", map_id, apart.away, apart.turn, apart.direction, lead)
    if map_id == best.hit.map_id:
        return Rival("slides", map_id, apart.away, apart.turn, apart.direction, lead)
    return Rival("elsewhere", map_id, apart.away, apart.turn, apart.direction, lead)
