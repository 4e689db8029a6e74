"""The command `map` as a user types it: its files, that its map can be searched, and what it refuses."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from calling import Call
from gtsam_oracle import optimise_g2o
from PIL import Image

from m2t_text.logs import Log
from m2t_text.util.geometry import between


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, circuit: Path) -> Path:
    from m2t_text.cli import run

    folder = tmp_path_factory.mktemp("maps") / "office"
    assert run(["map", str(circuit), "--out", str(folder), "--jobs", "2"]) == 0
    return folder


def test_its_files(folder: Path, drive: Log):
    names = ["graph.g2o", "map.pgm", "map.png", "map.yaml", "summary.json", "trajectory.tum"]
    assert sorted(path.name for path in folder.iterdir()) == names
    header = yaml.safe_load((folder / "map.yaml").read_text())
    assert header["image"] == "map.pgm" and header["resolution"] == 0.05 and header["mode"] == "trinary"
    with Image.open(folder / "map.pgm") as image:
        assert set(np.unique(np.asarray(image))) == {0, 205, 254}
    rows = np.loadtxt(folder / "trajectory.tum")
    assert len(rows) == len(drive.scans) and rows[-1, 0] == pytest.approx(drive.scans[-1].timestamp)
    assert drive.ground_truth is not None
    truth = between(drive.ground_truth[0], drive.ground_truth)
    assert np.hypot(*(rows[:, 1:3] - truth[:, :2]).T).max() < 0.2


@pytest.mark.long
def test_one_process_makes_the_same_files(folder: Path, circuit: Path, call: Call, own_folder: Path):
    """As the two that made them."""
    assert call("map", circuit, "--out", "alone", "--jobs", 1)[0] == 0
    for name in ("graph.g2o", "map.pgm", "trajectory.tum"):
        assert Path("alone", name).read_bytes() == (folder / name).read_bytes(), name


def test_other_optimisers_agree_with_its_graph(folder: Path):
    poses = optimise_g2o(folder / "graph.g2o")
    rows = np.loadtxt(folder / "trajectory.tum")
    assert np.hypot(*(poses[:, :2] - rows[:, 1:3]).T).max() < 0.1


def test_walls_are_where_they_are_and_people_are_gone(folder: Path, drive: Log):
    """Occupied cells by an oracle: hits of the true poses that recur."""
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["loops"] >= 4 and summary["neighbours"] > 300 and summary["datasets"][0]["joined"]
    assert 0.005 < summary["map"]["occupied"] / summary["map"]["free"] < 0.2


def test_its_map_can_be_indexed_and_searched(call: Call, short: Path, own_folder: Path):
    """And its JSON names the files."""
    status, out, err = call("map", short, "--out", "there", "--resolution", 0.1, "--json", "--jobs", 1)
    document = json.loads(out)
    assert status == 0 and err == ""
    assert document["map"]["resolution"] == 0.1 and all(Path(path).is_file() for path in document["files"])
    assert call("index", "there/map.yaml", "--index", "i", "--name", "office")[0] == 0
    status, out, _ = call("search", f"{short}@3", "--index", "i", "--json", "--top", 1)
    (best,) = json.loads(out)["results"]
    assert status == 0 and best["dataset"] == "office" and best["inlier_ratio"] > 0.6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["missing.log", "--out", "there"], "missing.log"),
        (["a.log", "--out", "a.log"], "is a file: name a folder"),
        (["a.log"], "--out"),
        (["a.log", "--out", "there", "--resolution", "nan"], "nan"),
        (["a.log", "a.log", "--out", "there"], "2 sources would be the dataset 'a'"),
        (["a.log", "--out", "there"], "no FLASER"),
    ],
)
def test_what_cannot_be_done_is_told(call: Call, own_folder: Path, arguments: list[str], message: str):
    Path("a.log").write_text("nothing\n")
    status, out, err = call("map", *arguments)
    assert (status, out) == (2, "") and message in err
    assert not Path("there").exists()
