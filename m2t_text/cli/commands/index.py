"""Commands that write: demo, simulate, index."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from m2t_text.cli.compiling import compile_beside, compile_first
from m2t_text.cli.console import a_number, as_called, bars, complain, note, print_held, print_lines, print_table
from m2t_text.cli.opening import ClusterOption, local_address, opened
from m2t_text.cli.options import DEFAULT_INDEX, IndexOption, reads_logs
from m2t_text.config import PROFILES, parameters_of
from m2t_text.util.files import check_folder
from m2t_text.util.names import is_saved_map
from m2t_text.util.workers import cores

if TYPE_CHECKING:
    from m2t_text.sources.indexing import IndexRequest, Report
    from m2t_text.sources.opening import SourceOptions
    from m2t_text.util.types import SourceProgress

JobsOption = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="Processes that describe maps.", show_default="all cores")
]
SeedOption = Annotated[int, typer.Option(min=0, metavar="N", help="Another seed, another building.")]


def demo(
    folder: Annotated[Path, typer.Option(metavar="DIR", help="Where logs, index and pictures go.")] = Path(
        "demo"
    ),
    seed: SeedOption = 1,
    jobs: JobsOption = None,
) -> None:
    """See it work without any data: a simulated building, indexed, and found again on a later visit.

    [bold]Examples[/bold]

    \b
    m2t-text demo
    m2t-text demo --seed 7 --folder another
    """
    from m2t_text.evaluation.demo import run_demo
    from m2t_text.util.compiled import Group

    compile_beside(Group.of_search(PROFILES["default"].matching.score))
    compile_first([Group.DESCRIBING])
    with bars() as progress:
        report = run_demo(folder, seed, cores(jobs), progress)
    print_lines(*report.lines(as_called()))


def simulate(
    out: Annotated[Path, typer.Argument(metavar="OUT.log", help="The file to write; .gz is packed.")],
    seed: SeedOption = 0,
    travel: Annotated[
        float,
        typer.Option(min=3.0, max=1000.0, callback=a_number, metavar="METRES", help="Length of the drive."),
    ] = 180.0,
    length: Annotated[
        float,
        typer.Option(min=24.0, max=200.0, callback=a_number, metavar="METRES", help="Length of the building."),
    ] = 44.0,
) -> None:
    """Write the laser log of a drive through a simulated building, in CARMEN's format.

    [bold]Examples[/bold]

    \b
    m2t-text simulate office.log
    m2t-text simulate office.log.gz --seed 3 --travel 90
    """
    from m2t_text.logs.simulation.simulator import Simulation, write_carmen
    from m2t_text.logs.simulation.simulator import simulate as drive

    check_folder(out)
    with bars() as progress:
        log = drive(
            Simulation(seed=seed, travel=travel, length=length), partial(progress, out.name, "simulating")
        )
    write_carmen(log, out)
    note(f"wrote {out}: {len(log.scans):,} scans; go on with: m2t-text index {out}")


@reads_logs
def index(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="SOURCE...",
            help="Laser logs: CARMEN .log, .clf, .gz; ROS .bag, .db3, .mcap or the folder of a bag. "
            "Point clouds: .pcd, .ply, .xyz, .csv, .npy. Saved ROS maps: .yaml.",
        ),
    ],
    index: IndexOption = DEFAULT_INDEX,
    profile: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help=f"Parameters of a new index: {', '.join(PROFILES)}.",
            show_default="that of the index, or default",
            autocompletion=lambda: list(PROFILES),
        ),
    ] = None,
    jobs: JobsOption = None,
    shards: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Parts of an index for a cluster.", show_default="as before"),
    ] = None,
    cluster: ClusterOption = None,
    *,
    reading: "SourceOptions",
) -> None:
    """Describe every local map of laser logs as text, and put the texts into an index.

    A point cloud is one map; a saved map is seen from many places. A dataset that the index already holds is
    replaced. All sources are committed together at the end. With --cluster its hosts share the work.

    [bold]Examples[/bold]

    \b
    m2t-text index robot.log
    m2t-text index monday.log tuesday.log.gz --index indexes/office
    m2t-text index robot.log --index indexes/paper --profile paper
    m2t-text index drive.mcap --scan-topic /front/scan
    m2t-text index rooms/*.pcd --height 0.2 1.0
    m2t-text index floor.yaml
    m2t-text index fleet/*.log --index indexes/fleet --shards 4
    m2t-text index fleet/*.log --index /shared/fleet --shards 4 --cluster 10.0.0.5:6399
    """
    from m2t_text.sources.indexing import IndexRequest
    from m2t_text.util.compiled import Group

    parameters = parameters_of(profile or "default")
    compile_beside([*Group.of_search(parameters.matching.score), Group.SIEVING])
    mapping = [Group.MAPPING] if any(map(is_saved_map, sources)) else []
    compile_first([Group.DESCRIBING, *mapping])
    with bars() as progress:
        report = _indexed(
            IndexRequest(sources, index, profile, cores(jobs), reading), shards, cluster, progress
        )
    for dataset in report.indexed:
        for warning in dataset.warnings:
            note(f"warning: {dataset.name}: {warning}")
    if report.indexed:
        with opened(index) as written:
            held = written.info()
        maps = {summary.name: summary for summary in held.datasets}
        rows = [
            [
                d.name,
                f"{d.scans:,}",
                f"{maps[d.name].maps:,}",
                f"{maps[d.name].travel:,.1f}",
                f"{d.seconds:.1f}",
            ]
            for d in report.indexed
        ]
        columns = {
            "dataset": "left",
            "scans": "right",
            "maps": "right",
            "travel (m)": "right",
            "seconds": "right",
        }
        print_table(f"indexed into {held.path}", columns, rows)
        print_held(held)
    for line in report.failed:
        complain(line, 2)
    if report.failed:
        raise typer.Exit(2)


def _indexed(
    request: "IndexRequest", shards: int | None, cluster: str | None, progress: "SourceProgress"
) -> "Report":
    """What became of the sources, in an index with shards or without, here or on a cluster."""
    from m2t_text.cluster.remote import holds_shards
    from m2t_text.sources.indexing import index_sources

    if cluster is not None:
        from m2t_text.cluster.indexing import index_on_cluster

        address = local_address(request.index) if cluster == "local" else cluster
        return index_on_cluster(request, shards, address, progress)
    if shards is not None or holds_shards(request.index):
        from m2t_text.cluster.indexing import index_sharded

        return index_sharded(request, shards, progress)
    return index_sources(request, progress)
