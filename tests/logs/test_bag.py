"""The reader of ROS bags: the same log as from other files, from robots of all kinds, and from damaged bags."""

import os
import shutil
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bags import LEVEL, OLDER, Messages, Sent, small_bags, turned
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from soundness import assert_sound_or_refused, at_most

from m2t_text.config import PROFILES
from m2t_text.errors import LogError
from m2t_text.logs import Log, LogOptions, read_log
from m2t_text.mapping.scan_cloud import scan_points
from m2t_text.pipeline import describe_log
from m2t_text.util.geometry import compose
from m2t_text.util.names import dataset_name

ROS1, ROS2 = Messages(1), Messages(2)
STATIC = Sent(0.0, "/tf_static", ROS2.transforms(0.0, ("base_link", "laser", (0.1, 0.0, 0.3), LEVEL)))
HIT = (1.0, 2.0, 3.0, 4.0)
DEFAULT = PROFILES["default"]


def read(folder: Path, sent: Sequence[Sent], options: LogOptions | None = None) -> Log:
    return read_log(ROS2.write(folder / "a.mcap", sent), options=options)


def drive(count: int = 4, child: str = "base_link", frame: str = "laser") -> list[Sent]:
    """A robot that goes a metre a second and scans every second, without tf."""
    times = np.arange(1.0, count + 1)
    wheels = [Sent(t, "/odom", ROS2.odometry(t, (t, 0.0, 0.0), child)) for t in times]
    return wheels + [Sent(t, "/scan", ROS2.scan(t, HIT, frame=frame)) for t in times]


# The same log from a bag.


@pytest.fixture(scope="module")
def freiburg(radish: Path) -> Log:
    return read_log(radish / "freiburg-101-corrected.log.gz")


@pytest.mark.parametrize("by_tf", [False, True], ids=["odometry", "tf"])
@pytest.mark.parametrize("kind", ["packed.bag", "plain.bag", "plain.db3", "plain.mcap", "packed.mcap"])
def test_a_bag_gives_the_very_scans_of_the_log_that_it_was_made_of(
    freiburg: Log, tmp_path: Path, kind: str, by_tf: bool
) -> None:
    """Though a LaserScan has 32 bits a number, and a pose is a quaternion."""
    ros = ROS1 if kind.endswith(".bag") else ROS2
    bag = read_log(
        ros.write(tmp_path / kind, ros.log(freiburg, by_tf=by_tf), compressed=kind.startswith("packed"))
    )
    assert bag.name == kind.rpartition(".")[0] and bag.ground_truth is None and bag.warnings == ()
    assert np.array_equal(bag.laser_pose, freiburg.laser_pose)
    assert np.array_equal(bag.odometry, freiburg.odometry)
    for one, other in zip(bag.scans, freiburg.scans, strict=True):
        assert np.array_equal(one.ranges, other.ranges) and np.array_equal(one.angles, other.angles)
        assert one.timestamp == other.timestamp


def test_a_bag_gives_the_same_texts_as_the_log(freiburg: Log, tmp_path: Path) -> None:
    begin = replace(freiburg, scans=freiburg.scans[:60], ground_truth=None)
    bag = read_log(ROS2.write(tmp_path / "bag.db3", ROS2.log(begin)))
    texts, wanted = ([str(one.text) for one in describe_log(log, DEFAULT)] for log in (bag, begin))
    assert texts == wanted and len(texts) > 30


def test_a_storage_file_is_read_without_its_folder(freiburg: Log, tmp_path: Path) -> None:
    log = replace(freiburg, scans=freiburg.scans[:5])
    for ending in (".mcap", ".db3"):
        folder = ROS2.write(tmp_path / f"run{ending}", ROS2.log(log))
        (file,) = folder.glob(f"*{ending}")
        alone = shutil.copy(file, tmp_path / f"alone{ending}")
        bag = read_log(Path(alone))
        assert bag.name == "alone" and np.array_equal(bag.odometry, log.odometry)


