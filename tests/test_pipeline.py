"""From a log to documents: all of them, and one run by itself."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from likeness import alike

from m2t_text.config import PROFILES
from m2t_text.description.document import Document
from m2t_text.logs import Log, read_log
from m2t_text.logs.log import Scan
from m2t_text.mapping.local_map import Survey, local_maps, run_starts
from m2t_text.mapping.parts import Matching
from m2t_text.mapping.trajectory import survey
from m2t_text.pipeline import describe, describe_at, describe_log
from m2t_text.util.geometry import travel

DEFAULT = PROFILES["default"]
RUN = DEFAULT.mapping.run_length
LASER = np.linspace(-np.pi / 2, np.pi / 2, 91)


@pytest.mark.parametrize("name", ["freiburg-101", pytest.param("freiburg-079", marks=pytest.mark.long)])
def test_a_run_by_itself_reads_as_in_the_whole_log(radish: Path, name: str) -> None:
    log = read_log(radish / f"{name}-corrected.log.gz")
    log = replace(log, scans=log.scans[:800])
    mapping = DEFAULT.mapping
    whole = survey(log, mapping)
    starts = run_starts(whole, mapping.run_length)
    shares = []
    for local_map in local_maps(whole, mapping, starts[:: len(starts) // 6]):
        wanted = describe(local_map, log.name, DEFAULT)
        alone = describe_at(log, wanted.first_scan, DEFAULT)
        assert alone.map_id == wanted.map_id and abs(alone.last_scan - wanted.last_scan) <= 5
        assert np.ptp(alone.travel) == pytest.approx(np.ptp(wanted.travel), abs=1.0)
        shares.append(alike(alone.text, wanted.text))
    assert np.median(shares) > 0.8 and min(shares) > 0.6


def test_travel_and_pose_of_a_run_by_itself_are_those_of_the_wheels(simulated: Path) -> None:
    log = read_log(simulated)
    way = travel(log.odometry)
    for scan in (0, 100):
        alone = describe_at(log, scan, DEFAULT)
        # The run ends with the scan that completes its length, at most one step beyond it.
        assert alone.travel[0] == way[scan] and RUN <= np.ptp(alone.travel) < RUN + 0.3
        assert np.hypot(*alone.pose[:2]) == pytest.approx(np.hypot(*(log.odometry[scan] - log.odometry[0])[:2]))


def test_the_first_run_is_the_same_by_itself(short: Path) -> None:
    log = read_log(short)
    wanted = next(describe_log(log, DEFAULT))
    alone = describe_at(log, 0, DEFAULT)
    assert str(alone.text) == str(wanted.text) and alone.last_scan == wanted.last_scan
    assert np.array_equal(alone.travel, wanted.travel)


def test_a_run_at_the_end_of_a_log_is_short(simulated: Path) -> None:
    log = read_log(simulated)
    for back in (1, 5):
        alone = describe_at(log, len(log.scans) - back, DEFAULT)
        assert alone.last_scan == len(log.scans) - 1 and np.ptp(alone.travel) < RUN


def in_a_room(poses: np.ndarray) -> Log:
    """What a perfect robot sees at these poses (S, 3) in a room of 13 m by 6 m."""
    scans = []
    for pose in poses:
        rays = np.stack([np.cos(pose[2] + LASER), np.sin(pose[2] + LASER)], axis=1)
        with np.errstate(divide="ignore"):
            ways = np.where(rays > 0, [10.0, 3.0] - pose[:2], [-3.0, -3.0] - pose[:2]) / rays
        scans.append(Scan(ways.min(axis=1), LASER, pose))
    return Log("room", tuple(scans))


def driving(metres: float) -> np.ndarray:
    x = np.arange(0.0, metres, 0.1)
    return np.column_stack([x, np.zeros((len(x), 2))])


def ahead(poses: np.ndarray) -> np.ndarray:
    return poses + np.array([1.0, 0.0, 0.0])


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_a_robot_that_stands_or_turns_on_the_spot_for_long(
    turn: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It does so before a run, and again in it; nothing but the run and a little before is matched."""
    monkeypatch.setattr("m2t_text.mapping.single_run.SCANS_BEFORE", 50)
    angles = turn * np.arange(100)
    angles = np.concatenate([angles, angles[::-1]])  # back to where it looked
    still = np.column_stack([np.zeros((200, 2)), angles])
    first, later = driving(1.0), ahead(driving(RUN))
    log = in_a_room(np.concatenate([still, first, ahead(still), later]))
    alone = describe_at(log, 200, DEFAULT)
    assert abs(alone.last_scan - (len(log.scans) - 11)) <= 1
    assert np.ptp(alone.travel) == pytest.approx(RUN, abs=0.15)
    whole = survey(log, DEFAULT.mapping)
    (local_map,) = local_maps(whole, DEFAULT.mapping, np.array([200]))
    assert alike(alone.text, describe(local_map, log.name, DEFAULT).text) > 0.6
    end = describe_at(log, len(log.scans) - 1, DEFAULT)
    assert np.ptp(end.travel) == 0.0


