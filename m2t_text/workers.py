"""Processes that share the work of one command."""

import os
import signal
from multiprocessing import parent_process
from threading import Thread


def cores(jobs: int | None) -> int:
    """As many processes as asked for, else as there are cores for this one."""
    affinity = getattr(os, "sched_getaffinity", None)  # not on every system
    return jobs or (len(affinity(0)) if affinity else os.cpu_count() or 1)


def follow_parent() -> None:
    """Makes a process of a pool leave Ctrl-C to its parent, and end when that is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it reaches all processes, and one of them answers it
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A parent that is killed cannot end its pool, whose processes would wait for work for ever."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
