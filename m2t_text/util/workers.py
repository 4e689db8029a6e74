"""Processes that share the work of one command. What starts them is loaded by those commands that need it."""

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from threading import Thread
from typing import Any, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


THREADS = "M2T_THREADS"  # the variable that says how many cores a process may use at most


def cores(jobs: int | None) -> int:
    """As many processes as asked for, else as there are cores for this one."""
    affinity = getattr(os, "sched_getaffinity", None)  # not on every system
    there = len(affinity(0)) if affinity else os.cpu_count() or 1
    most = os.environ.get(THREADS, "")
    return jobs or (min(there, max(1, int(most))) if most.isdecimal() else there)


def mapped(make: Callable[[], Callable[[Item], Result]], items: Sequence[Item], jobs: int) -> Iterator[Result]:
    """What the function that ``make()`` gives makes of each item, in their order, by so many processes.

    ``make`` is called once in each process, so that what the function holds is not sent with every item.
    """
    if jobs <= 1 or len(items) <= 1:
        yield from map(make(), items)
        return
    from concurrent.futures import ProcessPoolExecutor

    with ProcessPoolExecutor(jobs, initializer=_start, initargs=(make,)) as pool:
        yield from pool.map(_work, items)


_function: Callable[[Any], Any]


def _start(make: Callable[[], Callable[[Any], Any]]) -> None:
    global _function  # noqa: PLW0603
    follow_parent()
    _function = make()


def _work(item: Any) -> Any:
    return _function(item)


def follow_parent() -> None:
    """Makes a process of a pool leave Ctrl-C to its parent, and end when that is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it reaches all processes, and one of them answers it
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A parent that is killed cannot end its pool, whose processes would wait for work for ever."""
    from multiprocessing import parent_process

    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
