"""The command `info`."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from m2t_text.cli.console import note, print_json, print_table
from m2t_text.cli.opening import opened
from m2t_text.cli.options import DEFAULT_INDEX, IndexOption, JsonOption

if TYPE_CHECKING:
    from m2t_text.index.merging import Unreadable
    from m2t_text.index.results import IndexInfo


def info(context: typer.Context, index: IndexOption = DEFAULT_INDEX, as_json: JsonOption = False) -> None:
    """Say what an index holds; if none is named, also which others lie in indexes/.

    [bold]Examples[/bold]

    \b
    m2t-text info
    m2t-text info --index indexes/office --json
    """
    from m2t_text.index.merging import indexes_in

    source = context.get_parameter_source("index")
    unnamed = source is not None and source.name == "DEFAULT"
    beside = indexes_in(index.parent) if unnamed else []
    if as_json:
        with opened(index) as held:
            document = held.info().to_json()
        print_json(document | {"indexes": listing(beside)} if unnamed else document)
        return
    if index.exists() or not beside:
        with opened(index) as held:
            _print_info(held.info())
    if [one.path for one in beside] not in ([], [index]):
        _print_indexes(index.parent, beside)


def _print_info(held: "IndexInfo") -> None:
    rows = [[d.name, f"{d.maps:,}", f"{d.scans:,}", f"{d.travel:,.1f}"] for d in held.datasets]
    title = f"{held.path}: {held.maps:,} maps, {held.keypoints:,} keypoints, {held.bytes / 1e6:.2f} MB"
    columns = {"dataset": "left", "maps": "right", "scans": "right", "travel (m)": "right"}
    print_table(f"{title}, profile {held.parameters.profile}", columns, rows)


def _print_indexes(folder: Path, indexes: "list[IndexInfo | Unreadable]") -> None:
    from m2t_text.index.results import IndexInfo

    rows = []
    for one in indexes:
        if isinstance(one, IndexInfo):
            numbers = [f"{len(one.datasets):,}", f"{one.maps:,}", f"{one.bytes / 1e6:.2f}"]
            rows.append([str(one.path), one.parameters.profile, *numbers])
        else:
            rows.append([str(one.path), "unreadable", "", "", ""])
            note(f"warning: {one.path}: {one.reason}")
    columns = {"index": "left", "profile": "left"} | dict.fromkeys(("datasets", "maps", "size (MB)"), "right")
    print_table(f"{len(indexes)} indexes in {folder}; --index names one", columns, rows)


def listing(indexes: "Sequence[IndexInfo | Unreadable]") -> list[dict[str, Any]]:
    """The indexes of one folder, in ``info --json``."""
    from m2t_text.index.results import IndexInfo

    return [
        {"path": str(one.path), "error": one.reason}
        if not isinstance(one, IndexInfo)
        else {
            "path": str(one.path),
            "profile": one.parameters.profile,
            "maps": one.maps,
            "bytes": one.bytes,
            "datasets": [dataset.name for dataset in one.datasets],
        }
        for one in indexes
    ]
