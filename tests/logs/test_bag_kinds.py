"""Bags as robots of all kinds record them: clocks, frames, lasers and files that are not as in the book."""

import bz2
import gzip
import lzma
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bags import LEVEL, Messages, Sent, turned
from scipy.spatial.transform import Rotation

from m2t_text.errors import LogError
from m2t_text.logs import Log, LogOptions, read_log
from m2t_text.logs.log import ALONE
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.mapping.scan_cloud import scan_points
from m2t_text.util.geometry import between, compose, inverse, transform, travel

ROS1, ROS2 = Messages(1), Messages(2)
STEP = np.pi / 90
ANGLES = (-np.pi / 2, STEP)
STATIC = Sent(0.0, "/tf_static", ROS2.transforms(0.0, ("base_link", "laser", (0.1, 0.0, 0.3), LEVEL)))
HIT = tuple(np.linspace(1.0, 4.0, 91))


@pytest.fixture(scope="module")
def drive() -> Log:
    return simulate(Simulation(travel=12.0, beams=90))


def read(folder: Path, sent: Sequence[Sent], options: LogOptions | None = None) -> Log:
    return read_log(ROS2.write(folder / "a.mcap", sent), options=options)


def sent_of(
    drive: Log, stamps: np.ndarray | None = None, poses: np.ndarray | None = None, begin: float = 1000.0
) -> list[Sent]:
    """A drive with ten scans a second, recorded at ``begin`` and after; ``stamps`` of their own, if any."""
    poses = drive.odometry if poses is None else poses
    recorded = begin + 0.1 * np.arange(len(drive.scans))
    stamps = recorded if stamps is None else stamps
    sent = [replace(STATIC, time=begin)]
    for scan, pose, stamp, time in zip(drive.scans, poses, stamps, recorded, strict=True):
        sent.append(Sent(time, "/odom", ROS2.odometry(stamp, pose)))
        sent.append(Sent(time, "/scan", ROS2.scan(stamp, scan.ranges.tolist(), ANGLES)))
    return sent


def apart(log: Log, poses: np.ndarray) -> float:
    """By how much the odometry of a log differs from poses, metres or radians."""
    return float(np.abs(between(between(log.odometry[0], log.odometry), between(poses[0], poses))).max())


# Clocks.


def test_a_clock_that_is_set_back_cuts_the_drive_and_keeps_its_order(drive: Log, tmp_path: Path) -> None:
    count, half = len(drive.scans), len(drive.scans) // 2
    stamps = 0.1 + 0.1 * np.r_[np.arange(half), np.arange(count - half)]
    log = read(tmp_path, sent_of(drive, stamps))
    assert log.cuts.tolist() == [half] and apart(log, drive.odometry) < 0.5
    assert travel(log.odometry)[-1] == pytest.approx(travel(drive.odometry)[-1], abs=0.3)
    assert (np.diff([scan.timestamp for scan in log.scans]) > 0).all()
    assert log.warnings == ("the clock was set back once: the drive is cut there, and no map spans it",)


def test_first_messages_without_a_stamp_stay_first(drive: Log, tmp_path: Path) -> None:
    stamps = np.r_[np.zeros(3), 50.0 + 0.1 * np.arange(3, len(drive.scans))]
    log = read(tmp_path, sent_of(drive, stamps))
    assert apart(log, drive.odometry) < 1e-6 and not len(log.cuts)
    assert log.warnings == ("6 messages without a stamp are taken at the times of their recording",)


# Odometry.


def test_odometry_that_is_set_to_zero_cuts_the_drive(drive: Log, tmp_path: Path) -> None:
    half = len(drive.scans) // 2
    poses = drive.odometry.copy()
    poses[half:] = between(poses[half], poses[half:])
    log = read(tmp_path, sent_of(drive, poses=poses))
    assert log.cuts.tolist() == [half]
    assert travel(log.odometry)[-1] == pytest.approx(travel(drive.odometry)[-1], abs=0.3)
    (told,) = log.warnings
    assert "odometry leaps or begins again: the drive is cut, and no map spans it: message" in told


