"""Compiling before a command needs it, so that whoever waits is told, and as a command of its own."""

import os
import subprocess
import sys
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from m2t_text.cli.console import bars, note
from m2t_text.util.files import is_file

if TYPE_CHECKING:
    from m2t_text.config import Parameters
    from m2t_text.util.compiled import Group

ONCE = "compiling once for this machine"
NEVER_KEPT = (
    "compiling, for this command alone: no folder can be written in which to keep what is compiled; "
    "NUMBA_CACHE_DIR names one"
)


def compile_first(groups: "Iterable[Group]") -> None:
    """Compiles what a command needs unless it is compiled, with a bar on a terminal and a line elsewhere."""
    from m2t_text.util.compiled import missing
    from m2t_text.util.compiling import are_kept

    chosen = missing(groups)
    if chosen:
        from m2t_text.warming import warm

        if not are_kept():
            note(NEVER_KEPT)
        elif not sys.stderr.isatty():
            note(ONCE)
        with bars() as progress:
            warm(chosen, partial(progress, "m2t-text", ONCE))


def compile_for(queries: Iterable[str], parameters: "Parameters | None" = None, verify: bool = False) -> None:
    """Compiles what it takes to describe queries, and with the ``parameters`` of an index to look them up."""
    from m2t_text.util.compiled import Group

    groups = [] if parameters is None else Group.of_search(parameters.matching.score)
    if not verify and Group.VERIFICATION in groups:
        groups.remove(Group.VERIFICATION)
    if any(map(_is_described, queries)):
        groups.insert(0, Group.DESCRIBING)
    compile_first(groups)


def _is_described(query: str) -> bool:
    """Whether a query is cut from a log, or comes from a file that is no text."""
    return not query.endswith(".txt") and ("@" in query or "#" in query or is_file(Path(query)))


def compile_all_for(parameters: "Parameters", mapping: bool = False) -> None:
    """Compiles what it takes to describe maps, to search among them and to verify what is found; also what it
    takes to map whole drives if that is asked for."""
    from m2t_text.util.compiled import Group

    more = [Group.MAPPING] if mapping else []
    compile_first([Group.DESCRIBING, *Group.of_search(parameters.matching.score), *more])


def compile_beside(groups: "Iterable[Group]") -> None:
    """Starts processes that compile what is missing of the groups and can be kept. They outlive this one.

    The first group is compiled in a process of its own, beside the others, which share functions.
    """
    from m2t_text.util.compiled import missing
    from m2t_text.util.compiling import PACKAGE, are_kept

    chosen = missing(groups) if are_kept() else []
    for together in filter(None, (chosen[:1], chosen[1:])):
        path = os.pathsep.join(filter(None, [str(PACKAGE.parent), os.environ.get("PYTHONPATH")]))
        quiet = subprocess.DEVNULL
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "m2t_text", "warm-up", "--beside", *together],
            stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True,
            env={**os.environ, "PYTHONPATH": path},
        )  # fmt: skip
        _started.append(process)


_started: list[subprocess.Popen[bytes]] = []  # they go on when this process ends
