"""The command that verifies an index: check."""

from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from m2t_text.cli.console import bars, print_json, print_lines, print_table
from m2t_text.cli.options import DEFAULT_INDEX, IndexOption, JsonOption
from m2t_text.errors import MapIndexError

if TYPE_CHECKING:
    from m2t_text.index.integrity.check import Check


def check(
    index: IndexOption = DEFAULT_INDEX,
    repair: Annotated[
        bool, typer.Option("--repair", help="Rebuild what can be rebuilt, and remove what cannot.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Verify every byte and every map of an index, and say which dataset is hurt.

    The exit status is 2 if anything is damaged, and 0 if nothing is, or if all is repaired.

    [bold]Examples[/bold]

    \b
    m2t-text check
    m2t-text check --index indexes/office --json
    m2t-text check --index indexes/office --repair
    """
    from m2t_text.index.integrity.check import check_index, repair_index
    from m2t_text.index.map_index import LOCK_SECONDS

    done: list[str] = []
    with bars() as progress:
        tell = partial(progress, str(index), "checking maps")
        checked = check_index(index, tell)
        if repair and not checked.sound:
            done = repair_index(index, LOCK_SECONDS, tell)
            checked = check_index(index, tell)
    if as_json:
        print_json(_document(checked, done))
    else:
        _print(checked, done)
    if not checked.sound:
        raise MapIndexError(_damage(checked))


def _document(checked: "Check", done: list[str]) -> dict[str, Any]:
    """The document of ``check --json``."""
    return {
        "path": str(checked.path),
        "sound": checked.sound,
        "files": [asdict(file) for file in checked.files],
        "datasets": [asdict(dataset) for dataset in checked.datasets],
        "leftovers": list(checked.leftovers),
        "repaired": done,
    }


def _print(checked: "Check", done: list[str]) -> None:
    if done:
        print_lines(*done)
    state = "sound" if checked.sound else "damaged"
    rows = [[one.name, f"{one.maps:,}", f"{one.lost:,}"] for one in checked.datasets]
    columns = {"dataset": "left", "maps": "right", "lost": "right"}
    print_table(f"{checked.path}: {len(checked.files)} files, {state}", columns, rows)
    for file in checked.files:
        if file.problem is not None:
            print_lines(f"{file.name}: {file.problem}")
    for name in checked.leftovers:
        print_lines(f"{name}: left by a writer that was killed; the next one removes it")


def _damage(checked: "Check") -> str:
    """One line for all that is damaged."""
    hurt = [
        f"{one.lost:,} of {one.maps + one.lost:,} maps of {one.name}" for one in checked.datasets if one.lost
    ]
    lost = f"{', '.join(hurt)} lost" if hurt else "no map lost"
    if not checked.legible:
        lost = "nothing is known of its maps"
    return (
        f"the index in {checked.path} is damaged: {lost}; `m2t-text check --repair --index {checked.path}` "
        "rebuilds what can be rebuilt"
    )