def test_odometry_of_two_robots_on_one_topic_is_refused(drive: Log, tmp_path: Path) -> None:
    sent = sent_of(drive)
    for k, scan in enumerate(drive.scans):
        far = scan.odometry + np.array([15.0, 5.0, 1.0])
        sent.append(Sent(1000.05 + 0.1 * k, "/odom", ROS2.odometry(1000.05 + 0.1 * k, far)))
    with pytest.raises(LogError, match="not of one robot; name another topic, or `none`"):
        read(tmp_path, sent)
    other = [Sent(1000.05 + k, "/odom", ROS2.odometry(1000.05 + k, (k, 9, 0), "other")) for k in range(3)]
    log = read(tmp_path / "b", [*sent_of(drive), *other])
    assert apart(log, drive.odometry) < 1e-6
    assert any("/odom also tells how 'other' moves in 'odom', 3 times" in one for one in log.warnings)


def test_two_robots_with_the_same_frames_are_kept_apart_by_their_names(drive: Log, tmp_path: Path) -> None:
    other = compose([3.0, 1.0, 2.0], drive.odometry)[::-1]
    sent = []
    for robot in ("/r1", "/r2"):
        place = (0.1 if robot == "/r1" else 0.4, 0.0, 0.2)
        sent.append(Sent(1.0, f"{robot}/tf_static", ROS2.transforms(1.0, ("base_link", "laser", place, LEVEL))))
    for k, scan in enumerate(drive.scans):
        for robot, poses in (("/r1", drive.odometry), ("/r2", other)):
            time = 1 + 0.1 * k
            edge = ("odom", "base_link", (*poses[k][:2], 0.0), turned(poses[k][2]))
            sent.append(Sent(time, f"{robot}/tf", ROS2.transforms(time, edge)))
            sent.append(Sent(time, f"{robot}/scan", ROS2.scan(time, scan.ranges.tolist(), ANGLES)))
    path = ROS2.write(tmp_path / "a.mcap", sent)
    for options in (
        LogOptions(scan=("/r1/scan",)),
        LogOptions(odometry="/r1/tf"),
        LogOptions(scan=("/r1/scan",), odometry="r1/tf"),
    ):
        log = read_log(path, options=options)
        assert apart(log, drive.odometry) < 1e-6 and log.laser_pose.tolist() == [0.1, 0, 0]
    assert apart(read_log(path, options=LogOptions(scan=("/r2/scan",))), other) < 1e-6
    with pytest.raises(LogError, match=r"several topics .*: /r1/scan, /r2/scan; name one by --scan-topic"):
        read_log(path)
    alike = [replace(one, topic="/scan") if one.topic == "/r1/scan" else one for one in sent]
    with pytest.raises(LogError, match=r"transforms of several robots: .* as --odometry-topic /r1/tf"):
        read(tmp_path / "b", alike, LogOptions(scan=("/scan",)))


@pytest.mark.parametrize("above", ["odom", "r1/odom", "odom_combined"])
def test_a_base_that_tilts_on_its_footprint_is_not_the_drive(drive: Log, tmp_path: Path, above: str) -> None:
    tilt = np.random.default_rng(1).normal(0, 0.01, (len(drive.scans), 2))
    sent = [STATIC]
    for k, scan in enumerate(drive.scans):
        time = 1 + 0.1 * k
        pose = ((*scan.odometry[:2], 0.0), turned(scan.odometry[2]))
        rolled = Rotation.from_euler("xy", tilt[k]).as_quat()
        edges = [("map", above, (0.5 * np.sin(k), 0, 0), LEVEL), (above, "base_footprint", *pose)]
        edges.append(("base_footprint", "base_link", (0, 0, 0.1), rolled))
        sent.append(Sent(time, "/tf", ROS2.transforms(time, *edges)))
        sent.append(Sent(time, "/scan", ROS2.scan(time, scan.ranges.tolist(), ANGLES)))
    log = read(tmp_path, sent)
    assert apart(log, drive.odometry) < 1e-6
    assert log.laser_pose == pytest.approx([0.1, 0, 0], abs=0.01) and log.warnings == ()


def test_a_joint_that_turns_below_the_laser_is_named(drive: Log, tmp_path: Path) -> None:
    sent = [one for one in sent_of(drive) if one.topic != "/tf_static"]
    for k in range(len(drive.scans)):
        edge = ("base_link", "laser", (0.1, 0, 0), turned(0.02 * k))
        sent.append(Sent(1000.0 + 0.1 * k, "/tf", ROS2.transforms(1000.0 + 0.1 * k, edge)))
    with pytest.raises(LogError, match=r"'laser' moves in 'base_link', .* say where it sits by --laser-pose"):
        read(tmp_path, sent)
    assert read(tmp_path / "b", sent, LogOptions(laser_pose=(0.1, 0, 0))).laser_pose.tolist() == [0.1, 0, 0]


