"""The command that judges, by the ground truth, how well runs are found in saved maps: evaluate-map."""

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from m2t_text.cli.compiling import compile_all_for
from m2t_text.cli.console import a_number, bars, note, print_json, print_table
from m2t_text.cli.options import JobsOption, JsonOption, reads_logs
from m2t_text.config import PROFILES
from m2t_text.util.files import make_folder
from m2t_text.util.workers import cores

if TYPE_CHECKING:
    from m2t_text.evaluation.saved_maps import EvaluatedMap
    from m2t_text.sources.opening import SourceOptions


@reads_logs
def evaluate_map(
    sources: Annotated[
        list[Path], typer.Argument(metavar="SOURCE...", help="Laser logs with corrected poses.")
    ],
    run: Annotated[
        float,
        typer.Option(
            min=0.0, callback=a_number, metavar="METRES", help="Travel in a query; 0 for single scans."
        ),
    ] = 3.0,
    queries: Annotated[int, typer.Option(min=1, metavar="N", help="Queries drawn of each log.")] = 200,
    covered: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=1.0,
            callback=a_number,
            metavar="SHARE",
            help="Share of a query's points that the map must show.",
        ),
    ] = 0.65,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Another seed, another draw.")] = 0,
    jobs: JobsOption = None,
    maps: Annotated[Path | None, typer.Option(metavar="DIR", help="Keep the maps that are drawn.")] = None,
    as_json: JsonOption = False,
    *,
    reading: "SourceOptions",
) -> None:
    """Judge how well runs of a log are found in a saved map, drawn from the log's first half.

    The ground truth draws the map and judges the poses found in it. The queries are runs of the second half,
    where the map covers them, from raw odometry and scans. A pose is right within 0.5 m and 5 degrees.

    [bold]Examples[/bold]

    \b
    m2t-text evaluate-map robot.log
    m2t-text evaluate-map robot.log --run 0          single scans
    m2t-text evaluate-map robot.log --maps drawn     to index drawn/robot-map.yaml
    """
    from m2t_text.evaluation.saved_maps import MapEvaluationRequest, evaluate

    if maps is not None:
        make_folder(maps)
    request = MapEvaluationRequest(
        sources, run, queries, covered, seed=seed, jobs=cores(jobs), folder=maps, options=reading
    )
    compile_all_for(PROFILES["default"], mapping=True)
    with bars() as progress:
        evaluated = evaluate(request, progress)
    if maps is not None:
        first = maps / f"{evaluated[0].name}-map.yaml"
        note(f"drew {len(evaluated)} maps into {maps}; go on with: m2t-text index {first}")
    if as_json:
        print_json({"run": run, "covered": covered, "datasets": [one.to_json() for one in evaluated]})
    else:
        _print(evaluated, run)


def _print(evaluated: "list[EvaluatedMap]", run: float) -> None:
    columns = {
        "log": "left",
        "free (m²)": "right",
        "maps": "right",
        "queries": "right",
        "right, %": "right",
        "median error": "right",
        "`match`, %": "right",
        "right of these, %": "right",
    }
    what = f"runs of {run:g} m" if run else "single scans"
    print_table(f"{what}, found in saved maps", columns, [_row(one.to_json()) for one in evaluated])


def _row(figures: dict[str, Any]) -> list[str]:
    metres, turn, sure = (
        figures[name] for name in ("translation_error_median", "rotation_error_median", "match_right")
    )
    return [
        figures["dataset"],
        f"{figures['free']:.0f}",
        f"{figures['maps']:,}",
        f"{figures['queries']:,}",
        f"{figures['right']:.1f}",
        "–" if metres is None else f"{metres:.3f} m, {degrees(turn):.2f}°",
        f"{figures['match']:.1f}",
        "–" if sure is None else f"{sure:.1f}",
    ]
