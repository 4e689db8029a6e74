"""Many readers of an index that is written all the time, and one that reads and writes for long."""

import gc
import os
import random
import resource
import shutil
import signal
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any

import children
from map_oracle import random_documents
from states import Change, State, built, changes, contents, expected, maps

from m2t_text.index.map_index import MapIndex

Answers = list[tuple[str, float, int]]

STAMP = "stamp"  # a dataset whose number of scans says which state an index is in
METHODS = ("m2t", "bow")  # the scores of bow depend on all maps of a state
QUERIES = [one.text for one in random_documents(1, "query", 4, 20)]
THREADS = 2  # that share one index, in each reading process
HELD = 25  # one state in so many is held while others are committed, and asked again


@dataclass(frozen=True)
class Cycle:
    """States that follow each other again and again, and what a new index in each of them answers.

    Attributes:
        changes: from each state to the next; the last one leads to the first.
        answers: for each state, by query and method.
    """

    changes: list[Change]
    answers: list[dict[tuple[int, str], Answers]]

    @classmethod
    def of(cls, folder: Path, seed: int, length: int) -> "Cycle":
        made, before = changes(seed, {}), State()
        steps: list[Change] = []
        while len(steps) < length - 1:
            change = next(made)
            if change.after != before:
                steps.append(change)
            before = change.after
        first: dict[str, int | None] = dict.fromkeys(before)
        steps.insert(0, Change(first, True, {}))
        answers = []
        for number, step in enumerate(steps):
            with_stamp = built(folder / "fresh", {})
            stamp(with_stamp, Change(dict(step.after), False, step.after), number)
            answers.append({key: ask(with_stamp, *key) for key in keys()})
        shutil.rmtree(folder / "fresh")
        return cls(steps, answers)


def keys() -> list[tuple[int, str]]:
    return [(number, method) for number in range(len(QUERIES)) for method in METHODS]


def stamp(index: MapIndex, change: Change, number: int) -> None:
    """Makes the change that leads to a state of a cycle, and stamps it with the state's number."""
    with index.writer() as writer:
        for name, seed in change.replaced.items():
            writer.replace(name, [] if seed is None else maps(seed, name))
        writer.replace(STAMP, maps(5, STAMP), (number, 0.0))
        writer.optimize = change.optimize


def ask(index: MapIndex, query: int, method: Any) -> Answers:
    hits = index.search(QUERIES[query], top=0, method=method)
    return [(hit.map_id, hit.score, hit.matched) for hit in hits]


def state_of(index: MapIndex) -> int:
    """The number of the state that an index is in."""
    return next(dataset.scans for dataset in index.datasets() if dataset.name == STAMP)


def right(cycle: Cycle, view: MapIndex, query: int, method: str) -> bool:
    """Whether one state gave the answer, and it is that of a new index."""
    return ask(view, query, method) == cycle.answers[state_of(view)][query, method]


# --- Many readers


def read_while_written(folder: Path, cycle: Cycle, searches: int, processes: int) -> dict[str, int]:
    """Searches in several processes, and in several threads of each, while another process commits and merges.

    Returns the number of searches, of those whose answer no committed state gives, and of commits.
    """
    path = folder / "index"
    stamp(built(path, {}), cycle.changes[0], 0)
    first = MapIndex.open(path).whoosh.latest_generation()
    writer = children.start(_write_on, path, cycle)
    share = searches // processes // THREADS
    try:
        counts = _together([partial(children.call, _read, path, cycle, share, n) for n in range(processes)])
    finally:
        os.kill(writer, signal.SIGKILL)
        children.status(writer)
    sums = {name: sum(count[name] for count in counts) for name in ("searches", "wrong")}
    return sums | {"commits": MapIndex.open(path).whoosh.latest_generation() - first}


def _write_on(path: Path, cycle: Cycle) -> None:
    index, number = MapIndex.open(path), 0
    while True:
        number = (number + 1) % len(cycle.changes)
        stamp(index, cycle.changes[number], number)


def _read(path: Path, cycle: Cycle, searches: int, seed: int) -> dict[str, int]:
    index = MapIndex.open(path)
    return _summed(_together([partial(_search, index, cycle, searches, seed * 10 + n) for n in range(THREADS)]))


def _search(index: MapIndex, cycle: Cycle, searches: int, seed: int) -> dict[str, int]:
    rng, wrong, held = random.Random(seed), 0, index.pinned()
    for number in range(searches):
        view = held if number % 2 else index.pinned()
        wrong += not right(cycle, view, *rng.choice(keys()))
        if number % HELD == 0:
            wrong += contents(held) != _contents(cycle, state_of(held))
            held = index.pinned()
    return {"searches": searches, "wrong": wrong}


def _contents(cycle: Cycle, number: int) -> Any:
    return expected(cycle.changes[number].after | {STAMP: 5})


def _together(works: list[Callable[[], dict[str, int]]]) -> list[dict[str, int]]:
    """What all of them return, each run in a thread of its own."""
    results: list[dict[str, int]] = []
    threads = [Thread(target=lambda work=work: results.append(work())) for work in works]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == len(works), "a reader failed"
    return results


def _summed(counts: list[dict[str, int]]) -> dict[str, int]:
    return {name: sum(count[name] for count in counts) for name in counts[0]}


# --- Long runs


def run_long(folder: Path, cycle: Cycle, searches: int, early: int, every: int) -> dict[str, int]:
    """Searches for long in a process that also commits and merges, each time after so many searches.

    Returns the number of wrong answers, and of bytes in memory, open files and mappings of the index, after
    the early searches and after all.
    """
    path = folder / "index"
    stamp(built(path, {}), cycle.changes[0], 0)
    return dict(children.call(_run_long, path, cycle, searches, early, every))


def _run_long(path: Path, cycle: Cycle, searches: int, early: int, every: int) -> dict[str, int]:
    index, rng, counts = MapIndex.open(path), random.Random(1), {"wrong": 0}
    for number in range(searches):
        if number % every == 0:
            state = number // every % len(cycle.changes)
            stamp(index, cycle.changes[state], state)
        counts["wrong"] += not right(cycle, index, *rng.choice(keys()))
        if number + 1 in (early, searches):
            counts |= {f"{name} after {number + 1}": taken for name, taken in _taken(path).items()}
    return counts


def _taken(path: Path) -> dict[str, int]:
    gc.collect()
    resident = int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()
    mappings = Path("/proc/self/maps").read_text().count(str(path))
    return {"bytes": resident, "files": len(list(Path("/proc/self/fd").iterdir())), "mappings": mappings}
