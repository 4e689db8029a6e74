"""Localisation from call to call: each answer by itself, and what earlier answers of the same drive add.

An answer is a list of candidates, the pose of the robot at each with the evidence for it. Odometry carries
those of an earlier answer along. Where two answers, made of different scans, agree on the best, the evidence of
both is added, for it and for its rivals: a rival that only one of them has falls behind. So two that are
`ambiguous` may make a `match`, and a building that looks the same twice does not.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from whoosh.query import Not, Term

from m2t_text.description.document import Document
from m2t_text.index.map_index import MapIndex
from m2t_text.live.place import Place, State
from m2t_text.mapping.local_map import LocalMap
from m2t_text.pipeline import describe
from m2t_text.recognition.covariance import carried, fit_covariance
from m2t_text.recognition.finding import VERIFIED, find
from m2t_text.recognition.found import Found
from m2t_text.recognition.queries import Query
from m2t_text.recognition.raster import Raster, Shape
from m2t_text.recognition.symmetry import other_poses
from m2t_text.recognition.verdict import FURTHEST, NOTHING, SURE, Assessment, Reason, Rival, probability
from m2t_text.recognition.verification import relative_pose
from m2t_text.util.geometry import between, compose, wrap
from m2t_text.util.types import Floats

SAME = (0.5, np.radians(10.0))  # m and rad within which two answers agree,
DRIFT = 0.04  # and m more per metre of travel between them
REACH = 20.0  # m of travel over which an earlier answer counts


@dataclass(frozen=True)
class _Candidate:
    """A pose (3,) of the robot in the frame of a dataset, and the evidence for it."""

    dataset: str
    pose: Floats
    evidence: float


@dataclass(frozen=True)
class _Answer:
    """What was found: the candidates, the best first; the robot's pose (3,) in the frame of its drive; and the
    metres of travel at the begin and the end of the run that was looked up."""

    candidates: Sequence[_Candidate]
    robot: Floats
    travel: Floats
    assessment: Assessment

    def carried(self, robot: Floats) -> "Iterator[_Candidate]":
        """The candidates at a later pose (3,) of the robot in the frame of its drive."""
        motion = between(self.robot, robot)
        return (replace(one, pose=compose(one.pose, motion)) for one in self.candidates)


class Localizer:
    """Finds a robot in the maps of an index, and follows it from call to call.

    Examples:
        >>> import m2t_text as m2t
        >>> index = m2t.MapIndex.open("indexes/default")
        >>> place = m2t.Localizer(index).locate(index.document("drive/000040"))
        >>> place.dataset, place.covariance.shape, place.state in ("unknown", "tracked")
        ('drive', (3, 3), True)
    """

    def __init__(self, index: MapIndex) -> None:
        self._index = index
        self.without: str | None = None  # a dataset that no answer lies in: that of the drive itself
        self.reset()

    def reset(self) -> None:
        """Forgets all answers: the robot was carried away, or another drive begins."""
        self._answers: deque[_Answer] = deque()
        self._match: _Answer | None = None  # the last one
        self._suspect: _Answer | None = None  # the last one that contradicted it, though sure by itself

    def locate(self, seen: LocalMap | Document, robot: Floats | None = None) -> Place:
        """Where the robot is.

        Args:
            seen: what it saw on its last run, in the frame of its drive.
            robot: (3,) its pose now in the frame of its drive; None for the end of a local map's run, and the
                begin of a document's.
        """
        begin = perf_counter()
        if isinstance(seen, LocalMap):
            document = describe(seen, "live", self._index.parameters)
            robot = compose(seen.pose, seen.trajectory[-1]) if robot is None else robot
        else:
            document = seen
        here = document.pose if robot is None else np.asarray(robot, dtype=float)
        index = self._index.pinned()
        others = None if self.without is None else Not(Term("dataset", self.without))
        finding = find(index, Query.of(document), VERIFIED, filter=others) if len(document.text) else None
        if finding is None or not finding.results or finding.results[0].alignment is None:
            nothing = finding.assessment if finding else NOTHING
            return self._place(None, None, None, nothing, False, begin)
        best, motion = finding.results[0], between(document.pose, here)
        candidates = list(_candidates(index, document, finding.results, motion))
        answer = _Answer(candidates, here, document.travel, finding.assessment)
        confirmed = self._weighed(answer, best)
        self._follow(confirmed)
        changed = confirmed.assessment.verdict == "match" and finding.verdict != "match"
        uncertain = _uncertain(index, document, best, motion)
        return self._place(best, candidates[0].pose, uncertain, confirmed.assessment, changed, begin)

    @property
    def state(self) -> State:
        """Whether it is known where the robot is; see `Place`."""
        if self._match is None:
            return "unknown"
        return "tracked" if self._suspect is None else "lost"

    def _weighed(self, answer: _Answer, best: Found) -> _Answer:
        """The answer with the assessment that earlier ones make of it."""
        own = answer.assessment
        led = self._led(answer)
        if own.verdict == "match" and led is False:
            suspect, self._suspect = self._suspect, answer
            if suspect is None or not _consistent(suspect, answer):
                text = "it contradicts where the last match and the drive since then lead; the next one decides"
                reason = Reason("elsewhere", text)
                return replace(answer, assessment=replace(own, verdict="ambiguous", reason=reason))
        if own.verdict != "ambiguous" or best.alignment is None:
            return answer
        leads = [self._lead(answer, earlier) for earlier in self._answers if self._independent(answer, earlier)]
        ahead = max((lead for lead in leads if lead is not None), default=None)
        if led and ahead is None:
            ahead = FURTHEST  # the rivals are elsewhere than where the match led
        if ahead is None:
            return answer
        fit = best.alignment.fit
        rival = Rival("elsewhere", best.hit.map_id, 0.0, 0.0, 0.0, fit.evidence - ahead)
        sure = probability(fit, rival)
        if sure < SURE:
            return answer
        reason = Reason("fits", "an earlier place of this drive leads here, and to no rival of it")
        return replace(answer, assessment=Assessment("match", sure, reason))

    def _led(self, answer: _Answer) -> bool | None:
        """Whether the last match and the drive since then lead to the best; None where they lead nowhere."""
        match = self._match
        if match is None or not 0 <= answer.travel[1] - match.travel[1] <= REACH:
            return None
        return _consistent(match, answer)

    def _independent(self, answer: _Answer, earlier: _Answer) -> bool:
        """Whether two answers share no scan, and the drive between them is short."""
        return 0 <= answer.travel[0] - earlier.travel[1] <= REACH

    def _lead(self, answer: _Answer, earlier: _Answer) -> float | None:
        """By how much evidence the best leads once both answers are added; None if they do not agree on it.

        A candidate that one of both lacks is thought to have had the least evidence of all that it has.
        """
        gap = _gap(answer, earlier)
        before = list(earlier.carried(answer.robot))
        best = answer.candidates[0]
        if not _agree(before[0], best, gap):
            return None
        least_now = min(one.evidence for one in answer.candidates)
        least_before = min(one.evidence for one in before)
        joint = best.evidence + before[0].evidence
        rivals = [
            now.evidence + max((one.evidence for one in before if _agree(one, now, gap)), default=least_before)
            for now in answer.candidates
            if not _agree(now, best, 0.0)
        ]
        rivals += [one.evidence + least_now for one in before if not _agree(one, best, gap)]
        return joint - max(rivals) if rivals else None

    def _follow(self, answer: _Answer) -> None:
        """Keeps an answer for later ones, and notes whether the robot is where it should be."""
        while self._answers and answer.travel[0] - self._answers[0].travel[1] > REACH:
            self._answers.popleft()
        if answer.assessment.verdict != "none":
            self._answers.append(answer)
        if answer.assessment.verdict == "match":
            self._match, self._suspect = answer, None

    def _place(
        self,
        best: Found | None,
        pose: Floats | None,
        uncertain: Floats | None,
        assessment: Assessment,
        confirmed: bool,
        begin: float,
    ) -> Place:
        document = None if best is None else best.hit.document
        return Place(
            None if document is None else document.dataset,
            None if document is None else document.map_id,
            pose,
            uncertain,
            assessment.probability,
            assessment.verdict,
            assessment.reason,
            self.state,
            confirmed,
            perf_counter() - begin,
        )


def _candidates(
    index: MapIndex, document: Document, results: Sequence[Found], motion: Floats
) -> Iterator[_Candidate]:
    """Where the robot may be, the best first; ``motion`` (3,) leads there from the begin of its run."""
    best = results[0]
    assert best.alignment is not None
    cell = index.parameters.mapping.cell
    rasters = Raster.of(document.text, cell), Raster.of(index.document(best.hit.map_id).text, cell)
    symmetric = Found(best.hit, None, best.alignment, tuple(other_poses(*rasters, best.alignment.pose)))
    for found in (*results, symmetric):
        if found.alignment is None:
            continue
        hit = found.hit.document
        for alignment in (found.alignment, *found.others):
            pose = compose(hit.pose, compose(relative_pose(document, hit, alignment.pose), motion))
            yield _Candidate(hit.dataset, pose, alignment.fit.evidence)


def _agree(one: _Candidate, other: _Candidate, gap: float) -> bool:
    """Whether two candidates are one place, ``gap`` metres of travel apart."""
    away = np.hypot(*(one.pose - other.pose)[:2])
    near = away <= SAME[0] + DRIFT * gap and abs(wrap(one.pose[2] - other.pose[2])) <= SAME[1]
    return bool(near and one.dataset == other.dataset)


def _consistent(earlier: _Answer, answer: _Answer) -> bool:
    """Whether the best of an earlier answer and the drive since then lead to the best of a later one."""
    return _agree(next(earlier.carried(answer.robot)), answer.candidates[0], _gap(answer, earlier))


def _gap(answer: _Answer, earlier: _Answer) -> float:
    return float(answer.travel[1] - earlier.travel[1])


def _uncertain(index: MapIndex, document: Document, best: Found, motion: Floats) -> Floats:
    """(3, 3) covariance of the robot's pose in the axes of the dataset's frame."""
    assert best.alignment is not None
    cell, there = index.parameters.mapping.cell, index.document(best.hit.map_id)
    loose = fit_covariance(Shape.of(document.text, cell), Shape.of(there.text, cell), best.alignment.pose)
    viewpoint = compose(compose(there.pose, there.viewpoint), best.alignment.pose)
    return carried(loose, viewpoint, between(document.viewpoint, motion))
