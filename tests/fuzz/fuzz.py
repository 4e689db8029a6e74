"""Fuzzes every reader: `make fuzz` prints the table.

Each target gets FUZZ_RUNS inputs, or as many as fit into FUZZ_MINUTES for all of them. FUZZ_JOBS targets run
side by side, or as many as there are processors.

Findings are kept in ``indexes/fuzz``. Move one, once its cause is mended, to ``tests/fuzz/found/TARGET``: the
usual tests read all that is there.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from math import ceil
from pathlib import Path

from targets import TARGETS

from m2t_text.cli.console import note, print_table
from m2t_text.util.workers import cores

RUNS = 100_000
MORE = 75  # exit status of a process that read as much as it has memory for, and another one goes on
MEMORY = Path("/dev/shm")  # a disk would take longer to keep the inputs than the readers to read them
MALLOC = {"MALLOC_MMAP_THRESHOLD_": "1000000"}  # what one input took is given back, not counted with the next
FINDINGS = Path(__file__).resolve().parents[2] / "indexes" / "fuzz"
COLUMNS = {"target": "left", **dict.fromkeys(("runs", "read", "seconds", "slowest s", "peak MB"), "right")}


def fuzzed(name: str, runs: int, seconds: float | None, folder: Path) -> tuple[list[str], bool]:
    """A row of the table, and whether nothing was found."""
    statistics, findings = folder / f"{name}.json", FINDINGS / name
    findings.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, str(Path(__file__).with_name("child.py")), name, str(runs)]
    end, status, told = None if seconds is None else time.monotonic() + seconds, MORE, ""
    while status == MORE:
        child = subprocess.Popen(
            [*command, str(statistics), str(findings)], env=os.environ | MALLOC, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
        )  # fmt: skip
        try:
            told, _ = child.communicate(timeout=None if end is None else max(0.0, end - time.monotonic()))
            status = child.returncode
        except subprocess.TimeoutExpired:
            child.kill()
            child.communicate()
            status = 0
    sound = status == 0
    if not sound:
        print(f"{name}: exit status {status}\n{told[told.find(' === ') :]}", file=sys.stderr)
    found = json.loads(statistics.read_text()) if statistics.exists() else dict.fromkeys(("runs", "sound"), 0)
    took = [
        f"{found.get('seconds', 0):,.0f}",
        f"{found.get('slowest', 0):.2f}",
        f"{found.get('megabytes', 0):,}",
    ]
    return [name, f"{found['runs']:,}", f"{found['sound']:,}", *took], sound


def main(names: list[str]) -> int:
    """Fuzzes these targets, or all; returns 1 if anything was found."""
    runs, minutes = int(os.environ.get("FUZZ_RUNS", RUNS)), os.environ.get("FUZZ_MINUTES")
    chosen, jobs = names or list(TARGETS), cores(int(os.environ.get("FUZZ_JOBS", "0")))
    seconds = 60 * float(minutes) / ceil(len(chosen) / jobs) if minutes else None
    rows, sound = [], True
    place = MEMORY if MEMORY.is_dir() else None
    with (
        tempfile.TemporaryDirectory(prefix="m2t-fuzz-", dir=place) as folder,
        ThreadPoolExecutor(jobs) as side_by_side,
    ):
        for row, held in side_by_side.map(lambda name: fuzzed(name, runs, seconds, Path(folder)), chosen):
            note("  ".join(row))
            rows.append(row)
            sound &= held
    print_table("Damaged inputs: read, or refused with one line", COLUMNS, rows)
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
