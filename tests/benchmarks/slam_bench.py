"""`make slam-bench`: the SLAM benchmark's metric on every log that has relations, as a table."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

from m2t_text.evaluation.relations import published

ROOT = Path(__file__).resolve().parents[2]
LOGS = Path(os.environ.get("SLAM_LOGS", ROOT.parent / "shared" / "data" / "slam-benchmark"))
RIVALS = ("Cartographer (2016)", "Graph Mapping (2009)", "GMapping (2009)")


def main() -> None:
    logs = [log for log in sorted(LOGS.glob("*.log.gz")) if relations_of(log).is_file()]
    if not logs:
        sys.exit(
            f"no log with relations in {LOGS}: set SLAM_LOGS to a folder of NAME.log.gz and NAME.relations.gz"
        )
    print("| log | before loops, m | m2t-text, m | m2t-text, degrees |", " | ".join(RIVALS), "| seconds |")
    print("| --- | ---: | ---: | ---: |", " | ".join("---:" for _ in RIVALS), "| ---: |")
    for log in logs:
        begin = time.perf_counter()
        command = [
            sys.executable,
            "-m",
            "m2t_text",
            "evaluate-loops",
            log,
            "--relations",
            relations_of(log),
            "--json",
        ]
        (one,) = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)["datasets"]
        before, after = one["relations"]["scan_matching"], one["relations"]["map"]
        figures = [pair(before["translation"], 3), pair(after["translation"], 4), pair(after["rotation"], 2)]
        others = published(one["dataset"])
        figures += [pair(others[rival], 3) if rival in others else "" for rival in RIVALS]
        print(
            f"| {one['dataset']} |", " | ".join(figures), f"| {time.perf_counter() - begin:.0f} |", flush=True
        )


def relations_of(log: Path) -> Path:
    return log.with_name(log.name.replace(".log.gz", ".relations.gz"))


def pair(figures: tuple[float, float], digits: int) -> str:
    return f"{figures[0]:.{digits}f} ± {figures[1]:.{digits}f}"


if __name__ == "__main__":
    main()
