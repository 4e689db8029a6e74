"""Localisation from call to call: each answer by itself, and what earlier answers of the same drive add."""

from collections import deque
from collections.abc import Iterable
from dataclasses import replace
from functools import cache, partial
from time import perf_counter

import numpy as np
from whoosh.query import Not, Term

from m2t_text.description.document import Document
from m2t_text.index.map_index import MapIndex
from m2t_text.live.continuity import Continuity
from m2t_text.live.evidence import REMEMBERED_TRAVEL, Answer, Candidate, consistent, independent, joint_lead
from m2t_text.live.place import Place, State
from m2t_text.live.sought import Sought, candidates, covariance_of, may_fit
from m2t_text.mapping.local_map import LocalMap
from m2t_text.pipeline import describe
from m2t_text.recognition.finding import VERIFIED, find
from m2t_text.recognition.found import Found
from m2t_text.recognition.queries import Query
from m2t_text.recognition.verdict import FURTHEST, NOTHING, SURE, Assessment, Reason, Rival, probability
from m2t_text.util.geometry import compose
from m2t_text.util.types import Floats

WHOLE = Continuity()


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
        self._continuity = WHOLE
        self._answers: deque[Answer] = deque()
        self._match: Answer | None = None  # the last one
        self._suspect: Answer | None = None  # the last one that contradicted it, though sure by itself

    def locate(
        self,
        seen: LocalMap | Document,
        robot: Floats | None = None,
        shorter: Iterable[LocalMap] = (),
        latest: LocalMap | None = None,
        continuity: Continuity = WHOLE,
    ) -> Place:
        """Where the robot is.

        Args:
            seen: what it saw on its last run, in the frame of its drive.
            robot: (3,) its pose now in the frame of its drive; None for the end of a local map's run, and the
                begin of a document's.
            shorter: what it saw on shorter last runs; they are looked up where ``seen`` is no `match`, as it is
                none where the robot was carried elsewhere on it, or where the map ends.
            latest: what it saw on the very last scans; an answer where that does not fit is none.
            continuity: of its drive; what earlier answers say does not go beyond where that ends.
        """
        begin = perf_counter()
        self._continuity = continuity
        known = self.state == "tracked"
        index = self._index.pinned()
        newest = None if latest is None else describe(latest, "live", index.parameters)
        sought = self._look_up(index, seen, robot, newest)
        for run in shorter:
            if sought.assessment.verdict == "match":
                break
            other = self._look_up(index, run, robot, newest)
            sought = other if other.assessment.verdict == "match" else sought
        if sought.best is None:
            return self._place(sought.assessment, begin)
        found = candidates(index, sought.document, sought.results, sought.motion)
        best, rivals = next(found), cache(partial(list[Candidate], found))
        answer = Answer(best, rivals, sought.robot, sought.document.travel, sought.assessment)
        weighed = self._weighed(answer, sought.best)
        self._follow(weighed)
        match, hit = weighed.assessment.verdict == "match", sought.best.hit.document
        return replace(
            self._place(weighed.assessment, begin),
            dataset=hit.dataset,
            map_id=hit.map_id,
            pose=best.pose,
            covariance=covariance_of(index, sought.document, sought.best, sought.motion),
            confirmed=match and sought.assessment.verdict != "match",
            first=match and not known,
        )

    def _look_up(
        self, index: MapIndex, seen: LocalMap | Document, robot: Floats | None, newest: Document | None
    ) -> Sought:
        if isinstance(seen, LocalMap):
            document = describe(seen, "live", index.parameters)
            robot = compose(seen.pose, seen.trajectory[-1]) if robot is None else robot
        else:
            document = seen
        here = document.pose if robot is None else np.asarray(robot, dtype=float)
        if not len(document.text):
            return Sought(document, here, [], NOTHING)
        others = None if self.without is None else Not(Term("dataset", self.without))
        finding = find(index, Query.of(document), VERIFIED, filter=others)
        sought = Sought(document, here, finding.results, finding.assessment)
        if newest is None or sought.assessment.verdict == "none" or may_fit(index, sought, newest):
            return sought
        reason = Reason("conflict", "what the robot saw last does not fit there")
        return replace(sought, assessment=Assessment("none", sought.assessment.probability, reason))

    @property
    def state(self) -> State:
        """Whether it is known where the robot is; see `Place`."""
        if self._match is None:
            return "unknown"
        lost = self._suspect is not None or self._match.travel[1] <= self._continuity.carried
        return "lost" if lost else "tracked"

    def _weighed(self, answer: Answer, best: Found) -> Answer:
        """The answer with the assessment that earlier ones make of it."""
        verdict, led = answer.assessment.verdict, self._led(answer)
        if verdict == "match" and led is False:
            return self._doubted(answer)
        if verdict != "ambiguous" or best.alignment is None:
            return answer
        linked = filter(self._linked, self._answers)
        leads = [joint_lead(answer, one) for one in linked if independent(answer, one)]
        ahead = max((lead for lead in leads if lead is not None), default=None)
        if ahead is None and led and self._match is not None and self._linked(self._match):
            ahead = FURTHEST  # the rivals are elsewhere than where the match led
        if ahead is None:
            return answer
        rival = Rival("elsewhere", best.hit.map_id, 0.0, 0.0, 0.0, ahead)
        sure = probability(best.alignment.fit, rival)
        if sure < SURE:
            return answer
        reason = Reason("fits", "an earlier place of this drive leads here, and to no rival of it")
        return replace(answer, assessment=Assessment("match", sure, reason))

    def _doubted(self, answer: Answer) -> Answer:
        """A match that is elsewhere than the last one led to: it counts once another one agrees with it."""
        suspect, self._suspect = self._suspect, answer
        if suspect is not None and consistent(suspect, answer):
            return answer
        text = "it contradicts where the last match and the drive since then lead; the next one decides"
        reason = Reason("elsewhere", text)
        return replace(answer, assessment=replace(answer.assessment, verdict="ambiguous", reason=reason))

    def _linked(self, earlier: Answer) -> bool:
        """Whether it is sure how the robot came from where it was at an earlier answer."""
        return bool(earlier.travel[1] > self._continuity.doubtful)

    def _led(self, answer: Answer) -> bool | None:
        """Whether the last match and the drive since then lead to the best; None where they lead nowhere."""
        match = self._match
        if match is None or match.travel[1] <= self._continuity.carried:  # it may have stood
            return None
        if not 0 <= answer.travel[1] - match.travel[1] <= REMEMBERED_TRAVEL:
            return None
        return consistent(match, answer)

    def _follow(self, answer: Answer) -> None:
        """Keeps an answer for later ones, and notes whether the robot is where it should be."""
        while self._answers and answer.travel[0] - self._answers[0].travel[1] > REMEMBERED_TRAVEL:
            self._answers.popleft()
        if answer.assessment.verdict != "none":
            self._answers.append(answer)
        if answer.assessment.verdict == "match":
            self._match, self._suspect = answer, None

    def _place(self, assessment: Assessment, begin: float) -> Place:
        """An answer of which no more is known than how sure it is."""
        seconds = perf_counter() - begin
        return Place(assessment.verdict, assessment.probability, assessment.reason, self.state, seconds)
