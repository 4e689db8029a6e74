"""The command line as a user types it, and its JSON as contract and scripts expect it."""

import gzip
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from types import NoneType
from typing import Any

import pytest
from calling import PROGRAM, Call

from m2t_text.index.map_index import MapIndex
from m2t_text.logs import read_log
from m2t_text.util.geometry import travel

COMMANDS = (
    "demo",
    "simulate",
    "index",
    "search",
    "inspect",
    "info",
    "check",
    "evaluate",
    "fetch",
    "merge",
    "remove",
    "optimize",
)

pytestmark = pytest.mark.usefixtures("own_folder")

PAIR, POSE = [float, float], [float, float, float]
RESULT = {
    "rank": int,
    "map_id": str,
    "dataset": str,
    "first_scan": int,
    "last_scan": int,
    "travel": PAIR,
    "score": float,
    "matched": int,
    "pose": (NoneType, list),
    "dataset_pose": (NoneType, list),
    "inlier_ratio": (NoneType, float),
}
SEARCH = {
    "query": {
        "map_id": (str, NoneType),
        "dataset": (str, NoneType),
        "first_scan": (int, NoneType),
        "last_scan": (int, NoneType),
        "keypoints": int,
    },
    "index": {"path": str, "maps": int, "profile": str},
    "seconds": {"describe": float, "search": float, "verify": float},
    "verdict": str,
    "results": list,
}
INSPECT = {
    "map_id": (str, NoneType),
    "text": str,
    "keypoints": int,
    "words": int,
    "viewpoint": POSE,
    "centre_of_gravity": PAIR,
    "points": int,
    "travel": (list, NoneType),
}
INFO = {
    "path": str,
    "profile": str,
    "parameters": dict,
    "maps": int,
    "keypoints": int,
    "bytes": int,
    "datasets": list,
}
CHECK = {"path": str, "files": list, "datasets": list, "leftovers": list, "repaired": list}
FILE = {"name": str, "bytes": int, "problem": (str, NoneType)}
DATASET = {"name": str, "maps": int, "scans": int, "travel": float}


def conforms(value: Any, shape: Any) -> bool:
    """Whether a JSON value has all keys of a shape, with values of its types."""
    if isinstance(shape, dict):
        return isinstance(value, dict) and all(k in value and conforms(value[k], shape[k]) for k in shape)
    if isinstance(shape, list):
        return isinstance(value, list) and len(value) == len(shape) and all(map(conforms, value, shape))
    return isinstance(value, shape) and not isinstance(value, bool)


def ids(document: dict[str, Any]) -> list[str]:
    return [result["map_id"] for result in document["results"]]


# --- Help and version


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_examples(call: Call, command: str) -> None:
    status, out, err = call(command, "--help")
    assert (status, err) == (0, "") and "Examples" in out and f"m2t-text {command}" in out


@pytest.mark.parametrize("arguments", [[], ["--help"], ["-h"]])
def test_help_lists_the_commands(call: Call, arguments: list[str]) -> None:
    status, out, _ = call(*arguments)
    assert status == 0 and all(command in out for command in COMMANDS)


def test_version(call: Call) -> None:
    status, out, _ = call("--version")
    assert status == 0 and re.fullmatch(r"m2t-text \d+\.\d+\.\d+\n", out)


