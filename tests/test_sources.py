"""Every kind of source through the same commands: index, search, inspect, info and evaluate."""

import json
import shutil
from pathlib import Path
from statistics import median

import pytest
from bags import Messages, Sent
from calling import Call
from likeness import alike

from m2t_text.errors import M2TError, SourceError
from m2t_text.index.store import MapIndex
from m2t_text.logs import read_log
from m2t_text.sources import dataset_names

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
        assert answer["query"]["map_id"] == answer["results"][0]["map_id"] == "drive/000040"
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
