"""The CARMEN reader: what it makes of good logs, real and written, and of damaged ones."""

import gzip
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from soundness import assert_sound_or_refused

from m2t_text.errors import LogError, SourceError
from m2t_text.logs import Log, read_log
from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen
from m2t_text.util.geometry import between, compose, transform, travel, wrap
from m2t_text.util.names import dataset_name

POSE = "0.0 0.0 0.0"


def flaser(readings: str = "1 2 3 4", first: str = POSE, second: str = POSE, time: float = 0.0) -> str:
    return f"FLASER {len(readings.split())} {readings} {first} {second} {time} host {time}"


def odom(pose: str, time: float = 0.0) -> str:
    return f"ODOM {pose} 0 0 0 {time} host {time}"


def written(folder: Path, *lines: str, name: str = "a.log") -> Path:
    path = folder / name
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


@pytest.fixture(scope="module")
def drive() -> Log:
    return simulate(Simulation(travel=40.0, beams=4))


# Real logs.

# scans, beams, metres; median and 90th percentile of the odometry's error over 3 m in metres and degrees.
# The errors were computed apart from the reader, by joining the steps between a scan and the odometry lines
# before the next one.
REAL = {
    "freiburg-079-corrected": (4791, 360, 422, (0.153, 0.589, 3.42, 9.92)),
    "freiburg-101-corrected": (292, 360, 211, (0.123, 0.261, 3.22, 6.71)),
    "intel-corrected": (910, 180, 500, (0.351, 0.601, 11.82, 16.75)),
    "csail-corrected": (406, 361, 380, (0.310, 0.683, 7.70, 18.62)),
    "aces-corrected": (440, 180, 323, (0.109, 0.283, 1.35, 5.29)),
}


def drift(log: Log, length: float = 3.0) -> tuple[float, ...]:
    assert log.ground_truth is not None
    place = travel(log.ground_truth)
    end = np.searchsorted(place, place + length)
    start = np.flatnonzero(end < len(place))
    end = end[start]
    true = between(log.ground_truth[start], log.ground_truth[end])
    wheels = between(log.odometry[start], log.odometry[end])
    away = np.hypot(*(true - wheels)[:, :2].T)
    turned = np.degrees(np.abs(wrap(true[:, 2] - wheels[:, 2])))
    return (*np.percentile(away, [50, 90]), *np.percentile(turned, [50, 90]))


@pytest.mark.parametrize("name", REAL)
def test_real_log_is_read_whole_and_its_odometry_drifts_as_the_wheels_did(radish: Path, name: str) -> None:
    scans, beams, metres, errors = REAL[name]
    log = read_log(radish / f"{name}.log.gz")
    assert log.name == name
    assert len(log.scans) == scans
    assert {len(scan.ranges) for scan in log.scans} == {beams}
    assert log.ground_truth is not None
    assert travel(log.ground_truth)[-1] == pytest.approx(metres, abs=1)
    # An odometry that followed the restarts at the corrected poses would show a third of these errors.
    assert drift(log) == pytest.approx(errors, rel=0.03)
    step = np.hypot(*between(log.odometry[:-1], log.odometry[1:])[:, :2].T)
    true_step = np.hypot(*between(log.ground_truth[:-1], log.ground_truth[1:])[:, :2].T)
    assert np.abs(step - true_step).max() < 0.5  # no jump where the log restarts its odometry
    readings = np.array([scan.ranges for scan in log.scans])
    assert (readings > 0).all()
    assert not ((readings >= 50.0) & (readings < 80.0)).any() or name == "freiburg-101-corrected"


def test_the_map_of_a_real_log_is_sharpest_where_the_laser_is_put(radish: Path) -> None:
    """The corrected poses of the Freiburg logs are the laser's, 4 cm behind the robot's centre."""
    log = read_log(radish / "freiburg-101-corrected.log.gz")
    assert log.ground_truth is not None
    assert log.laser_pose == pytest.approx([-0.04, 0, 0])

    def cells(offset: float) -> int:
        points = []
        for scan, pose in zip(log.scans, compose(log.ground_truth, [offset, 0.0, 0.0]), strict=True):
            near = scan.ranges < 10.0
            ranges, angles = scan.ranges[near], scan.angles[near]
            ends = np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=1)
            points.append(transform(pose, ends))
        return len(np.unique(np.floor(np.concatenate(points) / 0.03), axis=0))

    assert cells(-0.04) < min(cells(0.0), cells(-0.08))


