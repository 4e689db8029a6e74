"""Processes that read what was uploaded, and what they say."""

import json
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from subprocess import PIPE, Popen
from typing import Any

from m2t_text.errors import M2TError

SECONDS = 900.0  # from the beginning of reading a file to its end
MESSAGE = 64 << 20  # characters of a message from a process, at most

Process = Popen[str]


class Readers:
    """Processes that read files. One is always ready, as it takes a while until a process has loaded all."""

    def __init__(self) -> None:
        self._spare: Process | None = None
        self._lock = threading.Lock()

    def warm(self) -> None:
        """Starts the one that is ready."""
        with self._lock:
            self._spare = self._spare or _reader()

    def take(self) -> Process:
        """The one that is ready; the next is started."""
        with self._lock:
            ready = self._spare if self._spare and self._spare.poll() is None else None
            self._spare = _reader()
            return ready or _reader()

    def close(self) -> None:
        with self._lock:
            end(self._spare)
            self._spare = None


def _reader() -> Process:
    command = [sys.executable, "-P", "-m", "m2t_text.web.uploads.parsing"]
    return Process(command, stdin=PIPE, stdout=PIPE, encoding="utf-8", start_new_session=True)


def listen(process: Process, take: Callable[[dict[str, Any]], None]) -> None:
    """Takes the messages of a process, until it has said how it ended, or has taken too long."""
    assert process.stdout is not None
    late = threading.Timer(SECONDS, process.kill)
    late.start()
    ended = False
    while not ended and (line := process.stdout.readline(MESSAGE)):
        try:
            message = json.loads(line)
            ended = "end" in message or "error" in message
            take(message)
        except (ValueError, TypeError, KeyError, M2TError):  # it was cut off
            break
    late.cancel()
    if not ended:
        take({"error": "it took too much time or memory to read"})
    end(process)


def end(process: Process | None) -> None:
    if process is None:
        return
    process.kill()
    process.wait(5.0)
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()
