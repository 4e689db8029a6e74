"""What the commands answer, as objects that are printed, saved as JSON and compared."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from time import perf_counter
from typing import Any

from m2t_text.errors import QueryError
from m2t_text.index.searchable import Searchable
from m2t_text.recognition.covariance import dataset_covariance
from m2t_text.recognition.finding import Finding, find, find_many
from m2t_text.recognition.found import Found
from m2t_text.recognition.queries import Context, Query, resolve
from m2t_text.sources.opening import SourceOptions


@dataclass(frozen=True)
class SearchOptions:
    """How to search.

    Attributes:
        top: number of results; 0 for every map.
        exclude_travel: metres; None to exclude nothing.
        verify: whether the best hits are aligned and judged.
        run: metres of travel in a query that is cut from a log; None for as many as in the maps of the index.
        sequence: metres of the drive up to the query's end that count, its hits having to agree on one motion;
            None for the query alone.
    """

    top: int = 10
    exclude_travel: float | None = None
    verify: bool = True
    run: float | None = None
    sequence: float | None = None


@dataclass(frozen=True)
class Answer:
    """What a search found, and how long its steps took in seconds."""

    query: Query
    index: Searchable
    finding: Finding
    describe_seconds: float

    def to_json(self) -> dict[str, Any]:
        """The document of ``search --json``."""
        origin = self.query.document
        driven = origin if self.query.driven else None
        return {
            "query": {
                "map_id": origin.map_id if origin else None,
                "dataset": origin.dataset if origin else None,
                "first_scan": driven.first_scan if driven else None,
                "last_scan": driven.last_scan if driven else None,
                "keypoints": len(self.query.text),
            },
            "index": {
                "path": str(self.index.path),
                "maps": len(self.index),
                "missing_maps": self.index.missing_maps,
                "profile": self.index.parameters.profile,
            },
            "seconds": {
                "describe": self.describe_seconds,
                "search": self.finding.search_seconds,
                "verify": self.finding.verify_seconds,
            },
            "verdict": self.finding.verdict,
            "probability": self.finding.assessment.probability,
            "reason": asdict(self.finding.assessment.reason),
            "results": [
                _result(rank, result, driven is not None) | {"covariance": self._covariance(result)}
                for rank, result in enumerate(self.finding.results, start=1)
            ],
        }

    def _covariance(self, result: Found) -> list[list[float]] | None:
        """Of the query's pose in the frame of the hit's dataset."""
        query, alignment = self.query.document, result.alignment
        if query is None or alignment is None or result.dataset_pose is None:
            return None
        found, cell = self.index.document(result.hit.map_id), self.index.parameters.mapping.cell
        covariance: list[list[float]] = dataset_covariance(query, found, alignment, cell).tolist()
        return covariance


def _result(rank: int, result: Found, driven: bool) -> dict[str, Any]:
    document = result.hit.document
    pose = None if result.pose is None else result.pose.tolist()
    return {
        "rank": rank,
        "map_id": document.map_id,
        "dataset": document.dataset,
        "first_scan": document.first_scan,
        "last_scan": document.last_scan,
        "travel": document.travel.tolist(),
        "score": result.hit.score,
        "matched": result.hit.matched,
        "pose": pose if driven else None,
        "frame_pose": pose,  # the same, and that of the frame of a query without scans
        "dataset_pose": None if result.dataset_pose is None else result.dataset_pose.tolist(),
        "inlier_ratio": result.inlier_ratio,
        "conflict_ratio": result.conflict_ratio,
    }


def search(
    target: str,
    index: Searchable,
    options: SearchOptions = SearchOptions(),
    reading: SourceOptions | None = None,
    where: str | None = None,
) -> Answer:
    """Finds the maps of the index that show what ``target`` names; ``reading`` says how, if it is a file.

    Only maps that ``where`` finds, a query of Whoosh's language, are looked at.

    Raises:
        QueryError, SourceError, TextError: if it names nothing that can be searched.

    Examples:
        >>> import m2t_text as m2t
        >>> index = m2t.MapIndex.open("indexes/default")
        >>> answer = m2t.search("drive.log@8", index, m2t.SearchOptions(top=1))
        >>> answer.finding.verdict
        'match'
    """
    begin = perf_counter()
    index = index.pinned()
    query = resolve(
        target, Context(index.parameters, index, reading or SourceOptions(), options.run, options.sequence)
    )
    return answer(query, index, options, perf_counter() - begin, where)


def search_many(
    queries: Sequence[Query],
    index: Searchable,
    options: SearchOptions = SearchOptions(),
    where: str | None = None,
) -> Iterator[Answer]:
    """What `search` answers to each of many queries, in order and of one state of the index; see `find_many`.

    Raises:
        QueryError: before the first answer, if there is nothing to search for.
    """
    index = index.pinned()
    for query in queries:
        _check(query)
        query.excluding(options.exclude_travel)
    chosen = None if where is None else index.parse(where)
    found = find_many(index, queries, options.top, options.exclude_travel, options.verify, chosen)
    return (Answer(query, index, finding, 0.0) for query, finding in zip(queries, found, strict=True))


def _check(query: Query) -> None:
    if not len(query.text):
        raise QueryError(f"{query.title} has no keypoints: the robot saw nothing there")


def answer(
    query: Query,
    index: Searchable,
    options: SearchOptions,
    described: float = 0.0,
    where: str | None = None,
) -> Answer:
    """Finds the maps of the index that show what a query shows; it took ``described`` seconds to make.

    Only maps that ``where`` finds, a query of Whoosh's language, are looked at.

    Raises:
        QueryError: if there is nothing to search for.
    """
    _check(query)
    index.model()  # loads the compiled code, which is no part of any one search
    exclude = query.excluding(options.exclude_travel)
    chosen = None if where is None else index.parse(where)
    return Answer(query, index, find(index, query, options.top, exclude, options.verify, chosen), described)


def inspection(query: Query, cell: float) -> dict[str, Any]:
    """The document of ``inspect --json``. A text alone is its own map, seen from its viewpoint."""
    text, document = query.text, query.document
    centre = text.positions().mean(axis=0) * cell if document is None else document.centre_of_gravity
    return {
        "map_id": document.map_id if document else None,
        "text": str(text),
        "keypoints": len(text),
        "words": text.words,
        "free_squares": len(text.free),
        "viewpoint": document.viewpoint.tolist() if document else [0.0, 0.0, 0.0],
        "centre_of_gravity": centre.tolist(),
        "points": document.points if document else len(text),
        "travel": document.travel.tolist() if document and document.driven else None,
    }