def test_help_and_version_import_nothing_heavy() -> None:
    code = (
        "import sys; from m2t_text.cli import run\n"
        "for line in (['--help'], ['--version'], ['search', '--help'], ['index', '--help'], ['inspect']):\n"
        "    run(line)\n"
        "heavy = {'numpy', 'scipy', 'numba', 'whoosh', 'matplotlib'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).returncode == 0


def test_shell_completion_knows_the_commands() -> None:
    environment = os.environ | {
        "_M2T_TEXT_COMPLETE": "complete_bash",
        "COMP_WORDS": "m2t-text in",
        "COMP_CWORD": "1",
    }
    done = subprocess.run(PROGRAM, env=environment, capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["index", "inspect", "info"]


@pytest.fixture
def own_index(simulated_index: Path, own_folder: Path) -> Path:
    """The index of the simulated drive, to be changed: ``i`` in the folder of the test."""
    shutil.copytree(simulated_index, own_folder / "i")
    return Path("i")


# --- simulate and index


def test_a_simulated_log_can_be_indexed_and_found(call: Call) -> None:
    status, out, err = call("simulate", "a.log.gz", "--seed", 5, "--travel", 8, "--length", 24)
    assert (status, out) == (0, "") and "m2t-text index a.log.gz" in err
    status, out, _ = call("index", "a.log.gz", "--jobs", 1)
    assert status == 0 and "indexes/default holds" in out
    status, out, _ = call("search", "a.log.gz#3", "--json", "--top", 1)
    assert status == 0 and ids(json.loads(out)) == ["a/000003"]


def test_the_same_seed_makes_the_same_log(call: Call) -> None:
    for name, seed in (("a.log", 5), ("b.log", 5), ("c.log", 6)):
        assert call("simulate", name, "--seed", seed, "--travel", 4, "--length", 24)[0] == 0
    a, b, c = (Path(name).read_bytes() for name in ("a.log", "b.log", "c.log"))
    assert a == b != c


def test_indexing_a_dataset_again_replaces_it_alone(call: Call, short: Path) -> None:
    assert call("index", short, "--index", "i", "--name", "first")[0] == 0
    assert call("index", short, "--index", "i", "--name", "second")[0] == 0
    before = [str(document.text) for document in MapIndex.open("i").documents()]
    assert call("index", short, "--index", "i", "--name", "second", "--jobs", 2)[0] == 0
    index = MapIndex.open("i")
    assert [str(document.text) for document in index.documents()] == before
    assert [summary.name for summary in index.datasets()] == ["first", "second"]


def test_several_sources_and_a_damaged_one_among_them(call: Call, short: Path) -> None:
    other, broken = Path("other.log"), Path("broken.log")
    other.write_bytes(short.read_bytes())
    broken.write_text("this is not a log\n")
    assert call("index", short, "--index", "i", "--name", "broken")[0] == 0
    status, out, err = call("index", short, broken, other, "--index", "i")
    assert status == 2 and "drive" in out and "other" in out
    assert err.count("\n") == 1 and "broken.log" in err
    maps = {summary.name: summary.maps for summary in MapIndex.open("i").datasets()}
    assert set(maps) == {"broken", "drive", "other"} and len(set(maps.values())) == 1


def test_a_damaged_source_alone_makes_no_index(call: Call) -> None:
    Path("broken.log").write_text("this is not a log\n")
    status, out, err = call("index", "broken.log")
    assert (status, out) == (2, "") and err.count("\n") == 1
    assert not Path("indexes").exists()


def test_a_drive_too_short_for_a_map_does_not_empty_its_dataset(
    call: Call, simulated: Path, own_index: Path
) -> None:
    lines = simulated.read_text().splitlines(keepends=True)
    Path("drive.log").write_text("".join(lines[:15]))
    status, _, err = call("index", "drive.log", "--index", own_index)
    assert status == 2 and "drive: the robot travels less than the 5 m of one map" in err
    assert len(MapIndex.open(own_index)) > 0


def test_skipped_damage_is_a_warning(call: Call, short: Path) -> None:
    Path("cut.log").write_bytes(short.read_bytes()[:-40])
    status, out, err = call("index", "cut.log", "--index", "i")
    assert status == 0 and "cut" in out and err.startswith("warning: cut: ") and err.count("\n") == 1


def test_a_profile_stays_that_of_the_index(call: Call, short: Path) -> None:
    assert call("index", short, "--index", "i", "--profile", "paper", "--name", "a")[0] == 0
    assert call("index", short, "--index", "i", "--name", "b")[0] == 0
    status, out, err = call("index", short, "--index", "i", "--profile", "default")
    assert (status, out) == (2, "") and "paper" in err and "default" in err
    assert json.loads(call("info", "--index", "i", "--json")[1])["profile"] == "paper"


# --- search, inspect, info


def test_search_json(call: Call, simulated_index: Path) -> None:
    status, out, err = call("search", "drive/000040", "--index", simulated_index, "--json", "--top", 3)
    answer = json.loads(out)
    assert (status, err) == (0, "") and conforms(answer, SEARCH)
    assert answer["query"]["map_id"] == "drive/000040" and answer["query"]["first_scan"] == 40
    assert answer["verdict"] in ("match", "ambiguous", "none")
    assert all(conforms(result, RESULT) for result in answer["results"])
    assert [result["rank"] for result in answer["results"]] == [1, 2, 3]
    assert ids(answer)[0] == "drive/000040"
    assert answer["verdict"] == "ambiguous" or answer["results"][0]["inlier_ratio"] > 0.5
    assert answer["results"][0]["pose"] == pytest.approx([0.0, 0.0, 0.0], abs=0.02)
    place = MapIndex.open(simulated_index).document("drive/000040").pose.tolist()
    for result in answer["results"]:  # all show the same place, in the frame of the trajectory
        assert result["dataset_pose"] == pytest.approx(place, abs=0.1)
    assert answer["seconds"]["verify"] > 0
    by_text = json.loads(call("search", "drive/000040", "--index", simulated_index, "--json", "--no-verify")[1])
    scores = [result["score"] for result in by_text["results"]]
    assert scores == sorted(scores, reverse=True) and by_text["seconds"]["verify"] == 0
    verified = ("pose", "dataset_pose", "inlier_ratio")
    assert all(result[key] is None for result in by_text["results"] for key in verified)


def test_search_of_a_text_has_no_origin(call: Call, simulated_index: Path) -> None:
    status, out, _ = call("search", "-", "--index", simulated_index, "--json", stdin="x1_y2_a3")
    answer = json.loads(out)
    assert status == 0 and conforms(answer, SEARCH)
    assert answer["query"] == {
        "map_id": None,
        "dataset": None,
        "first_scan": None,
        "last_scan": None,
        "keypoints": 1,
    }


def test_search_for_every_map(call: Call, simulated_index: Path) -> None:
    _, out, _ = call("search", "drive/000040", "--index", simulated_index, "--json", "--top", 0)
    assert sorted(ids(json.loads(out))) == MapIndex.open(simulated_index).ids


def test_excluded_travel(call: Call, simulated_index: Path, simulated: Path) -> None:
    middle = MapIndex.open(simulated_index).document("drive/000040").middle
    for query in ("drive/000040", f"{simulated}#40"):
        arguments = ("--index", simulated_index, "--json", "--top", 0, "--exclude-travel", 5)
        found = json.loads(call("search", query, *arguments)[1])["results"]
        assert found and all(abs(sum(result["travel"]) / 2 - middle) > 5 for result in found)


def test_only_maps_that_a_query_of_whoosh_finds(call: Call, simulated_index: Path) -> None:
    token = str(MapIndex.open(simulated_index).document("drive/000040").text).split()[0]
    arguments = ("--index", simulated_index, "--json", "--top", 0, "--no-verify", "--where")
    for where in (f"first_scan:[30 TO 50] AND {token}", f"first_scan:[30 TO 50] AND {token}~0"):
        status, out, _ = call("search", "drive/000040", *arguments, where)
        found = [hit["map_id"] for hit in json.loads(out)["results"]]
        held = [
            one.map_id for one in MapIndex.open(simulated_index).documents() if token in str(one.text).split()
        ]
        assert status == 0 and sorted(found) == [
            name for name in held if "drive/000030" <= name <= "drive/000050"
        ]


def test_search_prints_a_table(call: Call, simulated_index: Path) -> None:
    for arguments in ([], ["--no-verify"]):
        status, out, err = call("search", "drive/000040", "--index", simulated_index, "--top", 2, *arguments)
        assert (status, err) == (0, "") and "drive/000040" in out and "profile default" in out
        assert "\x1b" not in out


def test_plots(call: Call, simulated_index: Path) -> None:
    status, _, err = call("search", "drive/000040", "--index", simulated_index, "--plot", "match.png")
    assert status == 0 and "match.png" in err and Path("match.png").stat().st_size > 10_000
    status, out, _ = call("inspect", "drive/000040", "--index", simulated_index, "--plot", "map.svg", "--json")
    assert status == 0 and Path("map.svg").exists() and conforms(json.loads(out), INSPECT)


def test_inspect_prints_the_text_alone(call: Call, simulated_index: Path) -> None:
    stored = MapIndex.open(simulated_index).document("drive/000040")
    status, out, err = call("inspect", "drive/000040", "--index", simulated_index)
    assert (status, out, err) == (0, f"{stored.text}\n", "")


def test_inspect_json(call: Call, simulated_index: Path) -> None:
    stored = MapIndex.open(simulated_index).document("drive/000040")
    shown = json.loads(call("inspect", "drive/000040", "--index", simulated_index, "--json")[1])
    assert conforms(shown, INSPECT)
    assert shown["map_id"] == "drive/000040" and shown["text"] == str(stored.text)
    assert shown["travel"] == stored.travel.tolist() and shown["viewpoint"] == stored.viewpoint.tolist()
    assert (shown["keypoints"], shown["words"]) == (len(stored.text), stored.text.words)


def test_inspect_of_a_text_and_of_a_log_needs_no_index(call: Call, simulated: Path) -> None:
    shown = json.loads(call("inspect", "-", "--json", stdin="x10_y20_a3 x30_y40_a3")[1])
    assert conforms(shown, INSPECT) and shown["map_id"] is None and shown["travel"] is None
    assert shown["centre_of_gravity"] == pytest.approx([2.05, 3.05])
    shown = json.loads(call("inspect", f"{simulated}@12.5", "--json")[1])
    assert conforms(shown, INSPECT) and shown["map_id"].startswith("drive/")


def test_info(call: Call, simulated: Path, simulated_index: Path) -> None:
    status, out, _ = call("info", "--index", simulated_index, "--json")
    held = json.loads(out)
    assert status == 0 and conforms(held, INFO) and all(conforms(d, DATASET) for d in held["datasets"])
    assert held["maps"] == sum(dataset["maps"] for dataset in held["datasets"]) > 0
    assert held["parameters"]["mapping"]["run_length"] == 5.0
    (drive,) = held["datasets"]
    log = read_log(simulated)
    assert drive["scans"] == len(log.scans)
    assert drive["travel"] == pytest.approx(travel(log.odometry)[-1], rel=0.05)
    status, out, _ = call("info", "--index", simulated_index)
    assert status == 0 and "drive" in out


def test_check(call: Call, simulated_index: Path, tmp_path: Path) -> None:
    status, out, err = call("check", "--index", simulated_index)
    assert (status, err) == (0, "") and "sound" in out and "drive" in out
    copy = tmp_path / "copy"
    shutil.copytree(simulated_index, copy)
    (segment,) = copy.glob("*.seg")
    data = segment.read_bytes()
    segment.write_bytes(data[: len(data) // 2] + bytes([data[len(data) // 2] ^ 1]) + data[len(data) // 2 + 1 :])
    status, out, err = call("check", "--index", copy, "--json")
    found = json.loads(out)
    assert status == 2 and conforms(found, CHECK) and not found["sound"] and conforms(found["files"][0], FILE)
    assert err.startswith(f"m2t-text: the index in {copy} is damaged: ") and err.count("\n") == 1
    (dataset,) = found["datasets"]
    status, out, err = call("check", "--index", copy, "--repair")
    assert (status, err) == (0, "") and f"rebuilt {dataset['maps']} of" in out and segment.name in out
    held = json.loads(call("info", "--index", copy, "--json")[1])["maps"]
    assert (
        held == dataset["maps"] >= json.loads(call("info", "--index", simulated_index, "--json")[1])["maps"] - 1
    )
    assert json.loads(call("check", "--index", copy, "--json")[1])["sound"]


def test_the_environment_names_the_index(
    call: Call, simulated_index: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("M2T_INDEX", str(simulated_index))
    assert json.loads(call("info", "--json")[1])["path"] == str(simulated_index)


# --- Wrong calls and input


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["inspect"], "Missing argument"),
        (["search"], "name one QUERY, or a file of them with --queries FILE"),
        (["serach", "x"], "No such command 'serach'. Did you mean 'search'?"),
        (["search", "x", "y"], "unexpected extra argument"),
        (["search", "x", "--bottom", "3"], "No such option"),
        (["search", "drive/000040", "--top", "-1"], "--top"),
        (["search", "drive/000040", "--top", "many"], "--top"),
        (["search", "drive/000040", "--exclude-travel", "-1"], "--exclude-travel"),
        (["search", "drive/000040", "--where", "corridor"], "'corridor' is not a query"),
        (["search", "drive/000040", "--exclude-travel", "nan"], "--exclude-travel"),
        (["search", "drive/999999"], "the nearest of its"),
        (["search", "missing.log@3"], "missing.log does not exist"),
        (["search", "-"], "standard input holds no token"),
        (["search", "drive/000040", "--plot", "a.jpg"], "name a file that ends in"),
        (["search", "drive/000040", "--plot", "missing/a.png"], "no folder 'missing'"),
        (["search", "drive/000040", "--index", "missing"], "no index in missing"),
        (["inspect", "drive/000040", "--index", "missing"], "no index in missing"),
        (["info", "--index", "missing"], "no index in missing"),
        (["check", "--index", "missing"], "no index in missing"),
        (["index"], "Missing argument"),
        (["index", "missing.log"], "'missing.log' does not exist; nothing was indexed"),
        (["index", "."], "is a folder; name the files in it; nothing was indexed"),
        (["index", "LOG", "--profile", "papper"], "no profile 'papper'; there are default, paper"),
        (["index", "LOG", "--profile", "paper"], "profile 'default', asked for 'paper'"),
        (["index", "LOG", "LOG"], "2 sources would be the dataset 'drive'"),
        (["index", "LOG", "LOG", "--name", "x"], "--name names one dataset"),
        (["index", "LOG", "--name", "a/b"], "cannot name a dataset"),
        (["index", "LOG", "--name", ""], "cannot name a dataset"),
        (["index", "LOG", "--jobs", "0"], "--jobs"),
        (["simulate", "missing/a.log"], "name a file in a folder that exists"),
        (["simulate", "."], "name a file in a folder that exists"),
        (["simulate", "a.log", "--length", "3"], "--length"),
        (["simulate", "a.log", "--length", "nan"], "--length"),
        (["simulate", "a.log", "--travel", "nan"], "--travel"),
        (["search", "LOG@3", "--run", "nan"], "--run"),
        (["evaluate-map", "LOG", "--run", "nan"], "--run"),
        (["evaluate-map", "LOG", "--covered", "nan"], "--covered"),
    ],
)
def test_a_wrong_call_gets_one_line(
    call: Call,
    simulated: Path,
    simulated_index: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.setenv("M2T_INDEX", str(simulated_index))
    status, out, err = call(*(str(simulated) if argument == "LOG" else argument for argument in arguments))
    assert (status, out) == (2, "") and message in err
    assert err.startswith("m2t-text: ") and err.count("\n") == 1


def test_no_name_commands_the_terminal(call: Call, simulated_index: Path) -> None:
    for target in ("a\x1b[31mb", "a\rb", "a\x9bb/000001", "\u202edrive/1"):
        status, _, err = call("search", target, "--index", simulated_index)
        assert status == 2 and err[:-1].isprintable()


def test_an_unwritable_place_is_told(call: Call, simulated: Path) -> None:
    Path("file").write_text("")
    for arguments in (["index", simulated, "--index", "file"], ["demo", "--folder", "file"]):
        status, _, err = call(*arguments)
        assert status == 2 and err.count("\n") == 1


# --- The real logs


@pytest.mark.parametrize("profile", ["paper", "default"])
def test_a_real_log(call: Call, radish: Path, profile: str) -> None:
    """The first quarter of it."""
    log = Path("freiburg-101-corrected.log.gz")
    with gzip.open(radish / log) as whole:
        lines = whole.readlines()
    log.write_bytes(gzip.compress(b"".join(lines[: len(lines) // 4]), 1))
    assert call("index", log, "--profile", profile, "--index", "i")[0] == 0
    index = MapIndex.open("i")
    for map_id in index.ids[::30]:
        answer = json.loads(call("search", map_id, "--index", "i", "--top", 3, "--json")[1])
        assert ids(answer)[0] == map_id and answer["index"]["profile"] == profile
        assert answer["results"][0]["inlier_ratio"] == 1.0
    query = index.document("freiburg-101-corrected/000040")
    arguments = ("--index", "i", "--json", "--top", 5, "--exclude-travel", 10)
    for name in (query.map_id, f"{log}@{query.travel[0]:.2f}", f"{log}#40"):
        answer = json.loads(call("search", name, *arguments)[1])
        assert answer["query"]["map_id"] == query.map_id and len(answer["results"]) == 5
        assert all(abs(sum(r["travel"]) / 2 - query.middle) > 10 for r in answer["results"])


# --- As a process


def test_inspect_feeds_search(simulated_index: Path) -> None:
    environment = os.environ | {"M2T_INDEX": str(simulated_index)}
    line = [*PROGRAM, "inspect", "drive/000040"]
    with subprocess.Popen(line, stdout=subprocess.PIPE, env=environment) as inspect:
        line = [*PROGRAM, "search", "-", "--json", "--top", "1"]
        search = subprocess.run(line, stdin=inspect.stdout, env=environment, capture_output=True, check=True)
    assert inspect.returncode == 0 and ids(json.loads(search.stdout)) == ["drive/000040"]


def test_a_reader_that_has_seen_enough(simulated_index: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    line = [*PROGRAM, "inspect", "drive/000040", "--index", str(simulated_index)]
    done = subprocess.run(line, stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)
    assert (done.returncode, done.stderr) == (1, b"")


SLOW = """
import time
from m2t_text import pipeline
from m2t_text.cli import main

def slowly(*arguments, describe=pipeline.describe):
    print("working", flush=True)
    time.sleep(0.01)
    return describe(*arguments)

pipeline.describe = slowly
main()
"""


@pytest.mark.parametrize(
    ("ending", "everyone", "jobs", "status", "message"),
    [
        (signal.SIGINT, True, 1, 130, "m2t-text: interrupted; nothing was left half done\n"),
        (signal.SIGINT, True, 2, 130, "m2t-text: interrupted; nothing was left half done\n"),
        (signal.SIGINT, False, 2, 130, "m2t-text: interrupted; nothing was left half done\n"),
        (signal.SIGKILL, False, 2, -9, ""),
    ],
)
def test_indexing_that_ends_early_leaves_the_index_as_it_was_and_no_process(
    own_index: Path, short: Path, ending: signal.Signals, everyone: bool, jobs: int, status: int, message: str
) -> None:
    before = MapIndex.open(own_index).ids
    line = [sys.executable, "-c", SLOW, "index", str(short), "--index", "i", "--name", "b", "--jobs", str(jobs)]
    process = subprocess.Popen(
        line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stdout is not None and process.stdout.readline() == "working\n", process.communicate()
    (os.killpg if everyone else os.kill)(process.pid, ending)
    assert process.communicate(timeout=20)[1] == message  # read to its end: nobody is left to write there
    assert process.returncode == status
    assert MapIndex.open(own_index).ids == before


EARLY = """
import os
import signal
import sys

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "numba":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
from m2t_text.cli import main
main()
"""


def test_interrupted_while_it_starts(simulated_index: Path) -> None:
    search = ["search", MapIndex.open(simulated_index).ids[0], "--index", str(simulated_index)]
    done = subprocess.run([sys.executable, "-c", EARLY, *search], capture_output=True, text=True, check=False)
    message = "m2t-text: interrupted; nothing was left half done\n"
    assert (done.returncode, done.stdout, done.stderr) == (130, "", message)


# --- The demonstration


def test_demo(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("m2t_text.evaluation.demo.TRAVEL", 24.0)
    status, out, err = call("demo", "--folder", "demo", "--jobs", 1)
    assert (status, err) == (0, "")
    found = re.search(r"(\d+) of (\d+) found within 3 m", out)
    assert found is not None and int(found[1]) > 0.6 * int(found[2]) > 2
    assert all(Path("demo", name).stat().st_size > 10_000 for name in ("overview.png", "match.png"))
    commands = re.findall(r"^  m2t-text ((?!serve).*demo/index)$", out, re.MULTILINE)
    assert len(commands) == 3 and all(call(*command.split())[0] == 0 for command in commands)


def test_compiled_code_is_loaded_without_the_compiler(call: Call, simulated_index: Path) -> None:
    """What the compiler knows of Python's and NumPy's functions takes a tenth of a command to load."""
    search = ["search", MapIndex.open(simulated_index).ids[0], "--index", str(simulated_index)]
    assert call(*search)[0] == 0  # compiles what is not yet
    code = f"import sys\nfrom m2t_text.cli import run\nassert run({search!r}) == 0\n"
    known = "assert 'numba' in sys.modules and 'numba.np.arraymath' not in sys.modules\n"
    subprocess.run([sys.executable, "-c", code + known], check=True, capture_output=True)
