"""The commands for robots that drive: live and replay."""

import json
import sys
from functools import partial
from io import TextIOWrapper
from math import isfinite, radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from m2t_text.cli.console import a_number, bars, note
from m2t_text.cli.options import LaserPoseOption, reads_logs

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from m2t_text.sources.opening import SourceOptions


def live(
    source: Annotated[
        str, typer.Argument(metavar="SOURCE", help="- for standard input; a file, or a named pipe.")
    ] = "-",
    index: Annotated[
        Path | None,
        typer.Option("--index", metavar="DIR", envvar="M2T_INDEX", help="Say where in its maps it is."),
    ] = None,
    every: Annotated[
        float | None,
        typer.Option(
            "--every",
            min=0.1,
            callback=a_number,
            metavar="METRES",
            help="Of travel, from one answer to the next.",
            show_default="only when asked",
        ),
    ] = None,
    profile: Annotated[
        str | None,
        typer.Option("--profile", metavar="NAME", help="Without an index.", show_default="default"),
    ] = None,
    laser_pose: LaserPoseOption = None,
    poses: Annotated[bool, typer.Option("--poses/--no-poses", help="Whether each scan is answered.")] = True,
    loops: Annotated[
        bool, typer.Option("--loops", help="Say when it comes back to where it was before on this drive.")
    ] = False,
    append: Annotated[
        bool,
        typer.Option("--append", help="Add the drive to the index; its loops lead to other drives, too."),
    ] = False,
    keep_per_place: Annotated[
        int | None,
        typer.Option(
            "--keep-per-place",
            min=1,
            metavar="N",
            help="With --append: so many maps of a place, those that differ most.",
            show_default="all",
        ),
    ] = None,
) -> None:
    """Answer a robot while it drives: one JSON object a line in, and one a line out.

    [bold]In[/bold]

    \b
    {"type": "robot", "name": "r1", "laser_pose": [0.1, 0, 0]}     first, if at all
    {"type": "odometry", "time": 1.25, "pose": [0.5, 0, 0.1]}
    {"type": "scan", "time": 1.2, "angle_min": -1.57, "angle_increment": 0.0175,
     "range_max": 30, "ranges": [1.2, null, 3.4]}                  null: no return
    {"type": "locate"}                                             where am I?
    {"type": "reset"}                                              a new drive begins

    [bold]Out[/bold]

    \b
    {"type": "pose", "scan": 0, "time": 1.2, "pose": [0, 0, 0], "travel": 0.0}
    {"type": "place", "verdict": "match", "dataset": "office", "pose": [4.2, 1.0, 1.57],
     "covariance": [...], "probability": 0.999, "reason": {...}, "state": "tracked", ...}
    {"type": "loop", "from": 120, "to": 840, "pose": [0.1, -0.2, 0.03], "information": [...],
     "query": "live/000815", "map_id": "live/000099", ...}         two scans of one place; --loops
    {"type": "error", "line": 7, "text": "..."}                    the line was left out

    [bold]Examples[/bold]

    \b
    m2t-text replay robot.log --speed 0 | m2t-text live -    a log, as fast as it goes
    m2t-text replay robot.log | m2t-text live - --index indexes/office --every 2 --no-poses
    m2t-text replay robot.log | m2t-text live - --loops --no-poses
    m2t-text replay robot.log | m2t-text live - --index indexes/days --append --keep-per-place 3
    """
    from m2t_text.config import parameters_of
    from m2t_text.errors import M2TError
    from m2t_text.index.map_index import MapIndex, open_index
    from m2t_text.live.localizer import Localizer
    from m2t_text.live.looping import LiveLoops
    from m2t_text.live.messages import parse
    from m2t_text.live.session import Session

    mounted = None if laser_pose is None else (*laser_pose[:2], radians(laser_pose[2]))
    if index is not None and profile is not None:
        raise typer.BadParameter("the profile is the index's; name no other")
    if append and index is None:
        raise typer.BadParameter("--append takes --index, the folder of the index that grows")
    if keep_per_place is not None and not append:
        raise typer.BadParameter("--keep-per-place is for a drive that is added to an index: --append")
    opened = None if index is None else (open_index if append else MapIndex.open)(index)
    parameters = parameters_of(profile or "default") if opened is None else opened.parameters
    localizer = None if opened is None else Localizer(opened)
    behind = LiveLoops(parameters, opened if append else None, loops, localizer, keep_per_place)
    session = Session(parameters, localizer, every, poses, mounted, behind.take if loops or append else None)
    try:
        for number, line in enumerate(_lines(source), start=1):
            if not line.strip():
                continue
            try:
                for answer in session.take(parse(line)):
                    _say(answer)
            except M2TError as error:
                _say({"type": "error", "line": number, "text": str(error)})
        for answer in session.end():
            _say(answer)
    finally:
        behind.end()


def _say(answer: dict[str, Any]) -> None:
    print(json.dumps(answer, allow_nan=False), flush=True)


def _lines(source: str) -> "Iterator[str]":
    """The lines of a stream as they come; one that is too long comes in parts."""
    from m2t_text.errors import SourceError
    from m2t_text.live.messages import LONGEST

    try:
        raw = sys.stdin.buffer if source == "-" else Path(source).open("rb")  # noqa: SIM115, closed below
    except AttributeError as error:  # it is None where a process is started without one
        raise SourceError("standard input cannot be read; pipe messages into it, or name a file") from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise SourceError(f"cannot read {source!r}: {reason}") from error
    with TextIOWrapper(raw, encoding="utf-8", errors="replace") as stream:
        yield from iter(lambda: stream.readline(LONGEST + 1), "")


@reads_logs
def replay(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A laser log.", show_default=False)],
    speed: Annotated[
        float,
        typer.Option(
            "--speed", min=0.0, callback=a_number, metavar="X", help="Times real time; 0: as fast as it goes."
        ),
    ] = 1.0,
    *,
    reading: "SourceOptions",
) -> None:
    """Play a log as the messages of a robot that drives now, for `m2t-text live -`.

    [bold]Examples[/bold]

    \b
    m2t-text replay robot.log | m2t-text live -              in real time
    m2t-text replay robot.log --speed 10 | m2t-text live -   ten times faster
    """
    from m2t_text.live.replay import replayed
    from m2t_text.sources.opening import open_log

    if not isfinite(speed):
        raise typer.BadParameter("a speed is finite; 0 is as fast as it goes")
    with bars() as progress:
        opened = open_log(log, reading, partial(progress, str(log), "reading"))
    for warning in opened.warnings:
        note(f"warning: {opened.name}: {warning}")
    _print_all(replayed(opened, speed))


def _print_all(lines: "Iterable[str]") -> None:
    for line in lines:
        print(line, flush=True)