# The kinds of logs.


def restarted(log: Log, truth: np.ndarray, timed: bool = True) -> list[str]:
    """The lines of a log in GMapping's form: after each scan, odometry restarts at the corrected laser pose."""
    lasers, wheels = compose(truth, log.laser_pose), compose(log.odometry, log.laser_pose)
    lines = [f"PARAM robot_frontlaser_offset {log.laser_pose[0]} host 0"]
    now, last = wheels[0], wheels[0]
    for scan, laser, wheel in zip(log.scans, lasers, wheels, strict=True):
        time = scan.timestamp if timed else 0.0
        now, last = compose(now, between(last, wheel)), wheel
        pose = " ".join(f"{v:.9f}" for v in laser)
        lines += [odom(" ".join(f"{v:.9f}" for v in now), time), flaser("1 2", pose, pose, time), odom(pose)]
        now = laser
    return lines


@pytest.mark.parametrize("timed", [True, False])
def test_odometry_is_the_same_whatever_the_correction_it_restarts_at(
    drive: Log, tmp_path: Path, timed: bool
) -> None:
    """Odometry that depended on the ground truth would leak it into all that is judged by it."""
    assert drive.ground_truth is not None
    for shift in (0.0, 0.1):
        wobble = shift * np.sin(np.arange(len(drive.scans)))[:, None] * np.array([1.0, -0.5, 0.3])
        truth = drive.ground_truth + wobble
        log = read_log(written(tmp_path, *restarted(drive, truth, timed)))
        moved = between(log.odometry[0], log.odometry)
        assert np.abs(between(between(drive.odometry[0], drive.odometry), moved)).max() < 1e-6
        assert np.abs(between(truth, log.ground_truth)).max() < 1e-6
        assert log.warnings == ()


def test_a_scan_that_is_skipped_leaves_no_jump_where_odometry_restarts_after_it(
    drive: Log, tmp_path: Path
) -> None:
    assert drive.ground_truth is not None
    texts = restarted(drive, drive.ground_truth + [[0.3 * (-1) ** k, 0, 0] for k in range(len(drive.scans))])
    texts[2 + 3 * 50] = texts[2 + 3 * 50].replace(" 1 2 ", " 1 x ")
    log = read_log(written(tmp_path, *texts))
    assert len(log.warnings) == 1
    wheels = np.delete(drive.odometry, 50, axis=0)
    apart = between(between(wheels[0], wheels), between(log.odometry[0], log.odometry))
    assert np.abs(apart).max() < 1e-6


def test_a_log_without_correction_has_no_ground_truth(drive: Log, tmp_path: Path) -> None:
    path = tmp_path / "raw.log"
    write_carmen(replace(drive, ground_truth=None), path)
    log = read_log(path)
    assert log.ground_truth is None
    assert np.abs(between(drive.odometry, log.odometry)).max() < 1e-5
    assert log.laser_pose == pytest.approx(drive.laser_pose, abs=1e-5)


def test_a_short_drive_is_told_from_an_uncorrected_one(tmp_path: Path) -> None:
    """After some metres odometry has left the truth by centimetres only."""
    path = tmp_path / "short.log"
    write_carmen(simulate(Simulation(travel=12.0, beams=2)), path)
    assert read_log(path).ground_truth is not None


def test_without_odometry_lines_a_first_pose_that_leaves_the_second_is_the_truth(
    drive: Log, tmp_path: Path
) -> None:
    assert drive.ground_truth is not None
    lasers = compose(drive.ground_truth, drive.laser_pose)
    lines = [f"PARAM robot_frontlaser_offset {drive.laser_pose[0]} host 0"]
    for scan, laser in zip(drive.scans, lasers, strict=True):
        lines.append(flaser("1 2", *(" ".join(map(str, pose)) for pose in (laser, scan.odometry))))
    log = read_log(written(tmp_path, *lines))
    assert np.abs(between(drive.ground_truth, log.ground_truth)).max() < 1e-6
    assert np.abs(between(drive.odometry, log.odometry)).max() < 1e-6
    only = read_log(written(tmp_path, flaser(), flaser(first="1 0 0", second="1 0 0")))
    assert only.ground_truth is None
    assert only.odometry[1] == pytest.approx([1, 0, 0])


