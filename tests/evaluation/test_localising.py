"""Runs of a robot found in a map that was drawn before: through the command line, and judged by the truth."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from calling import Call

from m2t_text.evaluation.metrics import pose_error
from m2t_text.evaluation.saved_maps import MapEvaluationRequest, evaluate
from m2t_text.index.map_index import MapIndex
from m2t_text.logs import Log
from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen
from m2t_text.saved_maps.occupancy_mapping import build_map
from m2t_text.saved_maps.writing import write_map
from m2t_text.util.geometry import compose, transform

pytestmark = pytest.mark.usefixtures("own_folder")

DRIVE = Simulation(seed=3, length=24.0, travel=24.0)
MAP_FRAME = np.array([30.0, -4.0, 2.0])  # the building's frame in that of the saved map


@pytest.fixture(scope="module")
def floor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The index of a map that was drawn on a first visit, in a frame of its own."""
    from m2t_text.sources.indexing import IndexRequest, index_sources

    folder = tmp_path_factory.mktemp("floor")
    first = simulate(DRIVE)
    assert first.ground_truth is not None
    truth = compose(MAP_FRAME, first.ground_truth)
    write_map(build_map(first, truth, np.arange(len(truth)), 0.1), folder / "floor.yaml")
    index_sources(IndexRequest([folder / "floor.yaml"], folder / "index"))
    return folder / "index"


@pytest.fixture(scope="module")
def second(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Log]:
    """A second visit, with other doors and people, and what it truly was."""
    log = simulate(replace(DRIVE, drive=1))
    path = tmp_path_factory.mktemp("second") / "second.log"
    write_carmen(log, path)
    return path, log


def test_the_pose_of_a_run_in_the_maps_frame(call: Call, floor: Path, second: tuple[Path, Log]) -> None:
    path, log = second
    assert log.ground_truth is not None
    right, sure = [], []
    for scan in range(0, 100, 13):
        answer = json.loads(call("search", f"{path}#{scan}", "--run", 3, "--index", floor, "--json")[1])
        first = answer["results"][0]
        error = pose_error(np.array(first["dataset_pose"]), compose(MAP_FRAME, log.ground_truth[scan]))
        right.append(error[0] < 0.5 and error[1] < np.radians(5.0))
        sure.append(answer["verdict"] == "match")
        hit = MapIndex.open(floor).document(first["map_id"])
        assert first["dataset_pose"] == pytest.approx(compose(hit.pose, np.array(first["pose"])).tolist())
    assert np.mean(right) >= 0.85
    assert sum(sure) >= 4 and all(np.array(right)[sure])


def test_a_single_scan_is_found(call: Call, floor: Path, second: tuple[Path, Log]) -> None:
    path, log = second
    assert log.ground_truth is not None
    errors = []
    for scan in range(0, 100, 16):
        answer = json.loads(call("search", f"{path}#{scan}", "--run", 0, "--index", floor, "--json")[1])
        assert (answer["query"]["first_scan"], answer["query"]["last_scan"]) == (scan, scan)
        assert answer["results"][0]["pose"] is not None
        pose = np.array(answer["results"][0]["dataset_pose"])
        errors.append(pose_error(pose, compose(MAP_FRAME, log.ground_truth[scan]))[0])
    assert np.mean(np.array(errors) < 0.5) > 0.6


def test_a_saved_map_is_an_ordinary_dataset(call: Call, floor: Path) -> None:
    held = json.loads(call("info", "--index", floor, "--json")[1])["datasets"]
    assert [(one["name"], one["scans"], one["travel"]) for one in held] == [("floor", 0, 0.0)]
    assert held[0]["maps"] == len(MapIndex.open(floor))
    answer = json.loads(call("search", "floor/000005", "--index", floor, "--json", "--plot", "match.png")[1])
    first = answer["results"][0]
    assert (first["map_id"], first["travel"], first["inlier_ratio"]) == ("floor/000005", [0.0, 0.0], 1.0)
    assert Path("match.png").stat().st_size > 5000
    text = call("inspect", "floor/000005", "--index", floor, "--plot", "map.png")[1]
    assert json.loads(call("search", "-", "--index", floor, "--json", stdin=text)[1])["verdict"] == "match"
    status, out, _ = call("search", "floor/000005", "--index", floor, "--top", 1)
    place = MapIndex.open(floor).document("floor/000005").pose
    assert status == 0 and f"{place[0]:.2f} {place[1]:.2f}" in out


