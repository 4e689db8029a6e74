"""What is uploaded is read in a process of its own, leads nowhere else, and leaves nothing."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest
from serving import BINARY, Client, served, unpacked
from states import contents

from m2t_text.config import PROFILES
from m2t_text.index.map_index import MapIndex
from m2t_text.logs import read_log
from m2t_text.pipeline import describe_log
from m2t_text.saved_maps.grid import Grid
from m2t_text.saved_maps.writing import write_map
from m2t_text.web.routes import receiving
from m2t_text.web.uploads.drives import SPACING, described_places, from_message, to_json

pytestmark = pytest.mark.page
FOUND = Path(__file__).parents[1] / "fuzz" / "found"
ENDINGS = {"bag": ".bag", "carmen": ".log"}
IMAGES = {"bmp": "bmp", "jpeg": "jpg", "png": "png"}
HEADER = "image: {image}\nresolution: 0.05\norigin: [0, 0, 0]\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


@pytest.fixture(scope="module")
def client(simulated_index: Path) -> Iterator[Client]:
    with served(simulated_index) as client:
        yield client


def settled(client: Client, upload: dict[str, Any], seconds: float = 60.0) -> dict[str, Any]:
    """An upload when it is read, or was refused."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        told = client.get(f"/api/uploads/{upload['id']}")
        if told["state"] in ("ready", "failed", "waiting") and told["added"] != "adding":
            return told
        time.sleep(0.05)
    raise AssertionError(f"not read within {seconds} s: {told}")


def events(client: Client, path: str) -> list[tuple[str, dict[str, Any]]]:
    """All server-sent events of an address, until the server ends them."""
    body = client.ask(path).body.decode()
    pairs = []
    for block in body.strip().split("\n\n"):
        lines = dict(line.split(": ", 1) for line in block.splitlines())
        pairs.append((lines["event"], json.loads(lines["data"])))
    return pairs


@contextmanager
def unchanged(index: Path) -> Iterator[None]:
    before = {file.name: file.read_bytes() for file in index.iterdir()}
    yield
    assert {file.name: file.read_bytes() for file in index.iterdir()} == before


def test_places_of_a_drive_are_maps_of_the_whole(circuit: Path) -> None:
    log, parameters = read_log(circuit), PROFILES["default"]
    whole = {one.first_scan: to_json(one) for one in describe_log(log, parameters)}
    places = list(described_places(log, parameters))
    assert all(to_json(one) == whole[one.first_scan] for one in places)
    begins = [one.travel[0] for one in places]
    assert len(places) > 20 and np.diff(begins).min() >= SPACING
    assert to_json(from_message(to_json(places[0]))) == to_json(places[0])


def test_a_drive_is_looked_up_place_by_place(client: Client, simulated: Path) -> None:
    answer = client.send(simulated, "again.log")  # under its own name, only other visits would count
    assert answer.status == 201
    upload = answer.json()
    told = events(client, f"/api/replay/{upload['id']}")
    places = [data for kind, data in told if kind == "place"]
    assert (
        told[0][0] == "begin" and told[-1] == ("end", told[-1][1]) and told[-1][1]["total"] == len(places) > 20
    )
    assert [place["number"] for place in places] == list(range(len(places)))
    for place in places:  # the drive that is in the index, looked up in it: every place is there
        best = place["answer"]["results"][0]
        assert np.hypot(*np.subtract(best["dataset_pose"], place["own_pose"])[:2]) < 0.3
    again = events(client, f"/api/replay/{upload['id']}?from={len(places) - 2}")
    assert [data["number"] for kind, data in again if kind == "place"] == [len(places) - 2, len(places) - 1]
    found = client.get("/api/search", query=places[3]["query"], top=1)
    assert found["results"][0]["map_id"] == places[3]["answer"]["results"][0]["map_id"]


def test_a_dataset_is_replayed_against_its_other_visits(client: Client) -> None:
    places = [data for kind, data in events(client, "/api/replay/drive") if kind == "place"]
    assert len(places) > 20
    for place in places:
        for hit in place["answer"]["results"]:
            assert abs(np.mean(hit["travel"]) - np.mean(place["travel"])) > 10.0