def test_odometry_is_interpolated_by_time_and_the_short_way_round(tmp_path: Path) -> None:
    there = "9 9 0"  # far from the odometry: a corrected pose
    lines = [odom("0 0 3.1", 1), odom("1 0 -3.1", 2), flaser("1 2", there, there, 1.25), odom("2 0 -3.1", 3)]
    lines += [flaser("1 2", there, there, 2.5), odom("3 0 -3.1", 4)]
    log = read_log(written(tmp_path, *lines))
    turn = 2 * np.pi - 6.2
    assert log.odometry[0] == pytest.approx([0.25, 0, 3.1 + turn / 4])
    assert log.odometry[1] == pytest.approx([1.5, 0, -3.1])
    assert [scan.timestamp for scan in log.scans] == [1.25, 2.5]
    assert [scan.line for scan in log.scans] == [3, 5]


@pytest.mark.parametrize("times", [(0, 0, 0, 0), (7, 7, 7, 7), (5, 6, 3, 4)])
def test_odometry_is_interpolated_by_line_where_time_is_of_no_use(
    tmp_path: Path, times: tuple[int, ...]
) -> None:
    there = "9 9 0"
    lines = [odom("0 0 0", times[0]), flaser("1 2", there, there, times[0])]
    lines += [odom("1 0 0", times[1]), odom("2 0 0", times[2])]
    lines += [flaser("1 2", there, there, times[3]), odom("4 0 0", times[3])]
    log = read_log(written(tmp_path, *lines))
    assert log.odometry[:, 0] == pytest.approx([0.5, 3.0])
    assert any("backwards" in line for line in log.warnings) == (times[0] == 5)


def test_robotlaser_messages_bring_their_own_geometry(tmp_path: Path) -> None:
    def line(x: float) -> str:
        laser, robot = f"{x + 0.2} 0.1 0.3", f"{x} 0.1 0.3"
        return f"ROBOTLASER1 0 -1.0 2.0 0.5 30 0.01 0 5 1 2 29 30 31 1 7 {laser} {robot} 0 0 0 0 0 {x} host {x}"

    log = read_log(written(tmp_path, "PARAM laser on", line(0), "VERTEX2 0 0 0 0", line(1), line(2)))
    assert log.scans[0].angles == pytest.approx([-1.0, -0.5, 0.0, 0.5, 1.0])
    assert log.scans[0].ranges.tolist() == [1, 2, 29, np.inf, np.inf]
    assert [scan.timestamp for scan in log.scans] == [0, 1, 2]
    assert log.odometry[2] == pytest.approx([2, 0.1, 0.3])
    expected = between([0, 0.1, 0.3], [0.2, 0.1, 0.3])
    assert log.laser_pose == pytest.approx(expected)
    assert log.ground_truth is None


@pytest.mark.parametrize(
    ("count", "first", "last", "step"),
    [(180, -90, 89, 1), (181, -90, 90, 1), (360, -90, 89.5, 0.5), (361, -90, 90, 0.5), (4, -90, 45, 45)],
)
def test_beams_sweep_from_right_to_left(
    tmp_path: Path, count: int, first: float, last: float, step: float
) -> None:
    line = flaser(" ".join(["1"] * count))
    angles = np.degrees(read_log(written(tmp_path, line, line)).scans[0].angles)
    assert (angles[0], angles[-1], angles[1] - angles[0]) == pytest.approx((first, last, step))


def test_a_maximum_that_no_parameter_tells_is_found(tmp_path: Path) -> None:
    log = read_log(written(tmp_path, *[flaser("1 2 49.9 50")] * 99, flaser("1 2 3 4"), flaser("50 1 50 2")))
    assert log.scans[0].ranges.tolist() == [1, 2, 49.9, np.inf]
    wall = read_log(written(tmp_path, *[flaser("1 2 3 12")] * 200))
    assert wall.scans[0].ranges.tolist() == [1, 2, 3, 12]


def test_readings_at_the_maximum_are_no_return(tmp_path: Path) -> None:
    line = flaser("0 1 49.9 50 79.9 80 81.91 inf")
    plain = read_log(written(tmp_path, line, line)).scans[0]
    assert plain.ranges.tolist()[:4] == [np.inf, 1, 49.9, 50]
    assert np.isinf(plain.ranges[5:]).all()
    limited = read_log(written(tmp_path, "PARAM robot_front_laser_max 50 host 0", line, flaser("1 2")))
    assert limited.scans[0].ranges[:3].tolist() == [np.inf, 1, 49.9]
    assert np.isinf(limited.scans[0].ranges[3:]).all()


