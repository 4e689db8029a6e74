"""Forms of CARMEN logs that others write: other kinds of lines, no returns told in other ways, leaps."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from m2t_text.errors import LogError
from m2t_text.logs import Log, LogOptions, read_log
from m2t_text.logs.log import ALONE
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.util.geometry import between, compose, travel

BEAMS = 90


@pytest.fixture(scope="module")
def drive() -> Log:
    return simulate(Simulation(travel=20.0, beams=BEAMS))


def row(values: np.ndarray, none: str = "81.91") -> str:
    return " ".join(f"{value:.3f}" if np.isfinite(value) else none for value in values)


def end(time: float) -> str:
    return f"{time:.3f} host {time:.3f}"


def odom(pose: np.ndarray, time: float) -> str:
    return f"ODOM {row(pose)} 0 0 0 {end(time)}"


def flaser(ranges: np.ndarray, pose: np.ndarray, time: float, none: str = "81.91") -> str:
    return f"FLASER {len(ranges)} {row(ranges, none)} {row(pose)} {row(pose)} {end(time)}"


def raw(ranges: np.ndarray, time: float, word: str = "RAWLASER1") -> str:
    step = np.pi / BEAMS
    return f"{word} 0 -1.570796 3.141593 {step:.9f} 80 0.01 0 {len(ranges)} {row(ranges)} 0 {end(time)}"


def robot(ranges: np.ndarray, laser: np.ndarray, pose: np.ndarray, time: float, number: int = 1) -> str:
    head = raw(ranges, time, f"ROBOTLASER{number}").removesuffix(end(time))
    return f"{head}{row(laser)} {row(pose)} 0 0 0 0 0 {end(time)}"


def written(folder: Path, lines: list[str], name: str = "a.log") -> Path:
    path = folder / name
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def poses_apart(log: Log, drive: Log) -> float:
    ours, theirs = (between(one.odometry[0], one.odometry) for one in (log, drive))
    return float(np.abs(between(ours, theirs)).max())


@pytest.mark.parametrize(
    "none", ["nan", "-nan", "inf", "-1", "-1.000", "0.000", "1.#QNAN", "-1.#IND", "1.#INF00"]
)
def test_a_beam_without_return_may_be_told_in_any_way(drive: Log, tmp_path: Path, none: str) -> None:
    short = [np.where(scan.ranges < 3.0, scan.ranges, np.inf) for scan in drive.scans]
    lines = [flaser(r, scan.odometry, scan.timestamp, none) for r, scan in zip(short, drive.scans, strict=True)]
    log = read_log(written(tmp_path, lines))
    assert len(log.scans) == len(drive.scans) and log.warnings == ()
    assert [scan.ranges.round(3).tolist() for scan in log.scans] == [r.round(3).tolist() for r in short]


@pytest.mark.parametrize("maximum", [2.5, 4.0, 5.6, 8.183, 12.34])
def test_a_maximum_that_stands_for_no_return_is_found_whatever_the_laser(
    drive: Log, tmp_path: Path, maximum: float
) -> None:
    """Without it, the robot would seem to carry a round wall along."""
    lines = [flaser(np.minimum(scan.ranges, maximum), scan.odometry, scan.timestamp) for scan in drive.scans]
    log = read_log(written(tmp_path, lines))
    beyond = np.array([scan.ranges.round(3) >= maximum for scan in drive.scans])
    found = np.array([np.isinf(scan.ranges) for scan in log.scans])
    assert beyond.mean() > 0.01 and (found == beyond).all()
    assert len(log.warnings) == 1 and f"readings of {maximum:g} m, the largest, recur" in log.warnings[0]


def test_a_number_for_no_return_may_lie_below_the_farthest_walls(drive: Log, tmp_path: Path) -> None:
    lines = [
        flaser(np.where(scan.ranges < 4.5, scan.ranges, 4.0), scan.odometry, scan.timestamp)
        for scan in drive.scans
    ]
    log = read_log(written(tmp_path, lines))
    assert "readings of 4 m, next to the largest, recur" in log.warnings[0]
    for scan, true in zip(log.scans, drive.scans, strict=True):
        clear = np.abs(true.ranges - 4.5) > 1e-3
        wanted = (true.ranges >= 4.5) | (np.abs(true.ranges - 4.0) < 5e-4)
        assert (np.isinf(scan.ranges) == wanted)[clear].all()


def test_a_room_that_ends_all_readings_is_no_maximum(drive: Log, tmp_path: Path) -> None:
    """Neither a robot that stands for long before a wall, with or without noise."""
    noise = np.random.default_rng(1).normal(0.0, 0.01, (400, BEAMS))
    still = drive.scans[0]
    ranges = np.minimum(still.ranges, 9.0 / np.cos(still.angles / 2))
    for spread in (noise, 0 * noise):
        lines = [flaser(ranges + one, still.odometry, still.timestamp + k) for k, one in enumerate(spread)]
        log = read_log(written(tmp_path, lines))
        assert all(np.isfinite(scan.ranges).all() for scan in log.scans)


@pytest.mark.parametrize("word", ["RAWLASER1", "RAWLASER2", "LASER_LASER1"])
def test_scans_without_poses_go_by_the_odometry_lines(drive: Log, tmp_path: Path, word: str) -> None:
    lines = ["PARAM robot_frontlaser_offset 0.15 host 0", "PARAM robot_rearlaser_offset 0.1 host 0"]
    for scan in drive.scans:
        lines += [odom(scan.odometry, scan.timestamp), raw(scan.ranges, scan.timestamp, word)]
    log = read_log(written(tmp_path, lines))
    assert len(log.scans) == len(drive.scans) and log.warnings == () and log.has_odometry
    assert poses_apart(log, drive) < 0.01 and log.ground_truth is None
    place = [-0.1, 0.0, np.pi] if word == "RAWLASER2" else [0.15, 0.0, 0.0]
    assert log.laser_pose == pytest.approx(np.array(place))


def test_scans_without_any_odometry_go_by_scan_matching_alone(drive: Log, tmp_path: Path) -> None:
    lone = [raw(scan.ranges, scan.timestamp) for scan in drive.scans]
    still = [flaser(scan.ranges, np.zeros(3), scan.timestamp) for scan in drive.scans]
    for lines in (lone, still):
        log = read_log(written(tmp_path, lines))
        assert not log.has_odometry and not log.odometry.any() and log.warnings == (ALONE,)
    told = written(tmp_path, [flaser(scan.ranges, scan.odometry, scan.timestamp) for scan in drive.scans])
    assert read_log(told).has_odometry
    assert not read_log(told, options=LogOptions(odometry="none")).has_odometry


def test_of_several_lasers_the_front_one_is_read_once(drive: Log, tmp_path: Path) -> None:
    """Logs hold each scan twice, with and without its geometry, and often a rear laser, too."""
    lines = ["PARAM robot_frontlaser_offset 0.2 host 0", "PARAM robot_rearlaser_offset 0.3 host 0"]
    for scan in drive.scans:
        pose, time = scan.odometry, scan.timestamp
        rear = compose(pose, [-0.3, 0.0, np.pi])
        lines += [raw(scan.ranges, time), robot(scan.ranges, compose(pose, [0.2, 0.0, 0.0]), pose, time)]
        lines += [flaser(scan.ranges, pose, time), robot(scan.ranges / 2, rear, pose, time, number=2)]
        lines += [flaser(scan.ranges / 4, pose, time).replace("FLASER", "RLASER")]
    path = written(tmp_path, lines)
    log = read_log(path)
    count = len(drive.scans)
    assert len(log.scans) == count and log.laser_pose == pytest.approx([0.2, 0, 0], abs=2e-3)
    (told,) = log.warnings
    assert (
        f"{count} FLASER" in told
        and f"{count} RLASER lines are not read, but ROBOTLASER1: --scan-topic" in told
    )
    for word, place, share in (("ROBOTLASER2", -0.3, 2), ("rlaser", -0.3, 4)):
        rear = read_log(path, options=LogOptions(scan=(word,)))
        assert rear.laser_pose == pytest.approx([place, 0, np.pi], abs=3e-3)
        assert rear.scans[0].ranges == pytest.approx(drive.scans[0].ranges / share, abs=1e-3)
    with pytest.raises(LogError, match="lasers of a CARMEN log are read one at a time"):
        read_log(path, options=LogOptions(scan=("RLASER", "FLASER")))


@pytest.mark.parametrize("poses", [1, 2])
@pytest.mark.parametrize("timed", [True, False])
def test_old_lines_lack_what_came_later(drive: Log, tmp_path: Path, poses: int, timed: bool) -> None:
    lines = []
    for scan in drive.scans:
        time = f" {scan.timestamp:.3f}" if timed else ""
        pose = " ".join([row(scan.odometry)] * poses)
        lines += [f"ODOM {row(scan.odometry)} 0 0 0{time}", f"FLASER {BEAMS} {row(scan.ranges)} {pose}{time}"]
    log = read_log(written(tmp_path, lines))
    assert len(log.scans) == len(drive.scans) and log.warnings == ()
    assert poses_apart(log, drive) < 0.01
    assert bool(log.scans[-1].timestamp) == timed
    # In a log whose lines are whole, a line without its end is damage.
    whole = [flaser(scan.ranges, scan.odometry, scan.timestamp) for scan in drive.scans[:4]]
    cut = read_log(written(tmp_path, [*whole, f"FLASER {BEAMS} {row(drive.scans[4].ranges)} 1 2 3"]))
    assert len(cut.scans) == 4 and "wrong number of values" in cut.warnings[0]


def test_decimal_commas_are_read_as_points(drive: Log, tmp_path: Path) -> None:
    lines = [flaser(scan.ranges, scan.odometry, scan.timestamp) for scan in drive.scans]
    comma = read_log(written(tmp_path, [line.replace(".", ",") for line in lines], "comma.log"))
    assert [s.ranges.tolist() for s in comma.scans] == [
        s.ranges.tolist() for s in read_log(written(tmp_path, lines)).scans
    ]
    assert comma.odometry.tolist() == read_log(written(tmp_path, lines)).odometry.tolist()


@pytest.mark.parametrize("how", ["to zero", "by 3 m", "about"])
@pytest.mark.parametrize("timed", [True, False])
def test_odometry_that_begins_again_cuts_the_drive(drive: Log, tmp_path: Path, how: str, timed: bool) -> None:
    half = len(drive.scans) // 2
    wheels = drive.odometry.copy()
    frame = {
        "to zero": between(wheels[half], np.zeros(3)),
        "by 3 m": np.array([3.0, 0.0, 0.0]),
        "about": np.array([0.0, 0.0, 2.8]),
    }[how]
    if how == "to zero":
        wheels[half:] = between(wheels[half], wheels[half:])
    else:
        wheels[half:] = compose(wheels[half:], frame) if how == "about" else wheels[half:] + frame
    if how == "by 3 m" and not timed:
        pytest.skip("a step of 3 m may be one of a robot that reports seldom")
    lines = [
        flaser(scan.ranges, pose, 5 + 0.1 * k if timed else 0)
        for k, (scan, pose) in enumerate(zip(drive.scans, wheels, strict=True))
    ]
    log = read_log(written(tmp_path, lines))
    assert log.cuts.tolist() == [half]
    assert log.warnings == (
        f"odometry leaps or begins again: the drive is cut, and no map spans it: line {half + 1}",
    )
    assert travel(log.odometry)[-1] == pytest.approx(travel(drive.odometry)[-1], abs=0.4)
    assert np.hypot(*np.diff(log.odometry[:, :2], axis=0).T).max() < 0.4


def test_odometry_of_two_robots_is_refused(drive: Log, tmp_path: Path) -> None:
    lines = []
    for k, scan in enumerate(drive.scans):
        lines.append(flaser(scan.ranges, scan.odometry + np.array([20.0 * (k % 2), 0, 0]), 5 + 0.1 * k))
    with pytest.raises(LogError, match=r"a\.log: odometry leaps \d+ times .* not of one robot"):
        read_log(written(tmp_path, lines))


def test_where_the_laser_sits_can_be_told(drive: Log, tmp_path: Path) -> None:
    path = written(tmp_path, [flaser(scan.ranges, scan.odometry, scan.timestamp) for scan in drive.scans])
    plain, hung = read_log(path), read_log(path, options=LogOptions(laser_pose=(0.1, 0, 3.0), upside_down=True))
    assert hung.laser_pose.tolist() == [0.1, 0.0, 3.0]
    assert hung.scans[5].ranges.tolist() == plain.scans[5].ranges[::-1].tolist()
    assert hung.scans[5].angles.tolist() == (-plain.scans[5].angles[::-1]).tolist()
    for wrong in ((np.nan, 0, 0), (99, 0, 0), (0, np.inf, 0)):
        with pytest.raises(LogError, match="--laser-pose takes metres, 20 at most, and degrees"):
            LogOptions(laser_pose=wrong)


def test_what_a_file_holds_instead_of_scans_is_named(tmp_path: Path) -> None:
    path = written(tmp_path, ["REMISSION_FLASER 2 1 2", "REMISSION_FLASER 2 1 2", "LASER3 2 1 2"])
    with pytest.raises(LogError, match="it holds 2 REMISSION_FLASER, 1 LASER3 lines, but no FLASER"):
        read_log(path)
    path = written(tmp_path, ["1 2 3"], "a.las")
    with pytest.raises(LogError, match=r"no FLASER.* The ending '.las' is unknown; known are .log, .clf"):
        read_log(path)


def test_more_than_a_turn_of_beams_is_cut(tmp_path: Path) -> None:
    step = 2 * np.pi / 100
    line = f"RAWLASER1 0 -3.14159 6.4 {step:.12f} 80 0 0 103 {row(np.arange(1.0, 104.0))} 0 1 h 1"
    log = read_log(written(tmp_path, [line, line, line]))
    assert len(log.scans[0].angles) == 100
    wrong = line.replace(f"{step:.12f}", "3.4")
    with pytest.raises(LogError, match="as of angles in degrees where radians should be"):
        read_log(written(tmp_path, [wrong, wrong, wrong]))


def test_a_log_keeps_its_drives_when_it_is_cut(drive: Log) -> None:
    scans = tuple(replace(scan, drive=k // 10) for k, scan in enumerate(drive.scans))
    assert replace(drive, scans=scans[5:25]).cuts.tolist() == [5, 15]
