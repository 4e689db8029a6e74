"""Many queries in one go: read from a file, looked up side by side, and told of line by line."""

import sys
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from m2t_text.cli.compiling import compile_for
from m2t_text.cli.console import bars, print_json, print_lines, print_table, shown, sure
from m2t_text.cli.opening import warn_of_missing
from m2t_text.cli.options import warn
from m2t_text.errors import M2TError, QueryError

if TYPE_CHECKING:
    from m2t_text.index.searchable import Searchable
    from m2t_text.recognition.answer import Answer, SearchOptions
    from m2t_text.recognition.queries import Query
    from m2t_text.sources.opening import SourceOptions

LIMIT = 1 << 26  # bytes of a file of queries


def search_all(
    name: str,
    index: "Searchable",
    options: "SearchOptions",
    reading: "SourceOptions",
    where: str | None,
    as_json: bool,
) -> None:
    """Answers all queries of a file. What is wrong with one is said before any is looked up."""
    from m2t_text.recognition.answer import search_many

    targets = read_targets(name)
    begin = perf_counter()
    index = index.pinned()
    compile_for(targets.values(), index.parameters, options.verify)
    with bars() as progress:
        queries = _resolved(name, targets, index, options, reading, progress)
        answers = []
        for answer in search_many(queries, index, options, where):
            answers.append(answer)
            progress(name, "looking up", len(answers), len(queries))
    for query in {query.warnings: query for query in queries}.values():
        warn(query)
    warn_of_missing(answers[-1].index)
    seconds = perf_counter() - begin
    if as_json:
        print_json(_as_json(answers, seconds))
    else:
        _print(name, answers, index, seconds)


def read_targets(name: str) -> dict[int, str]:
    """What the lines of a file name, by their numbers; lines that are blank or begin with # name nothing.

    Raises:
        QueryError: if the file cannot be read, is no text, or names nothing.
    """
    shown = "standard input" if name == "-" else repr(name)
    try:
        if name == "-":
            contents = sys.stdin.buffer.read(LIMIT + 1)
        else:
            with Path(name).open("rb") as file:
                contents = file.read(LIMIT + 1)
        lines = contents.decode("utf-8-sig").splitlines()
    except (OSError, AttributeError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or error
        raise QueryError(f"cannot read the queries in {shown}: {reason}") from error
    if len(contents) > LIMIT:
        raise QueryError(f"{shown} is longer than {LIMIT >> 20} MB: look it up in parts")
    targets = {number: line.strip() for number, line in enumerate(lines, start=1)}
    targets = {number: line for number, line in targets.items() if line and not line.startswith("#")}
    if not targets:
        raise QueryError(f"{shown} names no query; write one in each line, as for `m2t-text search QUERY`")
    return targets


def _resolved(
    name: str,
    targets: dict[int, str],
    index: "Searchable",
    options: "SearchOptions",
    reading: "SourceOptions",
    progress: Any,
) -> "list[Query]":
    from m2t_text.recognition.queries import Context, resolve

    context = Context(index.parameters, index, reading, options.run, options.sequence)
    queries = []
    for number, target in targets.items():
        try:
            if target == "-":
                raise QueryError("- is standard input, which cannot be one of many queries")
            query = resolve(target, context)
            if not len(query.text):
                raise QueryError(f"{query.title} has no keypoints: the robot saw nothing there")
            query.excluding(options.exclude_travel)
            queries.append(query)
        except M2TError as error:
            raise QueryError(f"line {number} of {name}: {error}") from error
        progress(name, "reading", len(queries), len(targets))
    return queries


def _as_json(answers: "list[Answer]", seconds: float) -> dict[str, Any]:
    """The document of ``search --queries --json``: that of ``search --json`` for each query, in their order."""
    return {
        "queries": len(answers),
        "seconds": seconds,
        "queries_per_second": len(answers) / max(seconds, 1e-9),
        "answers": [answer.to_json() for answer in answers],
    }


def _print(name: str, answers: "list[Answer]", index: "Searchable", seconds: float) -> None:
    rows = []
    for answer in answers:
        finding = answer.finding
        probability = finding.assessment.probability
        best = finding.results[0] if finding.results else None
        place = None if best is None or finding.verdict == "none" else best.dataset_pose
        rows.append(
            [
                answer.query.title,
                finding.verdict,
                "" if probability is None else sure(probability),
                "" if best is None else best.hit.map_id,
                "" if best is None else f"{best.hit.score:.4g}",
                "" if place is None else shown(place),
            ]
        )
    numbers = ("sure", "score", "pose (m, m)")
    sides = {"query": "left", "verdict": "left", "sure": "right", "best map": "left"}
    print_table(f"{len(rows):,} queries of {name}", sides | dict.fromkeys(numbers[1:], "right"), rows)
    print_lines(
        f"{len(index):,} maps of {index.path}, profile {index.parameters.profile}; {len(rows):,} queries in "
        f"{seconds:.2f} s, {len(rows) / max(seconds, 1e-9):.1f} a second"
    )