# Damage.

GOOD = [flaser(first=f"{x} 0 0", second=f"{x} 0 0", time=x) for x in range(4)]

BAD_LINES = {
    "a count too high": "FLASER 5 1 2 3 4 0 0 0 0 0 0 0 host 0",
    "a count too low": "FLASER 3 1 2 3 4 0 0 0 0 0 0 0 host 0",
    "an absurd count": "FLASER 1000000000 1 2 3 4 0 0 0 0 0 0 0 host 0",
    "a count of many digits": f"FLASER {'9' * 5000} 1 2",
    "a negative count": "FLASER -4 1 2 3 4 0 0 0 0 0 0 0 host 0",
    "no count": "FLASER",
    "a word": "FLASER 4 1 2 x 4 0 0 0 0 0 0 0 host 0",
    "an infinite pose": flaser(first="inf 0 0"),
    "a pose that overflows": flaser(second="1e308 0 0"),
    "a NaN time": flaser(time=float("nan")),
    "absurd remissions": f"ROBOTLASER1 0 -1 2 1 30 0 0 2 1 1 999999999 {POSE} {POSE} 0 0 0 0 0 0 h 0",
    "no field of view": f"ROBOTLASER1 0 0 0 0 30 0 0 2 1 1 0 {POSE} {POSE} 0 0 0 0 0 0 h 0",
    "a line without end": "FLASER 4 " + "1 " * (1 << 20),
}


@pytest.mark.parametrize("kind", BAD_LINES)
def test_a_damaged_scan_among_good_ones_is_skipped_and_reported(tmp_path: Path, kind: str) -> None:
    log = read_log(written(tmp_path, *GOOD[:2], BAD_LINES[kind], GOOD[2], BAD_LINES[kind]))
    assert [scan.line for scan in log.scans] == [1, 2, 4]
    assert len(log.warnings) == 1
    assert "2 lines, the first is line 3" in log.warnings[0]


def test_damaged_odometry_is_skipped_and_reported(tmp_path: Path) -> None:
    bad = ["ODOM 1 2", odom("nan 0 0"), odom("1 x 0"), "PARAM", "PARAM robot_frontlaser_offset nan"]
    log = read_log(written(tmp_path, odom("0 0 0"), *bad, *GOOD))
    assert [line.rpartition(" ")[2] for line in log.warnings] == ["2", "3", "4"]
    assert log.laser_pose.tolist() == [0, 0, 0]


@pytest.mark.parametrize("keep", [1, 12, 20, 30, 40])
def test_a_last_line_that_is_cut_is_skipped(tmp_path: Path, keep: int) -> None:
    """A number that is cut is still a number, so whatever lacks its end of line must be whole to be used."""
    line = flaser(first="123.5 0 0", second="123.5 0 0", time=1071078718.5)
    path = tmp_path / "a.log"
    path.write_text("\n".join([*GOOD, line[:keep]]))
    log = read_log(path)
    assert len(log.scans) == 4
    assert ("cut off at the end of the file" in "".join(log.warnings)) == (keep > 6)


