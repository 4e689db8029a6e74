"""Finding a place: search by text, verify the best by their geometry, and say how sure the answer is."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter

from whoosh.query import Query as WhooshQuery

from m2t_text.index.results import Hit
from m2t_text.index.searchable import Searchable
from m2t_text.recognition.earlier import Earlier
from m2t_text.recognition.found import Found, differs, strongest
from m2t_text.recognition.queries import Query
from m2t_text.recognition.raster import Raster
from m2t_text.recognition.sequence import Trail
from m2t_text.recognition.symmetry import other_poses
from m2t_text.recognition.verdict import NOTHING, UNVERIFIED, Assessment, Verdict, assess
from m2t_text.recognition.verification import align_variously, relative_pose
from m2t_text.util.types import Floats
from m2t_text.util.workers import threaded

VERIFIED = 30  # best hits that are aligned
LIKELY = 0.8  # of the best score, from which a map that was not verified may fit as well
RIVALS = 3  # such maps elsewhere that are verified


@dataclass(frozen=True)
class Finding:
    """The answer: results, the best first, how sure the first is, and the seconds that it took."""

    results: list[Found]
    assessment: Assessment
    search_seconds: float
    verify_seconds: float

    @property
    def verdict(self) -> Verdict:
        """Whether the first result is the place."""
        return self.assessment.verdict


def find(
    index: Searchable,
    query: Query,
    top: int = 10,
    exclude: tuple[str, float, float] | None = None,
    verify: bool = True,
    filter: WhooshQuery | None = None,
) -> Finding:
    """The maps that show the query's place.

    The VERIFIED best by score are aligned with the query and ranked anew; the others follow in the order of
    their scores. A ``match`` must fit nowhere else, and in no other way. Without ``verify`` the order is the
    scores' and the verdict never ``match``.

    Args:
        top: number of results at most, 0 for all maps.
        exclude: (dataset, travel, metres), as for `MapIndex.search`.
        filter: of Whoosh; only maps that match it are searched.

    Examples:
        >>> import m2t_text as m2t
        >>> index = m2t.MapIndex.open("indexes/default")
        >>> query = m2t.Query.of(index.document("drive/000040"))
        >>> finding = m2t.find(index, query, top=1)
        >>> [(found.hit.map_id, found.inlier_ratio) for found in finding.results]
        [('drive/000040', 1.0)]
        >>> finding.verdict in ("match", "ambiguous", "none")
        True
    """
    begin = perf_counter()
    index = index.pinned()  # also where it is written meanwhile, the hits' texts are those that were scored
    search = partial(index.search, query.text, exclude=exclude, filter=filter)
    hits = search(max(top, VERIFIED), texts=top <= VERIFIED) if top and verify else search(top)
    searched = perf_counter() - begin
    if not hits or hits[0].score == 0:
        return Finding([Found(hit) for hit in hits], NOTHING, searched, 0.0)
    if not verify:
        return Finding([Found(hit) for hit in hits], UNVERIFIED, searched, 0.0)
    begin = perf_counter()
    trail = trail_of(index, query, exclude, filter)
    verified = verify_along(index, query, [hit for hit in hits[:VERIFIED] if hit.score > 0], trail)
    results = verified + [Found(hit) for hit in hits[len(verified) :]]
    assessment = judge(index, query, verified, search, trail)
    return Finding(results[: top or None], assessment, searched, perf_counter() - begin)


def find_many(
    index: Searchable,
    queries: Iterable[Query],
    top: int = 10,
    exclude_travel: float | None = None,
    verify: bool = True,
    filter: WhooshQuery | None = None,
) -> Iterator[Finding]:
    """What `find` says of each query, in their order and of one state of the index, in less time.

    Each core works on a query of its own, so that none waits for another within a query, and what the queries
    before it found is looked at first. Queries are taken as they are needed.

    Args:
        exclude_travel: metres within which maps of a query's own drive are left out.

    Examples:
        >>> import m2t_text as m2t
        >>> index = m2t.MapIndex.open("indexes/default")
        >>> queries = [m2t.Query.of(document) for document in index.documents("drive")][:20]
        >>> findings = list(m2t.find_many(index, queries, top=1))
        >>> [finding.results[0].hit.map_id for finding in findings] == [query.title for query in queries]
        True
    """
    index = index.pinned()
    index.model()  # loads the compiled code
    return threaded(
        lambda query: find(index, query, top, query.excluding(exclude_travel), verify, filter), queries
    )


def verify_hits(index: Searchable, query: Query, hits: Sequence[Hit]) -> list[Found]:
    """The hits aligned with the query, the same map first, then by evidence; ties by score and map id.

    Examples:
        >>> import m2t_text as m2t
        >>> index = m2t.MapIndex.open("indexes/default")
        >>> query = m2t.Query.of(index.document("drive/000040"))
        >>> best = m2t.verify_hits(index, query, index.search(query.text, top=5))[0]
        >>> best.inlier_ratio, best.pose.round(2).tolist()
        (1.0, [0.0, 0.0, 0.0])
    """
    return verify_along(index, query, hits, Trail(()))


def verify_along(index: Searchable, query: Query, hits: Sequence[Hit], trail: Trail) -> list[Found]:
    """The hits aligned with the query, and with the evidence of earlier texts, the best first."""
    texts = [hit.document.text if len(hit.document.text) else index.document(hit.map_id).text for hit in hits]
    alignments = align_variously(query.text, texts, index.parameters.mapping.cell)
    found = [
        trail.supported(Found(hit, None, some[0], tuple(some[1:])))
        for hit, some in zip(hits, alignments, strict=True)
    ]
    posed = [replace(one, pose=_pose(query, one)) for one in found]
    return sorted(posed, key=_order)


def _order(found: Found) -> tuple[bool, float, float, str]:
    """The same map comes first, which a larger one that holds all of it may else outdo."""
    assert found.alignment is not None
    exact, evidence = found.alignment.fit.exact, found.alignment.evidence
    return (not exact, -evidence, -found.hit.score, found.hit.map_id)


def _pose(query: Query, found: Found) -> Floats | None:
    if query.document is None:
        return None
    return relative_pose(query.document, found.hit.document, found.laid)


def trail_of(
    index: Searchable, query: Query, exclude: tuple[str, float, float] | None, filter: WhooshQuery | None
) -> Trail:
    """What the earlier texts of the query say, each looked up without the maps of its own visit."""

    def search(earlier: Earlier) -> list[Hit]:
        left_out = exclude and (exclude[0], exclude[1] - earlier.behind, exclude[2])
        return index.search(earlier.text, VERIFIED, left_out, filter=filter, texts=True)

    return Trail.of(query.earlier, search, lambda earlier, hits: verify_hits(index, Query(earlier.text), hits))


def judge(
    index: Searchable,
    query: Query,
    verified: Sequence[Found],
    search: Callable[..., list[Hit]],
    trail: Trail,
) -> Assessment:
    """How sure the first of the verified hits is; ``search`` is `MapIndex.search` as it found them.

    What takes longer is done only where the answer would else be a `match`: other poses on the best map, and
    maps elsewhere where all verified ones show one place.
    """
    best = verified[0].alignment
    assert best is not None
    rival = strongest(verified[0], verified)
    others = (
        partial(symmetric, index, query, verified[0]),
        partial(elsewhere, index, query, verified, search),
    )
    for more in others:
        assessment = assess(best.fit, rival)
        if assessment.verdict != "match":
            return assessment
        rival = strongest(verified[0], map(trail.supported, more()), rival)
    return assess(best.fit, rival)


def symmetric(index: Searchable, query: Query, best: Found) -> list[Found]:
    """The query on the best map at other poses."""
    assert best.alignment is not None
    cell = index.parameters.mapping.cell
    rasters = Raster.of(query.text, cell), Raster.of(index.document(best.hit.map_id).text, cell)
    return [Found(best.hit, None, other) for other in other_poses(*rasters, best.alignment.pose)]


def elsewhere(
    index: Searchable, query: Query, verified: Sequence[Found], search: Callable[..., list[Hit]]
) -> list[Found]:
    """The likeliest maps elsewhere that were not verified: one place may have more maps than those that were.

    None where a verified one is elsewhere, as it is more likely, or where no other map is likely.
    """
    best, floor = verified[0], LIKELY * verified[0].hit.score
    if any(differs(best, one) for one in verified):
        return []
    if len(verified) < VERIFIED or min(one.hit.score for one in verified) < floor:
        return []  # those that were verified have the best scores
    known = frozenset(one.hit.map_id for one in verified)
    return verify_hits(index, query, search(RIVALS, texts=True, least=floor, wanted=Elsewhere(best, known)))


@dataclass(frozen=True)
class Elsewhere:
    """Whether a hit is another answer than the best, and none of those that are ``known``, by their map ids."""

    best: Found
    known: frozenset[str]

    def __call__(self, hit: Hit) -> bool:
        return hit.map_id not in self.known and differs(self.best, Found(hit))
