"""The command `warm-up`."""

import os
from typing import Annotated

import typer

from m2t_text.cli.compiling import compile_first
from m2t_text.cli.console import note

NICE = 5  # of a process that compiles beside another command


def warm_up(
    purposes: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="PURPOSE",
            help="describing, agreement, intersection, verification or sieving.",
            show_default="all",
        ),
    ] = None,
    beside: Annotated[bool, typer.Option("--beside", hidden=True)] = False,
) -> None:
    """Compile now what commands would compile when they are first used on this machine.

    Once is enough for all users if the package's folder can be written now; later it need not be. Useful in the
    image of a robot or of a container that runs on the same kind of processor.

    [bold]Examples[/bold]

    \b
    m2t-text warm-up
    RUN pip install m2t-text && m2t-text warm-up       in a Dockerfile
    """
    from m2t_text.util.compiled import Group, missing
    from m2t_text.util.compiling import kernel_folder

    names = [str(group) for group in Group]
    for purpose in purposes or ():
        if purpose not in names:
            raise typer.BadParameter(f"{purpose!r} is none of {', '.join(names)}.")
    groups = [Group(purpose) for purpose in purposes or names]
    if beside and hasattr(os, "nice"):
        os.nice(NICE)
    if missing(groups):
        compile_first(groups)
    note(f"everything is compiled, in {kernel_folder()}")