@pytest.mark.parametrize("name", ["run.bag", "run.db3", "run.mcap", "run.MCAP", "run"])
def test_a_bag_names_its_dataset(name: str) -> None:
    assert dataset_name(Path("a") / name) == "run"


# Where the laser sits.

TURNS = {
    "upright": (0.0, 0.0, 0.7),
    "backwards": (0.0, 0.0, np.pi),
    "upside down": (np.pi, 0.0, 0.0),
    "upside down and turned": (np.pi, 0.0, -2.1),
    "tilted a little": (0.05, -0.04, 0.3),
}


@pytest.mark.parametrize("step", [0.4, -0.4], ids=["counter-clockwise", "clockwise"])
@pytest.mark.parametrize("turn", TURNS)
def test_the_laser_may_sit_anywhere(tmp_path: Path, turn: str, step: float) -> None:
    rotation = Rotation.from_euler("xyz", TURNS[turn])
    place = np.array([0.2, -0.1, 0.5])
    edge = ("base_link", "laser", place, rotation.as_quat())
    sent = [Sent(0.0, "/tf_static", ROS2.transforms(0.0, edge)), *drive()[:4]]
    sent += [Sent(t, "/scan", ROS2.scan(t, HIT, (-0.5, step))) for t in (1.0, 2.0)]
    log = read(tmp_path, sent)
    angles = -0.5 + step * np.arange(4)
    beams = np.array(HIT)[:, None] * np.stack([np.cos(angles), np.sin(angles), np.zeros(4)], axis=1)
    expected = (rotation.apply(beams) + place)[:, :2]
    found = scan_points(log.scans[0], log.laser_pose, 8.0)
    assert (np.diff(log.scans[0].angles) > 0).all()
    # In a slightly tilted plane points lie a little nearer than they are taken to be.
    nearest = np.hypot(*(found[:, None] - expected).transpose(2, 0, 1)).min(axis=0)
    assert nearest.max() < (0.02 if "tilted" in turn else 1e-6)


def test_a_laser_that_looks_at_the_floor_is_refused(tmp_path: Path) -> None:
    edge = ("base_link", "laser", (0, 0, 1), Rotation.from_euler("y", 45, degrees=True).as_quat())
    with pytest.raises(LogError, match="'laser' is tilted by 45 degrees"):
        read(tmp_path, [Sent(0.0, "/tf_static", ROS2.transforms(0.0, edge)), *drive()])


def test_the_laser_is_found_along_a_chain_of_frames(tmp_path: Path) -> None:
    """From the frame that the odometry tells of, up to where both branches meet; with and without slashes."""
    chain = ROS2.transforms(
        0.0,
        ("/base_footprint", "/base_link", (0, 0, 0.1), LEVEL),
        ("base_footprint", "wheel", (0.5, 0.5, 0), turned(np.pi / 2)),
        ("base_link", "tower", (0.3, 0, 0), turned(np.pi / 2)),
        ("tower", "laser", (0.1, 0, 0), LEVEL),
    )
    sent = [Sent(0.0, "/tf_static", chain), *drive(child="wheel")]
    expected = compose([-0.5, 0.5, -np.pi / 2], [0.3, 0.1, np.pi / 2])  # the wheel sees the base turned
    assert read(tmp_path, sent).laser_pose == pytest.approx(expected)
    sent = [Sent(0.0, "/tf_static", chain), *drive(child="")]  # some drivers do not tell
    assert read(tmp_path / "b", sent).laser_pose == pytest.approx([0.3, 0.1, np.pi / 2])
    assert read(tmp_path / "c", drive(frame="/base_link")).laser_pose.tolist() == [0, 0, 0]


# Odometry.


