"""What several answers of one drive say together.

An answer is a list of candidates, the pose of the robot at each with the evidence for it. Odometry carries
those of an earlier answer along. Where two answers, made of different scans, agree on the best, the evidence of
both is added, for it and for its rivals: a rival that only one of them has falls behind. So two that are
`ambiguous` may make a `match`, and a building that looks the same twice does not.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from m2t_text.recognition.verdict import Assessment
from m2t_text.util.geometry import between, compose, wrap
from m2t_text.util.types import Floats

SAME = (0.5, np.radians(10.0))  # m and rad within which two answers agree,
DRIFT = 0.04  # and m more per metre of travel between them
REMEMBERED_TRAVEL = 20.0  # m of travel over which an earlier answer counts


@dataclass(frozen=True)
class Candidate:
    """A pose (3,) of the robot in the frame of a dataset, and the evidence for it."""

    dataset: str
    pose: Floats
    evidence: float


@dataclass(frozen=True)
class Answer:
    """What was found.

    Attributes:
        best: the best candidate.
        rivals: lists the others, which takes a while and is seldom asked for.
        robot: (3,) the robot's pose in the frame of its drive.
        travel: (2,) metres of travel at the begin and the end of the run that was looked up.
        assessment: of the best candidate.
    """

    best: Candidate
    rivals: Callable[[], Sequence[Candidate]]
    robot: Floats
    travel: Floats
    assessment: Assessment

    @property
    def candidates(self) -> Sequence[Candidate]:
        """All of them, the best first."""
        return [self.best, *self.rivals()]

    def moved(self, one: Candidate, robot: Floats) -> Candidate:
        """A candidate at a later pose (3,) of the robot in the frame of its drive."""
        return replace(one, pose=compose(one.pose, between(self.robot, robot)))


def agree(one: Candidate, other: Candidate, gap: float) -> bool:
    """Whether two candidates are one place, ``gap`` metres of travel apart."""
    away = np.hypot(*(one.pose - other.pose)[:2])
    near = away <= SAME[0] + DRIFT * gap and abs(wrap(one.pose[2] - other.pose[2])) <= SAME[1]
    return bool(near and one.dataset == other.dataset)


def consistent(earlier: Answer, answer: Answer) -> bool:
    """Whether the best of an earlier answer and the drive since then lead to the best of a later one."""
    return agree(earlier.moved(earlier.best, answer.robot), answer.best, _gap(answer, earlier))


def _gap(answer: Answer, earlier: Answer) -> float:
    return float(answer.travel[1] - earlier.travel[1])


def independent(answer: Answer, earlier: Answer) -> bool:
    """Whether two answers share no scan, and the drive between them is short."""
    return 0 <= answer.travel[0] - earlier.travel[1] <= REMEMBERED_TRAVEL


def joint_lead(answer: Answer, earlier: Answer) -> float | None:
    """By how much evidence the best leads once an earlier answer is added; None if they do not agree on it.

    A candidate that one of both lacks is thought to have had the least evidence of all that it has.
    """
    gap = _gap(answer, earlier)
    best = answer.best
    if not agree(earlier.moved(earlier.best, answer.robot), best, gap):
        return None
    before = [earlier.moved(one, answer.robot) for one in earlier.candidates]
    least_now = min(one.evidence for one in answer.candidates)
    least_before = min(one.evidence for one in before)
    joint = best.evidence + before[0].evidence
    rivals = [
        now.evidence + max((one.evidence for one in before if agree(one, now, gap)), default=least_before)
        for now in answer.candidates
        if not agree(now, best, 0.0)
    ]
    rivals += [one.evidence + least_now for one in before if not agree(one, best, gap)]
    return joint - max(rivals) if rivals else None