def test_transforms_may_come_late_and_the_robot_have_another_name(drive: Log, tmp_path: Path) -> None:
    sent = sent_of(drive)
    late = [*sent[1:], replace(sent[0], time=1990.0)]
    assert read(tmp_path, late).laser_pose.tolist() == [0.1, 0, 0]
    named = [
        replace(one, message=ROS2.odometry(1000 + 0.1 * k, drive.scans[k].odometry, "base_footprint"))
        for k, one in enumerate(one for one in sent if one.topic == "/odom")
    ]
    log = read(tmp_path / "b", [sent[0], *named, *(one for one in sent if one.topic == "/scan")])
    assert log.laser_pose.tolist() == [0.1, 0, 0]
    assert "tf does not know 'base_footprint', whose odometry it is: taken for 'base_link'" in log.warnings[0]


def test_scans_alone_go_by_scan_matching(drive: Log, tmp_path: Path) -> None:
    bare = [one for one in sent_of(drive) if one.topic == "/scan"]
    log = read(tmp_path, bare)
    assert not log.has_odometry and log.warnings == (ALONE,) and log.laser_pose.tolist() == [0, 0, 0]
    assert len(log.scans) == len(drive.scans) and not log.odometry.any()
    mounted = read(tmp_path / "b", [STATIC, *bare])
    assert not mounted.has_odometry and mounted.laser_pose.tolist() == [0.1, 0, 0]
    told = read(tmp_path / "c", sent_of(drive), LogOptions(odometry="none"))
    assert not told.has_odometry and told.laser_pose.tolist() == [0.1, 0, 0]


def test_where_the_laser_sits_can_be_told(drive: Log, tmp_path: Path) -> None:
    sent = sent_of(drive)
    path = ROS2.write(tmp_path / "a.mcap", sent[1:])
    with pytest.raises(
        LogError, match=r"too, or say where the laser sits on the robot by --laser-pose X Y DEG"
    ):
        read_log(path)
    plain = read_log(path, options=LogOptions(laser_pose=(0.2, 0.1, 0.5)))
    assert plain.laser_pose == pytest.approx([0.2, 0.1, 0.5]) and plain.has_odometry
    hung = read_log(path, options=LogOptions(laser_pose=(0.2, 0.1, 0.5), upside_down=True))
    assert hung.laser_pose == pytest.approx([0.2, 0.1, 0.5])
    assert hung.scans[3].ranges.tolist() == plain.scans[3].ranges[::-1].tolist()
    # By tf upright, in truth upside down.
    flipped = read(tmp_path / "b", sent, LogOptions(upside_down=True))
    assert flipped.laser_pose == pytest.approx([0.1, 0, 0])
    assert flipped.scans[3].angles.tolist() == (-plain.scans[3].angles[::-1]).tolist()


# Readings.


@pytest.mark.parametrize("value", [3.49, 3.5, 3.4999, 2.0])
def test_a_reading_below_the_maximum_that_stands_for_no_return_is_found(
    drive: Log, tmp_path: Path, value: float
) -> None:
    near = min(value, 3.45)
    sent = [replace(STATIC, time=1000.0)]
    for k, scan in enumerate(drive.scans):
        time = 1000 + 0.1 * k
        ranges = np.where(scan.ranges < near, scan.ranges, value)
        sent.append(Sent(time, "/odom", ROS2.odometry(time, scan.odometry)))
        sent.append(Sent(time, "/scan", ROS2.scan(time, ranges.tolist(), ANGLES, limits=(0.05, 3.5))))
    log = read(tmp_path, sent)
    for scan, true in zip(log.scans, drive.scans, strict=True):
        clear = np.abs(true.ranges - near) > 1e-3
        assert (np.isinf(scan.ranges) == (true.ranges >= near))[clear].all()
    assert len(log.warnings) == (value < 3.5)


def test_a_least_reading_that_stands_for_no_return_is_found(drive: Log, tmp_path: Path) -> None:
    sent = [replace(STATIC, time=1000.0)]
    for k, scan in enumerate(drive.scans):
        time = 1000 + 0.1 * k
        ranges = np.where(scan.ranges < 3.0, scan.ranges, 0.15)
        sent.append(Sent(time, "/odom", ROS2.odometry(time, scan.odometry)))
        sent.append(Sent(time, "/scan", ROS2.scan(time, ranges.tolist(), ANGLES, limits=(0.1, 12.0))))
    log = read(tmp_path, sent)
    assert all(np.isinf(s.ranges[t.ranges >= 3.0]).all() for s, t in zip(log.scans, drive.scans, strict=True))
    assert "readings of 0.15 m, the smallest, recur" in log.warnings[0]


