"""What is answered, as JSON documents: those of the command line, and what the page needs beside them."""

from typing import Any

from m2t_text.description.document import Document, map_id_of
from m2t_text.recognition.answer import answer, inspection
from m2t_text.recognition.comparison import compare
from m2t_text.recognition.finding import Found
from m2t_text.recognition.queries import Query
from m2t_text.web.asking import Search
from m2t_text.web.naming import named
from m2t_text.web.served import Committed
from m2t_text.web.site import Site


def answered(committed: Committed, site: Site, asked: Search) -> dict[str, Any]:
    query = named(asked.query, committed, site.uploads)
    found = answer(query, committed.index, asked.options, where=asked.where)
    document = found.to_json()
    if asked.compare:
        cell = committed.index.parameters.mapping.cell
        document["query_map"] = inspection(query, cell) | _whereabouts(query.document)
        document["comparisons"] = [
            _laid(committed, query, result) for result in found.finding.results[: asked.compare]
        ]
    return document


def _laid(committed: Committed, query: Query, result: Found) -> dict[str, Any]:
    """How a query lies on a hit, and the hit as ``inspect --json`` tells of it."""
    found = committed.index.document(result.hit.map_id)
    cell = committed.index.parameters.mapping.cell
    laid = compare(query.text, found.text, cell, result.alignment)
    return laid.to_json() | {"map": _place(found, cell)}


def compared(committed: Committed, site: Site, a: str, b: str) -> dict[str, Any]:
    one, other = (named(name, committed, site.uploads) for name in (a, b))
    cell = committed.index.parameters.mapping.cell
    laid = compare(one.text, other.text, cell).to_json()
    maps = [inspection(query, cell) | _whereabouts(query.document) for query in (one, other)]
    return laid | {"query": maps[0], "map": maps[1], "cell": cell}


def map(committed: Committed, site: Site, name: str) -> dict[str, Any]:
    query = named(name, committed, site.uploads)
    cell = committed.index.parameters.mapping.cell
    return inspection(query, cell) | _whereabouts(query.document) | {"cell": cell}


def _place(document: Document, cell: float) -> dict[str, Any]:
    return inspection(Query.of(document), cell) | _whereabouts(document)


def _whereabouts(document: Document | None) -> dict[str, Any]:
    if document is None:
        return {"dataset": None, "first_scan": None, "last_scan": None, "dataset_pose": None}
    return {
        "dataset": document.dataset,
        "first_scan": document.first_scan,
        "last_scan": document.last_scan,
        "dataset_pose": document.pose.tolist(),
    }


def listed(
    committed: Committed, where: str | None, dataset: str | None, offset: int, limit: int
) -> dict[str, Any]:
    overview = committed.overview
    part = committed.slice_of(dataset) if dataset else slice(0, len(overview))
    numbers = range(len(overview))[part]
    if where:
        matches = committed.index.matching(where)
        numbers = [number for number in numbers if matches[number]]  # type: ignore[assignment]
    maps = []
    for number in numbers[offset : offset + limit]:
        record, name = overview.records[number], overview.names[int(overview.codes[number])]
        first = int(record["first_scan"])
        maps.append(
            {
                "map_id": map_id_of(name, first),
                "dataset": name,
                "first_scan": first,
                "last_scan": int(record["last_scan"]),
                "travel": record["travel"].tolist(),
                "dataset_pose": record["pose"].tolist(),
                "points": int(record["points"]),
            }
        )
    return {"total": len(numbers), "offset": offset, "maps": maps}
