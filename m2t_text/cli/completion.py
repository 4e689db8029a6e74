"""What the shell offers for a word that is not finished: ids and datasets."""

import os
from pathlib import Path
from typing import Any

OFFERED = 50  # ids at most: a shell shows no more at once


def datasets(ctx: Any, incomplete: str) -> list[str]:
    """The datasets of the index that begin so; none where it cannot be read."""
    from m2t_text.errors import M2TError
    from m2t_text.index.map_index import MapIndex

    try:
        held = MapIndex.open(_index(ctx)).datasets()
    except M2TError:  # the command itself will say it
        return []
    return [dataset.name for dataset in held if dataset.name.startswith(incomplete)]


def map_ids(ctx: Any, incomplete: str) -> list[str]:
    """The datasets that begin so, or behind a dataset's slash the ids of its maps."""
    dataset, slash, number = incomplete.rpartition("/")
    if not slash:
        return [f"{name}/" for name in datasets(ctx, incomplete)]
    from m2t_text.description.document import map_id_of
    from m2t_text.errors import M2TError
    from m2t_text.index.map_index import MapIndex

    try:
        scans, _ = MapIndex.open(_index(ctx)).runs(dataset)
    except M2TError:
        return []
    ids = (map_id_of(dataset, scan) for scan in scans.tolist())
    return [map_id for map_id in ids if map_id.startswith(f"{dataset}/{number}")][:OFFERED]


def _index(ctx: Any) -> Path:
    """The folder that the command line names, or would take."""
    named = ctx.params.get("index")
    return Path(named or os.environ.get("M2T_INDEX") or "indexes/default")
