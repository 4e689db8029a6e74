"""All commands as one program."""

from typing import Annotated

import typer

from m2t_text import __version__
from m2t_text.cli.commands.check import check
from m2t_text.cli.commands.cluster import cluster
from m2t_text.cli.commands.evaluate import evaluate
from m2t_text.cli.commands.evaluate_loops import evaluate_loops
from m2t_text.cli.commands.evaluate_map import evaluate_map
from m2t_text.cli.commands.index import demo, index, simulate
from m2t_text.cli.commands.info import info
from m2t_text.cli.commands.inspect import inspect
from m2t_text.cli.commands.live import live, replay
from m2t_text.cli.commands.loops import loops
from m2t_text.cli.commands.maintain import fetch, merge, optimize, remove, warm_up
from m2t_text.cli.commands.map import map_command
from m2t_text.cli.commands.search import search
from m2t_text.cli.commands.serve import serve

app = typer.Typer(
    name="m2t-text",
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
COMMANDS = (
    demo,
    simulate,
    fetch,
    index,
    search,
    inspect,
    info,
    loops,
    live,
    replay,
    serve,
    evaluate,
    evaluate_loops,
    evaluate_map,
    check,
    merge,
    remove,
    optimize,
    warm_up,
)
for command in COMMANDS:
    app.command()(command)
app.command("map")(map_command)
app.add_typer(cluster, name="cluster")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"m2t-text {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    """Find a place again: 2D laser maps as text documents in a full-text index.

    \b
    m2t-text demo                 see it work, without any data
    m2t-text index robot.log      index your log
    m2t-text search robot.log@35  what looks like the place after 35 m
    m2t-text COMMAND --help       examples for each command
    """
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