def test_a_log_may_have_the_name_of_a_saved_map(call: Call, floor: Path, second: tuple[Path, Log]) -> None:
    path, _ = second
    for target in (f"{path}@5", f"{path}#20"):
        answers = [
            json.loads(call("inspect", target, "--run", 3, "--index", floor, "--json", *name)[1])
            for name in ((), ("--name", "floor"))
        ]
        assert answers[0]["text"] == answers[1]["text"]
        assert answers[0]["travel"] == answers[1]["travel"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["search", "floor/000005", "--exclude-travel", "5"],
            "a map without a drive has no travel to exclude",
        ),
        (["search", "floor/000005", "--run", "3"], "--run cuts a run out of a log; 'floor/000005' is none"),
        (["search", "MAP"], "is a whole map; index it, and name one of its local maps"),
        (["search", "MAP#3"], "is a map without scans; name a laser log"),
        (["evaluate", "MAP"], "is a map without scans; name a laser log"),
        (["index", "LOST"], "nowhere.pgm does not exist"),
        (["index", "BAG"], "is not the YAML file of a map: it names no `image`"),
    ],
)
def test_a_wrong_call_gets_one_line(call: Call, floor: Path, arguments: list[str], message: str) -> None:
    Path("lost.yaml").write_text(
        yaml.safe_dump({"image": "nowhere.pgm", "resolution": 0.05, "origin": [0, 0, 0]})
    )
    Path("metadata.yaml").write_text("rosbag2_bagfile_information: {}\n")
    files = {"MAP": str(floor.parent / "floor.yaml"), "LOST": "lost.yaml", "BAG": "metadata.yaml"}
    for name, path in files.items():
        arguments = [argument.replace(name, path) for argument in arguments]
    index = [] if arguments[0] == "evaluate" else ["--index", floor]
    status, out, err = call(*arguments, *index)
    assert (status, out) == (2, "") and message in err
    assert err.startswith("m2t-text: ") and err.count("\n") == 1


def test_what_a_log_is_drawn_into_and_found_in(call: Call, short: Path) -> None:
    status, out, err = call("evaluate-map", short, "--queries", 3, "--covered", 0, "--maps", "drawn", "--json")
    assert status == 0 and "m2t-text index drawn/drive-map.yaml" in err
    document = json.loads(out)
    (figures,) = document["datasets"]
    assert (document["run"], figures["dataset"], figures["queries"]) == (3.0, "drive", 3)
    assert 0 <= figures["right"] <= 100 and figures["free"] > 20 and figures["maps"] > 10
    assert sorted(path.name for path in Path("drawn").iterdir()) == ["drive-map.pgm", "drive-map.yaml"]
    assert call("evaluate-map", "missing.log")[0] == 2


@pytest.mark.long
def test_real_runs_are_found_in_a_map_of_an_earlier_visit(radish: Path) -> None:
    (intel,) = evaluate(MapEvaluationRequest([radish / "intel-corrected.log.gz"], queries=20, jobs=2))
    assert len(intel.placed) == 20
    assert intel.right.mean() >= 0.9
    assert intel.match.mean() > 0.7 and intel.right[intel.match].mean() >= 0.98
    errors = np.array([one.error for one in intel.placed])[intel.right]
    assert np.median(errors, axis=0) == pytest.approx([0.0, 0.0], abs=0.1)
    assert len(intel.grid.states) * intel.grid.resolution > 25 and intel.maps < 2000
    corner = transform([0, 0, 0.0], intel.grid.to_map([[0, 0]]))
    assert corner[0] == pytest.approx(intel.grid.origin[:2])
