"""The command `evaluate-loops`."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from m2t_text.cli.compiling import compile_all_for
from m2t_text.cli.console import bars, note, print_json, print_lines, print_table
from m2t_text.cli.options import JobsOption, JsonOption, reads_logs
from m2t_text.config import PROFILES
from m2t_text.errors import M2TError

if TYPE_CHECKING:
    from m2t_text.evaluation.loops import Assessment
    from m2t_text.sources.opening import SourceOptions

STAGES = {
    "odometry": "odometry",
    "scan_matching": "and scan matching",
    "loops": "and loops, plain least squares",
    "map": "and neighbours, as in `map`",
}


@reads_logs
def evaluate_loops(
    sources: Annotated[
        list[Path],
        typer.Argument(metavar="SOURCE...", help="Logs with corrected poses, or one with --relations."),
    ],
    relations: Annotated[
        Path | None,
        typer.Option(
            "--relations",
            metavar="FILE",
            help="Relative poses measured by hand, a line each: t1 t2 x y z roll pitch yaw.",
            show_default="the log's corrected poses",
        ),
    ] = None,
    jobs: JobsOption = None,
    as_json: JsonOption = False,
    *,
    reading: "SourceOptions",
) -> None:
    """Judge how far loops correct the trajectory of logs.

    With relations by the metric of the SLAM benchmark (Kümmerle et al., 2009), beside what others published for
    a log of this name; without, by the corrected poses that the logs carry. Both only judge.

    [bold]Examples[/bold]

    \b
    m2t-text evaluate-loops aces-raw.log.gz --relations aces-raw.relations.gz
    m2t-text evaluate-loops intel-corrected.log.gz fr101.log.gz
    """
    from m2t_text.evaluation.loops import assess
    from m2t_text.evaluation.relations import read_relations
    from m2t_text.loops.detection import detect_loops
    from m2t_text.sources.opening import dataset_names, open_log
    from m2t_text.util.workers import cores

    if relations is not None and len(sources) > 1:
        raise M2TError("--relations belong to one log, but there are several: name them one by one")
    known = None if relations is None else read_relations(relations)
    assessments = []
    compile_all_for(PROFILES["default"])
    with bars() as progress:
        names = dataset_names(sources, "evaluated", reading.name)
        for source, name in zip(sources, names, strict=True):
            tell = partial(progress, name)
            log = open_log(source, reading, partial(tell, "reading"))
            for warning in log.warnings:
                note(f"warning: {log.name}: {warning}")
            detection = detect_loops(log, None, cores(jobs), tell)
            assessments.append(assess(detection, known, cores(jobs), tell))
    if as_json:
        print_json({"datasets": [one.to_json() for one in assessments]})
    elif known is not None:
        _print_relations(assessments[0])
    else:
        _print_absolute(assessments)


def _print_relations(one: "Assessment") -> None:
    from m2t_text.evaluation.relations import published

    rows = []
    for stage, label in STAGES.items():
        errors = one.relative[stage]
        rows.append([label, _figures(errors.translation, 4), _figures(errors.rotation, 3)])
    rows += [[who, _figures(figures, 4), ""] for who, figures in published(one.name).items()]
    used = one.relative["map"]
    columns = {"trajectory": "left", "translational error (m)": "right", "rotational error (°)": "right"}
    print_table(f"{one.name}: {used.relations:,} relations, {one.loops:,} loops", columns, rows)
    if used.left_out:
        print_lines(f"{used.left_out:,} relations left out: no scan within half a second of their times")
    if published(one.name):
        print_lines("Published values are quoted, Cartographer's from memory")


def _print_absolute(assessments: list["Assessment"]) -> None:
    rows = [
        [
            one.name,
            f"{one.loops:,}",
            str(one.wrong),
            *(f"{error:.3f}" for error in one.absolute.values()),
            *_cells(one),
        ]
        for one in assessments
    ]
    names = ("log", "loops", "wrong", "odometry", "scan matching", "loops ", "map", "precision", "recall")
    columns = dict.fromkeys(names, "right")
    print_table("Absolute trajectory error in m, before and after", columns | {"log": "left"}, rows)
    print_lines(
        "Precision and recall: of the map's occupied cells of 0.1 m, against those at the corrected poses; "
        "in brackets with the cells beside them"
    )


def _cells(one: "Assessment") -> list[str]:
    cells = one.cells
    assert cells is not None
    return [
        f"{100 * cells.precision:.1f} ({100 * cells.near_precision:.1f})",
        f"{100 * cells.recall:.1f} ({100 * cells.near_recall:.1f})",
    ]


def _figures(figures: tuple[float, float], digits: int) -> str:
    mean, deviation = figures
    return f"{mean:.{digits}f} ± {deviation:.{digits}f}"