def test_beams_beyond_a_turn_are_left_out(tmp_path: Path) -> None:
    sent = [STATIC]
    for k, count in enumerate((450, 455, 458, 450)):
        time, ranges = 1.0 + k, np.linspace(1, 2, count)
        sent.append(Sent(time, "/odom", ROS2.odometry(time, (k, 0, 0))))
        sent.append(Sent(time, "/scan", ROS2.scan(time, ranges.tolist(), (0.0, 2 * np.pi / 450))))
    log = read(tmp_path, sent)
    assert [len(scan.ranges) for scan in log.scans] == [450] * 4
    assert log.warnings[0].startswith("/scan with more than a turn of beams, the rest is left out: 2 messages")
    wrong = [
        replace(one, message=ROS2.scan(one.time, (1.0,) * 300, (0.0, 1.0))) if one.topic == "/scan" else one
        for one in sent
    ]
    with pytest.raises(LogError, match="as of angles in degrees where radians should be"):
        read(tmp_path / "b", wrong)


def test_a_step_that_is_missing_follows_from_the_ends(tmp_path: Path) -> None:
    sent = [STATIC]
    for time in (1.0, 2.0):
        scan = ROS2.scan(time, HIT, ANGLES)
        scan.angle_increment = 0.0
        sent += [Sent(time, "/odom", ROS2.odometry(time, (time, 0, 0))), Sent(time, "/scan", scan)]
    assert np.diff(read(tmp_path, sent).scans[0].angles) == pytest.approx(STEP)


# Lasers.


@pytest.mark.parametrize("first", ["laser", "rear"])
def test_of_two_lasers_on_a_topic_the_one_with_more_scans_is_read(tmp_path: Path, first: str) -> None:
    both = ROS2.transforms(
        0.0, ("base_link", "laser", (0.1, 0, 0), LEVEL), ("base_link", "rear", (-0.3, 0, 0), LEVEL)
    )
    sent = [Sent(0.0, "/tf_static", both)]
    for time in np.arange(1.0, 9.0):
        sent.append(Sent(time, "/odom", ROS2.odometry(time, (time, 0, 0))))
        frames = (first, "rear", "rear") if first == "laser" else ("rear", "laser", "rear")
        sent += [Sent(time, "/scan", ROS2.scan(time + 0.1 * k, HIT, ANGLES, f)) for k, f in enumerate(frames)]
    log = read(tmp_path, sent)
    assert log.laser_pose.tolist() == [-0.3, 0, 0] and len(log.scans) >= 14
    (told,) = [one for one in log.warnings if "lasers" in one]
    assert "'laser' (8)" in told and "'rear' (16)" in told and "only 'rear' is read" in told


def test_two_lasers_are_merged_if_both_are_named(tmp_path: Path) -> None:
    """Points of a room, seen by a laser that looks forwards and one that hangs and looks backwards, later."""
    hung = Rotation.from_euler("xyz", (np.pi, 0, np.pi)).as_quat()
    both = ROS2.transforms(
        0.0, ("base_link", "laser", (0.2, 0.1, 0), LEVEL), ("base_link", "rear", (-0.3, 0, 0), hung)
    )
    room = np.random.default_rng(0).uniform(-4, 4, (400, 2))
    sent = [Sent(0.0, "/tf_static", both)]
    angles = np.linspace(-np.pi / 2, np.pi / 2, 181)
    for k in range(10):
        pose, later = np.array([0.5 * k, 0, 0.1 * k]), np.array([0.5 * k + 0.2, 0, 0.1 * k + 0.04])
        sent.append(Sent(1.0 + k, "/odom", ROS2.odometry(1.0 + k, pose)))
        for place, topic, time, at in (
            ((0.2, 0.1, 0.0), "/scan", 1.0 + k, pose),
            ((-0.3, 0.0, np.pi), "/rear", 1.4 + k, later),
        ):
            seen = transform(inverse(compose(at, place)), room)
            bearings = np.arctan2(seen[:, 1], seen[:, 0]) * (-1 if topic == "/rear" else 1)
            ranges = np.full(181, np.inf)
            for bearing, distance in zip(bearings, np.hypot(*seen.T), strict=True):
                if abs(bearing) < np.pi / 2:
                    ranges[np.abs(angles - bearing).argmin()] = distance
            sent.append(
                Sent(
                    time,
                    topic,
                    ROS2.scan(
                        time, ranges.tolist(), (-np.pi / 2, np.pi / 180), topic[1:].replace("scan", "laser")
                    ),
                )
            )
    path = ROS2.write(tmp_path / "a.mcap", sent)
    with pytest.raises(LogError, match="twice reads two lasers of one robot as one"):
        read_log(path)
    log = read_log(path, options=LogOptions(scan=("/scan", "/rear")))
    alone = read_log(path, options=LogOptions(scan=("/scan",)))
    for scan, single in zip(log.scans[1:8], alone.scans[1:8], strict=True):
        points = transform(scan.odometry, scan_points(scan, log.laser_pose, 6.0))
        away = np.hypot(*(points[:, None] - room).transpose(2, 0, 1)).min(axis=1)
        assert len(points) > 1.5 * np.isfinite(single.ranges).sum() and np.percentile(away, 90) < 0.09
        assert (np.diff(scan.angles) >= 0).all()


