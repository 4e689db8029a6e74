"""What the HTTP interface answers is what the command line answers."""

import json
from pathlib import Path

import numpy as np
import pytest
from calling import Call
from serving import Client, served, unpacked

from m2t_text.index.map_index import MapIndex
from m2t_text.saved_maps.grid import FREE, OCCUPIED, UNKNOWN, Grid
from m2t_text.saved_maps.writing import write_map
from m2t_text.sources.indexing import IndexRequest, index_sources


@pytest.fixture(scope="module")
def client(simulated_index: Path):
    with served(simulated_index) as client:
        yield client


def test_info_is_that_of_the_command(client: Client, simulated_index: Path, call: Call) -> None:
    _, out, _ = call("info", "--index", simulated_index, "--json")
    told = client.get("/api/info")
    assert {name: told[name] for name in json.loads(out)} == json.loads(out)
    assert told["server"]["writable"] is False


def test_a_search_is_that_of_the_command(client: Client, simulated_index: Path, call: Call) -> None:
    options = ("--top", 4, "--exclude-travel", 2)
    _, out, _ = call("search", "drive/000040", "--index", simulated_index, "--json", *options)
    wanted = json.loads(out)
    told = client.get("/api/search", query="drive/000040", top=4, exclude_travel=2)
    posted = client.ask(
        "/api/search",
        method="POST",
        body=json.dumps({"query": "drive/000040", "top": 4, "exclude_travel": 2}),
        headers={"Content-Type": "application/json"},
    ).json()
    for answer in (wanted, told, posted):
        answer.pop("seconds")
    assert told == wanted == posted


def test_a_map_is_inspected_as_by_the_command(client: Client, simulated_index: Path, call: Call) -> None:
    _, out, _ = call("inspect", "drive/000040", "--index", simulated_index, "--json")
    told = client.get("/api/maps/drive/000040")
    assert {name: told[name] for name in json.loads(out)} == json.loads(out)


def test_the_image_of_a_saved_map_is_shown_as_its_walls(tmp_path: Path) -> None:
    """Every cell of it, in the map's frame; and no copy that a browser kept of what the maps saw."""
    states = np.full((90, 120), UNKNOWN, dtype=np.int8)
    states[10:80, 10:110] = FREE
    states[[10, 79], 10:110] = states[10:80, [10, 109]] = states[40:44, 50:60] = OCCUPIED
    grid = Grid(states, 0.05, np.array([-3.0, 1.0, 0.0]))
    write_map(grid, tmp_path / "room.yaml")
    index_sources(IndexRequest([tmp_path / "room.yaml"], tmp_path / "index"))
    with served(tmp_path / "index") as client:
        seen = client.ask("/api/walls", {"dataset": "room"})
    with served(tmp_path / "index", maps=[tmp_path / "room.yaml"]) as client:
        drawn = client.ask("/api/walls", {"dataset": "room"})
        missing = client.ask("/api/walls", {"dataset": "other"})
    assert missing.status == 404 and drawn.headers["etag"] != seen.headers["etag"]
    header, columns = unpacked(drawn.body)
    cells = (np.stack([columns["x"], columns["y"]], axis=1) + 0.5) * header["cell"] + header["origin"]
    assert header["cell"] == 0.05
    wanted = {tuple(cell) for cell in grid.centres(OCCUPIED).round(6).tolist()}
    assert {tuple(cell) for cell in cells.round(6).tolist()} == wanted and len(cells) == len(wanted)
    floor = np.stack([columns["floor_x"], columns["floor_y"]], axis=1) * header["floor_cell"] + header["origin"]
    assert (floor.min(axis=0) < [-2.4, 1.6]).all() and (floor.max(axis=0) > [2.3, 4.8]).all()


def test_places_are_where_the_maps_begin(client: Client, simulated_index: Path) -> None:
    header, columns = unpacked(client.ask("/api/places").body)
    documents = list(MapIndex.open(simulated_index).documents())
    assert header["maps"] == len(documents)
    assert np.allclose(columns["x"], [one.pose[0] for one in documents])
    assert columns["first_scan"].tolist() == [one.first_scan for one in documents]


@pytest.mark.parametrize(
    ("name", "scan"), [("drive@0", 0), ("drive#40", 40), ("drive@3.2", None), (" drive/000040 ", 40)]
)
def test_places_of_a_drive_are_named_by_travel_or_scan(client: Client, name: str, scan: int | None) -> None:
    query = client.get("/api/search", query=name, top=1)["query"]
    assert query["dataset"] == "drive" and scan in (None, query["first_scan"])


def test_a_token_finds_the_maps_that_have_it(client: Client, simulated_index: Path) -> None:
    index = MapIndex.open(simulated_index)
    token = str(index.document("drive/000040").text).split()[0]
    told = client.get("/api/matching", where=token)
    assert told["total"] == len(told["places"]) > 0
    listed = client.get("/api/maps", where=token, limit=1000)
    assert listed["total"] == told["total"]
    assert "drive/000040" in [one["map_id"] for one in listed["maps"]]
    narrowed = client.get("/api/maps", where=f"{token} AND first_scan:40")["maps"]
    assert [one["map_id"] for one in narrowed] == ["drive/000040"]


def test_a_map_compared_with_itself_shares_every_keypoint(client: Client) -> None:
    told = client.get("/api/compare", a="drive/000040", b="drive/000040")
    assert set(told["query_keypoints"]) == {"2"} and told["inlier_ratio"] == 1.0
    assert np.abs(told["laid"]).max() < 0.02


@pytest.mark.parametrize(
    ("path", "parameters", "status", "says"),
    [
        ("/api/search", {}, 400, "name what to look up"),
        ("/api/search", {"query": "drive/999999"}, 404, "no map 'drive/999999'"),
        ("/api/search", {"query": "/etc/passwd"}, 400, "neither a map of this index nor a text"),
        ("/api/search", {"query": "x1_y2_a5000"}, 400, "token 1 is"),
        ("/api/search", {"query": "drive/000040", "top": "many"}, 400, "top must be a whole number"),
        ("/api/search", {"query": "drive/000040", "exclude_travel": "nan"}, 400, "exclude_travel must be"),
        ("/api/search", {"query": "drive/000040", "wher": "x"}, 400, "unknown parameter 'wher'"),
        ("/api/search", {"query": "drive/000040", "where": "NOT NOT"}, 400, "is not a query"),
        ("/api/search", {"query": "drive/000040", "index": "../other"}, 404, "no index '../other'"),
        ("/api/matching", {"where": ""}, 400, "is not a query"),
        ("/api/walls", {"dataset": "other"}, 404, "no dataset 'other'"),
        ("/api/uploads/0123", {}, 404, "no upload '0123'"),
        ("/api/replay/other", {}, 404, "no dataset 'other'"),
        ("/api/nothing", {}, 404, "Not Found"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(
    client: Client, path: str, parameters: dict[str, str], status: int, says: str
) -> None:
    answer = client.ask(path, parameters)
    assert (answer.status, answer.json().keys()) == (status, {"error"})
    assert says in answer.json()["error"] and "\n" not in answer.json()["error"]