def test_a_saved_map_waits_for_its_image_and_for_nothing_else(client: Client, tmp_path: Path) -> None:
    states = np.zeros((120, 160), dtype=np.int8)
    states[[0, -1]] = states[:, [0, -1]] = states[40:60, 50:90] = 1
    write_map(Grid(states, 0.05, np.zeros(3)), tmp_path / "room.yaml")
    upload = client.send(tmp_path / "room.yaml").json()
    assert (upload["state"], upload["needs"]) == ("waiting", "room.pgm")
    image = (tmp_path / "room.pgm").read_bytes()
    other = client.ask(f"/api/uploads/{upload['id']}/other.pgm", method="PUT", body=image, headers=BINARY)
    assert other.status == 400 and "needs room.pgm" in other.json()["error"]
    assert client.ask(f"/api/uploads/{upload['id']}/room.pgm", None, "PUT", image, BINARY).status == 201
    told = settled(client, upload)
    assert told["state"] == "ready" and told["maps"] > 0 and not told["driven"]
    header, columns = unpacked(client.ask(f"/api/uploads/{upload['id']}/places").body)
    assert header["cell"] == 0.05 and len(columns["x"]) == (states == 1).sum()  # its image
    assert len(columns["place_x"]) == header["maps"] == told["maps"]


@pytest.mark.parametrize("image", ["/etc/hostname", "../secret.pgm", "a/../../x.pgm", "sub/room.pgm"])
def test_a_saved_map_names_no_image_elsewhere(client: Client, tmp_path: Path, image: str) -> None:
    (tmp_path / "room.yaml").write_text(HEADER.format(image=image))
    answer = client.send(tmp_path / "room.yaml")
    assert answer.status == 400 and "in another folder" in answer.json()["error"]


@pytest.mark.parametrize(
    "name",
    [
        "../drive.log",
        "/etc/drive.log",
        "..\\drive.log",
        ".log",
        "a\0.log",
        "a\nb.log",
        "drive.exe",
        "",
        "x" * 300 + ".log",
    ],
)
def test_names_lead_nowhere(client: Client, name: str) -> None:
    before = client.get("/api/uploads")
    answer = client.ask("/api/uploads", {"name": name}, "POST", b"x", BINARY)
    assert answer.status == 400 and set(answer.json()) == {"error"}
    assert client.get("/api/uploads") == before


@pytest.mark.parametrize(
    "path",
    [
        "/assets/../app.py",
        "/assets/%2e%2e/app.py",
        "/assets/..%2fapp.py",
        "/assets/%2fetc/passwd",
        "/api/maps/../../etc/passwd",
        "/api/maps/%2e%2e%2f%2e%2e%2fetc%2fpasswd",
        "/api/replay/..%2f..%2fetc%2fpasswd",
        "/api/uploads/..%2f..%2fetc/places",
    ],
)
def test_paths_lead_nowhere(client: Client, path: str) -> None:
    answer = client.ask(path)
    assert answer.status in (400, 404) and b"root:" not in answer.body and b"import" not in answer.body


def test_a_file_that_is_too_large_is_refused_before_it_is_sent(client: Client) -> None:
    connection = HTTPConnection("127.0.0.1", client.port, timeout=30)
    connection.putrequest("POST", "/api/uploads?name=large.log")
    for header, value in (BINARY | {"Content-Length": str(201 * 10**6)}).items():
        connection.putheader(header, value)
    connection.endheaders()
    assert connection.getresponse().status == 413
    connection.close()


