"""The command ``loops`` as a user types it: its files, its JSON, its picture, and what it refuses."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gtsam_oracle import optimise_g2o

from m2t_text.cli import run
from m2t_text.logs import Log
from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen
from m2t_text.loops.detection import LoopDetection
from m2t_text.loops.export import to_json, to_tum
from m2t_text.loops.graph import pose_graph
from m2t_text.util.geometry import between

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Runs ``m2t-text loops`` in an empty folder: (exit status, standard output, standard error)."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: object) -> tuple[int, str, str]:
        return run(["loops", *map(str, arguments)]), *capsys.readouterr()

    return call


def rows(path: Path, tag: str) -> np.ndarray:
    lines = [line.split() for line in path.read_text().splitlines()]
    return np.array([[float(word) for word in words[1:]] for words in lines if words[0] == tag])


def test_all_that_it_writes(call: Call, circuit: Path, drive: Log, detection: LoopDetection, tmp_path: Path):
    """The same by any number of processes: two here, one there."""
    files = ("--g2o", "a.g2o", "--tum", "a.tum", "--plot", "a.png")
    status, out, err = call(circuit, *files, "--json", "--jobs", 2)
    document = json.loads(out)
    assert status == 0 and err.splitlines() == ["wrote a.g2o", "wrote a.tum", "drew a.png"]
    assert document == json.loads(json.dumps(to_json(detection, pose_graph(detection))))
    check_g2o(tmp_path / "a.g2o", document, detection)
    assert (tmp_path / "a.tum").read_text() == to_tum(detection)
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def check_g2o(path: Path, document: dict[str, Any], detection: LoopDetection) -> None:
    """A vertex a scan, an edge from each scan to the next, and one for each loop, with its information."""
    vertices, edges = rows(path, "VERTEX_SE2"), rows(path, "EDGE_SE2")
    count, loops = document["scans"], document["loops"]
    assert vertices[:, 0].tolist() == list(range(count))
    assert vertices[:, 1:] == pytest.approx(detection.survey.trajectory, abs=1e-7)
    steps, closures = edges[: count - 1], edges[count - 1 :]
    assert steps[:, :2].tolist() == [[k, k + 1] for k in range(count - 1)]
    assert closures[:, :2].tolist() == [[loop["from"], loop["to"]] for loop in loops]
    assert all(loop["from"] < loop["to"] <= loop["known"] for loop in loops)
    moves = between(detection.survey.trajectory[:-1], detection.survey.trajectory[1:])
    assert steps[:, 2:5] == pytest.approx(moves, abs=1e-7)
    for edge, loop in zip(closures, loops, strict=True):
        assert edge[2:5] == pytest.approx(loop["pose"], abs=1e-7)
        assert edge[5:] == pytest.approx(np.array(loop["information"])[np.triu_indices(3)], rel=1e-6)
    information = np.zeros((len(edges), 3, 3))
    information[:, *np.triu_indices(3)] = edges[:, 5:]
    information += np.swapaxes(np.triu(information, 1), 1, 2)
    assert (np.linalg.eigvalsh(information) > 0).all()
    assert optimise_g2o(path).shape == (count, 3)


def test_tum_has_times_where_they_ascend_and_numbers_where_not(detection: LoopDetection, drive: Log):
    lines = to_tum(detection).splitlines()
    time, *pose = (float(word) for word in lines[-1].split())
    x, y, theta = detection.survey.trajectory[-1]
    assert len(lines) == len(drive.scans)
    assert time == pytest.approx(drive.scans[-1].timestamp) and time > 100
    assert pose == pytest.approx([x, y, 0, 0, 0, np.sin(theta / 2), np.cos(theta / 2)], abs=1e-6)
    timeless = replace(drive, scans=tuple(replace(scan, timestamp=0.0) for scan in drive.scans))
    numbered = to_tum(replace(detection, log=timeless)).splitlines()
    assert [float(line.split()[0]) for line in numbered] == list(range(len(lines)))


def test_an_index_of_another_building_has_no_loops(call: Call, simulated_index: Path, tmp_path: Path):
    """Though some of its places look alike; and what is found is said in plain words."""
    log = simulate(Simulation(seed=5, length=24.0, travel=30.0, step=0.3))
    write_carmen(log, tmp_path / "elsewhere.log")
    status, out, err = call("elsewhere.log", "--index", simulated_index, "--jobs", 1)
    assert (status, err) == (0, "") and f"elsewhere: {len(log.scans)} scans" in out
    assert re.search(r"\b[1-9]\d* with a likely match\n0 loops\n", out)


def test_help_has_examples(call: Call):
    status, out, err = call("--help")
    assert (status, err) == (0, "") and "Examples" in out and "m2t-text loops robot.log --g2o" in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--g2o", "nowhere/a.g2o"], "cannot write 'nowhere/a.g2o': name a file in a folder that exists"),
        (["--tum", "."], "cannot write '.'"),
        (["--plot", "a.gif"], "cannot draw 'a.gif'"),
        (["--index", "nowhere"], "nowhere"),
        (["--jobs", "0"], "--jobs"),
    ],
)
def test_what_cannot_be_done_is_told_first(call: Call, circuit: Path, arguments: list[str], message: str):
    status, out, err = call(circuit, *arguments)
    assert (status, out) == (2, "") and err.startswith("m2t-text: ") and message in err
    assert err.count("\n") == 1 and list(Path().iterdir()) == []


def test_a_missing_log(call: Call):
    status, out, err = call("missing.log")
    assert (status, out) == (2, "") and "missing.log" in err and err.count("\n") == 1
