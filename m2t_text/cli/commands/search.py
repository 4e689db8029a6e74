"""The command `search`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from m2t_text.cli.compiling import compile_for
from m2t_text.cli.completion import map_ids
from m2t_text.cli.console import a_number, note, print_json, print_lines, print_table, shown, sure
from m2t_text.cli.opening import ClusterOption, PartialOption, opened, warn_of_missing
from m2t_text.cli.options import (
    DEFAULT_INDEX,
    TARGETS,
    IndexOption,
    JsonOption,
    PlotOption,
    RunOption,
    check_plot,
    reads_logs,
    warn,
)
from m2t_text.errors import QueryError

if TYPE_CHECKING:
    from m2t_text.recognition.answer import Answer
    from m2t_text.recognition.finding import Finding
    from m2t_text.sources.opening import SourceOptions


@reads_logs
def search(
    query: Annotated[
        str | None, typer.Argument(metavar="QUERY", help=TARGETS, show_default=False, autocompletion=map_ids)
    ] = None,
    index: IndexOption = DEFAULT_INDEX,
    top: Annotated[int, typer.Option(min=0, metavar="K", help="Number of results; 0 for every map.")] = 10,
    exclude_travel: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            callback=a_number,
            metavar="METRES",
            help="Leave out maps of the same drive within these metres of travel.",
        ),
    ] = None,
    where: Annotated[
        str | None,
        typer.Option(
            metavar="WHERE",
            help="Only maps that this finds: dataset:NAME, travel:[10 TO 40], a token, or TOKEN~ for its "
            "neighbours, too; joined by AND, OR, NOT.",
        ),
    ] = None,
    sequence: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            callback=a_number,
            metavar="METRES",
            help="Look up the last METRES of the drive, up to the query's end, as several maps, whose hits "
            "must agree on one motion.",
        ),
    ] = None,
    no_verify: Annotated[bool, typer.Option("--no-verify", help="Rank by the texts' scores alone.")] = False,
    queries: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Look up many queries in one go, each a line of FILE, or of standard input if that is -.",
        ),
    ] = None,
    run: RunOption = None,
    cluster: ClusterOption = None,
    partial: PartialOption = False,
    as_json: JsonOption = False,
    plot: PlotOption = None,
    *,
    reading: "SourceOptions",
) -> None:
    """Find the maps of the index that show the same place as QUERY.

    [bold]Examples[/bold]

    \b
    m2t-text search robot/000123                       a map of the index
    m2t-text search robot/000123 --exclude-travel 10   on other visits only
    m2t-text search new.log@35 --where 'dataset:robot AND travel:[10 TO 40]'
    m2t-text search new.log@35 --plot match.png        35 m into a log, drawn
    m2t-text search new.log@35 --sequence 20           with the way that led there
    m2t-text search new.log#200 --top 3 --json         at scan 200, for scripts
    m2t-text search new.log#200 --run 0                the single scan 200
    m2t-text inspect robot/000123 | m2t-text search -  a text
    m2t-text search room.pcd --height 0.2 1.0          a point cloud
    m2t-text search robot/000123 --cluster 10.0.0.5:6399   among the maps of a cluster
    m2t-text search --queries ids.txt --json           many at once, in less time
    """
    if (query is None) == (queries is None):
        raise QueryError("name one QUERY, or a file of them with --queries FILE")
    if queries is not None and plot is not None:
        raise QueryError("--plot draws the answer to one QUERY; leave it out with --queries")
    check_plot(plot)
    from m2t_text.cli.batch import search_all
    from m2t_text.recognition.answer import SearchOptions
    from m2t_text.recognition.answer import search as find

    options = SearchOptions(top, exclude_travel, not no_verify, run, sequence)
    with opened(index, cluster, partial) as held:
        if where is not None:
            held.parse(where)  # what is wrong with it is said before anything takes time
        if query is None:
            search_all(str(queries), held, options, reading, where, as_json)
            return
        compile_for([query], held.parameters, not no_verify)
        answer = find(query, held, options, reading, where)
        warn(answer.query)
        if exclude_travel is not None:
            _warn_of_no_dataset(answer)
        if plot is not None:
            _draw(answer, plot)
        if as_json:
            print_json(answer.to_json())
        else:
            _print_answer(answer)
        warn_of_missing(answer.index)


def _warn_of_no_dataset(answer: "Answer") -> None:
    """Says that --exclude-travel had nothing to leave out: a log by another name than it was indexed."""
    document = answer.query.document
    if document is not None and not len(answer.index.runs(document.dataset)[0]):
        note(
            f"warning: --exclude-travel leaves nothing out: {answer.index.lacking(document.dataset)}; if it "
            "holds the query's drive by another name, give that with --name"
        )


def _print_answer(answer: "Answer") -> None:
    rows = []
    for rank, result in enumerate(answer.finding.results, start=1):
        document, hit = result.hit.document, result.hit
        begin, end = document.travel
        fit = [
            "" if share is None else f"{share:.0%}" for share in (result.inlier_ratio, result.conflict_ratio)
        ]
        pose = "" if result.pose is None else shown(result.pose)
        rows.append([str(rank), hit.map_id, f"{hit.score:.4g}", *fit, pose, f"{begin:.2f}–{end:.2f}"])
    finding, index = answer.finding, answer.index
    _print_verdict(finding)
    title = f"{answer.query.title}: {len(answer.query.text)} keypoints"
    numbers = ("score", "inliers", "conflicts", "pose (m, m)", "travel (m)")
    print_table(title, {"#": "right", "map": "left"} | dict.fromkeys(numbers, "right"), rows)
    seconds = (
        f"described in {answer.describe_seconds:.2f} s, searched in {finding.search_seconds:.2f} s, "
        f"verified in {finding.verify_seconds:.2f} s"
    )
    print_lines(f"{len(index):,} maps of {index.path}, profile {index.parameters.profile}; {seconds}")


def _print_verdict(finding: "Finding") -> None:
    """The answer in three lines: the verdict, where the query is if that is known, and why it is said."""
    probability = finding.assessment.probability
    said = "" if probability is None else f" ({sure(probability)} sure)"
    print_lines(f"verdict: {finding.verdict}{said}")
    place = finding.results[0].dataset_pose if finding.results else None
    if place is not None and finding.verdict != "none":
        best = finding.results[0].hit.document.dataset
        print_lines(f"pose in the frame of {best}: {shown(place)}")
    print_lines(f"because: {finding.assessment.reason.text}", "")


def _draw(answer: "Answer", path: Path) -> None:
    from m2t_text.plotting.pictures import PANELS, plot_match

    found = [(r, answer.index.document(r.hit.map_id).text) for r in answer.finding.results[:PANELS]]
    reason = f"{answer.finding.verdict}: {answer.finding.assessment.reason.text}"
    plot_match(answer.query.text, answer.query.title, found, answer.index.parameters, path, reason)
    note(f"drew {path}")
