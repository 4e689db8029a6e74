"""Opening what a command searches: an index in a folder, with shards or without, or what a cluster serves."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from m2t_text.cli.console import note

if TYPE_CHECKING:
    from m2t_text.index.searchable import Searchable

ClusterOption = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        metavar="ADDRESS",
        envvar="M2T_CLUSTER",
        help="HOST:PORT of a cluster to ask; `local` starts one here for --index.",
        show_default="none",
    ),
]
PartialOption = Annotated[
    bool, typer.Option("--partial", help="Answer from those shards of the cluster that do, and say so.")
]


@contextmanager
def opened(index: Path, cluster: str | None = None, partial: bool = False) -> "Iterator[Searchable]":
    """What the options name, during the block."""
    if cluster is not None:
        from m2t_text.cluster.ray_carrier import cluster_index

        with cluster_index(local_address(index) if cluster == "local" else cluster, partial) as served:
            yield served
            return
    from m2t_text.cluster.remote import holds_shards

    if holds_shards(index):
        from m2t_text.cluster.cluster_index import ClusterIndex

        yield ClusterIndex.open(index)
    else:
        from m2t_text.index.map_index import MapIndex

        yield MapIndex.open(index)


def local_address(index: Path) -> str:
    """That of a cluster on this host which serves the index; it is started, and said, if there is none."""
    from m2t_text.cluster import running

    address = running.serving(index)
    if address is None:
        note("starting a cluster on this host; `m2t-text cluster stop` ends it")
        address = running.local(index)
    return address


def warn_of_missing(index: "Searchable") -> None:
    """Says how many maps an answer leaves out."""
    if index.missing_maps:
        missing = f"{index.missing_maps:,} of {len(index):,}"
        note(f"warning: {missing} maps could not be searched; this is of the others alone")