def test_odometry_is_interpolated_at_the_scans_and_the_short_way_round(tmp_path: Path) -> None:
    poses = {1.0: (0, 0, 3.1), 2.0: (1, 0, -3.1), 3.0: (2, 0, -3.1)}
    sent = [STATIC, *(Sent(t, "/odom", ROS2.odometry(t, pose)) for t, pose in poses.items())]
    # They are written late, some out of order, and one lies before all odometry.
    late = {0.5: 4.0, 2.5: 4.1, 1.25: 4.2, 3.05: 4.3}
    sent += [Sent(recorded, "/scan", ROS2.scan(t, HIT)) for t, recorded in late.items()]
    log = read(tmp_path, sent)
    assert [scan.timestamp for scan in log.scans] == [1.25, 2.5, 3.05]
    assert log.odometry[0] == pytest.approx([0.25, 0, 3.1 + (2 * np.pi - 6.2) / 4 - 2 * np.pi * 0])
    assert log.odometry[1] == pytest.approx([1.5, 0, -3.1])
    assert log.odometry[2] == pytest.approx([2, 0, -3.1])  # so soon after, it has hardly moved on
    assert len(log.warnings) == 1 and "before the first odometry or after the last: message" in log.warnings[0]


def test_without_stamps_the_time_of_recording_counts(tmp_path: Path) -> None:
    sent = [STATIC, *(Sent(t, "/odom", ROS2.odometry(0.0, (t, 0, 0))) for t in (1.0, 2.0, 3.0))]
    sent += [Sent(t, "/scan", ROS2.scan(0.0, HIT)) for t in (1.5, 2.5)]
    assert read(tmp_path, sent).odometry[:, 0] == pytest.approx([1.5, 2.5])


@pytest.mark.parametrize("apart", [-30.0, 1e9])
def test_stamps_of_two_clocks_are_joined_by_the_times_of_recording(tmp_path: Path, apart: float) -> None:
    sent = [STATIC, *(Sent(t, "/odom", ROS2.odometry(100 + t + apart, (t, 0, 0))) for t in np.arange(1.0, 9.0))]
    sent += [Sent(t + 0.02, "/scan", ROS2.scan(100 + t, HIT)) for t in np.arange(1.5, 8.0)]
    log = read(tmp_path, sent)
    assert log.odometry[:, 0] == pytest.approx(np.arange(1.5, 8.0), abs=0.03)
    (told,) = log.warnings
    assert f"stamps are of clocks {abs(apart):.1f} s apart: joined by the times of recording" in told


def test_times_that_do_not_meet_are_refused(tmp_path: Path) -> None:
    sent = [STATIC, *(Sent(t, "/odom", ROS2.odometry(t, (t, 0, 0))) for t in (1.0, 2.0))]
    sent += [Sent(t, "/scan", ROS2.scan(t, HIT)) for t in (11.0, 12.0)]
    with pytest.raises(LogError, match=r"only 0 of 2 scans .* are the stamps of one clock\?"):
        read(tmp_path, sent)


@pytest.mark.parametrize("kind", ["tf2", "tf"])
def test_without_odometry_messages_the_frame_that_carries_the_laser_moves(tmp_path: Path, kind: str) -> None:
    """Not the map's frame, which a localisation corrects, nor a fixed joint that is published all the time."""
    sent = []
    for t in np.arange(1.0, 5.0):
        edges = ROS1.transforms(
            t,
            ("/map", "/odom", (7 * np.sin(t), 0, 0), turned(t)),
            ("/odom", "/base_link", (t, 0.5, 0), turned(0.1 * t)),
            ("/base_link", "/laser", (0.1, 0, 0), LEVEL),
            ("/base_link", "/wheel", (0, 0, 0), turned(3 * t)),
        )
        if kind == "tf":
            edges = ROS1.make(OLDER, edges.transforms)
        sent += [Sent(t, "/tf", edges), Sent(t, "/scan", ROS1.scan(t, HIT))]
    log = read_log(ROS1.write(tmp_path / "a.bag", sent))
    assert log.laser_pose == pytest.approx([0.1, 0, 0])
    assert log.odometry == pytest.approx(np.array([[t, 0.5, 0.1 * t] for t in np.arange(1.0, 5.0)]))


