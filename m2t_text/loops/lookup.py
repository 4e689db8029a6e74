"""Maps of a drive looked up among earlier ones: what is likely the same place is a candidate for a loop."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from whoosh.query import Not, Or, Query, Term

from m2t_text.config import MappingParameters
from m2t_text.description.document import Document
from m2t_text.index.map_index import MapIndex
from m2t_text.index.search.query import NumberRange
from m2t_text.loops.uncertainty import PoseWithCovariance
from m2t_text.recognition.covariance import fit_covariance
from m2t_text.recognition.finding import find
from m2t_text.recognition.queries import Query as Sought
from m2t_text.recognition.raster import Shape
from m2t_text.util.types import Floats
from m2t_text.util.workers import mapped

MIN_TRAVEL_APART = 10.0  # m of travel between the middles of two maps of one drive, at least: another visit
QUERY_SPACING = 1.0  # m of travel from one query to the next
LIKELY = 0.8  # probability of a candidate: the drive and the other loops have to agree with it as well


@dataclass(frozen=True)
class Candidate:
    """A query whose best hit is LIKELY the place; it may be wrong.

    Attributes:
        query: the map that was looked up.
        found: the hit.
        inlier_ratio: of the alignment.
        pose: the query's viewpoint as seen from the hit's.
    """

    query: Document
    found: Document
    inlier_ratio: float
    pose: PoseWithCovariance


def is_query(document: Document, last: Document | None) -> bool:
    """Whether a map of a drive is looked up, the ``last`` one that was being this."""
    return last is None or bool(document.travel[0] >= last.travel[0] + QUERY_SPACING)


def look_up(
    path: Path, queries: Sequence[Document], jobs: int = 1, progress: Callable[[int, int], None] | None = None
) -> Iterator[Candidate | None]:
    """The likely match of each query in the index in a folder, or None, in the order of the queries.

    Of the query's own dataset, maps count that lie more than MIN_TRAVEL_APART behind it, and none ahead.
    """
    for done, candidate in enumerate(mapped(partial(_searcher, path), queries, jobs), start=1):
        if progress:
            progress(done, len(queries))
        yield candidate


def _searcher(path: Path) -> Callable[[Document], Candidate | None]:
    return partial(look_up_one, MapIndex.open(path))


def look_up_one(index: MapIndex, query: Document) -> Candidate | None:
    """The likely match of a query in an index; None if there is none. See `look_up`."""
    finding = find(index, Sought(query.text, query), top=1, filter=known_before(query))
    if (finding.assessment.probability or 0.0) < LIKELY:
        return None
    best = finding.results[0]
    found, alignment = index.document(best.hit.map_id), best.alignment
    assert alignment is not None
    mapping = index.parameters.mapping
    sought, seen = (Shape.of(document.text, mapping.cell) for document in (query, found))
    pose = PoseWithCovariance(alignment.pose, alignment_covariance(sought, seen, alignment.pose, mapping))
    return Candidate(query, found, alignment.inlier_ratio, pose)


def known_before(query: Document) -> Query:
    """The maps of other datasets, and those of the query's own that the robot had left before."""
    past = NumberRange("travel", None, query.middle - MIN_TRAVEL_APART)
    return Or([Not(Term("dataset", query.dataset)), past])


def alignment_covariance(query: Shape, found: Shape, pose: Floats, mapping: MappingParameters) -> Floats:
    """(3, 3) covariance of the ``pose`` (3,) of the query in the found map's frame, in the query's frame.

    As the runs of queries overlap, the loops of one visit repeat each other, and each says so much less.
    """
    return fit_covariance(query, found, pose) * mapping.run_length / QUERY_SPACING