@pytest.mark.parametrize("harm", ["cut", "flip", "garbage behind"])
def test_what_a_broken_gzip_still_gives_is_read(tmp_path: Path, harm: str) -> None:
    rng = np.random.default_rng(0)
    scans = [flaser(" ".join(map(str, rng.uniform(1, 9, 180).round(2)))) for _ in range(300)]
    data = bytearray(gzip.compress(lines(*scans)))
    if harm == "cut":
        data = data[: len(data) // 2]
    elif harm == "flip":
        data[len(data) * 3 // 4] ^= 0xFF
    else:
        data += b"garbage"
    path = tmp_path / "a.clf.gz"
    path.write_bytes(data)
    log = read_log(path)
    assert log.name == "a"
    assert len(log.scans) >= (300 if harm == "garbage behind" else 100)
    assert any("gzip" in line for line in log.warnings)


def rubbish(folder: Path, content: bytes, name: str = "a.log") -> Path:
    (folder / name).write_bytes(content)
    return folder / name


def lines(*texts: str) -> bytes:
    return "".join(f"{text}\n" for text in texts).encode()


HOPELESS = {
    "empty": (b"", "is empty"),
    "text": (b"Dear Sir,\nno log.\n", "no FLASER, ROBOTLASER1 or RAWLASER1 line"),
    "binary": (bytes(range(256)) * 40, "no FLASER, ROBOTLASER1 or RAWLASER1 line"),
    "zeros": (bytes(3 << 20), "no FLASER, ROBOTLASER1 or RAWLASER1 line"),
    "zeros in a small gzip": (gzip.compress(bytes(1 << 27), 1), "does not end"),
    "the head of a gzip": (gzip.compress(lines(*GOOD))[:12], "gzip data is cut off"),
    "a gzip of nothing": (gzip.compress(b""), "no FLASER, ROBOTLASER1 or RAWLASER1 line"),
    "odometry only": (lines(odom(POSE), odom("1 0 0")), "no FLASER, ROBOTLASER1 or RAWLASER1 line"),
    "one scan": (lines(GOOD[0]), "only 1 scan"),
    "mostly damaged": (lines(GOOD[0], GOOD[1], *[flaser("1 x")] * 3), "3 of 5 FLASER lines cannot be used"),
}


@pytest.mark.parametrize("kind", HOPELESS)
def test_a_hopeless_file_gets_one_clear_line(tmp_path: Path, kind: str) -> None:
    content, message = HOPELESS[kind]
    path = rubbish(tmp_path, content)
    with pytest.raises(LogError) as caught:
        read_log(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_cannot_be_opened_gets_one_clear_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(LogError, match="does not exist"):
        read_log(tmp_path / "none.log")
    with pytest.raises(LogError, match="is a directory"):
        read_log(tmp_path)
    os.mkfifo(tmp_path / "pipe.log")  # to open it would wait for ever
    with pytest.raises(LogError, match="not a regular file"):
        read_log(tmp_path / "pipe.log")
    path = written(tmp_path, *GOOD)

    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(LogError, match="permissions"):
        read_log(path)


def test_progress_counts_the_bytes_of_the_file(tmp_path: Path) -> None:
    path = rubbish(tmp_path, gzip.compress(lines(*GOOD * 1000)), "a.log.gz")
    size = path.stat().st_size
    calls: list[tuple[int, int]] = []
    read_log(path, progress=lambda done, total: calls.append((done, total)))
    assert calls[-1] == (size, size)
    assert calls == sorted(calls)
    assert len(calls) > 3
    assert calls[0][0] <= size


# Names.


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("freiburg-079-corrected.log.gz", "freiburg-079-corrected"),
        ("a/b/x.clf", "x"),
        ("x.y.LOG", "x.y"),
        ("x.clf.gz", "x"),
        ("x", "x"),
    ],
)
def test_a_dataset_is_named_by_its_file(file: str, name: str) -> None:
    assert dataset_name(Path(file)) == name


@pytest.mark.parametrize("name", ["", ".", "..", "a/b", "a\nb", "a\0b", "x" * 201, "\udc80", "\x1b[2J"])
def test_an_unsafe_name_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(SourceError, match="cannot name a dataset") as caught:
        read_log(written(tmp_path, *GOOD), name=name)
    assert str(caught.value).isprintable()


# Any input.

WORDS = st.sampled_from(
    b"FLASER ODOM ROBOTLASER1 PARAM robot_frontlaser_offset robot_front_laser_max 0 1 2 3 4 -1 0.5 nan inf "
    b"1e308 -1e300 1e5 999999999999 81.9 host".split()
)
LINES = st.one_of(
    st.lists(WORDS, max_size=30).map(b" ".join),
    st.binary(max_size=40),
    st.sampled_from(lines(*GOOD, odom("1 2 3", 4), odom("0 0 0"), BAD_LINES["a word"]).splitlines()),
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(LINES, max_size=12).map(b"\n".join), st.booleans())
def test_whatever_the_file_holds_there_is_a_sound_log_or_a_log_error(
    tmp_path: Path, content: bytes, zipped: bool
) -> None:
    path = rubbish(tmp_path, gzip.compress(content) if zipped else content)
    assert_sound_or_refused(path)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_mutated_log_is_read_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    content = bytearray(lines(*(line for x, good in enumerate(GOOD) for line in (odom(f"{x} 0 0", x), good))))
    for _ in range(data.draw(st.integers(1, 6))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = rubbish(tmp_path, bytes(content[: data.draw(st.integers(1, len(content)))]))
    assert_sound_or_refused(path)
