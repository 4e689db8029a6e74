"""What the page must hold, measured in one run: ``make web-bench``.

It needs Chromium, Playwright and the logs of the Radish repository. WEB_BENCH=pictures,click picks parts;
WEB_SECONDS=60 is how long many clients ask at once.
"""

import contextlib
import io
import json
import os
import sys
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path
from typing import Any

import numpy as np
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "helpers")]

from browser import browser, missing, wait  # noqa: E402
from serving import Client, served  # noqa: E402

from m2t_text.cli import run  # noqa: E402
from m2t_text.description.document import Document  # noqa: E402
from m2t_text.index.map_index import MapIndex  # noqa: E402
from m2t_text.index.writing.folder import holds_index  # noqa: E402
from m2t_text.sources.indexing import IndexRequest, index_sources  # noqa: E402

LOGS = ROOT.parent / "shared" / "data" / "radish"
KEPT = ROOT / "indexes" / "bench"
SIZES = (13_600, 100_000)
CLIENTS = 32
WIDTH, HEIGHT = 1440, 900
PAN = """async (steps) => {
  const { building } = window.m2t, frame = () => new Promise(requestAnimationFrame);
  building.fit(); await frame(); building.frameTimes.length = 0;
  for (let k = 0; k < steps; k++) {
    if (k % 3) building.pan(Math.sin(k) * 40, Math.cos(k) * 30);
    else building.zoom(k < steps / 2 ? 1.06 : 1 / 1.06, 300 + k, 200);
    await frame();
  }
  return building.frameTimes;
}"""
PICK = """(count) => {
  const { building } = window.m2t, times = [];
  for (let k = 0; k < count; k++) {
    const begin = performance.now();
    building.pick((k * 37) % building.surface.width, (k * 53) % building.surface.height);
    times.push(performance.now() - begin);
  }
  return times;
}"""

Rows = list[tuple[str, str, str]]


def radish() -> MapIndex:
    """An index of the five logs, made once."""
    path = KEPT / "web-radish"
    if not holds_index(path):
        index_sources(IndexRequest(sorted(LOGS.glob("*.log.gz")), path, jobs=2))
    return MapIndex.open(path)


def one_log() -> MapIndex:
    path = KEPT / "web-fr079"
    if not holds_index(path):
        index_sources(IndexRequest([LOGS / "freiburg-079-corrected.log.gz"], path, jobs=2))
    return MapIndex.open(path)


def many(maps: int) -> MapIndex:
    """The five logs again and again, each time as other datasets, until there are so many maps."""
    path = KEPT / f"web-{maps}"
    if holds_index(path):
        return MapIndex.open(path)
    base = radish()
    index = MapIndex.create(path, base.parameters)
    with index.writer() as writer:
        left, again = maps, 0
        while left:
            for dataset in base.datasets():
                name = f"{dataset.name}-{again:02d}"
                documents = list(_renamed(base, dataset.name, name))[:left]
                if documents:
                    writer.replace(name, documents, (dataset.scans, dataset.travel))
                left -= len(documents)
            again += 1
    return index


def _renamed(base: MapIndex, dataset: str, name: str) -> Iterator[Document]:
    return (replace(document, dataset=name) for document in base.documents(dataset))


def pictures(chrome: Any) -> Rows:
    rows: Rows = []
    for maps in SIZES:
        with served(many(maps).path) as client:
            page = opened(chrome, client)  # once before, as the server has nothing at hand then
            cold = first_picture(page)
            page.close()
            times = []
            for _ in range(3):
                page = opened(chrome, client)
                times.append(first_picture(page))
                if len(times) < 3:
                    page.close()
            rows.append(
                (
                    f"first picture, {maps:,} maps",
                    f"{np.median(times):.0f} ms (the first time {cold:.0f} ms)",
                    "",
                )
            )
            if maps == SIZES[-1]:
                wait(page, "m2t.building.frames.every((frame) => frame.walls)", 300)
                frames, picks = page.evaluate(PAN, 240), page.evaluate(PICK, 400)
                rows.append(
                    (f"pan and zoom, {maps:,} maps, p95 a frame", f"{np.percentile(frames, 95):.1f} ms", "")
                )
                rows.append((f"picking among {maps:,} maps, p95", f"{np.percentile(picks, 95):.2f} ms", ""))
            page.close()
    return rows


def opened(chrome: Any, client: Client, address: str = "") -> Any:
    page = chrome.new_page(viewport={"width": WIDTH, "height": HEIGHT})
    page.goto(client.opened.address + address)
    return page


def first_picture(page: Any) -> float:
    wait(page, "performance.getEntriesByName('first picture').length > 0")
    return float(page.evaluate("performance.getEntriesByName('first picture')[0].startTime"))


def click(chrome: Any) -> Rows:
    index = one_log()
    with served(index.path) as client:
        page = opened(chrome, client)
        first_picture(page)
        times = []
        for number in np.linspace(200, len(index) - 200, 21).astype(int).tolist():
            times.append(page.evaluate(
                """async (number) => {
                  const { building } = window.m2t, begin = performance.now();
                  const drawn = () => performance.getEntriesByName("hits drawn");
                  performance.clearMarks("hits drawn");
                  building.picked(number, -1, false);
                  while (!drawn().length) await new Promise(requestAnimationFrame);
                  return drawn()[0].startTime - begin;
                }""",
                number,
            ))  # fmt: skip
        warm = times[1:]
        shown = f"{np.median(warm):.0f} ms, p95 {np.percentile(warm, 95):.0f} ms"
        return [(f"click to aligned hits, {len(index):,} maps, warm", shown, "")]