def test_a_run_that_begins_with_steps_too_small_to_count_is_complete() -> None:
    """It is 5 m as the local map counts them, from the log's begin: there the robot has not yet moved."""
    to_and_fro = np.array([[0.0, 0.0, 0.0], [0.04, 0.0, 0.0]])
    log = in_a_room(np.concatenate([to_and_fro, driving(RUN + 1.0) - [0.02, 0.0, 0.0]]))
    alone = describe_at(log, 1, DEFAULT)
    assert RUN <= np.ptp(alone.travel) < RUN + 0.15 and alone.last_scan < len(log.scans) - 1


def test_a_robot_does_not_travel_while_it_stands_or_turns() -> None:
    rng = np.random.default_rng(0)
    still = rng.normal(0.0, 0.005, (1000, 3)) + np.outer(np.arange(1000), [0.0, 0.0, 0.1])
    way = Survey(np.empty((0, 2)), np.zeros(1, dtype=np.int64), np.concatenate([still, driving(2.0)])).way
    assert way[:1000].max() == 0.0 and way[-1] == pytest.approx(1.9, abs=0.02)


def test_any_number_of_processes_makes_the_same_documents(short: Path) -> None:
    log = read_log(short)
    told: list[tuple[str, int, int]] = []

    def line(document: Document) -> tuple[str, str]:
        return document.map_id, str(document.text)

    one = [line(each) for each in describe_log(log, DEFAULT, 1, lambda *state: told.append(state))]
    assert [line(each) for each in describe_log(log, DEFAULT, 2)] == one
    for stage, count in (("scans", len(log.scans)), ("maps", len(one))):
        assert [state for state in told if state[0] == stage][-1] == (stage, count, count)


@pytest.mark.parametrize("spacing", [0.0, 0.7])
def test_maps_that_are_described_while_scans_are_matched_are_those_of_the_whole_drive(spacing: float) -> None:
    """Two drives and a leap; on one of them the robot stands, on another it does not drive as far as a run."""
    first, third = driving(8.0), driving(9.5)
    stands, leapt = np.repeat(first[-1:], 150, axis=0), third + np.array([60.0, 0.0, 0.0])
    poses = np.concatenate([first, stands, driving(4.0), third, leapt])
    log = in_a_room(poses % [9.0, 1.0, 1.0])
    seen = [replace(scan, odometry=pose) for scan, pose in zip(log.scans, poses, strict=True)]
    second = len(first) + 150
    log = replace(log, scans=tuple(replace(scan, drive=int(k >= second)) for k, scan in enumerate(seen)))
    mapping = DEFAULT.mapping
    whole = survey(log, mapping)
    assert len(np.unique(whole.drive_ends)) == 3
    matching = Matching(log, mapping, spacing)
    parts = list(matching.parts())
    starts = np.concatenate([part.starts + part.first for part in parts])
    assert np.array_equal(starts, run_starts(whole, mapping.run_length, spacing)) and len(parts) > 1
    assert matching.travel == whole.way[-1]
    found = [one for part in parts for one in part.local_maps(mapping)]
    for one, wanted in zip(found, local_maps(whole, mapping, starts), strict=True):
        assert (one.first_scan, one.last_scan) == (wanted.first_scan, wanted.last_scan)
        for name in ("points", "trajectory", "travel", "pose"):
            assert np.array_equal(getattr(one, name), getattr(wanted, name))
        assert one.free is not None and wanted.free is not None
        assert np.array_equal(one.free.cells, wanted.free.cells) and np.array_equal(
            one.free.pose, wanted.free.pose
        )
