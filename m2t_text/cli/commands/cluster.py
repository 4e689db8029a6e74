"""The commands `cluster start`, `join`, `status` and `stop`."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from m2t_text.cli.console import note, print_json, print_lines, print_table
from m2t_text.cli.options import JsonOption

cluster = typer.Typer(help="Search an index with shards on many machines.", no_args_is_help=True)

AddressArgument = Annotated[
    str | None, typer.Argument(metavar="ADDRESS", help="HOST:PORT.", show_default="the only one here")
]
CpusOption = Annotated[
    int | None,
    typer.Option("--cpus", min=1, metavar="N", help="Cores of this host to use.", show_default="all"),
]


@cluster.command()
def start(
    index: Annotated[Path, typer.Argument(metavar="DIR", help="An index with shards.")],
    replicas: Annotated[
        int, typer.Option(min=1, max=16, metavar="N", help="Servers for each shard, on different hosts.")
    ] = 1,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="This host's address; others join there.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1024, max=65000, metavar="N", help="The first of 100 ports.")] = 6399,
    cpus: CpusOption = None,
) -> None:
    """Start a cluster on this host that serves an index with shards.

    It goes on in the background. By default nobody else can reach it; --host names the interface on which other
    hosts may, with the token that is made at the first start.

    [bold]Examples[/bold]

    \b
    m2t-text cluster start indexes/fleet
    m2t-text cluster start /shared/fleet --replicas 2 --host 10.0.0.5
    """
    from m2t_text.cluster import running
    from m2t_text.cluster.connection import is_loopback, token_file

    started = running.start(index, replicas, host, port, cpus)
    print_lines(
        f"serving {index} at {started.address}",
        "",
        f"m2t-text search QUERY --cluster {started.address}",
        f"m2t-text cluster status {started.address}",
        f"m2t-text cluster stop {started.address}",
    )
    if not is_loopback(host):
        print_lines(
            "",
            f"on other hosts, with a copy of {token_file()}, and {index} at the same path:",
            f"m2t-text cluster join {started.address}",
        )


@cluster.command()
def join(
    address: Annotated[str, typer.Argument(metavar="ADDRESS", help="HOST:PORT of the cluster.")],
    host: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="This host's address.", show_default="that which reaches ADDRESS"),
    ] = None,
    only_ask: Annotated[bool, typer.Option("--only-ask", help="Serve nothing from this host.")] = False,
    cpus: CpusOption = None,
) -> None:
    """Make this host a part of a cluster: it serves shards, describes logs, and can ask.

    [bold]Examples[/bold]

    \b
    m2t-text cluster join 10.0.0.5:6399
    m2t-text cluster join 10.0.0.5:6399 --only-ask --cpus 1
    """
    from m2t_text.cluster import running

    started = running.join(address, host, cpus, not only_ask)
    print_lines(f"joining the cluster at {started.address}; {started.log} says how it goes")


@cluster.command()
def status(address: AddressArgument = None, as_json: JsonOption = False) -> None:
    """Say what a cluster serves, and by whom.

    [bold]Examples[/bold]

    \b
    m2t-text cluster status
    m2t-text cluster status 10.0.0.5:6399 --json
    """
    from m2t_text.cluster import running
    from m2t_text.cluster.ray_carrier import cluster_status

    at = address or running.chosen(None).address
    told = cluster_status(at)
    served = told.served
    if as_json:
        document = asdict(told) | {"address": at}
        if served is not None:
            table = {str(number): list(names) for number, names in served.table.items()}
            document["served"] = {"generation": served.manifest.generation, "maps": served.manifest.maps}
            document["served"] |= {"shards": len(served.manifest.shards), "servers": table}
        print_json(document)
        return
    if served is None:
        print_lines(f"{at} serves nothing yet of {told.folder}")
    else:
        manifest = served.manifest
        print_lines(
            f"{at} serves {manifest.maps:,} maps of {told.folder}: {len(manifest.shards)} shards, generation "
            f"{manifest.generation}, profile {manifest.parameters.profile}"
        )
    held = {} if served is None else served.table
    rows = []
    for name, (node, ready) in sorted(told.servers.items()):
        own = " ".join(str(number) for number, names in held.items() if name in names)
        rows.append([name, node, own, "yes" if ready else "opening"])
    columns = {"server": "left", "host": "left", "shards": "left", "ready": "right"}
    print_table(f"{len(told.nodes)} hosts, {told.replicas} servers for each shard", columns, rows)
    few = [number for number, names in held.items() if len(names) < told.replicas]
    if few:
        note(f"warning: {len(few)} shards have fewer than {told.replicas} servers")
    if told.problem:
        note(f"warning: {told.problem}")


@cluster.command()
def stop(address: AddressArgument = None) -> None:
    """End what this host does in a cluster. The index stays as it is.

    [bold]Examples[/bold]

    \b
    m2t-text cluster stop
    m2t-text cluster stop 10.0.0.5:6399
    """
    from m2t_text.cluster import running

    started = running.chosen(address)
    running.stop(started)
    what = "the cluster" if started.folder else "this host's part in the cluster"
    print_lines(f"stopped {what} at {started.address}")
