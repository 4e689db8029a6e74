"""Beside a particle filter: MRPT's `pf-localization`, in the same map, from the same starts, as far driven.

The ground truth of a log's first half draws a map. Runs of the second half that it shows are given to both: raw
odometry and scans, and no initial pose. Right is a pose within 0.5 m and 5° of the true one at a run's end. The
filter begins with 40,000 particles all over the free space and the settings of its own demonstration. It takes
Debian's package mrpt-apps.

    PF_STARTS=100 PF_FROM=40 python tests/benchmarks/particle_filter.py [LOG...]     without the first 40
"""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image
from scipy.spatial import KDTree

from m2t_text import PROFILES, LiveSurvey, Localizer, Log, MapIndex, read_log, write_carmen
from m2t_text.mapping.local_map import local_maps, run_starts
from m2t_text.mapping.trajectory import survey
from m2t_text.saved_maps.grid import FREE, OCCUPIED, Grid
from m2t_text.saved_maps.occupancy_mapping import build_map
from m2t_text.sources.saved_map import SavedMap
from m2t_text.util.geometry import compose, inverse, transform, wrap
from m2t_text.util.types import Floats

RADISH = Path(__file__).resolve().parents[3] / "shared" / "data" / "radish"
LOGS = ("freiburg-079", "intel")
STARTS = int(os.environ.get("PF_STARTS", "100"))
FROM = int(os.environ.get("PF_FROM", "0"))  # of these starts; to share them among runs
RIGHT = (0.5, np.radians(5.0))  # m and rad by which a right pose may err
ON_WALL, COVERED = 0.25, 0.65  # m; the share of a run's points that must be so near to a wall of the map
PARAMETERS = PROFILES["default"]
ESTIMATE = re.compile(r"PDF estimation: \(([-\d.e+]+),([-\d.e+]+),([-\d.e+]+)deg\)")
SETTINGS = """
[KLD_options]
KLD_binSize_PHI_deg=10
KLD_binSize_XY=0.10
KLD_delta=0.01
KLD_epsilon=0.01
KLD_maxSampleSize=40000
KLD_minSampleSize=150
KLD_minSamplesPerBin=0
[PF_options]
PF_algorithm=0
resamplingMethod=0
adaptiveSampleSize=1
BETA=0.5
sampleSize=1
[DummyOdometryParams]
minStdXY=0.10
minStdPHI=2.0
[LocalizationExperiment]
use_3D_poses=false
map_file=map.gridmap
rawlog_file=run.rawlog
logOutput_dir=out
3DSceneFrequency=-1
experimentRepetitions=1
particles_count=40000
init_PDF_mode=0
init_PDF_min_x={low[0]}
init_PDF_max_x={high[0]}
init_PDF_min_y={low[1]}
init_PDF_max_y={high[1]}
SHOW_PROGRESS_3D_REAL_TIME=false
[MetricMap]
occupancyGrid_count=1
likelihoodMapSelection=-1
[MetricMap_occupancyGrid_00_creationOpts]
resolution={resolution}
[MetricMap_occupancyGrid_00_likelihoodOpts]
likelihoodMethod=4
LF_decimation=10
LF_stdHit=0.40
LF_maxCorrsDistance=0.30
LF_zHit=0.95
LF_zRandom=0.05
LF_maxRange=80
LF_alternateAverageMethod=0
"""


@dataclass(frozen=True)
class Start:
    """A run of the second half, as a log of its own."""

    run: Log
    truth: Floats  # (3,) of the robot at its end


@dataclass(frozen=True)
class Outcome:
    """What became of a start: metres and radians of error, seconds of processor time and of waiting."""

    error: tuple[float, float]
    processor: float
    wall: float
    match: bool = True

    @property
    def right(self) -> bool:
        return self.error[0] <= RIGHT[0] and self.error[1] <= RIGHT[1]


def main() -> None:
    tools = ("pf-localization", "image2gridmap", "carmen2rawlog")
    missing = [tool for tool in tools if shutil.which(tool) is None]
    if missing:
        sys.exit(f"{', '.join(missing)} not found: install Debian's package mrpt-apps")
    paths = [Path(name) for name in sys.argv[1:]] or [RADISH / f"{name}-corrected.log.gz" for name in LOGS]
    for path in paths:
        log = read_log(path)
        assert log.ground_truth is not None
        half = len(log.scans) // 2
        grid = build_map(log, log.ground_truth, np.arange(half))
        chosen = list(starts(log, half, grid))[FROM:]
        with TemporaryDirectory(prefix="m2t-text-") as folder:
            ours = list(found_by_text(grid, chosen, Path(folder) / "index"))
            theirs = list(found_by_filter(grid, chosen, Path(folder)))
        print(f"{log.name}: {len(chosen)} starts, {PARAMETERS.mapping.run_length:g} m of travel")
        show("m2t-text", ours)
        matches = [one for one in ours if one.match]
        print(f"    match: {len(matches)}, of which {sum(one.right for one in matches)} right")
        show("pf-localization", theirs)