def test_tf_can_be_named_where_there_is_odometry_too(tmp_path: Path) -> None:
    sent = [STATIC, *drive()]
    for t in (1.0, 2.0, 3.0, 4.0):
        sent.append(Sent(t, "/tf", ROS2.transforms(t, ("odom", "base_link", (0, t, 0), LEVEL))))
    assert read(tmp_path, sent).odometry[:, 0] == pytest.approx([1, 2, 3, 4])
    by_tf = read(tmp_path / "b", sent, LogOptions(odometry="/tf"))
    assert by_tf.odometry[:, 1] == pytest.approx([1, 2, 3, 4])


# Readings.


def test_readings_that_are_no_returns(tmp_path: Path) -> None:
    ranges = (0.05, 0.1, 5.43, 11.99, 12.0, 13.0, np.nan, np.inf, -np.inf, -1.0, 0.0)
    sent = [STATIC, *drive()[:4]]
    sent += [Sent(t, "/scan", ROS2.scan(t, ranges, (-1.0, 0.1), limits=(0.1, 12.0))) for t in (1.0, 2.0)]
    sent.append(Sent(3.0, "/scan", ROS2.scan(3.0, ranges, (-1.0, 0.1), limits=(np.nan, 0.0))))
    log = read(tmp_path, sent)
    assert log.scans[0].ranges.tolist() == [np.inf, 0.1, 5.43, 11.99] + [np.inf] * 7
    assert log.scans[2].ranges.tolist() == [0.05, 0.1, 5.43, 11.99, 12.0, 13.0] + [np.inf] * 5


def test_numbers_that_are_no_decimals_stay_what_they_are(tmp_path: Path) -> None:
    ranges = np.random.default_rng(1).uniform(0.5, 9.0, 50).astype(np.float32)
    step = float(np.float32(2 * np.pi / 1147))
    sent = [STATIC, *drive()[:4], *(Sent(t, "/scan", ROS2.scan(t, ranges, (-2.0, step))) for t in (1.0, 2.0))]
    scan = read(tmp_path, sent).scans[0]
    assert scan.ranges.astype(np.float32).tolist() == ranges.tolist()
    assert np.diff(scan.angles) == pytest.approx(step, rel=1e-7)


# Topics and transforms that are missing.

FRONT = [replace(one, topic="/front") for one in drive() if one.topic == "/scan"]

CHOICES: dict[str, tuple[list[Sent], LogOptions, str]] = {
    "no scans": (
        [STATIC, *drive()[:4]],
        LogOptions(),
        "no laser scans (sensor_msgs/LaserScan) in the bag; its topics are /odom (nav_msgs/Odometry), /tf",
    ),
    "two lasers": (
        [STATIC, *drive(), *FRONT],
        LogOptions(),
        "several topics of the type sensor_msgs/LaserScan: /front, /scan; name one by --scan-topic",
    ),
    "another laser": (
        [STATIC, *drive(), *FRONT],
        LogOptions(scan=("/back",)),
        "--scan-topic: no topic '/back' of the type sensor_msgs/LaserScan; there is /front, /scan",
    ),
    "a topic of another type": (
        [STATIC, *drive()],
        LogOptions(odometry="/scan"),
        "--odometry-topic: no topic '/scan' of the type nav_msgs/Odometry; there is /odom, /tf_static",
    ),
    "two odometries": (
        [STATIC, *drive(), *(replace(one, topic="/visual") for one in drive()[:4])],
        LogOptions(),
        "several topics of the type nav_msgs/Odometry: /odom, /visual; name one by --odometry-topic",
    ),
    "no tf": (
        drive(),
        LogOptions(),
        "no fixed transform from the robot 'base_link' to the laser 'laser': record /tf_static, too, or say",
    ),
    "tf of another laser": (
        [STATIC, *drive(frame="sick")],
        LogOptions(),
        "no fixed transform from the robot 'base_link' to the laser 'sick'",
    ),
    "tf in a circle": (
        [
            Sent(0.0, "/tf", ROS2.transforms(0.0, ("a", "laser", (0, 0, 0), LEVEL))),
            Sent(0.0, "/tf", ROS2.transforms(0.0, ("laser", "a", (0, 0, 0), LEVEL))),
            *drive(),
        ],
        LogOptions(),
        "no fixed transform",
    ),
    "one scan": ([STATIC, *drive()[:5]], LogOptions(), "only 1 of 1 scans"),
}


