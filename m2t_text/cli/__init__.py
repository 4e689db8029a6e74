"""The command line. It parses and prints; what it calls computes. Heavy imports stay inside the commands."""

import os
import sys
from collections.abc import Sequence
from io import TextIOWrapper

INTERRUPTED = 130  # the exit status that shells give a program ended by Ctrl-C


def main() -> None:
    """The entry point of ``m2t-text``."""
    from m2t_text.cli.starting import end_quickly, start_quickly

    start_quickly()
    status = run()
    end_quickly()
    sys.exit(status)


def run(arguments: Sequence[str] | None = None) -> int:
    """Run one command line and return its exit status: 0 done, 2 wrong call or input, 1 anything else."""
    try:
        status = _run(arguments)
    except KeyboardInterrupt:
        status = INTERRUPTED
    except SystemError as error:  # how compiled code ends when Ctrl-C reaches it
        if not isinstance(error.__cause__, KeyboardInterrupt):
            raise
        status = INTERRUPTED
    except BrokenPipeError:  # the reader, head for one, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    if status == INTERRUPTED:
        print("m2t-text: interrupted; nothing was left half done", file=sys.stderr)
    return status


def _run(arguments: Sequence[str] | None) -> int:
    import typer  # here, so that Ctrl-C is answered from the first moment

    from m2t_text.cli.app import app
    from m2t_text.cli.console import complain
    from m2t_text.errors import M2TError

    usage_error: type[Exception] = typer.BadParameter.__mro__[2]  # Click's own class, wherever Typer keeps it
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # an ASCII terminal gets dashes and names spelled out
            stream.reconfigure(errors="backslashreplace")
    try:
        status = app(arguments, prog_name="m2t-text", standalone_mode=False)
        sys.stdout.flush()
    except usage_error as error:
        path = getattr(getattr(error, "ctx", None), "command_path", "m2t-text")
        message = error.format_message().rstrip(".")  # type: ignore[attr-defined]
        return complain(f"{message} (see `{path} --help`)", 2)
    except M2TError as error:
        return complain(str(error), 2)
    except typer.Abort:
        return INTERRUPTED
    except BrokenPipeError:
        raise
    except OSError as error:  # a full disk, for one
        return complain(str(error), 1)
    return status or 0
