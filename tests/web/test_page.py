"""The page in a real browser: what is seen, clicked, typed and dropped. Skipped where there is no browser."""

import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import browser, missing, wait
from PIL import Image
from serving import Client, served

from m2t_text.index.map_index import MapIndex
from m2t_text.logs import read_log
from m2t_text.saved_maps.occupancy_mapping import build_map
from m2t_text.saved_maps.writing import write_map
from m2t_text.sources.indexing import IndexRequest, index_sources

ROOT = Path(__file__).parents[2]
AXE = ROOT / "node_modules" / "axe-core" / "axe.min.js"
MARKUP = "<img src=x onerror=alert(1)>"
READY = "window.m2t && m2t.building && m2t.building.pictured"
WALLS = "m2t.building.frames.length && m2t.building.frames.every((frame) => frame.walls)"
ANSWERED = "m2t.answer && performance.getEntriesByName('hits drawn').length"

pytestmark = [pytest.mark.page, pytest.mark.skipif(missing() is not None, reason=missing() or "")]
Open = Callable[..., Any]


@pytest.fixture(scope="module")
def chrome() -> Iterator[Any]:
    with browser() as chrome:
        yield chrome


@pytest.fixture(scope="module")
def client(simulated_index: Path) -> Iterator[Client]:
    with served(simulated_index) as client:
        yield client


@pytest.fixture
def open_page(chrome: Any, client: Client) -> Iterator[Open]:
    """Opens the page; whatever goes wrong in it, and whatever it asks of another host, fails the test."""
    wrong: list[str] = []
    contexts = []

    def open_page(
        address: str = "", server: Client = client, width: int = 1440, height: int = 900, scheme: str = "light"
    ) -> Any:
        context = chrome.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on(
            "console",
            lambda m: wrong.append(m.text) if m.type == "error" and "Failed to load" not in m.text else None,
        )
        page.on("dialog", lambda dialog: wrong.append(dialog.message))
        page.on(
            "request", lambda r: wrong.append(r.url) if not r.url.startswith(server.opened.address) else None
        )
        page.goto(server.opened.address + address)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert not wrong


def pixels(page: Any, selector: str) -> np.ndarray:
    """(H, W, 3) what an element looks like."""
    image = Image.open(BytesIO(page.locator(selector).screenshot()))
    return np.asarray(image.convert("RGB")).astype(int)


def of_colour(page: Any, selector: str, name: str) -> int:
    """How many pixels of an element have a colour of the style sheet."""
    value = page.evaluate(f"getComputedStyle(document.documentElement).getPropertyValue('--{name}').trim()")
    wanted = [int(value[k : k + 2], 16) for k in (1, 3, 5)]
    return int((np.abs(pixels(page, selector) - wanted).sum(axis=2) < 12).sum())


def screen(page: Any, map_id: str) -> tuple[float, float]:
    """Where a place of the building is on the page."""
    dataset, _, scan = map_id.rpartition("/")
    x, y = page.evaluate(
        """([name, scan]) => {
          const { building } = m2t, k = building.placeNumber(name, scan);
          return building.toScreen(building.wx[k], building.wy[k]);
        }""",
        [dataset, int(scan)],
    )
    box = page.locator("#building").bounding_box()
    return box["x"] + x, box["y"] + y


def test_the_building_is_drawn(open_page: Open) -> None:
    page = open_page()
    wait(page, READY)
    wait(page, WALLS)
    page.wait_for_timeout(100)
    assert of_colour(page, "#building", "wall") > 500
    assert of_colour(page, "#building", "place") > 100
    assert of_colour(page, "#building", "floor") > 2000
    assert "maps of" in page.inner_text("#building-note")


