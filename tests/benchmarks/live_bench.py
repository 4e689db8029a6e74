"""Live answers on real logs: the first half of each is the map, its second half is driven in it.

Prints how many answers are right and how many are a `match`, after how many metres a robot that was carried
elsewhere is found, how long an answer takes in a saved map, what a scan costs while nothing is asked, and how
memory grows. The ground truth judges, and is not read by what answers.

    LIVE_PARTS=followed,carried,latency,idle,memory python tests/benchmarks/live_bench.py [LOG...]
    LIVE_PARTS=carried LIVE_SEED=1 python tests/benchmarks/live_bench.py [LOG...]     cut at other places
"""

import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial import KDTree

from m2t_text import PROFILES, LiveSurvey, Localizer, Log, MapIndex, describe, read_log
from m2t_text.live.messages import Swept
from m2t_text.live.session import LATEST, Session
from m2t_text.mapping.local_map import LocalMap
from m2t_text.saved_maps.grid import OCCUPIED
from m2t_text.saved_maps.occupancy_mapping import build_map
from m2t_text.sources.opening import LogSource
from m2t_text.sources.saved_map import SavedMap
from m2t_text.util.geometry import between, compose, inverse, transform, travel, wrap
from m2t_text.util.types import Floats

RADISH = Path(__file__).resolve().parents[3] / "shared" / "data" / "radish"
LOGS = ("freiburg-079", "intel")
PARTS = os.environ.get("LIVE_PARTS", "followed,carried,latency,idle,memory").split(",")
EVERY = 2.0  # m of travel from one request to the next; in a robot that was carried elsewhere half of it
RIGHT = (1.0, np.radians(10.0))  # m and rad within which a pose is right
NEAR = 1.0  # m between the centres of a run and of a map of its place
SEED = int(os.environ.get("LIVE_SEED", "0"))
CUTS = 20  # places to which the drive is carried,
BEFORE, AFTER, KNOWN = 8.0, 25.0, 5.0  # m driven before and after, and after it in a place that the map shows
SCANS = int(os.environ.get("LIVE_SCANS", "100000"))
REQUESTS = 100


def main() -> None:
    paths = [Path(name) for name in sys.argv[1:]] or [RADISH / f"{name}-corrected.log.gz" for name in LOGS]
    for path in paths:
        log = read_log(path)
        with TemporaryDirectory(prefix="m2t-text-") as folder:
            if "followed" in PARTS or "carried" in PARTS:
                known = Known.of(log, Path(folder) / "first")
                print(
                    f"{log.name}: {len(known.index):,} maps of the first half, "
                    f"{len(known.second.scans):,} scans driven in them"
                )
                if "followed" in PARTS:
                    followed(known)
                if "carried" in PARTS:
                    carried_away(known)
            if "latency" in PARTS and path == paths[0]:
                latency(log, Path(folder) / "saved")
    if "idle" in PARTS:
        idle(read_log(paths[0]))
    if "memory" in PARTS:
        memory(read_log(paths[0]))


@dataclass(frozen=True)
class Known:
    """The halves of a log, an index of the first one, and what of the second one the first one shows.

    Attributes:
        near: (S,) whether the first half came within NEAR of each scan of the second.
        centres: the centres of gravity of all maps of the index, at their true poses.
    """

    index: MapIndex
    first: Log
    second: Log
    near: np.ndarray
    centres: KDTree

    @classmethod
    def of(cls, log: Log, folder: Path) -> "Known":
        first, second = halves(log)
        index = MapIndex.create(folder, PROFILES["default"])
        index.add(LogSource(first), jobs=2)
        true, driven = true_poses(first), true_poses(second)
        centres = [transform(true[one.first_scan], one.centre_of_gravity[None])[0] for one in index.documents()]
        near = KDTree(true[:, :2]).query(driven[:, :2])[0] < NEAR
        return cls(index, first, second, np.asarray(near), KDTree(np.array(centres)))

    def shows(self, run: LocalMap) -> bool:
        """Whether a map of the place of a run of the second half is in the index, as `evaluate` has it."""
        centre = describe(run, "live", self.index.parameters).centre_of_gravity
        placed = transform(true_poses(self.second)[run.first_scan], centre[None])
        return bool(self.centres.query(placed[0])[0] <= NEAR)

    def right(self, map_id: str, pose: Floats, scan: int) -> bool:
        """Whether a pose is right as seen from the hit, so that drift of the map's trajectory counts little."""
        hit = self.index.document(map_id)
        true = between(true_poses(self.first)[hit.first_scan], true_poses(self.second)[scan])
        error = compose(inverse(true), between(hit.pose, pose))
        return bool(np.hypot(*error[:2]) <= RIGHT[0] and abs(wrap(error[2])) <= RIGHT[1])


