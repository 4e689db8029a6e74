"""Loops that come out while driving are those of the whole log; and the index that grows with the drive."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from calling import Call

from m2t_text.config import PROFILES
from m2t_text.description.document import Document
from m2t_text.errors import M2TError
from m2t_text.index.map_index import MapIndex
from m2t_text.live.localizer import Localizer
from m2t_text.live.looping import LiveLoops
from m2t_text.live.messages import Reset, Swept
from m2t_text.live.session import Session
from m2t_text.live.survey import SPACING
from m2t_text.logs import read_log
from m2t_text.logs.log import Log
from m2t_text.loops.detection import LoopDetection, detect_loops
from m2t_text.loops.export import to_json
from m2t_text.loops.graph import pose_graph
from m2t_text.loops.growing import TOGETHER, GrowingDataset
from m2t_text.loops.online import OnlineLoops
from m2t_text.mapping.trajectory import survey
from m2t_text.pipeline import describe_survey

DEFAULT = PROFILES["default"]


def answers(log: Log, behind: LiveLoops) -> list[tuple[int, dict[str, Any]]]:
    """What is told of a drive, each with the scan at which it is."""
    session = Session(DEFAULT, poses=False, laser_pose=log.laser_pose, left=behind.take)
    told = [(k, one) for k, scan in enumerate(log.scans) for one in session.take(Swept(scan, True))]
    behind.end()
    return told


def expected(detection: LoopDetection) -> list[dict[str, Any]]:
    loops: list[dict[str, Any]] = to_json(detection, pose_graph(detection))["loops"]
    return loops


def test_a_drive_has_the_loops_of_the_log_to_the_bit(drive: Log) -> None:
    check_to_the_bit(drive, 145)


@pytest.mark.long
def test_a_real_drive_has_the_loops_of_the_log_to_the_bit(radish: Path) -> None:
    """The first scans of the Intel Research Lab."""
    check_to_the_bit(read_log(radish / "intel-corrected.log.gz"), 118)


def check_to_the_bit(whole: Log, count: int) -> None:
    """The begin of a drive, cut once, while driving and as a log."""
    scans = tuple(replace(scan, drive=int(k >= 10)) for k, scan in enumerate(whole.scans[:count]))
    log = replace(whole, scans=scans, ground_truth=None)
    told = answers(log, LiveLoops(DEFAULT))
    assert [one["known"] for _, one in told] == [k for k, _ in told]  # each as soon as it is known
    named = [{**one, "query": one["query"].replace("live/", f"{log.name}/")} for _, one in told]
    for one in named:
        assert one.pop("type") == "loop"
        one["map_id"] = one["map_id"].replace("live/", f"{log.name}/")
    assert named == expected(detect_loops(log)) and named


def test_a_drive_that_is_added_finds_other_drives(
    drive: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("m2t_text.loops.gate.OTHER_RUNS", 2)  # so that a short drive will do
    index = MapIndex.create(tmp_path / "days", DEFAULT)
    part = replace(drive, scans=drive.scans[:80])
    assert answers(part, LiveLoops(DEFAULT, index, find=False)) == []
    assert [one.name for one in index.datasets()] == ["live"]
    maps = len(index)
    told = answers(part, LiveLoops(DEFAULT, index))
    assert [one.name for one in index.datasets()] == ["live", "live-2"] and len(index) == 2 * maps
    assert told and all(one["from"] is None and one["map_id"].startswith("live/") for _, one in told)
    assert all(one["query"].startswith("live-2/") for _, one in told)


def test_a_drive_that_is_added_is_not_where_it_is_found(drive: Log, tmp_path: Path) -> None:
    index = MapIndex.create(tmp_path / "days", DEFAULT)
    localizer = Localizer(index)
    behind = LiveLoops(DEFAULT, index, False, localizer)
    session = Session(DEFAULT, localizer, 5.0, False, drive.laser_pose, behind.take)
    places = [one for scan in drive.scans[:180] for one in session.take(Swept(scan, True))]
    assert len(places) > 5 and {one["verdict"] for one in places} == {"none"} and len(index) >= TOGETHER


def test_a_reset_begins_another_drive(drive: Log, tmp_path: Path) -> None:
    index = MapIndex.create(tmp_path / "days", DEFAULT)
    behind = LiveLoops(DEFAULT, index, False)
    session = Session(DEFAULT, poses=False, laser_pose=drive.laser_pose, left=behind.take)
    for _ in range(2):
        for scan in drive.scans[:60]:
            list(session.take(Swept(scan, True)))
        list(session.take(Reset()))
    behind.end()
    one, other = index.datasets()
    assert (one.maps, one.travel) == (other.maps, other.travel) and one.maps > 0


@pytest.fixture(scope="module")
def documents(drive: Log) -> list[Document]:
    """The maps of the begin of the drive."""
    part = survey(replace(drive, scans=drive.scans[:180], ground_truth=None), DEFAULT.mapping)
    return list(describe_survey(part, drive.name, DEFAULT, spacing=SPACING))


def test_commits_are_few_and_in_time(documents: list[Document], tmp_path: Path) -> None:
    index = MapIndex.create(tmp_path / "past", DEFAULT)
    past = GrowingDataset(index, documents[0].dataset)
    held = []
    for document in documents:
        past.add(document)
        held.append(len(index))
    assert set(held) == set(range(0, len(documents) + 1, TOGETHER))
    past.commit_up_to(documents[held[-1]].middle - 0.01)
    assert len(index) == held[-1]
    past.commit_up_to(documents[held[-1]].middle)
    assert len(index) == len(documents)


def test_a_map_before_its_poses_is_told(documents: list[Document], tmp_path: Path) -> None:
    document = documents[0]
    online = OnlineLoops(document.dataset, MapIndex.create(tmp_path / "past", DEFAULT))
    online.move(np.zeros((document.last_scan, 3)), np.zeros(document.last_scan))
    with pytest.raises(M2TError, match=f"before the pose of its scan {document.last_scan}"):
        online.add(document)


def test_in_a_pipe(call: Call, circuit: Path, detection: LoopDetection, tmp_path: Path) -> None:
    """The loops of a drive that is added to an index are those of the log, too."""
    _, lines, _ = call("replay", circuit, "--speed", "0")
    index = tmp_path / "days"
    options = ("--index", index, "--append", "--no-poses")
    status, out, err = call("live", "-", "--loops", *options, stdin=lines)
    assert (status, err) == (0, "")
    told = [json.loads(line) for line in out.splitlines()]
    assert told and told == [{"type": "loop"} | one for one in expected(detection)]
    begin = "\n".join(lines.splitlines()[:115])
    assert call("live", "-", *options, stdin=begin) == (0, "", "")
    status, out, _ = call("info", "--index", index, "--json")
    first, second = json.loads(out)["datasets"]
    assert (first["name"], second["name"]) == ("circuit", "circuit-2")
    assert first["maps"] > second["maps"] > TOGETHER
    assert call("live", "-", "--loops", "--no-poses", stdin=begin) == (0, "", "")  # none yet
    assert call("live", "-", "--append")[0] == 2
    assert call("live", "-", "--keep-per-place", "3")[0] == 2