def test_a_click_shows_aligned_hits_and_every_view_has_an_address(open_page: Open, client: Client) -> None:
    page = open_page()
    wait(page, READY)
    wait(page, WALLS)  # the building is fitted to them
    page.mouse.click(*screen(page, "drive/000040"))
    wait(page, ANSWERED)
    query = page.evaluate("m2t.answer.query.map_id")
    dataset, _, scan = query.rpartition("/")
    assert dataset == "drive" and abs(int(scan) - 40) < 12  # places lie close together
    told = client.get("/api/search", query=query, exclude_travel=10)
    assert page.locator(".hit h3").all_inner_texts() == [one["map_id"] for one in told["results"][:3]]
    assert told["verdict"] in page.inner_text("#verdict")
    assert of_colour(page, "#hits", "shared") > 200
    assert f"m2t-text search {query} --index" in page.inner_text("#same-command")
    again = open_page(page.url.partition("/#")[2] and "#" + page.url.partition("#")[2])
    wait(again, ANSWERED)
    assert again.evaluate("m2t.answer.query.map_id") == query
    page.go_back()
    wait(page, "!m2t.answer")
    assert page.locator(".hit").count() == 0


def test_a_token_and_its_keypoint_are_one(open_page: Open) -> None:
    page = open_page("#q=drive/000040")
    wait(page, ANSWERED)
    token = page.locator("#tokens span[data-k='5']")
    token.hover()
    assert page.evaluate("m2t.query.view.lit") == 5
    assert token.inner_text() in page.inner_text("#token-note")
    x, y = page.evaluate("m2t.query.view.project(...m2t.query.view.layers[0].points[200])")
    box = page.locator("#query-canvas").bounding_box()
    page.mouse.move(box["x"] + x, box["y"] + y)
    lit = page.evaluate("m2t.query.lit")
    assert page.locator("#tokens .lit").get_attribute("data-k") == str(lit)
    near = page.evaluate("(k) => m2t.query.view.layers[0].points[k]", lit)
    assert np.hypot(*np.subtract(near, page.evaluate("m2t.query.view.layers[0].points[200]"))) < 0.15


def test_a_typed_token_shows_all_places_that_have_it(
    open_page: Open, client: Client, simulated_index: Path
) -> None:
    token = str(MapIndex.open(simulated_index).document("drive/000040").text).split()[30]
    page = open_page()
    wait(page, READY)
    page.fill("#query", token)
    page.keyboard.press("Enter")
    wait(page, "m2t.building.matching")
    found = client.get("/api/matching", where=f"{token}~")
    assert page.evaluate("m2t.building.matching") == found["places"]
    assert of_colour(page, "#building", "find") > 20
    page.fill("#query", f"{token} AND first_scan:[38 TO 42]")
    page.keyboard.press("Enter")
    wait(page, f"m2t.building.matching.length < {found['total']}")
    page.locator(".try .link").first.click()
    wait(page, ANSWERED)
    assert page.locator("#tokens .found").count() >= 1
    page.fill("#query", "NOT NOT")
    page.keyboard.press("Enter")
    wait(page, "document.getElementById('query-note').textContent.includes('is not a query')")


def test_it_works_by_keyboard_alone(open_page: Open) -> None:
    page = open_page()
    wait(page, READY)
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    page.focus("#building")
    before = page.evaluate("m2t.building.view.scale")
    page.keyboard.press("+")
    assert page.evaluate("m2t.building.view.scale") > before
    page.keyboard.press("]")
    page.keyboard.press("]")
    assert re.search(r"drive/\d{6}", page.inner_text("#live"))
    page.keyboard.press("Enter")
    wait(page, ANSWERED)
    page.keyboard.press("/")
    page.keyboard.type("x")
    assert page.evaluate("document.activeElement.id") == "query"
    page.focus("#tokens")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("m2t.query.lit") == 0


