"""What reaches the terminal: results on standard output, everything else on standard error."""

import json
import os
import shlex
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from math import degrees, isnan
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

from m2t_text.errors import clean

if TYPE_CHECKING:
    from rich.console import Console

    from m2t_text.index.results import IndexInfo
    from m2t_text.util.types import Floats, SourceProgress

WIDE = 160  # columns of a table that no terminal shows
STAGES = {"scans": "matching scans", "views": "looking around", "maps": "describing maps"}
REFRESH = 0.1  # s between two states of a progress bar


def complain(message: str, code: int) -> int:
    """One line on standard error; returns the exit status."""
    print(f"m2t-text: {clean(' '.join(message.split()))}", file=sys.stderr)
    return code


def note(message: str) -> None:
    """One line on standard error that is no error."""
    print(clean(message), file=sys.stderr)


def print_json(document: dict[str, Any]) -> None:
    """One JSON document on standard output and nothing else."""
    print(json.dumps(document, indent=2, allow_nan=False))


def print_table(title: str, columns: dict[str, str], rows: list[list[str]]) -> None:
    """A title and a table on standard output; ``columns`` gives the side to which each is aligned."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD)
    for name, side in columns.items():
        left = side == "left"  # names and ids, which do not break on a narrow terminal
        table.add_column(name, justify="left" if left else "right", overflow="fold", no_wrap=left)
    for row in rows:
        table.add_row(*(Text(clean(cell)) for cell in row))
    console = _console()
    console.print(Text(clean(title), style="bold"))
    console.print(table)


def print_held(info: "IndexInfo") -> None:
    """What an index holds, in one line on standard output."""
    size, profile = info.bytes / 1e6, info.parameters.profile
    print_lines(f"{info.path} holds {info.maps:,} maps in {size:.2f} MB, profile {profile}")


def print_lines(*lines: str) -> None:
    """Plain lines on standard output."""
    print("\n".join(clean(line) for line in lines))


def sure(probability: float) -> str:
    """A probability in per cent; never 100 or 0, which nothing is."""
    return f"{100 * min(max(probability, 0.001), 0.999):.1f} %"


def shown(pose: "Floats") -> str:
    """A pose (3,) in metres and degrees."""
    return f"{pose[0]:.2f} {pose[1]:.2f} {degrees(pose[2]):.0f}°"


def as_called() -> str:
    """How the program can be called from here: by its name where the shell would find it, else by its path."""
    program = Path(sys.argv[0])
    if program.parts[-2:] == ("m2t_text", "__main__.py"):
        return f"{_shortest(Path(sys.executable))} -m m2t_text"
    found = shutil.which("m2t-text")
    if program.stem != "m2t-text" or (found is not None and Path(found).resolve() == program.resolve()):
        return "m2t-text"
    return _shortest(program)


def _shortest(program: Path) -> str:
    """A path for a shell: relative where that is shorter, and quoted."""
    whole = program.absolute()
    relative = os.path.relpath(whole)
    named = relative if os.sep in relative else f"./{relative}"
    return shlex.quote(min(named, str(whole), key=len))


@contextmanager
def bars() -> Iterator["SourceProgress"]:
    """SourceProgress bars on standard error, if it is a terminal: call it with (what, stage, done, all).

    They are drawn when told to, without a thread of their own: processes are forked while they show.
    """
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = _console(stderr=True)
    if not console.is_terminal:
        yield lambda what, stage, done, of: None
        return
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeRemainingColumn())
    shown: dict[str, Any] = {}
    drawn = 0.0
    with Progress(*columns, console=console, auto_refresh=False, transient=True) as progress:

        def tell(what: str, stage: str, done: int, of: int) -> None:
            nonlocal drawn
            label = clean(f"{what}: {STAGES.get(stage, stage)}")
            if label not in shown:
                shown[label] = progress.add_task(label)
            progress.update(shown[label], completed=done, total=of)
            if done >= of or monotonic() - drawn > REFRESH:
                progress.refresh()
                drawn = monotonic()

        yield tell


def _console(stderr: bool = False) -> "Console":
    from rich.console import Console

    console = Console(stderr=stderr, highlight=False)
    return console if console.is_terminal else Console(stderr=stderr, highlight=False, width=WIDE)


def a_number(value: float | None) -> float | None:
    """The value of an option, if it is a number: "nan" lies within all limits of some versions of Typer."""
    if value is not None and isnan(value):
        from typer import BadParameter

        raise BadParameter("nan is not a number of metres or a share.")
    return value