def test_of_several_echoes_the_first_counts(tmp_path: Path) -> None:
    sent = [STATIC]
    for time in (1.0, 2.0):
        echoes = [[1.0, 5.0], [], [2.0], [np.inf, 3.0]]
        sent.append(Sent(time, "/odom", ROS2.odometry(time, (time, 0, 0))))
        sent.append(Sent(time, "/echoes", ROS2.echoes(time, echoes, (-0.2, 0.1))))
    assert read(tmp_path, sent).scans[0].ranges.tolist() == [1.0, np.inf, 2.0, np.inf]


def room_and_road(pose: np.ndarray, slope: float, height: float) -> np.ndarray:
    """Points of a 3D laser at ``height`` over sloping ground: rings on it, walls about it, and a ceiling."""
    bearings = np.radians(np.arange(0, 360, 1.0))
    rings = [np.column_stack([r * np.cos(bearings), r * np.sin(bearings)]) for r in (2.0, 3.0, 4.5, 6.0)]
    ground = np.concatenate(rings)
    ground = np.column_stack([ground, slope * ground[:, 0] - height])
    walls = []
    for x in np.arange(-7, 7.01, 0.25):
        for side in (-7.0, 7.0):
            walls += [(x, side), (side, x)]
    seen = transform(inverse(pose), np.array(walls))
    up = np.arange(0.0, 3.0, 0.2)
    standing = np.concatenate(
        [
            np.column_stack([seen, slope * seen[:, 0] - height + z])
            for z in map(np.full, [len(seen)] * len(up), up)
        ]
    )
    ceiling = np.column_stack([ground[:, :2], slope * ground[:, 0] - height + 2.9])
    return np.concatenate([ground, standing, ceiling, np.zeros((5, 3)), np.full((5, 3), np.nan)])


@pytest.mark.parametrize("code", ["<f4", ">f4", "<f8"])
@pytest.mark.parametrize("slope", [0.0, 0.1])
def test_of_clouds_of_a_3d_laser_the_ground_is_left_out(tmp_path: Path, slope: float, code: str) -> None:
    sent = [STATIC]
    for k in range(4):
        pose, time = np.array([0.4 * k, 0.1, 0.05 * k]), 1.0 + k
        sent.append(Sent(time, "/odom", ROS2.odometry(time, pose)))
        cloud = ROS2.points(time, room_and_road(compose(pose, [0.1, 0, 0]), slope, 0.6), code=code)
        sent.append(Sent(time, "/points", cloud))
    log = read(tmp_path, sent)
    for scan in log.scans:
        points = transform(scan.odometry, scan_points(scan, log.laser_pose, 20.0))
        off = np.abs(np.abs(points).max(axis=1) - 7.0)
        assert len(points) > 150 and np.percentile(off, 95) < 0.08 and np.hypot(*points.T).min() > 6.0
    (told,) = log.warnings
    assert told == "clouds are cut to heights of 0.3 to 1.5 m above the ground; --height names others"
    low = read(tmp_path / "b", sent, LogOptions(height=(-0.4, -0.2)))  # the road, in the robot's frame
    assert np.nanmin(low.scans[0].ranges) < 2.5 or slope
    with pytest.raises(LogError, match="without two points in the band of heights; --height names another"):
        read(tmp_path / "c", sent, LogOptions(height=(50, 60)))


