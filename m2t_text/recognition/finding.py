"""Finding a place: search by text, verify the best by their geometry, and say how sure the answer is."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log
from time import perf_counter
from typing import Literal

import numpy as np
from whoosh.query import Query as WhooshQuery

from m2t_text.index.map_index import MapIndex
from m2t_text.index.results import Hit
from m2t_text.recognition.queries import Query
from m2t_text.recognition.symmetry import rivals
from m2t_text.recognition.verification import Alignment, Shape, align, relative_pose
from m2t_text.util.geometry import compose
from m2t_text.util.types import Floats

Verdict = Literal["match", "ambiguous", "none"]

VERIFIED = 30  # best hits that are aligned
AGREEMENT = 0.5  # weight of the agreement beside the inlier ratio, in the order of verified hits
DRIFT = (
    2.0,
    0.04,
)  # m, and m per metre of travel: two poses of one trajectory nearer than this may be one place
FITS = 0.6  # inlier ratio from which a map shows the query's place, if no other does
MARGIN = 0.1  # inlier ratio by which it must exceed that of any other place, and of other poses at this one
LIKELY = 0.8  # of the best score, from which a map that was not verified may fit as well
WIDER, RIVALS = 4, 3  # times as many hits are looked through for such maps elsewhere; so many are verified
GRIP = 0.03  # below, the query may slide along a featureless wall
WEAK = 0.4  # inlier ratio below which nothing fits


@dataclass(frozen=True)
class Found:
    """A hit, and once it is verified how the query lies on it.

    Attributes:
        hit: as the index found it.
        pose: (3,) the query's first-scan robot frame in the hit's first-scan robot frame, or in each case the
            frame of a map that was not driven; None where it was not verified, or where the query is a text.
        inlier_ratio: of the alignment, None where it was not verified.
        alignment: of the two texts, None where it was not verified.
    """

    hit: Hit
    pose: Floats | None = None
    inlier_ratio: float | None = None
    alignment: Alignment | None = None

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
class Finding:
    """The answer: results, the best first, the verdict on the first, and the seconds that it took."""

    results: list[Found]
    verdict: Verdict
    search_seconds: float
    verify_seconds: float


def find(
    index: MapIndex,
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
    hits = index.search(query.text, max(top, VERIFIED) if top and verify else top, exclude, filter=filter)
    searched = perf_counter() - begin
    if not verify:
        unsure: Verdict = "ambiguous" if hits and hits[0].score > 0 else "none"
        return Finding([Found(hit) for hit in hits], unsure, searched, 0.0)
    begin = perf_counter()
    verified = verify_hits(index, query, [hit for hit in hits[:VERIFIED] if hit.score > 0])
    results = verified + [Found(hit) for hit in hits[len(verified) :]]
    answer = verdict(verified)
    if answer == "match" and (
        fits_otherwise(index, query, verified[0]) or fits_elsewhere(index, query, verified, hits, exclude)
    ):
        answer = "ambiguous"
    return Finding(results[: top or None], answer, searched, perf_counter() - begin)


def verify_hits(index: MapIndex, query: Query, hits: Sequence[Hit]) -> list[Found]:
    """The hits aligned with the query, best first: by inlier ratio and agreement, ties by score, size, map id.

    Both count more where both maps are large, as they say more: a short piece of wall fits anywhere.

    Examples:
        >>> import m2t_text as m2t
        >>> index = m2t.MapIndex.open("indexes/default")
        >>> query = m2t.Query.of(index.document("drive/000040"))
        >>> best = m2t.verify_hits(index, query, index.search(query.text, top=5))[0]
        >>> best.inlier_ratio, best.pose.round(2).tolist()
        (1.0, [0.0, 0.0, 0.0])
    """
    texts = [index.document(hit.map_id).text for hit in hits]
    alignments = align(query.text, texts, index.parameters.mapping.cell)
    weights = [log(1 + min(len(query.text), len(text))) for text in texts]
    fits = [
        weight * (alignment.inlier_ratio + AGREEMENT * alignment.agreement)
        for weight, alignment in zip(weights, alignments, strict=True)
    ]
    unlike = [abs(len(query.text) - len(text)) for text in texts]
    order = sorted(range(len(hits)), key=lambda k: (-fits[k], -hits[k].score, unlike[k], hits[k].map_id))
    return [_found(query, hits[k], alignments[k]) for k in order]


def _found(query: Query, hit: Hit, alignment: Alignment) -> Found:
    document = query.document
    pose = None if document is None else relative_pose(document, hit.document, alignment.pose)
    return Found(hit, pose, alignment.inlier_ratio, alignment)


def verdict(verified: Sequence[Found]) -> Verdict:
    """Whether the first of the verified hits is the place: it fits, holds the pose, and no other place fits.

    The thresholds make `match` right 99 times in 100 on eight simulated buildings; real logs confirmed them.
    """
    if not verified or (verified[0].inlier_ratio or 0.0) < WEAK:
        return "none"
    best = verified[0]
    assert best.alignment is not None and best.inlier_ratio is not None
    rival = max((one.inlier_ratio or 0.0 for one in verified[1:] if _elsewhere(best, one)), default=0.0)
    sure = best.inlier_ratio >= FITS and best.inlier_ratio - rival >= MARGIN and best.alignment.grip >= GRIP
    return "match" if sure else "ambiguous"


def fits_otherwise(index: MapIndex, query: Query, best: Found) -> bool:
    """Whether a query lies nearly as well on a verified hit at another pose: the place is symmetric."""
    assert best.alignment is not None
    cell = index.parameters.mapping.cell
    shapes = Shape.of(query.text, cell), Shape.of(index.document(best.hit.map_id).text, cell)
    others = rivals(*shapes, best.alignment.pose)
    return any(best.alignment.inlier_ratio - other.inlier_ratio < MARGIN for other in others)


def fits_elsewhere(
    index: MapIndex,
    query: Query,
    verified: Sequence[Found],
    hits: Sequence[Hit],
    exclude: tuple[str, float, float] | None = None,
) -> bool:
    """Whether a place fits as well as the best, none of whose maps is among the verified: one place may have
    more maps than are verified. The ``hits`` are those of the search, from which it goes on."""
    best, known = verified[0], {one.hit.map_id for one in verified}
    floor = LIKELY * hits[0].score

    def likely_elsewhere() -> list[Hit]:
        unknown = [hit for hit in hits if hit.score >= floor and hit.map_id not in known]
        return [hit for hit in unknown if _elsewhere(best, Found(hit))]

    others, before = likely_elsewhere(), 0
    while not others and hits[-1].score >= floor and len(hits) > before:
        before = len(hits)
        hits = index.search(query.text, WIDER * before, exclude)
        others = likely_elsewhere()
    return verdict([best, *verify_hits(index, query, others[:RIVALS])]) != "match"


def _elsewhere(a: Found, b: Found) -> bool:
    """Whether two hits place the query's viewpoint so far apart that drift cannot account for it."""
    if a.hit.document.dataset != b.hit.document.dataset:
        return True
    away = np.hypot(*(_place(a) - _place(b)))
    return bool(away > DRIFT[0] + DRIFT[1] * abs(a.hit.document.middle - b.hit.document.middle))


def _place(one: Found) -> Floats:
    """(2,) the query's viewpoint in the frame of the hit's dataset, according to the hit."""
    document = one.hit.document
    return compose(document.pose, compose(document.viewpoint, one.laid))[:2]
