"""Processes and threads that share the work of one command.

What starts them is loaded by those commands that need it.
"""

import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from itertools import chain, islice
from threading import Thread, local
from typing import Any, TypeVar

AHEAD = 4  # items for each thread that are worked on or wait to be taken

Item = TypeVar("Item")
Result = TypeVar("Result")


THREADS = "M2T_THREADS"  # the variable that says how many cores a process may use at most


def cores(jobs: int | None) -> int:
    """As many processes as asked for, else as there are cores for this one."""
    affinity = getattr(os, "sched_getaffinity", None)  # not on every system
    there = len(affinity(0)) if affinity else os.cpu_count() or 1
    most = os.environ.get(THREADS, "")
    return jobs or (min(there, max(1, int(most))) if most.isdecimal() else there)


class _Place(local):
    """What each thread knows of itself: whether it works on one item of many beside others."""

    beside_others = False


_place = _Place()


def own_cores() -> int:
    """As many threads as the work at hand may take: 1 where it is one item of many that are worked on."""
    return 1 if _place.beside_others else cores(None)


def beside_others(function: Callable[[], Result]) -> Result:
    """What a function gives that works on one item of many: it leaves the other cores to the other items."""
    before, _place.beside_others = _place.beside_others, True
    try:
        return function()
    finally:
        _place.beside_others = before


def threaded(function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """What a function makes of each item, in their order, by a thread for each core.

    For functions that spend their time in compiled code, which lets other threads run. Items are taken as they
    are needed.
    """
    threads = own_cores()
    if threads == 1:
        yield from map(function, items)
        return
    from concurrent.futures import ThreadPoolExecutor

    pool = ThreadPoolExecutor(threads, initializer=_work_beside_others)
    try:
        waiting: deque[Any] = deque()
        for item in items:
            waiting.append(pool.submit(function, item))
            if len(waiting) > AHEAD * threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)


def together(function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    """What a function makes of each item, in their order, by the caller and threads for the other cores.

    For many small works in compiled code, which lets other threads run. To hand one over takes as long as some
    of them take to do, so the threads are kept, and each takes the next item as it comes free.
    """
    threads = own_cores()
    helpers = min(threads, len(items)) - 1
    if helpers < 1:
        return [function(item) for item in items]
    left = deque(enumerate(items))
    results: dict[int, Result] = {}

    def work() -> None:
        while True:
            try:
                number, item = left.popleft()
            except IndexError:
                return
            results[number] = function(item)

    helping = [_helpers(threads - 1).submit(work) for _ in range(helpers)]
    try:
        work()
    finally:
        left.clear()  # nothing is left, unless the function failed
        begun = [other for other in helping if not other.cancel()]
        for other in begun:
            other.exception()  # waits
    for other in begun:
        other.result()
    return [results[number] for number in range(len(items))]


@cache
def _helpers(threads: int) -> Any:
    from concurrent.futures import ThreadPoolExecutor

    return ThreadPoolExecutor(threads)


if hasattr(os, "register_at_fork"):  # not on every system
    os.register_at_fork(after_in_child=_helpers.cache_clear)  # which has none of its parent's threads


def _work_beside_others() -> None:
    _place.beside_others = True


def mapped(make: Callable[[], Callable[[Item], Result]], items: Iterable[Item], jobs: int) -> Iterator[Result]:
    """What the function that ``make()`` gives makes of each item, in their order, by so many processes.

    ``make`` is called once in each process, so that what the function holds is not sent with every item. All
    items are taken before the first result is given, and while they are made those before them are worked on.
    """
    coming = iter(items)
    first = list(islice(coming, 2))
    if jobs <= 1 or len(first) <= 1:
        yield from map(make(), [*first, *coming])
        return
    from concurrent.futures import ProcessPoolExecutor

    pool = ProcessPoolExecutor(jobs, initializer=_start, initargs=(make,))
    try:
        yield from pool.map(_work, chain(first, coming))
    finally:
        pool.shutdown(cancel_futures=True)


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