def halves(log: Log) -> tuple[Log, Log]:
    half, true = len(log.scans) // 2, true_poses(log)
    return (
        replace(log, scans=log.scans[:half], ground_truth=true[:half], name="first"),
        replace(log, scans=log.scans[half:], ground_truth=true[half:], name="second"),
    )


def true_poses(log: Log) -> Floats:
    assert log.ground_truth is not None
    return log.ground_truth


def requests(log: Log, every: float) -> Iterator[tuple[int, LiveSurvey, LocalMap]]:
    """A drive: the scan of each request, the survey by then, and its last run."""
    survey, asked = LiveSurvey(PROFILES["default"], log.laser_pose), 0.0
    for k, scan in enumerate(log.scans):
        survey.add(scan)
        if survey.travel < asked + every:
            continue
        run = survey.last_run()
        if run is not None:
            asked = survey.travel
            yield k, survey, run


@dataclass(frozen=True)
class Answered:
    """A request: whether it was a `match`, by earlier answers, and right; and whether the map shows the place:
    as `evaluate` has it, and merely by where the run begins."""

    match: bool
    confirmed: bool
    right: bool
    shown: bool
    near: bool


def followed(known: Known) -> None:
    """The drive, as `m2t-text live --every 2` takes it."""
    session = Session(known.index.parameters, Localizer(known.index), EVERY, False, known.second.laser_pose)
    answers = []
    for k, scan in enumerate(known.second.scans):
        for place in session.take(Swept(scan, True)):
            run = session.last_run()
            if place["type"] != "place" or run is None:
                continue
            found = place["pose"] is not None
            right = found and known.right(place["map_id"], np.array(place["pose"]), k)
            match = place["verdict"] == "match"
            near = bool(known.near[run.first_scan])
            answers.append(Answered(match, match and place["confirmed"], right, known.shows(run), near))
    matches = [one for one in answers if one.match]
    good = sum(one.right for one in matches)
    confirmed = sum(one.confirmed for one in matches)
    print(f"followed: {len(answers)} requests, {len(matches)} match, {confirmed} of them by earlier answers")
    print(f"  of the matches {good} are right, {100 * good / max(len(matches), 1):.1f} %")
    for what, chosen in (
        ("a map of the place is in the index", [one for one in answers if one.shown]),
        ("the first half came by where the run begins", [one for one in answers if one.near]),
    ):
        count = sum(one.match for one in chosen)
        print(f"  where {what}: {count} of {len(chosen)} match, {100 * count / max(len(chosen), 1):.0f} %")


