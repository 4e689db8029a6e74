"""The command `inspect`."""

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from m2t_text.cli.compiling import compile_for
from m2t_text.cli.completion import map_ids
from m2t_text.cli.console import note, print_json
from m2t_text.cli.opening import ClusterOption, opened
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

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from m2t_text.index.searchable import Searchable
    from m2t_text.sources.opening import SourceOptions


@reads_logs
def inspect(
    target: Annotated[
        str, typer.Argument(metavar="TARGET", help=TARGETS, show_default=False, autocompletion=map_ids)
    ],
    index: IndexOption = DEFAULT_INDEX,
    run: RunOption = None,
    cluster: ClusterOption = None,
    as_json: JsonOption = False,
    plot: PlotOption = None,
    *,
    reading: "SourceOptions",
) -> None:
    """Print the text that describes a map.

    [bold]Examples[/bold]

    \b
    m2t-text inspect robot/000123                   its text
    m2t-text inspect robot/000123 --json            with viewpoint and travel
    m2t-text inspect robot.log@12.5 --plot map.png  drawn, straight from a log
    m2t-text inspect robot.log#40 > place.txt       to search for it later
    """
    from m2t_text.config import PROFILES
    from m2t_text.recognition.answer import inspection
    from m2t_text.recognition.queries import Context, resolve

    check_plot(plot)
    with _if_any(index, cluster) as held:
        parameters = held.parameters if held else PROFILES["default"]
        compile_for([target])
        found = resolve(target, Context(parameters, held, reading, run))
    warn(found)
    if plot is not None:
        from m2t_text.plotting.pictures import plot_document

        plot_document(found.text, found.document, parameters.mapping.cell, plot)
        note(f"drew {plot}")
    if as_json:
        print_json(inspection(found, parameters.mapping.cell))
    else:
        print(found.text)


def _if_any(index: Path, cluster: str | None) -> "AbstractContextManager[Searchable | None]":
    """The index; None if it is the default one and was not made yet."""
    without = index == DEFAULT_INDEX and not index.exists() and cluster is None
    return nullcontext() if without else opened(index, cluster)
