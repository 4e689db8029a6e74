"""Commands that read an index: search, inspect, info."""

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from m2t_text.cli.console import a_number, note, print_json, print_lines, print_table

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from m2t_text.answers import Answer
    from m2t_text.index.results import IndexInfo
    from m2t_text.index.store import MapIndex
    from m2t_text.keeping import Unreadable
    from m2t_text.queries import Query

DEFAULT_INDEX = Path("indexes/default")

IndexOption = Annotated[
    Path, typer.Option("--index", metavar="DIR", envvar="M2T_INDEX", help="The folder of the index.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]
PlotOption = Annotated[
    Path | None, typer.Option("--plot", metavar="FILE", help="Draw a picture: .png, .pdf or .svg.")
]
LogNameOption = Annotated[
    str | None,
    typer.Option(
        "--name", metavar="NAME", help="The dataset that the log is in the index, if not its file's name."
    ),
]
ScanTopicOption = Annotated[
    str | None,
    typer.Option(
        "--scan-topic", metavar="TOPIC", help="Laser scans of a ROS bag.", show_default="the only one"
    ),
]
OdometryTopicOption = Annotated[
    str | None,
    typer.Option(
        "--odometry-topic",
        metavar="TOPIC",
        help="Odometry of a ROS bag; /tf takes it from there.",
        show_default="the only one, else tf",
    ),
]
JobsOption = Annotated[
    int | None, typer.Option("--jobs", min=1, metavar="N", help="Processes.", show_default="all cores")
]
RunOption = Annotated[
    float | None,
    typer.Option(
        "--run",
        min=0.0,
        callback=a_number,
        metavar="METRES",
        help="Travel in a map that is cut from a log; 0 for a single scan.",
        show_default="as in the index",
    ),
]
HeightOption = Annotated[
    tuple[float, float] | None,
    typer.Option(
        "--height",
        metavar="FROM TO",
        help="Cut a cloud to these heights, in metres.",
        show_default="0.3 to 1.5 above its floor",
    ),
]
TARGETS = (
    "A map id; LOG@METRES or LOG#SCAN, where a map begins in a log; a .txt file or - with a text; "
    "a point cloud."
)


def search(
    query: Annotated[str, typer.Argument(metavar="QUERY", help=TARGETS, show_default=False)],
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
    no_verify: Annotated[bool, typer.Option("--no-verify", help="Rank by the texts' scores alone.")] = False,
    name: LogNameOption = None,
    run: RunOption = None,
    scan_topic: ScanTopicOption = None,
    odometry_topic: OdometryTopicOption = None,
    height: HeightOption = None,
    as_json: JsonOption = False,
    plot: PlotOption = None,
) -> None:
    """Find the maps of the index that show the same place as QUERY.

    [bold]Examples[/bold]

    \b
    m2t-text search robot/000123                       a map of the index
    m2t-text search robot/000123 --exclude-travel 10   on other visits only
    m2t-text search new.log@35 --plot match.png        35 m into a log, drawn
    m2t-text search new.log#200 --top 3 --json         at scan 200, for scripts
    m2t-text search new.log#200 --run 0                the single scan 200
    m2t-text inspect robot/000123 | m2t-text search -  a text
    m2t-text search room.pcd --height 0.2 1.0          a point cloud
    """
    from m2t_text.answers import SearchOptions
    from m2t_text.answers import search as find
    from m2t_text.index.store import MapIndex
    from m2t_text.logs import Topics
    from m2t_text.sources import SourceOptions

    _check(plot)
    options = SearchOptions(top, exclude_travel, not no_verify, run)
    reading = SourceOptions(name, Topics(scan_topic, odometry_topic), height)
    answer = find(query, MapIndex.open(index), options, reading)
    _warn(answer.query)
    if plot is not None:
        _draw(answer, plot)
    if as_json:
        print_json(answer.to_json())
    else:
        _print_answer(answer)


def inspect(
    target: Annotated[str, typer.Argument(metavar="TARGET", help=TARGETS, show_default=False)],
    index: IndexOption = DEFAULT_INDEX,
    name: LogNameOption = None,
    run: RunOption = None,
    scan_topic: ScanTopicOption = None,
    odometry_topic: OdometryTopicOption = None,
    height: HeightOption = None,
    as_json: JsonOption = False,
    plot: PlotOption = None,
) -> None:
    """Print the text that describes a map.

    [bold]Examples[/bold]

    \b
    m2t-text inspect robot/000123                   its text
    m2t-text inspect robot/000123 --json            with viewpoint and travel
    m2t-text inspect robot.log@12.5 --plot map.png  drawn, straight from a log
    m2t-text inspect robot.log#40 > place.txt       to search for it later
    """
    from m2t_text.answers import inspection
    from m2t_text.config import PROFILES
    from m2t_text.logs import Topics
    from m2t_text.queries import Context, resolve
    from m2t_text.sources import SourceOptions

    _check(plot)
    opened = _if_any(index)
    parameters = opened.parameters if opened else PROFILES["default"]
    reading = SourceOptions(name, Topics(scan_topic, odometry_topic), height)
    found = resolve(target, Context(parameters, opened, reading, run))
    _warn(found)
    if plot is not None:
        from m2t_text.plots import plot_document

        plot_document(found.text, found.document, plot)
        note(f"drew {plot}")
    if as_json:
        print_json(inspection(found))
    else:
        print(found.text)


def info(context: typer.Context, index: IndexOption = DEFAULT_INDEX, as_json: JsonOption = False) -> None:
    """Say what an index holds; if none is named, also which others lie in indexes/.

    [bold]Examples[/bold]

    \b
    m2t-text info
    m2t-text info --index indexes/office --json
    """
    from m2t_text.answers import listing, summary
    from m2t_text.index.store import MapIndex
    from m2t_text.keeping import indexes_in

    source = context.get_parameter_source("index")
    unnamed = source is not None and source.name == "DEFAULT"
    beside = indexes_in(index.parent) if unnamed else []
    if as_json:
        document = summary(MapIndex.open(index).info())
        print_json(document | {"indexes": listing(beside)} if unnamed else document)
        return
    if index.exists() or not beside:
        _print_info(MapIndex.open(index).info())
    if [one.path for one in beside] not in ([], [index]):
        _print_indexes(index.parent, beside)


def _print_info(held: "IndexInfo") -> None:
    rows = [[d.name, f"{d.maps:,}", f"{d.scans:,}", f"{d.travel:,.1f}"] for d in held.datasets]
    title = f"{held.path}: {held.maps:,} maps, {held.keypoints:,} keypoints, {held.bytes / 1e6:.2f} MB"
    columns = {"dataset": "left", "maps": "right", "scans": "right", "travel (m)": "right"}
    print_table(f"{title}, profile {held.parameters.profile}", columns, rows)


def _print_indexes(folder: Path, indexes: "list[IndexInfo | Unreadable]") -> None:
    from m2t_text.index.results import IndexInfo

    rows = []
    for one in indexes:
        if isinstance(one, IndexInfo):
            numbers = [f"{len(one.datasets):,}", f"{one.maps:,}", f"{one.bytes / 1e6:.2f}"]
            rows.append([str(one.path), one.parameters.profile, *numbers])
        else:
            rows.append([str(one.path), "unreadable", "", "", ""])
            note(f"warning: {one.path}: {one.reason}")
    columns = {"index": "left", "profile": "left"} | dict.fromkeys(("datasets", "maps", "size (MB)"), "right")
    print_table(f"{len(indexes)} indexes in {folder}; --index names one", columns, rows)


def _print_answer(answer: "Answer") -> None:
    rows = []
    for rank, result in enumerate(answer.finding.results, start=1):
        document, hit = result.hit.document, result.hit
        begin, end = document.travel
        fit = "" if result.inlier_ratio is None else f"{result.inlier_ratio:.0%}"
        pose = "" if result.pose is None else "{:.2f} {:.2f} {:.0f}°".format(*_degrees(result.pose))
        rows.append([str(rank), hit.map_id, f"{hit.score:.4g}", fit, pose, f"{begin:.2f}–{end:.2f}"])
    title = f"{answer.query.title}: {len(answer.query.text)} keypoints"
    columns = {"#": "right", "map": "left", "score": "right", "inliers": "right", "pose (m, m)": "right"}
    print_table(title, columns | {"travel (m)": "right"}, rows)
    finding, index = answer.finding, answer.index
    seconds = (
        f"described in {answer.describe_seconds:.2f} s, searched in {finding.search_seconds:.2f} s, "
        f"verified in {finding.verify_seconds:.2f} s"
    )
    print_lines(f"verdict: {finding.verdict}")
    place = finding.results[0].dataset_pose if finding.results else None
    if place is not None:
        best = finding.results[0].hit.document.dataset
        print_lines("pose in the frame of {}: {:.2f} {:.2f} {:.0f}°".format(best, *_degrees(place)))
    print_lines(f"{len(index):,} maps of {index.path}, profile {index.parameters.profile}; {seconds}")


def _degrees(pose: "NDArray[np.float64]") -> tuple[float, float, float]:
    return float(pose[0]), float(pose[1]), degrees(pose[2])


def _draw(answer: "Answer", path: Path) -> None:
    from m2t_text.plots import PANELS, plot_match

    found = [(r, answer.index.document(r.hit.map_id).text) for r in answer.finding.results[:PANELS]]
    plot_match(answer.query.text, answer.query.title, found, answer.index.parameters.matching.tolerance, path)
    note(f"drew {path}")


def _warn(query: "Query") -> None:
    for warning in query.warnings:
        note(f"warning: {query.title}: {warning}")


def _check(plot: Path | None) -> None:
    """Before the work, that a picture can be written."""
    if plot is not None:
        from m2t_text.plots import check_picture

        check_picture(plot)


def _if_any(index: Path) -> "MapIndex | None":
    """The index; None if it is the default one and was not made yet."""
    from m2t_text.index.store import MapIndex

    return None if index == DEFAULT_INDEX and not index.exists() else MapIndex.open(index)