def starts(log: Log, half: int, grid: Grid) -> Iterator[Start]:
    """Runs of the scans from ``half`` on that the map shows, drawn at random."""
    assert log.ground_truth is not None
    whole = survey(log, PARAMETERS.mapping)
    firsts = run_starts(whole, PARAMETERS.mapping.run_length)
    walls, found = KDTree(grid.centres(OCCUPIED)), 0
    for first in np.random.default_rng(0).permutation(firsts[firsts >= half]):
        (run,) = local_maps(whole, PARAMETERS.mapping, np.array([first]))
        away, _ = walls.query(transform(log.ground_truth[first], run.points))
        if np.mean(away <= ON_WALL) < COVERED:
            continue
        part = slice(run.first_scan, run.last_scan + 1)
        yield Start(
            replace(log, scans=log.scans[part], ground_truth=log.ground_truth[part]),
            log.ground_truth[run.last_scan],
        )
        found += 1
        if found == STARTS:
            return


def found_by_text(grid: Grid, chosen: list[Start], folder: Path) -> Iterator[Outcome]:
    index = MapIndex.create(folder, PARAMETERS)
    index.add(SavedMap("map", grid))
    Localizer(index).locate(index.document(index.ids[0]))  # compiled and opened by then
    for start in chosen:
        wall, processor = time.perf_counter(), time.process_time()
        survey, log = LiveSurvey(PARAMETERS, start.run.laser_pose), start.run
        for scan in log.scans:
            survey.add(scan)
        run = survey.last_run() or (survey.last_run(survey.driven) if survey.driven else None)
        place = Localizer(index).locate(run, survey.pose) if run else None  # none if just carried elsewhere
        taken = time.process_time() - processor, time.perf_counter() - wall
        pose, match = (None, False) if place is None else (place.pose, place.verdict == "match")
        yield Outcome(error(pose, start.truth), *taken, match=match)


def found_by_filter(grid: Grid, chosen: list[Start], folder: Path) -> Iterator[Outcome]:
    lay_out(grid, folder)
    for start in chosen:
        write_carmen(replace(start.run, ground_truth=None), folder / "run.log")
        called(folder, "carmen2rawlog", "-w", "-q", "-i", "run.log", "-o", "run.rawlog")
        shutil.rmtree(folder / "out_000_0040000", ignore_errors=True)
        before, wall = os.times(), time.perf_counter()
        told = called(folder, "pf-localization", "pf.ini")
        taken = time.perf_counter() - wall
        after = os.times()
        processor = after.children_user + after.children_system - before.children_user - before.children_system
        said = ESTIMATE.findall(told)
        pose = None if not said else np.array([float(value) for value in said[-1]]) * [1, 1, np.pi / 180]
        yield Outcome(error(pose, start.truth), processor, taken)


def lay_out(grid: Grid, folder: Path) -> None:
    """The map and the settings as MRPT reads them."""
    shades = np.select([grid.states == OCCUPIED, grid.states == FREE], [0, 255], 127).astype(np.uint8)
    Image.fromarray(shades[::-1]).save(folder / "map.png")
    size = np.array(shades.shape[::-1]) * grid.resolution
    low, high = grid.origin[:2], grid.origin[:2] + size
    (x, y), resolution = (low + high) / 2, grid.resolution
    sides = ("-r", str(resolution), "--cx", str(x), "--cy", str(y))
    called(folder, "image2gridmap", "-w", "-i", "map.png", "-o", "map.gridmap", *sides)
    text = SETTINGS.format(low=low, high=high, resolution=resolution)
    (folder / "pf.ini").write_text(text, encoding="ascii")


def called(folder: Path, *command: str) -> str:
    done = subprocess.run(command, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    if done.returncode:
        sys.exit(f"{' '.join(command)} failed: {done.stderr.decode(errors='replace')[-300:]}")
    return (done.stdout + done.stderr).decode(errors="replace")


def error(pose: Floats | None, truth: Floats) -> tuple[float, float]:
    if pose is None:
        return np.inf, np.pi
    away = compose(inverse(truth), pose)
    return float(np.hypot(*away[:2])), float(abs(wrap(away[2])))


def show(who: str, outcomes: list[Outcome]) -> None:
    right = sum(one.right for one in outcomes)
    processor, wall = (np.median([getattr(one, name) for one in outcomes]) for name in ("processor", "wall"))
    print(
        f"  {who}: {right} right, {100 * right / len(outcomes):.0f} %; "
        f"{processor:.2f} s of processor time, {wall:.2f} s in all, in the median",
        flush=True,
    )


if __name__ == "__main__":
    main()
