"""Fuzzes every reader: `make fuzz` prints the table.

Each target gets FUZZ_RUNS inputs, or as many as fit into FUZZ_MINUTES for all of them.

Findings are kept in ``indexes/fuzz``. Move one, once its cause is mended, to ``tests/fuzz/found/TARGET``: the
usual tests read all that is there.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from targets import TARGETS

from m2t_text.cli.console import note, print_table

RUNS = 100_000
FINDINGS = Path(__file__).resolve().parents[2] / "indexes" / "fuzz"
COLUMNS = {"target": "left", **dict.fromkeys(("runs", "read", "seconds", "slowest s", "peak MB"), "right")}


def fuzzed(name: str, runs: int, seconds: float | None, folder: Path) -> tuple[list[str], bool]:
    """A row of the table, and whether nothing was found."""
    statistics, findings = folder / f"{name}.json", FINDINGS / name
    findings.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, str(Path(__file__).with_name("child.py")), name, str(runs)]
    child = subprocess.Popen(
        [*command, str(statistics), str(findings)],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
    )  # fmt: skip
    sound = True
    try:
        told, _ = child.communicate(timeout=seconds)
        sound = child.returncode == 0
    except subprocess.TimeoutExpired:
        child.kill()
        told, _ = child.communicate()
    if not sound:
        print(f"{name}: exit status {child.returncode}\n{told[told.find(' === ') :]}", file=sys.stderr)
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
    chosen = names or list(TARGETS)
    seconds = 60 * float(minutes) / len(chosen) if minutes else None
    rows, sound = [], True
    with tempfile.TemporaryDirectory(prefix="m2t-fuzz-") as folder:
        for name in chosen:
            row, held = fuzzed(name, runs, seconds, Path(folder))
            note("  ".join(row))
            rows.append(row)
            sound &= held
    print_table("Damaged inputs: read, or refused with one line", COLUMNS, rows)
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
