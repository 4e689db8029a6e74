"""Options that several commands share."""

import inspect
from collections.abc import Callable
from functools import wraps
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from m2t_text.cli.console import a_number, note

if TYPE_CHECKING:
    from m2t_text.recognition.queries import Query
    from m2t_text.sources.opening import SourceOptions

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
        "--name",
        metavar="NAME",
        help="The dataset's name; of a query, that of its log in the index.",
        show_default="the file's name",
    ),
]
ScanTopicOption = Annotated[
    list[str] | None,
    typer.Option(
        "--scan-topic",
        metavar="TOPIC",
        help="Laser scans of a ROS bag; twice for two lasers of one robot. Of a CARMEN log, a word as RLASER.",
        show_default="the only one",
    ),
]
OdometryTopicOption = Annotated[
    str | None,
    typer.Option(
        "--odometry-topic",
        metavar="TOPIC",
        help="Odometry of a ROS bag; /tf takes it from there, none goes by scan matching alone.",
        show_default="the only one, else tf",
    ),
]
NoOdometryOption = Annotated[
    bool, typer.Option("--no-odometry", help="Go by scan matching alone, whatever odometry the log has.")
]
LaserPoseOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        "--laser-pose",
        metavar="X Y DEGREES",
        help="Where the laser sits on the robot, in metres, and where it looks.",
        show_default="what the log says",
    ),
]
UpsideDownOption = Annotated[
    bool, typer.Option("--upside-down", help="The laser hangs upside down, whatever the log says.")
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
        help="Cut a cloud, or scans of a 3D laser, to these heights, in metres.",
        show_default="0.3 to 1.5 above the ground",
    ),
]
READING = {
    "name": (LogNameOption, None),
    "scan_topic": (ScanTopicOption, None),
    "odometry_topic": (OdometryTopicOption, None),
    "no_odometry": (NoOdometryOption, False),
    "laser_pose": (LaserPoseOption, None),
    "upside_down": (UpsideDownOption, False),
    "height": (HeightOption, None),
}
TARGETS = (
    "A map id; LOG@METRES or LOG#SCAN, where a map begins in a log, or DATASET@METRES in an indexed "
    "dataset; a .txt file or - with a text; a point cloud."
)


def reads_logs(command: Callable[..., None]) -> Callable[..., None]:
    """Gives a command the options that say how logs and clouds are read.

    They are told the command together, as its parameter ``reading``, a SourceOptions.
    """
    signature = inspect.signature(command)
    added = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=option)
        for name, (option, default) in READING.items()
    ]
    own = [one.replace(kind=one.KEYWORD_ONLY) for one in signature.parameters.values()]
    place = [one.name for one in own].index("reading")
    parameters = [*own[:place], *added, *own[place + 1 :]]

    @wraps(command)
    def reading_command(**values: Any) -> None:
        chosen = {name: values.pop(name) for name in READING}
        command(**values, reading=source_options(**chosen))

    reading_command.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    reading_command.__annotations__ = {one.name: one.annotation for one in parameters} | {"return": None}
    return reading_command


def source_options(
    name: str | None,
    scan_topic: list[str] | None,
    odometry_topic: str | None,
    no_odometry: bool,
    laser_pose: tuple[float, float, float] | None,
    upside_down: bool,
    height: tuple[float, float] | None,
) -> "SourceOptions":
    """How to read a source, as it was typed. Raises M2TError for what cannot be meant."""
    from m2t_text.logs import LogOptions
    from m2t_text.sources.opening import SourceOptions

    pose = None if laser_pose is None else (*laser_pose[:2], radians(laser_pose[2]))
    odometry = "none" if no_odometry else odometry_topic
    log = LogOptions(tuple(scan_topic or ()), odometry, pose, upside_down, height)
    return SourceOptions(name, log)


def warn(query: "Query") -> None:
    for warning in query.warnings:
        note(f"warning: {query.title}: {warning}")


def check_plot(plot: Path | None) -> None:
    """Before the work, that a picture can be written."""
    if plot is not None:
        from m2t_text.plotting.pictures import check_picture

        check_picture(plot)
