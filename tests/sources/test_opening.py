"""Every kind of source through the same commands: index, search, inspect, info and evaluate."""

import json
import shutil
from pathlib import Path
from statistics import median

import numpy as np
import pytest
from bags import Messages, Sent
from calling import Call
from likeness import alike

from m2t_text.errors import M2TError, SourceError
from m2t_text.index.map_index import MapIndex
from m2t_text.logs import read_log
from m2t_text.sources.opening import dataset_names
from m2t_text.util.geometry import compose, transform

pytestmark = pytest.mark.usefixtures("own_folder")


def test_sources_are_checked_before_the_work(simulated: Path) -> None:
    assert dataset_names([simulated], "indexed") == ["drive"]
    assert dataset_names([simulated], "indexed", "monday") == ["monday"]
    Path("folder").mkdir()
    for path, message in (
        (Path("missing.log"), "does not exist"),
        (Path("folder"), "is a folder; name the files"),
    ):
        with pytest.raises(SourceError, match=f"'{path}' {message}.*; nothing was evaluated"):
            dataset_names([simulated, path], "evaluated")
    with pytest.raises(M2TError, match="2 sources would be the dataset 'drive'"):
        dataset_names([simulated, Path(shutil.copy(simulated, "drive.clf"))], "indexed")


# --- ROS bags