def test_a_cloud_of_a_2d_laser_is_a_scan(tmp_path: Path) -> None:
    angles = np.linspace(-2.0, 2.0, 50)
    cloud = np.column_stack([3 * np.cos(angles), 3 * np.sin(angles), np.zeros(50)])
    upside = ROS2.transforms(0.0, ("base_link", "laser", (0, 0, 0.3), (1.0, 0.0, 0.0, 0.0)))
    for static in (STATIC, Sent(0.0, "/tf_static", upside)):
        sent = [static]
        for time in (1.0, 2.0):
            sent.append(Sent(time, "/odom", ROS2.odometry(time, (time, 0, 0))))
            sent.append(Sent(time, "/points", ROS2.points(time, cloud[3:])))
        scan = read(tmp_path / static.topic[1:] / str(id(static)), sent).scans[0]
        wanted = angles[3:] if static is STATIC else -angles[3:][::-1]
        assert scan.angles == pytest.approx(wanted, abs=1e-6) and scan.ranges == pytest.approx(np.full(47, 3.0))


# Files.


def test_files_of_a_folder_are_the_parts_of_one_recording(drive: Log, tmp_path: Path) -> None:
    """Their numbers are counted, not spelled; only the first holds the transforms."""
    sent = sent_of(drive)
    bounds = np.linspace(0, len(sent), 12).astype(int)
    for ros, ending in ((ROS2, ".mcap"), (ROS2, ".db3"), (ROS1, ".bag")):
        folder = tmp_path / f"parts{ending[1:]}"
        folder.mkdir()
        whole = sent if ros is ROS2 else [*ROS1.log(drive)]
        for k in range(11):
            share = slice(*(bounds[k : k + 2] * len(whole) // len(sent)))
            made = ros.write(tmp_path / f"one{k}{ending}", whole[share])
            shutil.move(made if ros is ROS1 else next(made.glob(f"*{ending}")), folder / f"drive_{k}{ending}")
        log = read_log(folder)
        assert len(log.scans) == len(drive.scans) and apart(log, drive.odometry) < 1e-6
        assert log.name == folder.name
        assert log.warnings == ("11 files without a metadata.yaml are read as the parts of one recording",)
        with pytest.raises(
            LogError, match=r"part of a recording, name its folder .*, or mend it by `ros2 bag rein"
        ):
            read_log(folder / f"drive_3{ending}")
    (folder / "drive_5.bag").unlink()
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  relative_file_paths:\n    - gone.bag\n"
    )
    assert "1 of 1 files that its metadata.yaml names are missing" in read_log(folder).warnings[0]


def test_a_folder_of_several_recordings_is_refused(drive: Log, tmp_path: Path) -> None:
    for name, begin in (("run_1", 1000.0), ("run_2", 5000.0)):
        made = ROS2.write(tmp_path / f"{name}.mcap", sent_of(drive, begin=begin))
        shutil.move(next(made.glob("*.mcap")), tmp_path / f"a{name}.mcap")
        shutil.rmtree(made)
    with pytest.raises(LogError, match=r"recorded .* s after each other, .* name the files in it one by one"):
        read_log(tmp_path)
    shutil.move(tmp_path / "arun_2.mcap", tmp_path / "other.mcap")
    with pytest.raises(LogError, match=r"2 bags of different names and no metadata.yaml: .*`ros2 bag reindex"):
        read_log(tmp_path)


@pytest.mark.parametrize("ending", [".gz", ".bz2", ".xz", ".zst", ".zstd"])
@pytest.mark.parametrize("kind", [".mcap", ".db3", ".bag", ".log"])
def test_files_that_are_compressed_as_such_are_read(drive: Log, tmp_path: Path, kind: str, ending: str) -> None:
    from backports import zstd

    from m2t_text.logs.simulation.simulator import write_carmen

    pack = {".gz": gzip.compress, ".bz2": bz2.compress, ".xz": lzma.compress}.get(ending, zstd.compress)
    short = replace(drive, scans=drive.scans[:5], ground_truth=None)
    path = tmp_path / f"a{kind}"
    if kind == ".log":
        write_carmen(short, path)
    elif kind == ".bag":
        ROS1.write(path, ROS1.log(short))
    else:
        path = next(ROS2.write(path, ROS2.log(short)).glob(f"*{kind}"))
    packed = tmp_path / f"packed{kind}{ending}"
    packed.write_bytes(pack(path.read_bytes()))
    log = read_log(packed)
    assert log.name == "packed" and len(log.scans) == 5 and apart(log, short.odometry) < 1e-3
    packed.write_bytes(pack(path.read_bytes())[:-20])
    try:
        assert "data is cut off or corrupt, the rest was not read" in read_log(packed).warnings[0]
    except LogError as error:
        assert "data is cut off or corrupt" in str(error)
