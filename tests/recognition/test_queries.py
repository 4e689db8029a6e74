"""What a user can name on the command line, and what happens where it names nothing."""

import io
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from likeness import alike

from m2t_text.config import PROFILES
from m2t_text.description.text import Text
from m2t_text.errors import LogError, M2TError, QueryError, TextError
from m2t_text.index.map_index import MapIndex
from m2t_text.index.snapshot import Snapshot
from m2t_text.logs import read_log
from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen
from m2t_text.mapping.scan_cloud import scan_points
from m2t_text.recognition.queries import Context, Query, resolve
from m2t_text.sources.opening import SourceOptions
from m2t_text.util.geometry import travel

DEFAULT = PROFILES["default"]


@pytest.fixture
def context(simulated_index: Path) -> Context:
    return Context(DEFAULT, MapIndex.open(simulated_index))


def same(a: Text, b: Text) -> bool:
    return str(a) == str(b)


def test_a_map_id_is_the_stored_map(context: Context) -> None:
    assert context.index is not None
    query = resolve("drive/000040", context)
    stored = context.index.document("drive/000040")
    assert query.document is not None and query.title == "drive/000040"
    assert same(query.text, stored.text) and query.document.middle == stored.middle


def test_a_map_id_is_looked_up_without_a_list_of_all_ids(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It took 2.7 s in an index of a million maps."""
    monkeypatch.setattr(Snapshot, "_sorted", property(lambda snapshot: pytest.fail("all ids are listed")))
    document = resolve("drive/000040", context).document
    assert document is not None and document.first_scan == 40
    assert context.index is not None
    for name in ("drive/40", "drive/999999", "drive/", "", "\ud800/000040"):
        assert context.index.find_document(name) is None


def test_a_scan_of_an_indexed_log_knows_its_travel(context: Context, simulated: Path) -> None:
    assert context.index is not None
    query = resolve(f"{simulated}#40", context)
    stored = context.index.document("drive/000040")
    assert query.document is not None and query.document.map_id == "drive/000040"
    assert query.excluding(10.0) == ("drive", stored.middle, 10.0)
    assert alike(query.text, stored.text) > 0.6  # described by itself it may differ a little


def test_metres_are_those_that_the_index_shows(context: Context, simulated: Path) -> None:
    assert context.index is not None
    for map_id in ("drive/000000", "drive/000057", context.index.ids[-1]):
        begin = context.index.document(map_id).travel[0]
        assert resolve(f"{simulated}@{begin:.2f}", context).title == map_id
    between = context.index.document("drive/000057").travel[0] + 0.02
    assert resolve(f"{simulated}@{between:.2f}", context).title == "drive/000058"


def test_metres_of_a_log_without_an_index_are_wheel_odometry(simulated: Path) -> None:
    query = resolve(f"{simulated}@12.5", Context(DEFAULT))
    way = travel(read_log(simulated).odometry)
    assert query.document is not None
    assert query.document.first_scan == np.flatnonzero(way >= 12.5 - 0.005)[0]


def test_a_log_may_have_another_name_in_the_index(simulated: Path, context: Context) -> None:
    query = resolve(f"{simulated}#40", Context(DEFAULT, context.index, options=SourceOptions("other")))
    assert query.document is not None and query.document.dataset == "other"


def test_a_log_may_hold_the_separators_in_its_name(simulated: Path, tmp_path: Path) -> None:
    path = tmp_path / "a@b#c.log"
    path.write_bytes(simulated.read_bytes())
    assert resolve(f"{path}#40", Context(DEFAULT)).title == "a@b#c/000040"


def test_a_run_of_another_length_is_cut_from_a_log(context: Context, simulated: Path) -> None:
    assert context.index is not None
    stored = context.index.document("drive/000040")
    whole, short, scan = (
        resolve(f"{simulated}#40", replace(context, run=run)).document for run in (None, 1.5, 0.0)
    )
    assert whole is not None and short is not None and scan is not None
    for document, metres in ((short, 1.5), (scan, 0.0)):
        assert document.travel[0] == stored.travel[0]
        assert np.ptp(document.travel) == pytest.approx(metres, abs=0.3)
    assert scan.first_scan == scan.last_scan == 40 < short.last_scan < whole.last_scan
    assert scan.points < short.points < whole.points
    # A single scan is its own hits within the range limit, one for each cell.
    log = read_log(simulated)
    own = scan_points(log.scans[40], log.laser_pose, DEFAULT.mapping.range_limit)
    assert scan.points == len(np.unique(np.floor(own / DEFAULT.mapping.cell), axis=0))
    assert whole.travel.tolist() == stored.travel.tolist()


def test_a_single_scan_is_a_map_with_scans_that_has_travel_to_exclude(simulated: Path) -> None:
    query = resolve(f"{simulated}#40", Context(DEFAULT, run=0.0))
    assert query.driven and query.excluding(10.0) is not None
    last = len(read_log(simulated).scans) - 1  # where a longer run would not be complete
    found = resolve(f"{simulated}#{last}", Context(DEFAULT, run=0.0)).document
    assert found is not None and found.last_scan == last


@pytest.mark.parametrize("target", ["drive/000040", "-", "place.txt"])
def test_only_a_run_of_a_log_has_a_length(context: Context, target: str) -> None:
    with pytest.raises(QueryError, match=f"--run cuts a run out of a log; '{target}' is none"):
        resolve(target, replace(context, run=3.0))


@pytest.mark.parametrize("ending", ["", "\n", " \r\n"])
def test_a_text_file_holds_a_text(context: Context, tmp_path: Path, ending: str) -> None:
    path = tmp_path / "place.txt"
    path.write_text("x1_y2_a3 x-4_y5_a6" + ending)
    query = resolve(str(path), context)
    assert query.document is None and str(query.text) == "x1_y2_a3 x-4_y5_a6"


def test_standard_input_holds_a_text(context: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(b"x1_y2_a3\n")))
    assert str(resolve("-", context).text) == "x1_y2_a3"


@pytest.mark.parametrize("stdin", [None, SimpleNamespace()])
def test_no_standard_input_is_told(
    context: Context, monkeypatch: pytest.MonkeyPatch, stdin: SimpleNamespace | None
) -> None:
    monkeypatch.setattr(sys, "stdin", stdin)
    with pytest.raises(QueryError, match="standard input cannot be read"):
        resolve("-", context)


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("drive/999999", r"no map 'drive/999999' in .*; the nearest of its \d+ maps is drive/000\d+"),
        ("driev/000001", "no dataset 'driev' in .*; it holds drive"),
        ("nonsense", "neither a map nor a file; name a map id"),
        ("", "neither a map nor a file"),
        ("missing.log@3", "missing.log does not exist"),
        ("missing.log#3", "missing.log does not exist"),
        ("missing.txt", "cannot read the text 'missing.txt': No such file"),
        ("LOG", "is a whole log; name a run of it, as .*@12.5"),
        ("LOG@", "does not end in metres"),
        ("LOG@-3", "does not end in metres"),
        ("LOG@nan", "does not end in metres"),
        ("LOG#1.5", "does not end in the number of a scan"),
        ("LOG#99999", r"the log has \d+ scans, #0 to #\d+"),
        ("LOG#LAST", r"a map takes \d m of travel, and the log ends 0.00 m after scan"),
        ("LOG@4000", r"drive@4000: the log's last map begins after \d+\.\d\d m, at scan #\d+"),
    ],
)
def test_each_wrong_name_says_what_to_try(context: Context, simulated: Path, target: str, message: str) -> None:
    last = str(len(read_log(simulated).scans) - 1)
    with pytest.raises((QueryError, LogError), match=message) as raised:
        resolve(target.replace("LAST", last).replace("LOG", str(simulated)), context)
    assert "\n" not in str(raised.value)


def test_metres_beyond_a_log_without_an_index(simulated: Path) -> None:
    with pytest.raises(QueryError, match=r"the log's last map begins after 3\d\.\d\d m, at scan #\d+"):
        resolve(f"{simulated}@4000", Context(DEFAULT))


def test_a_map_id_needs_an_index() -> None:
    with pytest.raises(QueryError, match="there is no index to find the map 'a/000001' in"):
        resolve("a/000001", Context(DEFAULT))


@pytest.mark.parametrize(
    ("contents", "error", "message"),
    [
        (b"x1_y2_a3 hello", TextError, "token 2 is 'hello'"),
        (b"x1_y2_a1024", TextError, "token 1"),
        (b"", QueryError, "holds no token"),
        (b" \n", QueryError, "holds no token"),
        (b"\xff\xfe", QueryError, "byte 0 is no UTF-8"),
    ],
)
def test_each_broken_text_is_told(
    context: Context, tmp_path: Path, contents: bytes, error: type[M2TError], message: str
) -> None:
    path = tmp_path / "broken.txt"
    path.write_bytes(contents)
    with pytest.raises(error, match=message) as raised:
        resolve(str(path), context)
    assert "broken.txt" in str(raised.value)


def test_an_endless_text_is_refused(context: Context, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("m2t_text.recognition.queries.MAX_TEXT_BYTES", 10)
    path = tmp_path / "long.txt"
    path.write_text("x1_y2_a3 x1_y2_a3")
    with pytest.raises(QueryError, match="longer than"):
        resolve(str(path), context)


def test_a_text_alone_has_no_travel_to_exclude() -> None:
    query = Query(Text.of([1], [2], [3]))
    assert query.excluding(None) is None
    with pytest.raises(QueryError, match="name the map by its id or by its log"):
        query.excluding(10.0)


def test_a_run_that_the_drive_is_cut_in_is_refused(tmp_path: Path) -> None:
    """Odometry that begins again after scan 29 leaves less than a map between there and scan 20."""
    log = simulate(Simulation(travel=20.0, beams=20))
    far = tuple(
        replace(one, odometry=one.odometry + np.array([50.0 * (k > 29), 0, 0]))
        for k, one in enumerate(log.scans)
    )
    path = tmp_path / "cut.log"
    write_carmen(replace(log, scans=far, ground_truth=None), path)
    with pytest.raises(QueryError, match=r"and the drive is cut \d\.\d\d m after scan #20; name an earl"):
        resolve(f"{path}#20", Context(DEFAULT))
    assert resolve(f"{path}#31", Context(DEFAULT)).document is not None


def test_a_dataset_of_the_index_is_named_like_its_log(context: Context) -> None:
    assert context.index is not None
    begin = context.index.document("drive/000057").travel[0]
    for target in (f"drive@{begin:.2f}", "drive#57"):
        query = resolve(target, context)
        assert query.title == "drive/000057" and same(query.text, context.index.document("drive/000057").text)
    with pytest.raises(QueryError, match=r"'drive@900': the last map of drive begins after .* m, at scan #"):
        resolve("drive@900", context)
    with pytest.raises(QueryError, match="'drive' is a dataset of the index, name its log"):
        resolve("drive@3", replace(context, run=0.0))


def test_what_is_named_is_found_without_looking_at_all_names(
    context: Context, simulated: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To list and sort the ids of a million maps takes longer than a search."""

    def every_id(index: MapIndex) -> list[str]:
        raise AssertionError("all ids were asked for")

    monkeypatch.setattr(MapIndex, "ids", property(every_id))
    for target in ("drive/000040", "drive@3", f"{simulated}#40", f"{simulated}@3"):
        assert resolve(target, context).document is not None
    with pytest.raises(QueryError, match="the nearest of its"):
        resolve("drive/999999", context)
