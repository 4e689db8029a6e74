"""Processes that tests start, and may kill: forked, so that a test can start hundreds."""

import json
import logging
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Callable
from typing import Any


def start(work: Callable[..., None], *arguments: Any) -> int:
    """Runs a function in a process of its own, which ends with status 1 if it raises; returns its id."""
    sys.stdout.flush()
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", DeprecationWarning
        )  # NumPy's threads are asleep, and the child needs none
        process = os.fork()
    if process:
        return process
    status = 1
    try:
        logging.disable()
        work(*arguments)
        status = 0
    finally:  # whatever happened, the child must not go on as if it were the parent
        if status:
            traceback.print_exc()
        sys.stderr.flush()
        os._exit(status)


def status(process: int) -> int:
    """Waits for a process to end: its exit status, or minus the signal that killed it."""
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def call(work: Callable[..., Any], *arguments: Any) -> Any:
    """What a function returns, in a process of its own. Raises AssertionError if it raises or crashes."""
    read, write = os.pipe()

    def answer() -> None:
        os.write(write, json.dumps(work(*arguments)).encode())

    process = start(answer)
    os.close(write)
    with os.fdopen(read, "rb") as file:
        data = file.read()
    ended = status(process)
    assert ended == 0, f"{work.__name__} ended with {signal.Signals(-ended).name if ended < 0 else ended}"
    return json.loads(data)