@pytest.fixture(scope="session")
def bag(simulated: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a bag of the simulated drive, with a second laser that sees nothing."""
    ros = Messages(2)
    log = read_log(simulated)
    other = [Sent(scan.timestamp, "/back/scan", ros.scan(scan.timestamp, [9.0, 9.0])) for scan in log.scans]
    path = tmp_path_factory.mktemp("bags") / "drive.mcap"
    return ros.write(path, [*ros.log(log), *other]).rename(path.with_suffix(""))


def test_a_bag_is_a_source_and_a_query(call: Call, bag: Path, simulated_index: Path) -> None:
    topics = ("--scan-topic", "/scan", "--odometry-topic", "/odom")
    status, out, err = call("index", bag, "--index", "i", *topics)
    assert (status, err) == (0, "") and "drive" in out
    index, other = MapIndex.open("i"), MapIndex.open(simulated_index)
    assert index.ids == other.ids
    assert median(alike(index.document(i).text, other.document(i).text) for i in index.ids[::20]) > 0.95
    for target in (f"{bag}#40", f"{bag}@{index.document('drive/000040').travel[0]:.2f}"):
        answer = json.loads(call("search", target, "--index", "i", "--json", "--top", 1, *topics)[1])
        assert answer["query"]["map_id"] == "drive/000040"
        assert abs(answer["results"][0]["first_scan"] - 40) <= 2  # a run by itself, and maps that overlap
    status, out, _ = call("inspect", f"{bag}#40", "--name", "monday", "--json", *topics)
    assert status == 0 and json.loads(out)["map_id"] == "monday/000040"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["index", "BAG"], "several topics of the type sensor_msgs/LaserScan: /back/scan, /scan"),
        (["index", "BAG", "--scan-topic", "/front"], "--scan-topic: no topic '/front'"),
        (["search", "BAG#40", "--index", "INDEX"], "name one by --scan-topic"),
        (
            ["inspect", "BAG@3", "--odometry-topic", "/x", "--scan-topic", "/scan"],
            "there is /odom, /tf_static",
        ),
        (["inspect", "BAG"], "is a whole log; name a run of it, as"),
        (["inspect", "BAG@x"], "does not end in metres"),
    ],
)
def test_a_wrong_call_with_a_bag_gets_one_line(
    call: Call, bag: Path, simulated_index: Path, arguments: list[str], message: str
) -> None:
    for name, path in (("BAG", bag), ("INDEX", simulated_index)):
        arguments = [argument.replace(name, str(path)) for argument in arguments]
    status, out, err = call(*arguments)
    assert (status, out) == (2, "") and message in err
    assert err.startswith("m2t-text: ") and err.count("\n") == 1


def test_a_bag_has_no_ground_truth_to_be_evaluated_by(call: Call, simulated: Path) -> None:
    ros = Messages(1)
    log = read_log(simulated)
    status, out, err = call("evaluate", ros.write(Path("run.bag"), ros.log(log)))
    assert (status, out) == (2, "") and "'run.bag' has no ground truth to judge by" in err


def test_the_folder_that_one_is_in_may_be_a_bag(call: Call, bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    index = Path("i").absolute()
    monkeypatch.chdir(bag)
    assert call("index", ".", "--index", index, "--scan-topic", "scan")[0] == 0
    assert MapIndex.open(index).ids[0] == "drive/000000"


# --- Point clouds


@pytest.fixture
def cloud(simulated_index: Path) -> Path:
    """``room.xyz``: the keypoints of a map of the simulated drive, in a frame of their own."""
    document = MapIndex.open(simulated_index).document("drive/000040")
    np.savetxt("room.xyz", transform(FRAME, document.text.positions() * 0.1))
    return Path("room.xyz")


FRAME = np.array([30.0, -20.0, 0.5])  # of the map's viewpoint in the cloud


def test_a_cloud_finds_the_place_that_it_shows(call: Call, cloud: Path, simulated_index: Path) -> None:
    status, out, err = call("search", cloud, "--index", simulated_index, "--json", "--top", 3)
    answer = json.loads(out)
    assert (status, err) == (0, "")
    assert answer["query"] == {
        "map_id": "room/000000",
        "dataset": "room",
        "first_scan": None,
        "last_scan": None,
        "keypoints": pytest.approx(len(np.loadtxt(cloud)), rel=0.2),
    }
    first = answer["results"][0]
    assert abs(first["first_scan"] - 40) <= 5 and first["inlier_ratio"] > 0.8
    assert first["pose"] is None  # the query has no scans, but a frame
    viewpoint = MapIndex.open(simulated_index).document(first["map_id"]).viewpoint
    assert compose(first["frame_pose"], FRAME)[:2] == pytest.approx(viewpoint[:2], abs=0.3)
    assert "room/000000" in call("search", cloud, "--index", simulated_index)[1]


def test_a_cloud_is_a_dataset_of_one_map(call: Call, cloud: Path, short: Path) -> None:
    status, out, err = call("index", cloud, short, "--index", "i", "--profile", "paper")
    assert (status, err) == (0, "") and "room" in out
    held = {one["name"]: one for one in json.loads(call("info", "--index", "i", "--json")[1])["datasets"]}
    assert held["room"] == {"name": "room", "maps": 1, "scans": 0, "travel": 0.0}
    shown = [
        json.loads(call("inspect", target, "--index", "i", "--json")[1]) for target in (cloud, "room/000000")
    ]
    assert shown[0] == shown[1] and shown[0]["travel"] is None
    assert shown[0]["viewpoint"][:2] == pytest.approx(shown[0]["centre_of_gravity"])
    answer = json.loads(call("search", cloud, "--index", "i", "--json", "--top", 1)[1])
    assert answer["results"][0]["map_id"] == "room/000000" and answer["results"][0]["travel"] == [0.0, 0.0]
    assert call("index", cloud, "--index", "i")[0] == 0 and MapIndex.open("i").ids.count("room/000000") == 1


def test_a_cloud_of_three_dimensions_is_cut(call: Call, cloud: Path) -> None:
    wall = np.loadtxt(cloud)
    levels = ((wall[::2], 1.0), (wall, 2.0), (wall[::3], 3.0))
    np.save("room.npy", np.concatenate([np.column_stack([xy, np.full(len(xy), z)]) for xy, z in levels]))
    flat = call("inspect", cloud)[1]
    for options in ((), ("--height", 1.9, 2.1), ("--height", -5, 9)):
        assert call("inspect", "room.npy", *options)[1] == flat
    assert call("inspect", "room.npy", "--height", 0.5, 1.5)[1] != flat
    cut = "cut to heights of 1.30 to 2.50 m; --height names others\n"
    assert call("inspect", "room.npy")[2] == f"warning: room/000000: {cut}"
    status, _, err = call("index", "room.npy", "--index", "i")
    assert status == 0 and err == f"warning: room: {cut}"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["index", "room.xyz", "room.csv"], "2 sources would be the dataset 'room'"),
        (["index", "large.npy"], "spans 6,000 by 6,000 m, a map at most 1,000: is it in millimetres?"),
        (["inspect", "large.npy"], "is it in millimetres?"),
        (["search", "small.npy", "--index", "INDEX"], "small: 1 cells of 0.1 m are occupied"),
        (["search", "missing.pcd", "--index", "INDEX"], "missing.pcd does not exist"),
        (
            ["search", "room.xyz", "--index", "INDEX", "--exclude-travel", "3"],
            "a map without a drive has no travel to exclude",
        ),
        (["inspect", "room.xyz", "--height", "2", "1"], "--height takes two heights in metres"),
        (["inspect", "room.xyz", "--height", "2"], "--height"),
        (["inspect", "room.xyz@3"], "'room.xyz' is a map without scans"),
        (["evaluate", "room.xyz"], "'room.xyz' is a map without scans; name a laser log"),
    ],
)
def test_a_wrong_call_with_a_cloud_gets_one_line(
    call: Call, cloud: Path, simulated_index: Path, arguments: list[str], message: str
) -> None:
    Path("room.csv").write_bytes(cloud.read_bytes())
    np.save("small.npy", np.zeros((20, 2)))
    np.save("large.npy", np.random.default_rng(0).uniform(0, 6000, (50, 2)).round(-3))
    status, out, err = call(*(str(simulated_index) if word == "INDEX" else word for word in arguments))
    assert (status, out) == (2, "") and message in err
    assert err.startswith("m2t-text: ") and err.count("\n") == 1