@pytest.mark.parametrize("case", CHOICES)
def test_what_is_missing_is_told_in_one_line(tmp_path: Path, case: str) -> None:
    sent, topics, message = CHOICES[case]
    with pytest.raises(LogError) as caught:
        read(tmp_path, sent, topics)
    assert message in str(caught.value) and "a.mcap" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_one_of_two_lasers_can_be_named(tmp_path: Path) -> None:
    sent = [STATIC, *drive(), *FRONT[:2]]
    assert len(read(tmp_path, sent, LogOptions(scan=("front",))).scans) == 2


def test_a_missing_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = ROS2.write(tmp_path / "a.mcap", [STATIC, *drive()])
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(LogError, match="takes the package rosbags: pip install rosbags"):
        read_log(path)


# Damage.


def test_messages_that_cannot_be_used_are_skipped_and_reported(tmp_path: Path) -> None:
    sent = [STATIC, *drive(6)]
    sent.append(Sent(7.0, "/scan", ROS2.scan(7.0, (1.0,))))
    sent.append(Sent(7.1, "/scan", ROS2.scan(2.5, HIT, (np.nan, 0.1))))
    sent.append(Sent(7.2, "/scan", ROS2.scan(2.5, HIT, frame="other")))
    sent.append(Sent(7.3, "/odom", ROS2.odometry(2.5, (np.nan, 0, 0))))
    sent.append(Sent(7.4, "/tf", ROS2.transforms(2.5, ("map", "laser", (0, 0, 0), LEVEL))))
    sent.append(Sent(7.5, "/tf", ROS2.transforms(2.5, ("base_link", "laser", (0, 0, 0), (0, 0, 0, 0)))))
    log = read(tmp_path, sent)
    assert len(log.scans) == 6 and np.isfinite(log.odometry).all()
    assert sorted(log.warnings) == [
        "/odom with a pose that is none: message 17",
        "/scan has scans of 2 lasers, 'laser' (6), 'other' (1): only 'laser' is read: message 16",
        "/scan with an impossible field of view: 2 messages, the first is message 14",
        "/tf that puts 'laser' into 'map', which is in 'base_link': message 18",
        "/tf with a pose that is none: message 19",
    ]


