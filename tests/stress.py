"""What an index promises, tried in full: `make stress` prints the table. The tests try the same for seconds."""

import errno
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "helpers"))

import crashes
import flips
import hostile
import readers
from crashes import BEFORE, WHOLE
from states import built, copied

from m2t_text.cli.console import note, print_table

Row = tuple[str, int, int, bool]  # what was tried, how often it held, of how many, and whether that will do

KILLS, FLIPS, SEARCHES, EARLY, PROCESSES, TRIES = 300, 1_000, 10_000, 100, 2, 20
GROWTH = 1.05  # of the memory of a long run


def random_kills(folder: Path) -> Iterator[Row]:
    counts = crashes.survive_kills(folder, KILLS, seed=1)
    survived, pairs = counts["survived"], KILLS // len(crashes.WRITERS)
    yield "writers killed at random moments, nothing committed lost", survived, KILLS, survived == KILLS
    yield "pairs of these that left a commit half done", counts["interrupted"], pairs, True


def every_step(folder: Path) -> Iterator[Row]:
    index = built(folder / "index", BEFORE)
    killed = refused = lost = wrong = 0
    for change in WHOLE.values():
        steps = crashes.steps_of(copied(index, folder / "copy").path, change)
        for step in range(steps):
            crashes.killed_at(index, folder / "copy", change, step)
            killed += 1
            for code in (errno.ENOSPC, errno.EIO):
                crashes.refused_at(index, folder / "copy", change, step, code)
                refused += 1
        counts = crashes.lose_power(copied(index, folder / "copy").path, change, BEFORE, TRIES, seed=1)
        lost, wrong = lost + counts["folders"], wrong + counts["wrong"]
    yield "writers killed before each step of a commit, old or new state", killed, killed, True
    yield "disks that refuse a step, old state and no litter", refused, refused, True
    yield "disks after a loss of power, old or new state", lost - wrong, lost, wrong == 0


def flipped_bytes(folder: Path) -> Iterator[Row]:
    counts = flips.flip(built(folder / "index", BEFORE), folder / "copy", FLIPS, seed=1)
    found = counts["found"] + counts["harmless"]
    yield "flipped bytes that `check` finds, or without effect", found, FLIPS, found == FLIPS
    repaired = counts["repaired"]
    yield "damaged indexes repaired to all that is whole", repaired, repaired, repaired > 0
    yield "of these, with nothing lost", counts["whole"], repaired, True


def hostile_indexes(folder: Path) -> Iterator[Row]:
    index = built(folder / "index", {"a": 5, "b": 11})
    index.optimize()
    index.search(readers.QUERIES[0])
    told = [
        hostile.suffer(index, folder / "copy", folder / "canary", attack) for attack in hostile.ATTACKS.values()
    ]
    refused = sum(one is not None for one in told)
    yield "hostile indexes refused with one line", refused, len(told), refused == len(told)


def readers_and_writer(folder: Path) -> Iterator[Row]:
    cycle = readers.Cycle.of(folder, seed=3, length=8)
    counts = readers.read_while_written(folder, cycle, SEARCHES, PROCESSES)
    right = counts["searches"] - counts["wrong"]
    what = f"searches during {counts['commits']:,} commits and merges, answers of one committed state"
    yield what, right, counts["searches"], counts["wrong"] == 0
    long = readers.run_long(folder, cycle, SEARCHES, EARLY, every=20)
    right = SEARCHES - long["wrong"]
    what = f"searches in one process, {SEARCHES // 20:,} commits, answers of a new index"
    yield what, right, SEARCHES, long["wrong"] == 0
    first, last = (long[f"bytes after {count}"] for count in (EARLY, SEARCHES))
    what = f"KB of memory after {SEARCHES:,} searches, of those after {EARLY} ({last / first - 1:+.1%})"
    yield what, last >> 10, first >> 10, last <= GROWTH * first
    first, last = (long[f"files after {count}"] for count in (EARLY, SEARCHES))
    yield f"open files after {SEARCHES:,} searches, of those after {EARLY}", last, first, last <= first


TRIALS: list[Callable[[Path], Iterator[Row]]] = [
    random_kills, every_step, flipped_bytes, hostile_indexes, readers_and_writer,
]  # fmt: skip


def main() -> int:
    """Runs all trials; returns 1 if a promise was broken."""
    rows, kept = [], True
    for trial in TRIALS:
        begin = time.monotonic()
        with tempfile.TemporaryDirectory(prefix="m2t-stress-") as folder:
            for what, held, of, will_do in trial(Path(folder)):
                rows.append([what, f"{held:,}", f"{of:,}", "yes" if will_do else "NO"])
                kept &= will_do
        note(f"{trial.__name__}: {time.monotonic() - begin:.0f} s")
    columns = {"tried": "left", "held": "right", "of": "right", "promise kept": "right"}
    print_table("What an index promises", columns, rows)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