def test_maps_are_compared(open_page: Open) -> None:
    page = open_page("#q=drive/000040")
    wait(page, ANSWERED)
    page.locator(".hit").first.get_by_text("Compare").click()
    wait(page, "m2t.compare.view && m2t.compare.view.layers.length === 2")
    assert page.is_visible("#compare") and "keypoints have the same word" in page.inner_text("#compare-note")
    assert of_colour(page, "#compare-canvas", "shared") > 300
    page.fill("#compare-b", "nothing/000001")
    page.keyboard.press("Enter")
    wait(page, "document.getElementById('compare-note').textContent.includes('no map')")


def test_a_drive_that_is_dropped_is_recognised(open_page: Open, simulated: Path) -> None:
    page = open_page()
    wait(page, READY)
    page.set_input_files("#file", {"name": "again.log", "mimeType": "", "buffer": simulated.read_bytes()})
    wait(page, "m2t.replay.known && m2t.replay.places.length === m2t.replay.known")
    verdicts = page.evaluate("m2t.replay.places.map((place) => place.answer.verdict)")
    assert verdicts.count("match") > len(verdicts) / 2
    page.select_option("#speed", "1000")
    wait(page, "m2t.replay.at === m2t.replay.known - 1")
    assert of_colour(page, "#track", "match") > 500
    assert not page.is_visible("#add")  # the server only reads
    page.focus("#track")
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    wait(page, "location.hash.includes('at=1')")
    wait(page, ANSWERED)
    assert page.evaluate("m2t.answer.query.map_id").startswith("again/")
    assert "again.log#" in page.inner_text("#same-command")
    page.click("#replay-close")
    assert not page.is_visible("#replay")


def test_what_cannot_be_read_is_said(open_page: Open) -> None:
    page = open_page()
    wait(page, READY)
    page.set_input_files("#file", {"name": "broken.log", "mimeType": "", "buffer": b"nothing\n"})
    wait(page, "document.getElementById('replay-note').getAttribute('role') === 'alert'")
    assert "broken.log" in page.inner_text("#replay-note")
    page.set_input_files("#file", {"name": "virus.exe", "mimeType": "", "buffer": b"MZ"})
    wait(page, "document.getElementById('replay-note').textContent.includes('of no kind')")


def test_an_indexed_drive_is_replayed_and_its_loops_are_drawn(open_page: Open) -> None:
    page = open_page("#drive=drive")
    wait(page, "m2t.replay.known && m2t.replay.places.length === m2t.replay.known")
    page.select_option("#speed", "1000")
    page.evaluate("m2t.replay.go(1e9)")
    places = page.evaluate("m2t.replay.places.map((place) => place.answer.verdict)")
    assert len(page.evaluate("m2t.building.marks.trail")) == len(places)
    assert len(page.evaluate("m2t.building.marks.arcs")) == places.count("match")


def test_names_are_text(open_page: Open, simulated_index: Path, tmp_path: Path) -> None:
    source, index = (
        MapIndex.open(simulated_index),
        MapIndex.create(tmp_path / "index", MapIndex.open(simulated_index).parameters),
    )
    index.replace(MARKUP, [replace(one, dataset=MARKUP) for one in source.documents()], (242, 40.0))
    with served(index.path) as client:
        page = open_page(f"#q={MARKUP}/000040&where=dataset:'{MARKUP}'", client)
        wait(page, READY)
        page.evaluate(
            """([a, b]) => { location.hash = new URLSearchParams({ q: a, a, b }); }""",
            [f"{MARKUP}/000040", f"{MARKUP}/000050"],
        )
        wait(page, ANSWERED)
        page.click("#datasets summary")
        page.wait_for_timeout(300)
        assert page.locator("img").count() == 0
        assert MARKUP in page.inner_text("#datasets-list") and MARKUP in page.inner_text("#hits")
        assert MARKUP in page.inner_text("#query-note") and MARKUP in page.inner_text("#same-command")


