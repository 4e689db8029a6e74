"""What the HTTP interface answers is what the command line answers."""

import json
from pathlib import Path

import numpy as np
import pytest
from calling import Call
from serving import Client, served

from m2t_text.index.map_index import MapIndex


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


def test_places_are_where_the_maps_begin(client: Client, simulated_index: Path) -> None:
    body = client.ask("/api/places").body
    length = int.from_bytes(body[:4], "little")
    header = json.loads(body[4 : 4 + length])
    documents = list(MapIndex.open(simulated_index).documents())
    assert header["maps"] == len(documents)
    at, columns = 4 + length, {}
    for column in header["columns"]:
        array = np.frombuffer(body, f"<{column['type']}", column["length"], at)
        columns[column["name"]] = array
        at += array.nbytes + -array.nbytes % 8
    assert at == len(body)
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
