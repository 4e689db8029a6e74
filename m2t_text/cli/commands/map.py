"""The command `map`."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from m2t_text.cli.compiling import compile_all_for
from m2t_text.cli.console import a_number, bars, note, print_json, print_lines
from m2t_text.cli.options import JobsOption, JsonOption, reads_logs
from m2t_text.config import PROFILES
from m2t_text.errors import M2TError
from m2t_text.util.files import make_folder

if TYPE_CHECKING:
    from m2t_text.slam.mapping import MapOfLogs
    from m2t_text.sources.opening import SourceOptions


@reads_logs
def map_command(
    sources: Annotated[
        list[Path], typer.Argument(metavar="SOURCE...", help="Laser logs or bags.", show_default=False)
    ],
    out: Annotated[
        Path, typer.Option("--out", metavar="FOLDER", help="Folder for the map.", show_default=False)
    ],
    resolution: Annotated[
        float,
        typer.Option(min=0.01, max=1.0, callback=a_number, metavar="METRES", help="Side of a cell of the map."),
    ] = 0.05,
    jobs: JobsOption = None,
    as_json: JsonOption = False,
    *,
    reading: "SourceOptions",
) -> None:
    """Make a map of laser logs: find their loops, correct their trajectories, and draw what the laser saw.

    Writes map.yaml and map.pgm, as Nav2 reads them and `index` does; trajectory.tum with the corrected pose of
    each scan; graph.g2o with all poses and constraints, for other optimisers; map.png to look at; and
    summary.json. Several logs make one map, where loops join them.

    [bold]Examples[/bold]

    \b
    m2t-text map robot.log --out maps/office
    m2t-text map monday.log tuesday.log --out maps/office --resolution 0.1
    m2t-text map handheld.bag --no-odometry --out maps/hall
    m2t-text index maps/office/map.yaml         localise in it
    """
    from m2t_text.slam.files import write_map_folder
    from m2t_text.slam.mapping import map_logs
    from m2t_text.sources.opening import dataset_names, open_log
    from m2t_text.util.names import checked_name
    from m2t_text.util.workers import cores

    names = dataset_names(sources, "made", reading.name)
    if out.exists() and not out.is_dir():
        raise M2TError(f"--out {str(out)!r} is a file: name a folder")
    called = names[0] if len(names) == 1 else checked_name(out.resolve().name)
    compile_all_for(PROFILES["default"], mapping=True)
    with bars() as progress:
        logs = [
            open_log(source, reading, partial(progress, dataset, "reading"))
            for source, dataset in zip(sources, names, strict=True)
        ]
        made = map_logs(logs, called, resolution, cores(jobs), partial(progress, called))
        make_folder(out)
        written = write_map_folder(made, out)
    for log in logs:
        for warning in log.warnings:
            note(f"warning: {log.name}: {warning}")
    for left_out in made.left_out:
        note(f"warning: {left_out} is not in the map: no loop joins it to the other logs")
    if as_json:
        print_json(made.to_json() | {"files": [str(path) for path in written]})
    else:
        _print(made, written)


def _print(made: "MapOfLogs", written: list[Path]) -> None:
    correction, grid, detection = made.correction, made.grid, made.detection
    rows, columns = grid.states.shape
    loops, neighbours = correction.dropped
    log, travelled = detection.log, detection.survey.way[-1]
    print_lines(
        f"{log.name}: {len(log.scans):,} scans, {travelled:,.1f} m of travel",
        f"{correction.count('loop'):,} loops found by text, {loops:,} more left out as others contradict them",
        f"{correction.count('neighbour'):,} pairs of neighbouring scans, {neighbours:,} more left out",
        f"{columns * grid.resolution:,.1f} m x {rows * grid.resolution:,.1f} m, cells of {grid.resolution:g} m",
    )
    for path in written:
        note(f"wrote {path}")