def test_mostly_damaged_scans_are_refused(tmp_path: Path) -> None:
    bad = [Sent(9.0 + t, "/scan", ROS2.scan(t, HIT, (0.0, 0.0))) for t in range(5)]
    with pytest.raises(LogError, match=r"5 of 9 scans cannot be used .* impossible field of view"):
        read(tmp_path, [STATIC, *drive(), *bad])


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The bytes of sound bags of a few scans, by their endings."""
    return small_bags(tmp_path_factory.mktemp("sound"))


HOPELESS = {
    "empty": (b"", "is empty"),
    "text": (b"Dear Sir,\nno bag.\n", "no sound bag"),
    "not UTF-8": (b"\xff\xfe" * 999, "no sound bag"),
    "zeros": (bytes(100_000), "no sound bag"),
}


@pytest.mark.parametrize("ending", [".bag", ".db3", ".mcap"])
@pytest.mark.parametrize("kind", HOPELESS)
def test_a_file_that_is_no_bag_gets_one_clear_line(tmp_path: Path, kind: str, ending: str) -> None:
    content, message = HOPELESS[kind]
    path = tmp_path / f"a{ending}"
    path.write_bytes(content)
    with pytest.raises(LogError, match=message) as caught:
        read_log(path)
    assert str(path) in str(caught.value) and str(caught.value).isprintable()


@pytest.mark.parametrize("ending", [".bag", ".db3", ".mcap"])
def test_a_bag_that_cannot_be_opened_gets_one_clear_line(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"a{ending}"
    with pytest.raises(LogError, match="does not exist"):
        read_log(path)
    os.mkfifo(path)  # to open it would wait for ever
    with pytest.raises(LogError, match="not a regular file"):
        read_log(path)


FOLDERS = {
    "no YAML": "\0",
    "nothing": "{}",
    "another document": "- 1\n- 2\n",
    "a deep one": "[" * 1_000,
    "a file that is not there": (
        "rosbag2_bagfile_information: {version: 5, storage_identifier: mcap, relative_file_paths: [gone.mcap], "
        "topics_with_message_count: []}"
    ),
}


@pytest.mark.parametrize("kind", FOLDERS)
def test_the_folder_of_a_bag_with_broken_metadata_gets_one_clear_line(tmp_path: Path, kind: str) -> None:
    (tmp_path / "metadata.yaml").write_text(FOLDERS[kind])
    with pytest.raises(LogError, match="no sound bag") as caught:
        read_log(tmp_path)
    assert str(caught.value).isprintable() and len(str(caught.value)) < 1000


@pytest.mark.parametrize("ending", [".bag", ".db3", ".mcap"])
def test_a_bag_that_is_cut_is_read_or_refused(tmp_path: Path, sound: dict[str, bytes], ending: str) -> None:
    content, path, refused = sound[ending], tmp_path / f"a{ending}", 0
    for share in np.linspace(0.02, 0.98, 25):
        path.write_bytes(content[: int(share * len(content))])
        try:
            assert read_log(path).warnings
        except LogError as error:
            assert str(error).isprintable()
            refused += 1
    assert refused > 10


def test_no_more_is_allocated_than_a_bag_holds(tmp_path: Path, sound: dict[str, bytes]) -> None:
    """Counts and lengths at the places where the formats claim them, far beyond the file's end."""
    huge = b"\xf0\xff\xff\xff"
    mcap = bytearray(sound[".mcap"])
    mcap[9:17] = huge[::-1] * 2  # the length of the first record
    bag = bytearray(sound[".bag"])
    bag[13:17] = huge  # that of the first header
    index = sound[".bag"].index(b"conn_count=") + len(b"conn_count=")
    counts = bytearray(sound[".bag"])
    counts[index : index + 4] = huge
    for number, (content, ending) in enumerate(((mcap, ".mcap"), (bag, ".bag"), (counts, ".bag"))):
        path = tmp_path / f"a{number}{ending}"
        path.write_bytes(content)
        with at_most(memory=20e6), pytest.raises(LogError):
            read_log(path)


@pytest.mark.parametrize("ending", [".bag", ".db3", ".mcap"])
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_mutated_bag_is_read_or_refused(
    tmp_path: Path, sound: dict[str, bytes], ending: str, data: st.DataObject
) -> None:
    content = bytearray(sound[ending])
    for _ in range(data.draw(st.integers(1, 20))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / f"a{ending}"
    path.write_bytes(content)
    assert_sound_or_refused(path)


def test_progress_counts_messages(tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    path = ROS2.write(tmp_path / "a.mcap", [STATIC, *drive(500)])
    read_log(path, progress=lambda done, total: calls.append((done, total)))
    assert calls[-1] == (1001, 1001) and calls == sorted(calls) and len(calls) > 3
