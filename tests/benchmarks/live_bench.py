"""Live answers on a real log: its first half is the map, its second half is driven in it.

Prints how many answers are right and how many are a `match`, how long they take, what a scan costs while
nothing is asked, and how memory grows. The ground truth judges, and is not read by what answers.

    python tests/benchmarks/live_bench.py [LOG]     by default the corrected log of Freiburg's building 079
"""

import os
import sys
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from m2t_text import PROFILES, LiveSurvey, Localizer, Log, MapIndex, Place, read_log
from m2t_text.live.messages import Swept
from m2t_text.live.session import Session
from m2t_text.sources.opening import LogSource
from m2t_text.util.geometry import between, compose, inverse, travel, wrap

RADISH = Path(__file__).resolve().parents[3] / "shared" / "data" / "radish"
EVERY = 2.0  # m of travel from one request to the next
RIGHT = (1.0, np.radians(10.0))  # m and rad within which a pose is right
CUTS = 20  # places to which the drive is carried
SCANS = int(os.environ.get("LIVE_SCANS", "100000"))


def main() -> None:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else RADISH / "freiburg-079-corrected.log.gz"
    log = read_log(path)
    assert log.ground_truth is not None
    half = len(log.scans) // 2
    first = replace(log, scans=log.scans[:half], ground_truth=log.ground_truth[:half], name="first")
    second = replace(log, scans=log.scans[half:], ground_truth=log.ground_truth[half:], name="second")
    with TemporaryDirectory(prefix="m2t-text-") as folder:
        index = MapIndex.create(folder, PROFILES["default"])
        index.add(LogSource(first), jobs=2)
        print(f"{log.name}: {len(index):,} maps of {half:,} scans, {len(second.scans):,} scans driven in them")
        followed(index, first, second)
        carried_away(index, first, second)
    idle(second)
    memory(second)


def judged(place: Place, first: Log, truth: np.ndarray, index: MapIndex) -> bool:
    """Whether a pose is right as seen from the hit, so that drift of the map's trajectory counts little."""
    assert first.ground_truth is not None and place.pose is not None and place.map_id is not None
    hit = index.document(place.map_id)
    seen = between(hit.pose, place.pose)
    true = between(first.ground_truth[hit.first_scan], truth)
    error = compose(inverse(true), seen)
    return bool(np.hypot(*error[:2]) <= RIGHT[0] and abs(wrap(error[2])) <= RIGHT[1])


def followed(index: MapIndex, first: Log, second: Log) -> None:
    assert second.ground_truth is not None
    survey, localizer = LiveSurvey(index.parameters, second.laser_pose), Localizer(index)
    localizer.locate(index.document(index.ids[0]))
    localizer.reset()
    near = visited(first, second)
    asked, answers, seconds = 0.0, [], []
    for k, scan in enumerate(second.scans):
        pose = survey.add(scan)
        run = survey.last_run()
        if run is None or survey.travel < asked + EVERY:
            continue
        asked = survey.travel
        begin = time.perf_counter()
        place = localizer.locate(run, pose)
        seconds.append(time.perf_counter() - begin)
        right = place.pose is not None and judged(place, first, second.ground_truth[k], index)
        answers.append((place.verdict, right, bool(near[run.first_scan]), place.confirmed))
    show("followed", answers)
    p50, p95 = np.percentile(seconds, [50, 95]) * 1e3
    print(f"request to answer: p50 {p50:.0f} ms, p95 {p95:.0f} ms")


def show(what: str, answers: list[tuple[str, bool, bool, bool]]) -> None:
    matches = [one for one in answers if one[0] == "match"]
    known = [one for one in answers if one[2]]
    right = sum(one[1] for one in matches)
    of_known = sum(one[0] == "match" for one in known)
    confirmed = sum(one[3] for one in matches)
    print(f"{what}: {len(answers)} requests, {len(matches)} match, {confirmed} of them by earlier answers")
    print(f"  of the matches {right} are right, {100 * right / max(len(matches), 1):.1f} %")
    share = 100 * of_known / max(len(known), 1)
    print(f"  where the first half came by, {of_known} of {len(known)} match, {share:.0f} %")


def visited(first: Log, second: Log) -> np.ndarray:
    """(S,) whether the first half came within 1 m of each scan of the second."""
    assert first.ground_truth is not None and second.ground_truth is not None
    from scipy.spatial import KDTree

    return np.asarray(KDTree(first.ground_truth[:, :2]).query(second.ground_truth[:, :2])[0] < 1.0)


def carried_away(index: MapIndex, first: Log, second: Log) -> None:
    """The drive is cut and glued to another part of itself, and the odometry joined, so that nothing tells."""
    assert second.ground_truth is not None
    rng = np.random.default_rng(0)
    way = travel(second.odometry)
    metres, wrong = [], 0
    for _ in range(CUTS):
        before, after = rng.uniform(0.0, way[-1] - 30.0, 2)
        numbers = [*between_metres(way, before, before + 8.0), *between_metres(way, after, after + 25.0)]
        glued = len(between_metres(way, before, before + 8.0))
        last, following = (second.scans[numbers[k]].odometry for k in (glued - 1, glued))
        frame = compose(last, inverse(following))
        session = Session(index.parameters, Localizer(index), 1.0, poses=False, laser_pose=second.laser_pose)
        found, carried = None, 0.0
        for k, number in enumerate(numbers):
            scan = second.scans[number]
            if k == glued:
                carried = session.survey.travel
            if k >= glued:
                scan = replace(scan, odometry=compose(frame, scan.odometry))
            for answer in session.take(Swept(scan, True)):
                if answer["type"] != "place" or answer["verdict"] != "match" or k < glued:
                    continue
                right = judged(_place(answer), first, second.ground_truth[number], index)
                wrong += not right
                if right and found is None:
                    found = session.survey.travel - carried
        metres.append(np.inf if found is None else found)
    never = int(np.isinf(metres).sum())
    print(f"carried away {CUTS} times: right again after {np.median(metres):.1f} m in the median")
    print(f"  {never} times not within 25 m; {wrong} wrong match meanwhile")


def between_metres(way: np.ndarray, begin: float, end: float) -> list[int]:
    """The scans between so many metres of travel."""
    return list(range(*np.searchsorted(way, [begin, end]).tolist()))


def _place(answer: dict[str, Any]) -> Any:
    from types import SimpleNamespace

    return SimpleNamespace(pose=np.array(answer["pose"]), map_id=answer["map_id"])


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
    print(f"resident memory: {early / 1e6:.1f} MB after 1,000 scans, {resident() / 1e6:.1f} MB after {taken:,}")


def resident() -> int:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


if __name__ == "__main__":
    main()