def carried_away(known: Known) -> None:
    """The drive is cut and glued to another part of itself, and the odometry joined, so that nothing tells.

    It goes on where the map shows the place, as a robot cannot be found elsewhere.
    """
    second, rng = known.second, np.random.default_rng(SEED)
    way = travel(second.odometry)
    shown = [(way[run.first_scan], known.shows(run)) for _, _, run in requests(second, 0.5)]
    begins = [at for at, _ in shown if all(good for one, good in shown if at <= one <= at + KNOWN)]
    begins = [at for at in begins if at + KNOWN < way[-1] - BEFORE]
    metres, wrong = [], 0
    for _ in range(CUTS):
        before, after = rng.uniform(0.0, way[-1] - BEFORE), rng.choice(begins)
        numbers, glued = glue(way, before, after)
        last, following = (second.scans[numbers[k]].odometry for k in (glued - 1, glued))
        frame = compose(last, inverse(following))
        localizer = Localizer(known.index)
        session = Session(known.index.parameters, localizer, EVERY / 2, False, second.laser_pose)
        found, carried = np.inf, 0.0
        for k, number in enumerate(numbers):
            scan = second.scans[number]
            if k == glued:
                carried = session.survey.travel
            if k >= glued:
                scan = replace(scan, odometry=compose(frame, scan.odometry))
            for answer in session.take(Swept(scan, True)):
                if answer["type"] != "place" or answer["verdict"] != "match" or k < glued:
                    continue
                right = known.right(answer["map_id"], np.array(answer["pose"]), number)
                wrong += not right
                found = min(found, session.survey.travel - carried) if right else found
            if np.isfinite(found):
                break
        metres.append(found)
    print(f"carried away {CUTS} times: right again after {np.median(metres):.1f} m in the median,")
    most, never = np.percentile(metres, 90, method="lower"), int(np.isinf(metres).sum())
    print(f"  {most:.1f} m in nine of ten; {never} times not within {AFTER:g} m; {wrong} wrong match meanwhile")


def glue(way: Floats, before: float, after: float) -> tuple[list[int], int]:
    """The scans of the glued drive, and how many of them are those before the cut."""
    first, then = np.searchsorted(way, [(before, before + BEFORE), (after, after + AFTER)]).tolist()
    return [*range(*first), *range(*then)], first[1] - first[0]


def latency(log: Log, folder: Path) -> None:
    """Requests in a saved map of the first half, of runs of the second half that it shows."""
    first, second = halves(log)
    grid = build_map(first, true_poses(first), np.arange(len(first.scans)))
    index = MapIndex.create(folder, PROFILES["default"])
    index.add(SavedMap("saved", grid))
    walls, true = KDTree(grid.centres(OCCUPIED)), true_poses(second)
    localizer, seconds, shown = Localizer(index), [], []
    localizer.locate(index.document(index.ids[0]))
    localizer.reset()
    half = index.parameters.mapping.run_length / 2
    for _, survey, run in requests(second, 1.0):
        begin = time.perf_counter()
        localizer.locate(run, survey.pose, filter(None, map(survey.last_run, [half])), survey.last_run(LATEST))
        seconds.append(time.perf_counter() - begin)
        shown.append(np.mean(walls.query(transform(true[run.first_scan], run.points))[0] <= 0.25) >= 0.65)
        if len(seconds) == REQUESTS:
            break
    times, on_map = np.array(seconds), np.array(shown)
    print(f"a saved map of {len(index):,} local maps, {len(times)} requests, from request to answer:")
    for what, chosen in (("all", times), ("on the map", times[on_map]), ("off it", times[~on_map])):
        if len(chosen):
            p50, p95 = np.percentile(chosen, [50, 95]) * 1e3
            print(f"  {what}: {len(chosen)}, p50 {p50:.0f} ms, p95 {p95:.0f} ms")


def idle(log: Log) -> None:
    survey = LiveSurvey(PROFILES["default"], log.laser_pose)
    for scan in log.scans[:200]:
        survey.add(scan)
    begin = time.process_time()
    for scan in log.scans[200:1200]:
        survey.add(scan)
    taken = (time.process_time() - begin) / 1000
    print(f"processor time a scan of {len(log.scans[0].ranges)} beams: {taken * 1e3:.2f} ms")


def memory(log: Log) -> None:
    """There and back, over and over."""
    survey = LiveSurvey(PROFILES["default"], log.laser_pose)
    part = log.scans[:400]
    early, taken = 0, 0
    while taken < SCANS:
        for scan in (*part, *part[::-1]):
            survey.add(scan)
            taken += 1
            if taken == 1000:
                early = resident()
    late = resident()
    print(f"resident memory: {early / 1e6:.1f} MB after 1,000 scans, {late / 1e6:.1f} MB after {taken:,},")
    print(f"  {100 * (late / early - 1):+.1f} %")


def resident() -> int:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


if __name__ == "__main__":
    main()
