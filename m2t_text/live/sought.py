"""A run of a drive that was looked up: where the robot may be, how sure that is, and what contradicts it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from m2t_text.description.document import Document
from m2t_text.index.map_index import MapIndex
from m2t_text.live.continuity import may_show
from m2t_text.live.evidence import Candidate
from m2t_text.recognition.covariance import dataset_covariance
from m2t_text.recognition.finding import symmetric
from m2t_text.recognition.found import Found
from m2t_text.recognition.queries import Query
from m2t_text.recognition.verdict import Assessment
from m2t_text.recognition.verification import Alignment, relative_pose
from m2t_text.util.geometry import between, compose
from m2t_text.util.types import Floats


@dataclass(frozen=True)
class Sought:
    """A run that was looked up: the robot's pose (3,) at its end, and what was found, the best first."""

    document: Document
    robot: Floats
    results: Sequence[Found]
    assessment: Assessment

    @property
    def best(self) -> Found | None:
        """None where nothing was verified."""
        return self.results[0] if self.results and self.results[0].alignment is not None else None

    @property
    def motion(self) -> Floats:
        """(3,) from the begin of the run to the robot."""
        return between(self.document.pose, self.robot)


def candidates(
    index: MapIndex, document: Document, results: Sequence[Found], motion: Floats
) -> Iterator[Candidate]:
    """Where the robot may be, the best first; ``motion`` (3,) leads there from the begin of its run."""

    def placed(hit: Document, alignment: Alignment) -> Candidate:
        pose = compose(hit.pose, compose(relative_pose(document, hit, alignment.pose), motion))
        return Candidate(hit.dataset, pose, alignment.fit.evidence)

    for found in results:
        yield from (placed(found.hit.document, one) for one in found.alignments)
    for found in symmetric(index, Query.of(document), results[0]):
        yield from (placed(found.hit.document, one) for one in found.alignments)


def may_fit(index: MapIndex, sought: Sought, newest: Document) -> bool:
    """Whether what the robot saw last may be seen where its whole run was found."""
    best = sought.best
    if best is None or best.alignment is None:
        return True
    there = index.document(best.hit.map_id)
    begin = relative_pose(sought.document, there, best.alignment.pose)
    pose = compose(begin, between(sought.document.pose, newest.pose))
    return may_show(newest, pose, there, index.parameters.mapping.cell)


def covariance_of(index: MapIndex, document: Document, best: Found, motion: Floats) -> Floats:
    """(3, 3) covariance of the robot's pose in the axes of the dataset's frame."""
    assert best.alignment is not None
    there = index.document(best.hit.map_id)
    return dataset_covariance(document, there, best.alignment, index.parameters.mapping.cell, motion)