def test_a_new_commit_shows_up_by_itself_also_the_first(
    open_page: Open, simulated_index: Path, tmp_path: Path
) -> None:
    path = tmp_path / "new"
    with served(path) as client:
        page = open_page("", client)
        wait(page, "m2t.info")
        assert "There is no index here yet" in page.inner_text("#empty")
        assert f"m2t-text index robot.log --index {path}" in page.inner_text("#empty")
        shutil.copytree(simulated_index, path)
        wait(page, READY, 15)
        maps = page.evaluate("m2t.info.maps")
        assert maps > 0 and not page.is_visible("#empty")
        index = MapIndex.open(path)
        index.replace("more", [replace(one, dataset="more") for one in index.documents("drive")], (1, 1.0))
        wait(page, f"m2t.info.maps === {2 * maps} && m2t.building.places.maps === {2 * maps}", 15)


def test_a_lost_server_is_said_and_found_again(open_page: Open, simulated_index: Path) -> None:
    with served(simulated_index) as client:
        page = open_page("", client)
        wait(page, READY)
        port = client.port
    wait(page, "!document.getElementById('banner').hidden", 15)
    assert "does not answer" in page.inner_text("#banner")
    with served(simulated_index, port=port):
        wait(page, "document.getElementById('banner').hidden", 15)


@pytest.mark.parametrize("width", [360, 800, 1440])
def test_it_fits_any_screen(open_page: Open, width: int) -> None:
    page = open_page("#q=drive/000040&a=drive/000040&b=drive/000050&drive=drive", width=width, height=740)
    wait(page, ANSWERED)
    wait(page, "m2t.replay.places.length > 3")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    for selector in ("#building", "#query-canvas", "#hits canvas >> nth=0", "#ask button", "#play"):
        box = page.locator(selector).bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= width and box["width"] > 30


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(
    "address",
    ["", "#q=drive/000040&a=drive/000040&b=drive/000050", "#drive=drive", "#where=x1_y2_a3", "#q=nothing"],
)
def test_axe_finds_nothing_serious(open_page: Open, address: str, scheme: str) -> None:
    if not AXE.exists():
        pytest.skip("axe-core is not there: npm install --no-save axe-core")
    page = open_page(address, scheme=scheme)
    wait(page, READY)
    page.wait_for_timeout(1200)
    page.evaluate(AXE.read_text(encoding="utf-8"))
    found = page.evaluate("axe.run()")["violations"]
    serious = [one for one in found if one["impact"] in ("serious", "critical")]
    assert not [(one["id"], [node["html"] for node in one["nodes"]][:3]) for one in serious]


def test_a_click_into_the_image_of_a_saved_map_finds_the_robot(
    open_page: Open, simulated: Path, tmp_path: Path
) -> None:
    """The pose is that of the place that was clicked, with how far it may be off."""
    log = read_log(simulated)
    assert log.ground_truth is not None
    write_map(build_map(log, log.ground_truth, np.arange(len(log.scans))), tmp_path / "floor.yaml")
    index_sources(IndexRequest([tmp_path / "floor.yaml"], tmp_path / "index"))
    with served(tmp_path / "index", maps=[tmp_path / "floor.yaml"]) as server:
        page = open_page(server=server)
        wait(page, READY)
        wait(page, WALLS)
        page.wait_for_timeout(100)
        assert of_colour(page, "#building", "floor") > 5000
        robot = log.ground_truth[60]
        x, y = page.evaluate(
            "([x, y]) => m2t.building.toScreen(x + m2t.building.frames[0].x, y + m2t.building.frames[0].y)",
            robot[:2].tolist(),
        )
        box = page.locator("#building").bounding_box()
        page.mouse.click(box["x"] + x, box["y"] + y)
        wait(page, ANSWERED)
        told = re.search(
            r"pose in floor: (-?[\d.]+) (-?[\d.]+) m, .* ± ([\d.]+), ([\d.]+) m", page.inner_text("#verdict")
        )
        assert told is not None
        found = np.array([float(number) for number in told.groups()])
        assert np.hypot(*(found[:2] - robot[:2])) < 1.5 and (found[2:] < 0.2).all()
