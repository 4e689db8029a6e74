"""An index that grows for days: laps of one simulated building, and what is kept of them.

A lap goes there and back, each time with other doors open, other people and other noise. Printed is, for each
number of maps that are kept of a place, how many the index holds after some laps, and how many places of one
more lap are found in it.

    python tests/benchmarks/patrol.py     PATROL_LAPS=20 laps, PATROL_KEEP=1,2,4 maps of a place
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from tempfile import TemporaryDirectory

import numpy as np

from m2t_text import (
    PROFILES,
    Document,
    GrowingDataset,
    Log,
    MapIndex,
    Query,
    Simulation,
    describe,
    find,
    simulate,
)
from m2t_text.live.survey import LiveSurvey
from m2t_text.util.geometry import between, compose, inverse, wrap
from m2t_text.util.types import Floats

LAPS = int(os.environ.get("PATROL_LAPS", "20"))
KEEP = [int(part) for part in os.environ.get("PATROL_KEEP", "1,2,4").split(",")]
BUILDING = Simulation(seed=7, length=24.0, travel=32.0, beams=180, people=2)
SHOWN = (1, 2, 5, 10, 20)  # laps after which the index is looked at
RIGHT = (0.5, np.radians(10.0))  # m and rad within which a pose is right
EVERY = 1.0  # m of travel from one place that is looked up to the next
PARAMETERS = PROFILES["default"]


@dataclass(frozen=True)
class Patrol:
    """The maps of a drive, the number of the lap that each is of, and the true poses (S, 3) of all scans."""

    documents: Sequence[Document]
    laps: Sequence[int]
    truth: Floats


def main() -> None:
    patrol = described(joined([leg for lap in range(LAPS + 1) for leg in legs(lap)]))
    one = sum(lap == 0 for lap in patrol.laps)
    print(f"{LAPS} laps of {patrol.documents[-1].travel[1] / (LAPS + 1):.0f} m, {one} maps each")
    print(
        "kept of a place | maps after laps " + ", ".join(map(str, SHOWN)) + " | times one lap | found | match"
    )
    for most in [None, *KEEP]:
        with TemporaryDirectory(prefix="m2t-text-") as folder:
            index, maps = grown(folder, patrol, most)
            found, match, asked = looked_up(index, patrol)
        counts = ", ".join(f"{count:,}" for count in maps)
        print(
            f"{most or 'all'} | {counts} | {maps[-1] / one:.2f} | {100 * found / asked:.1f} % of {asked} "
            f"| {100 * match / asked:.1f} %",
            flush=True,
        )


def legs(lap: int) -> list[Log]:
    """There and back."""
    return [
        simulate(replace(BUILDING, drive=2 * lap)),
        simulate(replace(BUILDING, drive=2 * lap + 1, backwards=True)),
    ]


def joined(logs: Sequence[Log]) -> Log:
    """One drive: each log's odometry goes on where the last one's ended, as its robot does."""
    scans, truth = list(logs[0].scans), [np.asarray(logs[0].ground_truth)]
    for log in logs[1:]:
        assert log.ground_truth is not None
        motion = between(truth[-1][-1], log.ground_truth[0])
        frame = compose(compose(scans[-1].odometry, motion), inverse(log.scans[0].odometry))
        scans += [replace(scan, odometry=compose(frame, scan.odometry)) for scan in log.scans]
        truth.append(log.ground_truth)
    return replace(logs[0], scans=tuple(scans), ground_truth=np.concatenate(truth), name="patrol")


def described(log: Log) -> Patrol:
    survey, documents, laps = LiveSurvey(PARAMETERS, log.laser_pose), [], []
    count = len(log.scans)
    for k, scan in enumerate(log.scans):
        survey.add(scan)
        for run in survey.new_runs():
            documents.append(describe(run, "patrol", PARAMETERS))
            laps.append(k * (LAPS + 1) // count)
    assert log.ground_truth is not None
    return Patrol(documents, laps, log.ground_truth)


def grown(folder: str, patrol: Patrol, most: int | None) -> tuple[MapIndex, list[int]]:
    """The index of all laps but the last one, and its maps after some of them."""
    index = MapIndex.create(folder, PARAMETERS)
    past, maps, done = GrowingDataset(index, "patrol", most), [], 0
    for document, lap in zip(patrol.documents, patrol.laps, strict=True):
        if lap > done:
            done = lap
            if lap in SHOWN:
                past.commit()
                maps.append(len(index))
        if lap == LAPS:
            break
        past.add(document)
    return index, maps


def looked_up(index: MapIndex, patrol: Patrol) -> tuple[int, int, int]:
    """Of the last lap's places: how many are found, how many with a right `match`, and how many there are."""
    found = match = asked = 0
    after = 0.0
    for document, lap in zip(patrol.documents, patrol.laps, strict=True):
        if lap < LAPS or document.travel[0] < after:
            continue
        after = document.travel[0] + EVERY
        finding = find(index, Query.of(document), 1)
        best = finding.results[0]
        true = between(patrol.truth[best.hit.document.first_scan], patrol.truth[document.first_scan])
        error = np.full(3, np.inf) if best.pose is None else compose(inverse(true), best.pose)
        right = bool(np.hypot(*error[:2]) <= RIGHT[0] and abs(wrap(error[2])) <= RIGHT[1])
        found, match, asked = found + right, match + (right and finding.verdict == "match"), asked + 1
    return found, match, asked


if __name__ == "__main__":
    main()
