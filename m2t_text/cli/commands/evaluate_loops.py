"""The command `evaluate-loops`."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from m2t_text.cli.console import bars, print_table


def evaluate_loops(
    sources: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs with corrected poses.")],
) -> None:
    """Print how far the loops of each log correct its trajectory (needs GTSAM).

    [bold]Examples[/bold]

    \b
    m2t-text evaluate-loops intel-corrected.log.gz fr101.log.gz
    """
    from m2t_text.evaluation.loops import assess
    from m2t_text.logs import read_log
    from m2t_text.loops.detection import walk
    from m2t_text.util.names import dataset_name
    from m2t_text.util.workers import cores

    rows = []
    with bars() as progress:
        for source in sources:
            one = assess(walk(read_log(source), None, cores(None), partial(progress, dataset_name(source))))
            before = [f"{error:.2f}" for error in (one.odometry, one.matched)]
            rows.append([one.name, str(one.loops), str(one.wrong), *before, f"{one.optimised:.3f}"])
    columns = dict.fromkeys(("log", "loops", "wrong", "odometry", "scan matching", "optimised"), "right")
    print_table("Absolute trajectory error in m, before and after", columns | {"log": "left"}, rows)
