"""The command that closes loops: loops."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from m2t_text.cli.compiling import compile_all_for
from m2t_text.cli.console import bars, note, print_json, print_lines
from m2t_text.cli.options import JobsOption, JsonOption, PlotOption, reads_logs
from m2t_text.config import PROFILES
from m2t_text.util.files import check_folder
from m2t_text.util.workers import cores

if TYPE_CHECKING:
    from m2t_text.loops.detection import LoopDetection
    from m2t_text.sources.opening import SourceOptions


@reads_logs
def loops(
    source: Annotated[Path, typer.Argument(metavar="SOURCE", help="A laser log.", show_default=False)],
    index: Annotated[
        Path | None,
        typer.Option(
            "--index", metavar="DIR", help="Look places up in this index.", show_default="the log's own past"
        ),
    ] = None,
    g2o: Annotated[
        Path | None, typer.Option("--g2o", metavar="FILE", help="Write the pose graph for an optimiser.")
    ] = None,
    tum: Annotated[
        Path | None, typer.Option("--tum", metavar="FILE", help="Write the trajectory before any correction.")
    ] = None,
    mcap: Annotated[
        Path | None, typer.Option("--mcap", metavar="FILE", help="Write all for Foxglove, as time goes on.")
    ] = None,
    jobs: JobsOption = None,
    as_json: JsonOption = False,
    plot: PlotOption = None,
    *,
    reading: "SourceOptions",
) -> None:
    """Find where a drive comes back to places, as the loop edges of a pose graph.

    The log is read in the order of time, and each place is looked up among those that the robot had left
    before. Only a likely match becomes an edge, and only if neither the trajectory nor another loop contradicts
    it. With an index, places of other drives count too, and its own past as far as the index holds it.

    [bold]Examples[/bold]

    \b
    m2t-text loops robot.log --g2o robot.g2o    for g2o, GTSAM, Ceres
    m2t-text loops robot.log --plot robot.png   drawn
    m2t-text loops robot.log --mcap robot.mcap  for Foxglove
    m2t-text loops robot.log --json             each loop, for scripts
    m2t-text loops new.log --index indexes/office --g2o both.g2o
    """
    from m2t_text.index.map_index import MapIndex
    from m2t_text.loops.detection import detect_loops
    from m2t_text.loops.export import to_g2o, to_json, to_tum, write
    from m2t_text.loops.graph import pose_graph
    from m2t_text.sources.opening import open_log
    from m2t_text.util.names import dataset_name

    for path in (g2o, tum, mcap):
        if path is not None:
            check_folder(path)
    if mcap is not None:
        from m2t_text.loops.foxglove import check_mcap

        check_mcap()
    if plot is not None:
        from m2t_text.plotting.pictures import check_picture

        check_picture(plot)
    opened = None if index is None else MapIndex.open(index)
    compile_all_for(opened.parameters if opened else PROFILES["default"])
    with bars() as progress:
        shown = reading.name or dataset_name(source)
        log = open_log(source, reading, partial(progress, shown, "reading"))
        detection = detect_loops(log, opened, cores(jobs), partial(progress, shown))
    for warning in log.warnings:
        note(f"warning: {log.name}: {warning}")
    graph = pose_graph(detection)
    for path, text in ((g2o, to_g2o(graph)), (tum, to_tum(detection))):
        if path is not None:
            write(path, text)
            note(f"wrote {path}")
    if mcap is not None:
        from m2t_text.loops.foxglove import write_mcap

        write_mcap(detection, graph, mcap)
        note(f"wrote {mcap}")
    if plot is not None:
        from m2t_text.loops.plots import plot_detection

        plot_detection(detection, graph, plot)
        note(f"drew {plot}")
    if as_json:
        print_json(to_json(detection, graph))
    else:
        _print(detection)


def _print(detection: "LoopDetection") -> None:
    refused, waiting = len(detection.refused), len(detection.waiting)
    log, travelled = detection.log, detection.survey.way[-1]
    print_lines(
        f"{log.name}: {len(log.scans):,} scans, {travelled:,.1f} m of travel",
        f"{detection.queries:,} places looked up, {detection.matches:,} with a likely match",
        f"{len(detection.loops):,} loops",
        f"{refused:,} matches refused, which contradict the trajectory or other loops",
        f"{waiting:,} matches left out, which nothing confirms",
    )
