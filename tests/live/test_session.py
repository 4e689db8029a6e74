"""Messages in, answers out: what a robot sends, in whatever state and order, and a log that is replayed."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from calling import Call

from m2t_text.config import PROFILES
from m2t_text.errors import M2TError
from m2t_text.live.messages import Swept, parse, scan_line
from m2t_text.live.replay import PAUSE, replayed
from m2t_text.live.session import Session
from m2t_text.logs import read_log
from m2t_text.logs.log import Log, Scan
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.mapping.trajectory import survey

DEFAULT = PROFILES["default"]


@pytest.fixture(scope="module")
def short() -> Log:
    return simulate(Simulation(seed=2, length=24.0, travel=5.0, beams=60))


def said(session: Session, *lines: str | dict[str, Any]) -> list[dict[str, Any]]:
    texts = [line if isinstance(line, str) else json.dumps(line) for line in lines]
    return [answer for text in texts for answer in session.take(parse(text))]


def scan(time: float, log: Log, number: int) -> dict[str, Any]:
    one = json.loads(scan_line(log.scans[number], time))
    del one["odometry"], one["drive"]
    return dict(one)


def odometry(time: float, x: float) -> dict[str, Any]:
    return {"type": "odometry", "time": time, "pose": [x, 0.0, 0.0]}


def test_a_replayed_log_gives_the_poses_of_the_batch_to_the_bit(call: Call, simulated: Path) -> None:
    status, lines, err = call("replay", simulated, "--speed", "0")
    assert (status, err) == (0, "")
    status, out, err = call("live", "-", stdin=lines)
    assert (status, err) == (0, "")
    answers = [json.loads(line) for line in out.splitlines()]
    whole = survey(read_log(simulated), DEFAULT.mapping)
    assert [one["type"] for one in answers] == ["pose"] * len(whole.trajectory)
    assert np.array_equal([one["pose"] for one in answers], whole.trajectory)
    assert [one["travel"] for one in answers] == whole.way.tolist()


def test_scans_of_any_beams_go_through_the_pipe_unchanged(short: Log) -> None:
    uneven = replace(short.scans[0], angles=short.scans[0].angles + np.linspace(0, 0.01, 60) ** 2)
    turned = replace(short.scans[1], drive=3)
    even = Scan.from_ranges([1.0, 2.0, np.inf], -0.5, 0.25)
    for one in (short.scans[0], uneven, turned, even):
        message = parse(scan_line(one, one.timestamp))
        assert isinstance(message, Swept) and message.placed
        assert np.array_equal(message.scan.ranges, one.ranges)
        assert np.array_equal(message.scan.angles, one.angles)
        assert np.array_equal(message.scan.odometry, one.odometry) and message.scan.drive == one.drive
    assert "angles" in json.loads(scan_line(uneven, 0.0))
    assert "angles" not in json.loads(scan_line(even, 0.0))


def test_a_scan_waits_for_its_odometry(short: Log) -> None:
    session = Session(DEFAULT)
    assert said(session, odometry(0.0, 0.0), scan(0.1, short, 0)) == []
    (answer,) = said(session, odometry(0.2, 0.1))
    assert (answer["type"], answer["scan"], answer["time"]) == ("pose", 0, 0.1)
    assert said(session, scan(0.3, short, 1), scan(0.4, short, 2)) == []
    assert [one["time"] for one in said(session, odometry(0.4, 0.15))] == [0.3, 0.4]


def test_scans_without_odometry_are_left_out_with_a_word(short: Log) -> None:
    session = Session(DEFAULT)
    answers = said(session, scan(0.0, short, 0), scan(0.5, short, 1), scan(1.2, short, 2))
    assert [one["type"] for one in answers] == ["warning"] and "0 s has no odometry" in answers[0]["text"]
    assert "last 2 scans" in next(session.end())["text"]


def test_without_wheels_scan_matching_goes_alone(short: Log) -> None:
    session, still = Session(DEFAULT), tuple(replace(one, odometry=np.zeros(3)) for one in short.scans)
    said(session, {"type": "robot", "has_odometry": False, "laser_pose": short.laser_pose.tolist()})
    answers = said(session, *(scan(0.1 * k, short, k) for k in range(len(still))))
    log = replace(short, scans=still, has_odometry=False)
    poses = survey(log, DEFAULT.mapping).trajectory
    assert np.array_equal([one["pose"] for one in answers], poses) and np.ptp(poses[:, 0]) > 1.0
    replay = said(Session(DEFAULT), *replayed(log, 0.0))
    assert [one["pose"] for one in replay] == [one["pose"] for one in answers]


def test_late_and_repeated_scans_and_a_clock_that_begins_again(short: Log) -> None:
    session = Session(DEFAULT)
    said(session, *(odometry(0.1 * k, 0.02 * k) for k in range(60)))
    assert len(said(session, scan(5.0, short, 0), scan(5.1, short, 1))) == 2
    for time in (5.1, 5.05):
        with pytest.raises(M2TError, match="comes after"):
            said(session, scan(time, short, 2))
    said(session, *(odometry(0.1 * k, 0.0) for k in range(5)))
    (answer,) = said(session, scan(0.25, short, 3))
    assert answer["type"] == "pose" and answer["scan"] == 2


def test_a_scan_may_come_before_the_odometry_of_a_clock_that_begins_again(short: Log) -> None:
    session = Session(DEFAULT)
    said(session, *(odometry(0.1 * k, 0.02 * k) for k in range(60)))
    assert len(said(session, scan(5.0, short, 0))) == 1
    assert said(session, scan(0.15, short, 1), odometry(0.1, 0.0)) == []
    assert [one["type"] for one in said(session, odometry(0.2, 0.1))] == ["pose"]
    assert session.drive > 0


def test_a_reset_begins_a_drive(short: Log) -> None:
    session = Session(DEFAULT)
    lines = list(replayed(short, 0.0))
    first = said(session, *lines[:10])
    with pytest.raises(M2TError, match="before the first scan"):
        said(session, lines[0])
    assert said(session, {"type": "reset"}, *lines[1:10]) == first


BROKEN = {
    "": "no JSON",
    "[1, 2": "no JSON",
    "[" * 100_000: "no JSON",
    "3": '"type"',
    "{}": '"type"',
    '{"type": []}': '"type"',
    '{"type": "scam"}': "scan",
    '{"type": "scan", "time": 0}': "'ranges' is missing",
    '{"type": "scan", "time": 0, "ranges": 5}': "scan: ",
    '{"type": "scan", "time": 0, "ranges": [1, 2]}': "'angle_min' is missing",
    '{"type": "scan", "time": 0, "ranges": [1, "x"], "angle_min": 0, "angle_increment": 1}': "scan: ",
    '{"type": "scan", "time": 0, "ranges": [1, 2], "angle_min": NaN, "angle_increment": 1}': "field of view",
    '{"type": "scan", "time": 0, "ranges": [], "angle_min": 0, "angle_increment": 1}': "field of view",
    '{"type": "scan", "time": NaN, "ranges": [1, 2], "angle_min": 0, "angle_increment": 1}': "finite",
    '{"type": "scan", "time": 0, "ranges": [1, 2], "angles": [1]}': '"angles"',
    '{"type": "odometry", "time": 0, "pose": [1, 2]}': "odometry is",
    '{"type": "odometry", "time": 0, "pose": [1, NaN, 3]}': "odometry is",
    '{"type": "odometry", "time": 0, "pose": [1, {}, 3]}': "odometry: ",
    '{"type": "odometry", "time": 1e999, "pose": [1, 2, 3]}': "odometry is",
    '{"type": "robot", "laser_pose": [1, 2]}': "laser",
    '{"type": "robot", "laser_pose": [1e9, 0, 0]}': "laser",
    '{"type": "robot", "name": "a/b\\u0000"}': "name",
    '{"type": "locate"}': "--index",
}


@pytest.mark.parametrize("line", BROKEN)
def test_a_bad_line_gets_one_clear_line_and_changes_nothing(line: str, short: Log) -> None:
    session, sound = Session(DEFAULT), Session(DEFAULT)
    good = list(replayed(short, 0.0))
    assert said(session, *good[:4]) == said(sound, *good[:4])
    with pytest.raises(M2TError, match=re.escape(BROKEN[line])) as error:
        said(Session(DEFAULT) if "robot" in line else session, line)
    assert "\n" not in str(error.value)
    assert said(session, *good[4:9]) == said(sound, *good[4:9])


def test_bad_lines_do_not_end_the_command(call: Call, short: Log) -> None:
    lines = list(replayed(short, 0.0))[:4]
    status, out, err = call("live", "-", stdin="\n".join([lines[0], "rubbish", "", *lines[1:]]) + "\n")
    assert (status, err) == (0, "")
    answers = [json.loads(line) for line in out.splitlines()]
    assert [one["type"] for one in answers] == ["error", "pose", "pose", "pose"]
    assert answers[0]["line"] == 2 and "no JSON" in answers[0]["text"]


def test_what_cannot_be_read(call: Call, tmp_path: Path) -> None:
    assert call("live", tmp_path / "none")[0] == 2
    assert call("live", "-", "--profile", "none")[0] == 2
    assert call("replay", tmp_path / "none")[0] == 2
    assert call("replay", tmp_path / "none", "--speed", "nan")[0] == 2


def test_a_log_is_played_at_its_pace(short: Log) -> None:
    waits: list[float] = []
    scans = tuple(
        replace(one, timestamp=time) for one, time in zip(short.scans, (0.0, 8.0, 8.5, 7.0), strict=False)
    )
    assert len(list(replayed(replace(short, scans=scans), 2.0, waits.append))) == 5
    assert np.allclose(waits, np.array([PAUSE, PAUSE + 0.5, PAUSE + 0.5]) / 2, atol=0.2)
    waits.clear()
    timeless = tuple(replace(one, timestamp=0.0) for one in short.scans[:3])
    lines = list(replayed(replace(short, scans=timeless), 1.0, waits.append))
    assert [json.loads(line)["time"] for line in lines[1:]] == [0.0, 0.1, 0.2]
    list(replayed(short, 0.0, waits.append))
    assert len(waits) == 2
