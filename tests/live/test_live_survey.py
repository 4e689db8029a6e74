"""A drive that is not finished gives what the whole log gives, to the bit, and forgets the rest."""

from dataclasses import replace

import numpy as np
import pytest

from m2t_text.config import PROFILES
from m2t_text.errors import LogError, M2TError
from m2t_text.live.survey import MAX_SCANS, SPACING, LiveSurvey
from m2t_text.logs.log import Log, Scan
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.mapping.local_map import LocalMap, Survey, local_maps, run_starts
from m2t_text.mapping.trajectory import survey

DEFAULT = PROFILES["default"]
RUN = DEFAULT.mapping.run_length


@pytest.fixture(scope="module")
def log() -> Log:
    """A drive that stands still and turns on the spot now and then, and is cut once."""
    whole = simulate(Simulation(seed=4, length=24.0, travel=34.0, beams=90))
    scans, count = [], len(whole.scans)
    rng = np.random.default_rng(0)
    for k, one in enumerate(whole.scans):
        scan = replace(one, drive=int(k >= count // 2))
        scans.append(scan)
        if k % 17 == 3:
            for _ in range(int(rng.integers(1, 5))):
                noise = rng.normal(0.0, 0.01, len(scan.ranges))
                scans.append(replace(scan, ranges=scan.ranges + noise))
    return replace(whole, scans=tuple(scans), ground_truth=None)


@pytest.fixture(scope="module")
def whole(log: Log) -> Survey:
    return survey(log, DEFAULT.mapping)


def equal(one: LocalMap, other: LocalMap) -> bool:
    assert one.free is not None and other.free is not None
    arrays = ("points", "trajectory", "travel", "pose")
    return (
        all(np.array_equal(getattr(one, name), getattr(other, name)) for name in arrays)
        and (one.first_scan, one.last_scan) == (other.first_scan, other.last_scan)
        and np.array_equal(one.free.cells, other.free.cells)
        and np.array_equal(one.free.pose, other.free.pose)
    )


def test_live_is_batch_to_the_bit(log: Log, whole: Survey) -> None:
    maps = {one.first_scan: one for one in local_maps(whole, DEFAULT.mapping)}
    spaced = run_starts(whole, RUN, SPACING).tolist()
    live = LiveSurvey(DEFAULT, log.laser_pose)
    left, asked = [], 0
    for k, scan in enumerate(log.scans):
        assert np.array_equal(live.add(scan), whole.trajectory[k])
        assert live.travel == whole.way[k]
        for one in live.new_runs():
            left.append(one.first_scan)
            assert equal(one, maps[one.first_scan]) and one.last_scan == k
        now = live.last_run()
        if now is not None:
            asked += 1
            assert equal(now, maps[now.first_scan])
            complete = whole.way[k] - whole.way[: k + 1] >= RUN
            assert now.first_scan == np.flatnonzero(complete)[-1]  # and the latest
    assert left == spaced and len(left) > 20
    assert asked > 100


def test_the_last_run_is_none_until_the_robot_travelled_so_far_on_its_drive(log: Log, whole: Survey) -> None:
    live = LiveSurvey(DEFAULT, log.laser_pose)
    cut = int(log.cuts[0])
    for k, scan in enumerate(log.scans):
        live.add(scan)
        begin = 0 if k < cut else cut
        assert (live.last_run() is None) == (whole.way[k] - whole.way[begin] < RUN)
    shorter = live.last_run(2.0)
    assert shorter is not None and 2.0 <= np.ptp(shorter.travel) < 2.5
    with pytest.raises(M2TError, match="not kept"):
        live.last_run(2 * RUN + 1)


def test_a_reset_begins_anew(log: Log) -> None:
    live, fresh = LiveSurvey(DEFAULT, log.laser_pose), LiveSurvey(DEFAULT, log.laser_pose)
    for scan in log.scans[:60]:
        live.add(scan)
    live.reset()
    for scan in log.scans[60:90]:
        assert np.array_equal(live.add(scan), fresh.add(scan))
    assert live.scans == 30


def test_what_is_kept_is_bounded_however_long_the_robot_stands_or_turns(log: Log) -> None:
    live = LiveSurvey(DEFAULT, log.laser_pose)
    for scan in log.scans:
        live.add(scan)
    driven = len(live._kept)
    for k in range(50):
        live.add(replace(log.scans[-1], ranges=log.scans[-1].ranges + 1e-4 * (k % 3)))
    assert len(live._kept) <= driven + 3
    live._kept[:] = live._kept[-1:] * (MAX_SCANS + 50)
    live.add(log.scans[-1])
    assert len(live._kept) <= MAX_SCANS + 1


@pytest.mark.parametrize("pose", [(0.0, 0.0), (np.nan, 0.0, 0.0), (50.0, 0.0, 0.0)])
def test_a_laser_that_sits_nowhere(pose: tuple[float, ...]) -> None:
    with pytest.raises(LogError, match="laser"):
        LiveSurvey(DEFAULT, pose)


def test_scans_of_plain_arrays() -> None:
    nan, inf = float("nan"), float("inf")
    scan = Scan.from_ranges([nan, inf, 0.0, -1.0, 0.05, 1.5, 8.0, 9.0], 0.0, 0.1, range_min=0.1, range_max=8.0)
    assert scan.ranges.tolist() == [inf] * 5 + [1.5] + [inf] * 2
    assert Scan.from_ranges([1.0, 9.0], 0.0, 0.1).ranges.tolist() == [1.0, 9.0]
    backwards = Scan.from_ranges([1.0, 2.0, 3.0], 0.2, -0.1)
    assert backwards.ranges.tolist() == [3.0, 2.0, 1.0] and (np.diff(backwards.angles) > 0).all()
    hanging = Scan.from_ranges([1.0, 2.0, 3.0], 0.0, 0.1, upside_down=True)
    assert hanging.ranges.tolist() == [3.0, 2.0, 1.0] and hanging.angles.tolist() == [-0.2, -0.1, 0.0]
    half = np.array([1.2345], dtype=np.float32).repeat(2)
    assert Scan.from_ranges(half, float(np.float32(-np.pi / 2)), 0.1).ranges[0] == 1.2345
    assert Scan.from_ranges(half, float(np.float32(-np.pi / 2)), 0.1).angles[0] == -np.pi / 2


@pytest.mark.parametrize(
    "broken",
    [
        {"ranges": [1.0]},
        {"ranges": [[1.0, 2.0]]},
        {"angle_increment": 0.0},
        {"angle_min": float("nan")},
        {"angle_increment": 90.0},
        {"odometry": (0.0, float("nan"), 0.0)},
        {"odometry": (0.0, 0.0)},
        {"timestamp": float("nan")},
    ],
)
def test_what_is_no_scan(broken: dict[str, object]) -> None:
    sound = {"ranges": [1.0, 2.0, 3.0], "angle_min": 0.0, "angle_increment": 0.1}
    with pytest.raises(LogError, match="scan"):
        Scan.from_ranges(**(sound | broken))  # type: ignore[arg-type]
