"""`make slam-bench`: the SLAM benchmark's metric on every log that has relations, as a table.

Each log is run twice: as it is, and without its odometry.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from m2t_text.evaluation.relations import published

ROOT = Path(__file__).resolve().parents[2]
LOGS = Path(os.environ.get("SLAM_LOGS", ROOT.parent / "shared" / "data" / "slam-benchmark"))
RIVALS = ("Cartographer (2016)", "Graph Mapping (2009)", "GMapping (2009)")
COLUMNS = (
    "log",
    "before loops, m",
    "m2t-text, m",
    "m2t-text, degrees",
    "loops",
    "without odometry, m",
    "degrees",
    *(f"{rival}, m" for rival in RIVALS),
    "seconds",
)


def main() -> None:
    logs = [log for log in sorted(LOGS.glob("*.log.gz")) if relations_of(log).is_file()]
    if not logs:
        sys.exit(
            f"no log with relations in {LOGS}: set SLAM_LOGS to a folder of NAME.log.gz and NAME.relations.gz"
        )
    print_row(COLUMNS)
    print_row(["---", *["---:"] * (len(COLUMNS) - 1)])
    for log in logs:
        begin = time.perf_counter()
        one = assessed(log)
        seconds = time.perf_counter() - begin
        before, after = one["relations"]["scan_matching"], one["relations"]["map"]
        alone = assessed(log, "--no-odometry")["relations"]["map"]
        others = published(one["dataset"])
        print_row(
            [
                one["dataset"],
                pair(before["translation"], 3),
                *[pair(after["translation"], 4), pair(after["rotation"], 2)],
                str(one["loops"]),
                *[pair(alone["translation"], 4), pair(alone["rotation"], 2)],
                *(pair(others[rival], 3) if rival in others else "" for rival in RIVALS),
                f"{seconds:.0f}",
            ]
        )


def assessed(log: Path, *options: str) -> dict[str, Any]:
    """What ``evaluate-loops --json`` says of a log."""
    command = [sys.executable, "-m", "m2t_text", "evaluate-loops", log, "--relations", relations_of(log)]
    done = subprocess.run([*command, "--json", *options], check=True, capture_output=True)
    one: dict[str, Any] = json.loads(done.stdout)["datasets"][0]
    return one


def relations_of(log: Path) -> Path:
    return log.with_name(log.name.replace(".log.gz", ".relations.gz"))


def pair(figures: tuple[float, float], digits: int) -> str:
    return f"{figures[0]:.{digits}f} ± {figures[1]:.{digits}f}"


def print_row(cells: tuple[str, ...] | list[str]) -> None:
    print("|", " | ".join(cells), "|", flush=True)


if __name__ == "__main__":
    main()