def drop(chrome: Any) -> Rows:
    """The log of freiburg-101, of 292 scans, in an index of freiburg-079 and in one that holds its place."""
    rows: Rows = []
    log = LOGS / "freiburg-101-corrected.log.gz"
    for name, index in (("4,688 maps", one_log()), ("6,708 maps", radish())):
        with served(index.path) as client:
            client.get("/api/search", query=f"{index.datasets()[0].name}@5")  # loads compiled code
            page = opened(chrome, client)
            first_picture(page)
            begin = time.perf_counter()
            page.set_input_files("#file", str(log))
            wait(page, "m2t.replay.places.length > 0")
            first = time.perf_counter() - begin
            wait(page, "m2t.replay.known && m2t.replay.places.length === m2t.replay.known", 300)
            places = page.evaluate("m2t.replay.known")
            rate = (places - 1) / (time.perf_counter() - begin - first)
            rows.append((f"a dropped log of 292 scans, {name}: first verdict", f"{first:.2f} s", ""))
            rows.append((f"its replay, {name}", f"{rate:.1f} places a second", f"{places} places"))
            page.close()
    return rows


def agreement(chrome: Any) -> Rows:
    index = radish()
    ids = index.ids
    chosen = [ids[k] for k in np.linspace(0, len(ids) - 1, 100).astype(int).tolist()]
    with served(index.path) as client:
        page = opened(chrome, client)
        first_picture(page)
        agreed = 0
        for map_id in chosen:
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                run(["search", map_id, "--index", str(index.path), "--exclude-travel", "10", "--json"])
            told = json.loads(out.getvalue())
            asked = client.get("/api/search", query=map_id, exclude_travel=10)
            page.evaluate(
                "(id) => { m2t.answer = null; location.hash = new URLSearchParams({ q: id }); }", map_id
            )
            shown = wait(page, "m2t.answer")
            answers = [{name: one[name] for name in told if name != "seconds"} for one in (told, asked, shown)]
            agreed += answers[0] == answers[1] == answers[2]
    return [("page, API and --json agree", f"{agreed} of {len(chosen)} queries", "")]


def crowd(chrome: Any) -> Rows:
    index, seconds = one_log(), float(os.environ.get("WEB_SECONDS", "60"))
    ids = index.ids
    with served(index.path) as client:
        client.get("/api/search", query=ids[0])
        times: list[float] = []
        errors: list[str] = []
        end = time.monotonic() + seconds

        def asking(number: int) -> None:
            rng = np.random.default_rng(number)
            while time.monotonic() < end:
                begin = time.perf_counter()
                query = ids[int(rng.integers(len(ids)))]
                try:
                    answer = client.ask("/api/search", {"query": query, "exclude_travel": 10})
                    if answer.status != 200 or answer.json()["query"]["map_id"] != query:
                        errors.append(str(answer.status))
                except Exception as error:  # noqa: BLE001
                    errors.append(repr(error))
                times.append(time.perf_counter() - begin)

        threads = [threading.Thread(target=asking, args=(number,)) for number in range(CLIENTS)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    p50, p95 = np.percentile(times, [50, 95])
    shown = f"{len(errors)} errors in {len(times):,} searches"
    return [
        (f"{CLIENTS} clients at once for {seconds:.0f} s", shown, ", ".join(sorted(set(errors))[:3])),
        ("a search then", f"p50 {p50:.2f} s, p95 {p95:.2f} s", f"{len(times) / seconds:.1f} a second"),
    ]


def weight(chrome: Any) -> Rows:
    assets = ROOT / "m2t_text" / "web" / "assets"
    size = sum(file.stat().st_size for file in assets.iterdir())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    plain = closure(project["dependencies"])
    more = sorted(closure(project["optional-dependencies"]["web"]) - plain)
    return [
        ("assets, uncompressed", f"{size / 1000:.1f} kB", f"{len(list(assets.iterdir()))} files"),
        ("packages that the extra adds", str(len(more)), ", ".join(more)),
    ]


def closure(lines: list[str]) -> set[str]:
    """The names of all packages that these requirements bring along."""
    found: set[str] = set()
    left = [Requirement(line) for line in lines]
    while left:
        one = left.pop()
        name = one.name.lower().replace("_", "-")
        if name in found or (one.marker is not None and not one.marker.evaluate({"extra": ""})):
            continue
        found.add(name)
        with contextlib.suppress(PackageNotFoundError):
            left += [Requirement(line) for line in requires(name) or []]
    return found


PARTS: dict[str, Callable[[Any], Rows]] = {
    "weight": weight,
    "pictures": pictures,
    "click": click,
    "drop": drop,
    "agreement": agreement,
    "crowd": crowd,
}


def main() -> int:
    reason = missing() or (None if LOGS.is_dir() else f"the logs are not in {LOGS}")
    if reason:
        print(f"cannot measure the page: {reason}", file=sys.stderr)
        return 2
    KEPT.mkdir(parents=True, exist_ok=True)
    wanted = os.environ.get("WEB_BENCH", ",".join(PARTS)).split(",")
    with browser() as chrome:
        for name in wanted:
            for what, value, more in PARTS[name](chrome):
                print(f"{what:62} {value:42} {more}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
