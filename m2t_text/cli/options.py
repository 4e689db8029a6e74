"""Options that several commands share."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from m2t_text.cli.console import a_number, note

if TYPE_CHECKING:
    from m2t_text.recognition.queries import Query

DEFAULT_INDEX = Path("indexes/default")

IndexOption = Annotated[
    Path, typer.Option("--index", metavar="DIR", envvar="M2T_INDEX", help="The folder of the index.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]
PlotOption = Annotated[
    Path | None, typer.Option("--plot", metavar="FILE", help="Draw a picture: .png, .pdf or .svg.")
]
LogNameOption = Annotated[
    str | None,
    typer.Option(
        "--name", metavar="NAME", help="The dataset that the log is in the index, if not its file's name."
    ),
]
ScanTopicOption = Annotated[
    str | None,
    typer.Option(
        "--scan-topic", metavar="TOPIC", help="Laser scans of a ROS bag.", show_default="the only one"
    ),
]
OdometryTopicOption = Annotated[
    str | None,
    typer.Option(
        "--odometry-topic",
        metavar="TOPIC",
        help="Odometry of a ROS bag; /tf takes it from there.",
        show_default="the only one, else tf",
    ),
]
JobsOption = Annotated[
    int | None, typer.Option("--jobs", min=1, metavar="N", help="Processes.", show_default="all cores")
]
RunOption = Annotated[
    float | None,
    typer.Option(
        "--run",
        min=0.0,
        callback=a_number,
        metavar="METRES",
        help="Travel in a map that is cut from a log; 0 for a single scan.",
        show_default="as in the index",
    ),
]
HeightOption = Annotated[
    tuple[float, float] | None,
    typer.Option(
        "--height",
        metavar="FROM TO",
        help="Cut a cloud to these heights, in metres.",
        show_default="0.3 to 1.5 above its floor",
    ),
]
TARGETS = (
    "A map id; LOG@METRES or LOG#SCAN, where a map begins in a log; a .txt file or - with a text; "
    "a point cloud."
)


def warn(query: "Query") -> None:
    for warning in query.warnings:
        note(f"warning: {query.title}: {warning}")


def check_plot(plot: Path | None) -> None:
    """Before the work, that a picture can be written."""
    if plot is not None:
        from m2t_text.plotting.pictures import check_picture

        check_picture(plot)
