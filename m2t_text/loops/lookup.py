"""Maps of a drive looked up among earlier ones: each `match` is a candidate for a loop."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree
from whoosh.query import Not, Or, Query, Term

from m2t_text.config import MappingParameters
from m2t_text.description.document import Document
from m2t_text.index.map_index import MapIndex
from m2t_text.index.search.query import NumberRange
from m2t_text.loops.uncertainty import Uncertain
from m2t_text.recognition.finding import find
from m2t_text.recognition.queries import Query as Sought
from m2t_text.recognition.verification import INLIER, Shape
from m2t_text.util.geometry import inverse, transform
from m2t_text.util.types import Floats
from m2t_text.util.workers import mapped

APART = 10.0  # m of travel between the middles of two maps of one drive, at least: another visit
EVERY = 1.0  # m of travel from one query to the next
# Errors of alignments on the five logs of the Radish repository:
REMAINDER = np.array([0.03, 0.03, 0.01])  # m, m, rad; of the best ones, as drift bends the runs themselves
LEAST_NOISE = 0.01  # m
KNOWN_ANYWAY = np.array([1e-2, 1e-2, 1e-1])  # 1/m², 1/m², 1/rad²; information that is taken for granted
CORRELATION = 25.0  # neighbouring keypoints err together: so many count as one


@dataclass(frozen=True)
class Candidate:
    """A query whose best hit has the verdict `match`; it may be wrong.

    Attributes:
        query: the map that was looked up.
        found: the hit.
        inlier_ratio: of the alignment.
        pose: the query's viewpoint as seen from the hit's.
    """

    query: Document
    found: Document
    inlier_ratio: float
    pose: Uncertain


def look_up(
    path: Path, queries: Sequence[Document], jobs: int = 1, progress: Callable[[int, int], None] | None = None
) -> Iterator[Candidate]:
    """The matches of the queries in the index in a folder, in the order of the queries.

    Of the query's own dataset, maps count that lie more than APART metres of travel behind it, and none ahead.
    """
    for done, candidate in enumerate(mapped(partial(_searcher, path), queries, jobs), start=1):
        if progress:
            progress(done, len(queries))
        if candidate is not None:
            yield candidate


def _searcher(path: Path) -> Callable[[Document], Candidate | None]:
    return partial(_find, MapIndex.open(path))


def _find(index: MapIndex, query: Document) -> Candidate | None:
    finding = find(index, Sought(query.text, query), top=1, filter=_known(query))
    if finding.verdict != "match":
        return None
    best = finding.results[0]
    found, alignment = index.document(best.hit.map_id), best.alignment
    assert alignment is not None
    mapping = index.parameters.mapping
    sought, seen = (Shape.of(document.text, mapping.cell) for document in (query, found))
    pose = Uncertain(alignment.pose, alignment_covariance(sought, seen, alignment.pose, mapping))
    return Candidate(query, found, alignment.inlier_ratio, pose)


def _known(query: Document) -> Query:
    """The maps of other datasets, and those of the query's own that the robot had left before."""
    past = NumberRange("travel", None, query.middle - APART)
    return Or([Not(Term("dataset", query.dataset)), past])


def alignment_covariance(query: Shape, found: Shape, pose: Floats, mapping: MappingParameters) -> Floats:
    """(3, 3) covariance of the ``pose`` (3,) of the query in the found map's frame, in the query's frame.

    That of a point-to-line fit by least squares: large along a wall if little stands across it. As the runs of
    queries overlap, the loops of one visit repeat each other, and each says so much less.
    """
    back = inverse(pose)
    walls = transform(back, found.points)
    across = transform(np.array([0.0, 0.0, back[2]]), found.normals)
    near = KDTree(walls).query(query.points, distance_upper_bound=INLIER)
    distance, nearest = (np.asarray(part) for part in near)
    points, partner = query.points[np.isfinite(distance)], nearest[np.isfinite(distance)]
    lever = across[partner, 1] * points[:, 0] - across[partner, 0] * points[:, 1]
    slopes = np.column_stack([across[partner], lever])
    misfit = ((points - walls[partner]) * across[partner]).sum(axis=1)
    held = max(int(slopes.any(axis=1).sum()), 1)
    variance = max(float((misfit**2).sum()) / held, LEAST_NOISE**2) * CORRELATION
    fit = np.linalg.inv(slopes.T @ slopes / variance + np.diag(KNOWN_ANYWAY))  # nothing may hold a direction
    return (np.diag(REMAINDER**2) + fit) * mapping.run_length / EVERY
