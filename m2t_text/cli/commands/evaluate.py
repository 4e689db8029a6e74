"""The command that judges places found by the ground truth: evaluate."""

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from m2t_text.cli.compiling import compile_all_for
from m2t_text.cli.console import bars, note, print_json, print_table
from m2t_text.cli.options import JobsOption, JsonOption, reads_logs
from m2t_text.config import PROFILES, parameters_of
from m2t_text.util.files import make_folder
from m2t_text.util.workers import cores

if TYPE_CHECKING:
    from m2t_text.evaluation.run import Evaluation
    from m2t_text.sources.opening import SourceOptions

TEXT_METHODS = ("bow", "m2t")  # those of the paper's Table I


@reads_logs
def evaluate(
    sources: Annotated[
        list[Path],
        typer.Argument(metavar="SOURCE...", help="CARMEN logs with corrected poses."),
    ],
    profile: Annotated[
        str,
        typer.Option(
            metavar="NAME", help=f"Parameters: {', '.join(PROFILES)}.", autocompletion=lambda: list(PROFILES)
        ),
    ] = "default",
    queries: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Queries drawn of each log.", show_default="all"),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Another seed, another draw.")] = 0,
    jobs: JobsOption = None,
    as_json: JsonOption = False,
    plot: Annotated[Path | None, typer.Option(metavar="DIR", help="A folder to draw pictures in.")] = None,
    *,
    reading: "SourceOptions",
) -> None:
    """Measure how well places of a log are found again, as the paper does.

    Maps are built from raw odometry and scans; the corrected poses only judge what was found. Each log is
    looked up in itself, without the maps of the same visit; several logs are looked up in each other, too,
    where each `match` is wrong, as it is at places that were never visited before.

    [bold]Examples[/bold]

    \b
    m2t-text evaluate robot-corrected.log
    m2t-text evaluate *.log.gz --queries 1000 --json
    m2t-text evaluate robot-corrected.log --profile paper --plot pictures
    """
    from m2t_text.evaluation.report import report
    from m2t_text.evaluation.run import EvaluationRequest
    from m2t_text.evaluation.run import evaluate as run

    if plot is not None:
        make_folder(plot)  # before the work, not after it
    compile_all_for(parameters_of(profile))
    with bars() as progress:
        evaluation = run(EvaluationRequest(sources, profile, queries, seed, cores(jobs), reading), progress)
    for one in evaluation.datasets:
        for warning in one.log.warnings:
            note(f"warning: {one.log.name}: {warning}")
    figures = report(evaluation)
    if plot is not None:
        _draw(evaluation, plot)
    if as_json:
        print_json(figures)
    else:
        _print_ranks(figures)
        _print_hits(figures)
        _print_poses(figures)


def _print_ranks(figures: dict[str, Any]) -> None:
    rows = []
    for d in figures["datasets"]:
        paper = d["published_anr"] or {}
        counts = [f"{d['travel']:,.0f}", *(f"{d[key]:,}" for key in ("scans", "maps", "queries", "pairs"))]
        ranks = [_number(d["methods"][method]["anr"]) for method in TEXT_METHODS]
        rows.append([d["dataset"], *counts, *ranks, *(_number(paper.get(method)) for method in TEXT_METHODS)])
    if len(rows) > 1:
        means = [_number(figures["mean"][method]["anr"]) for method in TEXT_METHODS]
        rows.append(["mean", *[""] * 5, *means, "", ""])
    right = ("travel (m)", "scans", "maps", "queries", "pairs", "BoW", "M2T", "BoW (paper)", "M2T (paper)")
    columns = {"dataset": "left"} | dict.fromkeys(right, "right")
    print_table(f"Average normalised rank in %, less is better; profile {figures['profile']}", columns, rows)


def _print_hits(figures: dict[str, Any]) -> None:
    shown = [(d["dataset"], d["methods"]) for d in figures["datasets"]]
    if len(shown) > 1:
        shown.append(("mean", figures["mean"]))
    rows = []
    for name, methods in shown:
        recalls = [" / ".join(map(_number, m["recall_at_1"].values())) for m in methods.values()]
        found = methods["verified"]
        way, turn = found["translation_error_median"], found["rotation_error_median"]
        error = "–" if way is None or turn is None else f"{way:.3f} m, {degrees(turn):.2f}°"
        match = [_number(found["verdict_precision"]), _number(found["verdict_recall"])]
        rows.append([name, *recalls, error, *match])
    right = ("BoW", "M2T", "verified", "pose error", "match: right", "found")
    columns = {"dataset": "left"} | dict.fromkeys(right, "right")
    title = "Best hit within 1 m / 3 m in %; median error of its pose; `match` verdicts: precision, recall in %"
    print_table(title, columns, rows)


def _print_poses(figures: dict[str, Any]) -> None:
    shown = [(d["dataset"], d["methods"]["verified"]) for d in figures["datasets"]]
    if len(shown) > 1:
        shown.append(("mean", figures["mean"]["verified"]))
    rows = []
    for name, found in shown:
        shares = [_number(found[key]) for key in ("pose_recall", "match_precision", "match_recall")]
        wrong = [
            f"{found[f'{kind}_matches']:g} of {found[kind]:g}" if found[kind] else "–"
            for kind in ("unvisited", "elsewhere")
        ]
        rows.append([name, *shares, *wrong])
    right = ("first hit", "match: right", "found", "match where never visited", "in other logs")
    title = "What a robot needs: a pose within 1 m and 10° in %; `match` verdicts where each is wrong"
    print_table(title, {"dataset": "left"} | dict.fromkeys(right, "right"), rows)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.1f}"


def _draw(evaluation: "Evaluation", folder: Path) -> None:
    from m2t_text.evaluation.plots import plot_all

    for path in plot_all(evaluation, folder):
        note(f"drew {path}")