def test_a_file_that_does_not_say_how_large_it_is_is_cut(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(receiving, "BYTES", 100_000)
    before = client.get("/api/uploads")
    chunks = (bytes(1000) for _ in range(200))
    answer = client.ask("/api/uploads", {"name": "a.log"}, "POST", chunks, BINARY)
    assert answer.status == 413 and client.get("/api/uploads") == before


def test_a_third_at_once_is_asked_to_come_again(client: Client, simulated: Path) -> None:
    half = []
    for _ in range(2):  # sends the first bytes, and holds the rest back
        connection = HTTPConnection("127.0.0.1", client.port, timeout=30)
        connection.putrequest("POST", "/api/uploads?name=slow.log")
        for header, value in (BINARY | {"Content-Length": "1000"}).items():
            connection.putheader(header, value)
        connection.endheaders(b"#")
        half.append(connection)
    for _ in range(200):
        if sum(one["state"] == "receiving" for one in client.get("/api/uploads")["uploads"]) == 2:
            break
        time.sleep(0.02)
    answer = client.send(simulated)
    assert answer.status == 429 and answer.headers["retry-after"]
    for connection in half:
        connection.close()
    for _ in range(200):
        if not any(one["state"] == "receiving" for one in client.get("/api/uploads")["uploads"]):
            break
        time.sleep(0.02)
    assert client.send(simulated).status == 201


@pytest.mark.parametrize("path", sorted(FOUND.glob("*/*")), ids=lambda path: f"{path.parent.name}-{path.name}")
def test_what_fuzzing_found_is_read_or_refused(
    client: Client, simulated_index: Path, tmp_path: Path, path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    kind, content = path.parent.name, path.read_bytes()
    with unchanged(simulated_index):
        if kind in ENDINGS:
            (tmp_path / "found").write_bytes(content)
            answer = client.send(tmp_path / "found", f"found{ENDINGS[kind]}")
            assert answer.status == 201 and settled(client, answer.json())["state"] in ("ready", "failed")
        elif kind in IMAGES:
            image = f"found.{IMAGES[kind]}"
            (tmp_path / "found.yaml").write_text(HEADER.format(image=image))
            upload = client.send(tmp_path / "found.yaml").json()
            assert (
                client.ask(f"/api/uploads/{upload['id']}/{image}", None, "PUT", content, BINARY).status == 201
            )
            assert settled(client, upload)["state"] in ("ready", "failed")
        else:
            query = {
                "query": "drive/000040",
                "where" if kind == "filter" else "query": content.decode("latin-1"),
            }
            answer = client.ask("/api/search", query)
            assert answer.status in (200, 400, 404), answer.body
    said = capfd.readouterr()
    assert "Traceback" not in said.out + said.err


def test_nothing_is_left_of_an_upload_that_is_removed(client: Client, simulated: Path) -> None:
    upload = client.send(simulated).json()
    settled(client, upload)
    assert client.ask(f"/api/uploads/{upload['id']}", method="DELETE").status == 204
    assert client.ask(f"/api/uploads/{upload['id']}").status == 404
    assert client.ask("/api/search", {"query": f"upload:{upload['id']}/000000"}).status == 404


def test_an_index_is_only_written_where_the_server_may(
    client: Client, simulated: Path, simulated_index: Path
) -> None:
    upload = client.send(simulated).json()
    settled(client, upload)
    with unchanged(simulated_index):
        assert client.ask(f"/api/uploads/{upload['id']}/index", None, "POST", b"", BINARY).status == 403


def test_an_upload_is_added_and_shows_up(tmp_path: Path, simulated: Path) -> None:
    """Also where there was no index yet; a name is what it is, not markup."""
    name = "<img src=x onerror=alert(1)>"
    with served(tmp_path / "new", write=True) as client:
        nothing = client.get("/api/info")
        assert nothing["maps"] == 0 and "m2t-text index" in nothing["error"]
        assert client.ask("/api/places").status == 404
        upload = client.send(simulated, f"{name}.log").json()
        assert settled(client, upload)["state"] == "ready"
        assert client.ask(f"/api/uploads/{upload['id']}/index", None, "POST", b"", BINARY).status == 202
        assert settled(client, upload)["added"] == "added"
        info = client.get("/api/info")
        assert [dataset["name"] for dataset in info["datasets"]] == [name] and info["maps"] > 20
        inspected = client.get(f"/api/maps/{quote(name)}/000000")
        assert inspected["dataset"] == name
        assert len(contents(MapIndex.open(tmp_path / "new"))) == info["maps"]


def test_a_server_that_ends_leaves_no_files(
    simulated_index: Path, simulated: Path, tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with served(simulated_index) as client:
        settled(client, client.send(simulated).json())
        assert list(tmp_path.glob("m2t-text-uploads-*/*/drive.log"))
    assert not list(tmp_path.glob("m2t-text-*"))
