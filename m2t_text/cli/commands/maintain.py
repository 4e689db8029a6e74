"""Commands that keep things in order: fetch public logs; merge, remove and optimize what indexes hold."""

import os
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from m2t_text.cli.compiling import compile_first
from m2t_text.cli.completion import datasets as names
from m2t_text.cli.console import bars, note, print_held, print_json, print_lines, print_table
from m2t_text.cli.opening import opened
from m2t_text.cli.options import DEFAULT_INDEX, IndexOption, JsonOption
from m2t_text.sources.public_logs import LOGS, SOURCE

if TYPE_CHECKING:
    from m2t_text.index.searchable import Searchable

NICE = 5  # of a process that compiles beside another command


def fetch(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME",
            help="Public logs; without any, they are listed.",
            show_default=False,
            autocompletion=lambda: list(LOGS),
        ),
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", envvar="M2T_CACHE", help="Where logs are kept.", show_default="the user's cache"
        ),
    ] = None,
    mirror: Annotated[
        str,
        typer.Option(
            metavar="URL", envvar="M2T_MIRROR", help="A folder with the same files.", show_default="GitHub"
        ),
    ] = SOURCE,
    as_json: JsonOption = False,
) -> None:
    """Download public laser logs, and print where they are.

    A log that is there already is not downloaded again. Each is checked by its sha256.

    [bold]Examples[/bold]

    \b
    m2t-text fetch
    m2t-text index $(m2t-text fetch radish/fr079)
    m2t-text evaluate $(m2t-text fetch radish/fr101 radish/intel)
    m2t-text fetch radish/fr079 --mirror https://example.org/logs --folder logs
    """
    import pooch

    from m2t_text.sources.public_logs import cache_folder, public_log
    from m2t_text.sources.public_logs import fetch as download

    logs = [public_log(name) for name in names or LOGS]
    place = (folder or cache_folder()).absolute()
    if names:
        pooch.get_logger().setLevel("WARNING")  # its line for each download would break the progress bar
        with bars() as progress:
            for log in logs:
                download(log.name, place, mirror, partial(progress, log.name, "fetching"))
    paths = [path if (path := place / log.file).is_file() else None for log in logs]
    if as_json:
        found = [asdict(log) | {"path": path and str(path)} for log, path in zip(logs, paths, strict=True)]
        print_json({"logs": found})
    elif names:
        print_lines(*map(str, paths))
    else:
        rows = [[log.name, log.place, str(path or "")] for log, path in zip(logs, paths, strict=True)]
        print_table("Public logs", dict.fromkeys(("name", "place", "fetched"), "left"), rows)


def merge(
    sources: Annotated[list[Path], typer.Argument(metavar="INDEX", help="The indexes to copy from.")],
    index: IndexOption = DEFAULT_INDEX,
    replace: Annotated[
        bool, typer.Option("--replace", help="Of datasets of the same name, keep the last.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Copy the datasets of several indexes into one, which is made if there is none.

    All must have the same parameters. They are committed together; the indexes copied from stay as they are.

    [bold]Examples[/bold]

    \b
    m2t-text merge indexes/monday indexes/tuesday --index indexes/week
    m2t-text merge indexes/monday --index indexes/week --replace
    """
    from m2t_text.index.map_index import MapIndex
    from m2t_text.index.merging import merge as copy_all

    with bars() as progress:
        merged = copy_all(sources, index, replace, progress)
    if as_json:
        copied = [{"name": one.dataset.name, "from": str(one.source)} for one in merged]
        _print_summary(MapIndex.open(index), {"merged": copied})
        return
    rows = [
        [one.dataset.name, str(one.source), f"{one.dataset.maps:,}", f"{one.dataset.travel:,.1f}"]
        for one in merged
    ]
    columns = {"dataset": "left", "from": "left", "maps": "right", "travel (m)": "right"}
    print_table(f"merged into {index}", columns, rows)
    print_held(MapIndex.open(index).info())


def remove(
    datasets: Annotated[
        list[str], typer.Argument(metavar="DATASET", help="Names, as `info` shows them.", autocompletion=names)
    ],
    index: IndexOption = DEFAULT_INDEX,
    as_json: JsonOption = False,
) -> None:
    """Remove datasets with all their maps from an index.

    [bold]Examples[/bold]

    \b
    m2t-text remove monday
    m2t-text remove monday tuesday --index indexes/week
    """
    with opened(index) as held:
        before = len(held)
        held.remove(*datasets)
        if as_json:
            _print_summary(held, {"removed": datasets})
            return
        print_lines(f"removed {', '.join(datasets)}: {before - len(held):,} maps")
        print_held(held.info())


def optimize(index: IndexOption = DEFAULT_INDEX, as_json: JsonOption = False) -> None:
    """Write an index anew as one piece, without what was removed or replaced.

    [bold]Examples[/bold]

    \b
    m2t-text optimize
    m2t-text optimize --index indexes/week
    """
    from m2t_text.index.map_index import MapIndex

    held = MapIndex.open(index)
    before = held.info().bytes
    with bars() as progress:
        held.optimize(partial(progress, str(index), "writing"))
    if as_json:
        _print_summary(held, {"bytes_before": before})
        return
    print_lines(f"optimized {index}, which took {before / 1e6:.2f} MB")
    print_held(held.info())


def _print_summary(index: "Searchable", more: dict[str, object]) -> None:
    """What `info --json` prints of the index, and what was done."""
    print_json(index.info().to_json() | more)


def warm_up(
    purposes: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="PURPOSE",
            help="describing, bounds, agreement, intersection, verification, sieving or mapping.",
            show_default="all",
        ),
    ] = None,
    beside: Annotated[bool, typer.Option("--beside", hidden=True)] = False,
) -> None:
    """Compile now what commands would compile when they are first used on this machine.

    Once is enough for all users if the package's folder can be written now; later it need not be. Useful in the
    image of a robot or of a container that runs on the same kind of processor.

    [bold]Examples[/bold]

    \b
    m2t-text warm-up
    RUN pip install m2t-text && m2t-text warm-up       in a Dockerfile
    """
    from m2t_text.util.compiled import Group, missing
    from m2t_text.util.compiling import kernel_folder

    names = [str(group) for group in Group]
    for purpose in purposes or ():
        if purpose not in names:
            raise typer.BadParameter(f"{purpose!r} is none of {', '.join(names)}.")
    groups = [Group(purpose) for purpose in purposes or names]
    if beside and hasattr(os, "nice"):
        os.nice(NICE)
    if missing(groups):
        compile_first(groups)
    note(f"everything is compiled, in {kernel_folder()}")
