"""Every query looked up and judged against the ground truth, on several cores."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.document import Document
from m2t_text.evaluation.metrics import best, normalised_ranks, pose_error
from m2t_text.evaluation.protocol import MIN_TRAVEL_APART, RIGHT_DISTANCE, GroundTruth
from m2t_text.index.map_index import MapIndex
from m2t_text.index.search.weighting import Method
from m2t_text.recognition.finding import find
from m2t_text.recognition.queries import Query
from m2t_text.util.geometry import between
from m2t_text.util.types import Floats
from m2t_text.util.workers import mapped

METHODS: tuple[Method, ...] = ("bow", "m2t")  # the paper's two, which rank by the text alone


@dataclass(frozen=True)
class Judgement:
    """What became of one query.

    Attributes:
        query: its number among the maps of the dataset.
        relevant: number of maps that are relevant to it.
        normalised_rank: by method, the mean over its relevant maps, 0...1.
        distance: by method and for "verified", metres from its place to that of the best hit; inf without one.
        verdict: of the verified search.
        error: metres and radians by which the verified hit's relative pose errs; None if the hit is wrong or
            was not aligned.
        right: whether that pose is right, as a robot needs it: see `GroundTruth.right`.
    """

    query: int
    relevant: int
    normalised_rank: dict[str, float]
    distance: dict[str, float]
    verdict: str
    error: tuple[float, float] | None
    right: bool


def judge(index: MapIndex, truth: GroundTruth, query: int) -> Judgement:
    """Looks up one map of an index that holds its dataset alone, in the order of the truth."""
    document = index.document(index.ids[query])
    relevant, irrelevant = truth.relevance(query)
    distances = truth.distances(query)
    rank: dict[str, float] = {}
    distance: dict[str, float] = {}
    for method in METHODS:
        scores = index.scores(document.text, method).score
        rank[method] = float(normalised_ranks(scores, relevant, irrelevant).mean())
        hit = best(scores, relevant | irrelevant)
        distance[method] = np.inf if hit is None else float(distances[hit])
    # The very search of the command line, so that what is judged is what users get.
    found = Query.of(document)
    finding = find(index, found, exclude=found.excluding(MIN_TRAVEL_APART))
    distance["verified"] = np.inf
    error, right = None, False
    if finding.results:
        first = finding.results[0]
        hit = index.ids.index(first.hit.map_id)
        distance["verified"] = float(distances[hit])
        if first.pose is not None:
            right = truth.right(query, hit, first.pose)
            if distances[hit] <= RIGHT_DISTANCE:
                error = pose_error(first.pose, between(truth.poses[hit], truth.poses[query]))
    return Judgement(query, int(relevant.sum()), rank, distance, finding.verdict, error, right)


def matches(index: MapIndex, apart: float, document: Document) -> bool:
    """Whether a map gets a ``match`` without the maps of its dataset within ``apart`` metres of travel."""
    query = Query.of(document)
    return find(index, query, top=1, exclude=query.excluding(apart)).verdict == "match"


def judge_all(
    path: Path,
    truth: GroundTruth,
    queries: NDArray[np.int64],
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> list[Judgement]:
    """The judgements of all queries, in order, by the index in a folder; the same for any number of jobs."""
    judgements = []
    # Processes, not threads: reading an index moves a file position that threads would share.
    for judgement in mapped(partial(_judge_of, path, truth), queries.tolist(), jobs):
        judgements.append(judgement)
        if progress:
            progress(len(judgements), len(queries))
    return judgements


def _judge_of(path: Path, truth: GroundTruth) -> Callable[[int], Judgement]:
    return partial(judge, MapIndex.open(path), truth)


def count_matches(
    path: Path,
    documents: Sequence[Document],
    apart: float = MIN_TRAVEL_APART,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """How many of the documents get a ``match`` in the index in a folder; see `matches`."""
    count = 0
    for done, match in enumerate(mapped(partial(_matches_of, path, apart), documents, jobs), start=1):
        count += match
        if progress:
            progress(done, len(documents))
    return count


def _matches_of(path: Path, apart: float) -> Callable[[Document], bool]:
    return partial(matches, MapIndex.open(path), apart)


def column(judgements: list[Judgement], name: str, key: str) -> Floats:
    """(Q,) one number of each judgement."""
    return np.array([getattr(judgement, name)[key] for judgement in judgements])
