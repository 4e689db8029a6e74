"""Measures search, indexing, verification and start-up on this machine, in one run: `make bench`.

Prints a table, writes bench.json, and with --plot a picture of latency against database size. Databases are
kept in indexes/bench and used again. BENCH_SIZES chooses their sizes. Engines other than this project's are
left out where they would take minutes a query, unless BENCH_SLOW=1. BENCH_PARTS=search,find picks parts.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np
from databases import database, mirrored, other_visits, queries
from engines import ENGINES, TOP
from whoosh.index import open_dir
from whoosh.query import Term, Wildcard

from m2t_text.index.map_index import MapIndex
from m2t_text.logs import read_log
from m2t_text.mapping.local_map import local_maps
from m2t_text.mapping.trajectory import survey
from m2t_text.pipeline import describe
from m2t_text.recognition.finding import VERIFIED, find, verify_hits
from m2t_text.recognition.queries import Query
from m2t_text.sources.indexing import IndexRequest, index_sources
from m2t_text.util.workers import cores

ROOT = Path(__file__).parents[2]
LOGS = ROOT.parent / "shared" / "data" / "radish"
FOLDER = ROOT / "indexes" / "bench"
SIZES = (1_000, 13_600, 100_000)
QUERIES = {"m2t": 100, "numpy": 10, "tantivy": 10, "whoosh-or": 5, "literal": 2}
LIMITS = {
    "m2t": 10**9,
    "numpy": 20_000,
    "tantivy": 20_000,
    "whoosh-or": 1_000,
    "literal": 1_000,
}  # or BENCH_SLOW
TERMS = ("term", "term_again", "wildcard", "lexicon")  # that the full-text field is asked for
PARTS = ("search", "terms", "find", "batch", "writer", "index", "start")
BATCH, WRITTEN = 200, 100_000  # queries of a batch, and maps that are written to measure memory
ENOUGH = 3  # searches before those that are timed: from then on tiles are there
INDEXED = "freiburg-079-corrected"  # the log that is timed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plot", type=Path, help="draw latency against database size")
    arguments = parser.parse_args()
    if not LOGS.is_dir():
        sys.exit(f"bench: there are no logs in {LOGS}")
    sizes = [int(size) for size in os.environ.get("BENCH_SIZES", "").split(",") if size] or SIZES
    parts = os.environ.get("BENCH_PARTS", ",".join(PARTS)).split(",")
    base_indexes()
    result: dict[str, Any] = {"search": [], "search_default": [], "other_visits": [], "terms": [], "batch": []}
    result["bytes_per_second"] = bytes_per_second()
    for maps in sizes:
        measure_size(maps, parts, result)
    if "find" in parts:
        result["find"] = in_own_process(measure_find)
    if "writer" in parts:
        result["writer"] = in_own_process(measure_writer)
    if "index" in parts:
        result |= {"index": index_log(), "verify_ms": verify_ms(), "describe_ms": describe_ms()}
    if "start" in parts:
        result |= {
            "cold_search_seconds": cold_search_seconds(),
            "first_search_seconds": first_search_seconds(),
        }
    (ROOT / "bench.json").write_text(json.dumps(result, indent=2) + "\n")
    print_tables(result)
    if arguments.plot:
        draw(result, arguments.plot)


def measure_size(maps: int, parts: list[str], result: dict[str, Any]) -> None:
    """Adds what is measured on databases of so many maps to the result."""
    slow, bandwidth = os.environ.get("BENCH_SLOW") == "1", result["bytes_per_second"]
    database(MapIndex.open(FOLDER / "logs-default"), maps, FOLDER)
    if "search" in parts:
        database(MapIndex.open(FOLDER / "logs-paper"), maps, FOLDER)
        for engine in ENGINES:
            if slow or maps <= LIMITS[engine]:
                result["search"].append(alone(engine, "paper", maps, bandwidth))
        result["search_default"].append(alone("m2t", "default", maps, bandwidth))
        result["other_visits"].append(in_own_process(measure_other_visits, maps))
    if "terms" in parts:
        result["terms"].append(terms(maps))
    if "batch" in parts:
        result["batch"].append(in_own_process(measure_batch, maps))


def base_indexes() -> None:
    """Makes the indexes of the logs, of both profiles, unless they are there."""
    for profile in ("paper", "default"):
        if not (FOLDER / f"logs-{profile}").is_dir():
            sources = sorted(LOGS.glob("*.log.gz"))
            index_sources(IndexRequest(sources, FOLDER / f"logs-{profile}", profile, cores(None)))


def index_log() -> dict[str, Any]:
    """The time that one log takes from its file to its maps in an index."""
    timed = next(source for source in LOGS.glob("*.log.gz") if source.name.startswith(INDEXED))
    index_sources(IndexRequest([timed], FOLDER / "timed", jobs=cores(None)))  # loads the compiled code
    begin = perf_counter()
    index_sources(IndexRequest([timed], FOLDER / "timed", jobs=cores(None)))
    seconds = perf_counter() - begin
    info = MapIndex.open(FOLDER / "timed").info()
    return {
        "dataset": INDEXED,
        "maps": info.maps,
        "seconds": seconds,
        "maps_per_second": info.maps / seconds,
        "bytes_per_keypoint": info.bytes / info.keypoints,
    }


def in_own_process(work: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        found = pool.submit(work, *arguments).result()
    print(work.__name__, found, file=sys.stderr)
    return found


def alone(engine: str, profile: str, maps: int, bandwidth: float) -> dict[str, Any]:
    """One row of the table, measured in a process of its own."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        row = pool.submit(measure, engine, profile, maps).result()
    row["floor_ms"] = row.pop("bytes") / bandwidth * 1e3
    print(f"{profile:8}{engine:10}{maps:9,} maps{row['p50_ms']:12,.1f} ms", file=sys.stderr)
    return row


def measure(engine: str, profile: str, maps: int) -> dict[str, Any]:
    """Latency of one search after the other, and memory beyond the page cache."""
    base = MapIndex.open(FOLDER / f"logs-{profile}")
    texts = queries(base, QUERIES[engine])
    index = MapIndex.open(FOLDER / f"{profile}-{maps}")
    before = resident_mb()
    searched = ENGINES[engine](index)
    for text in texts[:ENOUGH]:
        searched.search(text)
    memory = resident_mb() - before
    times = []
    for text in texts:
        begin = perf_counter()
        searched.search(text)
        times.append(perf_counter() - begin)
    info = index.info()
    return {
        "maps": maps,
        "keypoints": info.keypoints,
        "engine": engine,
        "p50_ms": float(np.percentile(times, 50)) * 1e3,
        "p95_ms": float(np.percentile(times, 95)) * 1e3,
        "queries_per_second": len(times) / sum(times),
        "resident_mb": memory,
        "bytes": 2.3 * info.keypoints,  # cells and runs of all maps
    }


def measure_other_visits(maps: int) -> dict[str, Any]:
    """Latency of the profile `default` where the query's place was seen only on other visits."""
    base, index = MapIndex.open(FOLDER / "logs-default"), MapIndex.open(FOLDER / f"default-{maps}")
    times, last = [], []
    for number, (text, allowed) in enumerate(other_visits(base, QUERIES["m2t"] + ENOUGH, maps)):
        begin = perf_counter()
        with index._reading() as snapshot:
            assert [len(segment.live) for segment in snapshot.segments] == [maps]
            scores = snapshot.ranking(text, index.model(), TOP, [allowed]).best()[1]
        if number >= ENOUGH:
            times.append(perf_counter() - begin)
            last.append(scores.score.min())
    return {"maps": maps, **percentiles(times), "last_score": float(np.median(last))}


def measure_find() -> dict[str, Any]:
    """The whole answer, with verification and verdict, at places of other visits: maps as logs give them."""
    index = mirrored(MapIndex.open(FOLDER / "logs-default"), FOLDER)
    ids = [map_id for map_id in index.ids if "mirrored" not in map_id]
    chosen = [ids[int(place)] for place in np.linspace(0, len(ids) - 1, QUERIES["m2t"] + ENOUGH)]
    asked = [Query.of(index.document(map_id)) for map_id in chosen]
    times, searching = [], []
    for query in asked:
        begin = perf_counter()
        found = find(index, query, exclude=query.excluding(10.0))
        times.append(perf_counter() - begin)
        searching.append(found.search_seconds)
    search_ms = float(np.median(searching[ENOUGH:])) * 1e3
    return {"maps": len(index), **percentiles(times[ENOUGH:]), "search_p50_ms": search_ms}


def measure_batch(maps: int) -> dict[str, Any]:
    """Queries a second of a batch, and one by one, both with the profile `default`."""
    base, index = MapIndex.open(FOLDER / "logs-default"), MapIndex.open(FOLDER / f"default-{maps}")
    texts = queries(base, BATCH + ENOUGH)
    for text in texts[:ENOUGH]:
        index.search(text, TOP)
    begin = perf_counter()
    single = [[hit.map_id for hit in index.search(text, TOP)] for text in texts[ENOUGH:]]
    middle = perf_counter()
    many = [[hit.map_id for hit in hits] for hits in index.search_many(texts[ENOUGH:], TOP)]
    end = perf_counter()
    assert many == single
    count = len(single)
    return {
        "maps": maps,
        "queries": count,
        "one_by_one_per_second": count / (middle - begin),
        "batch_per_second": count / (end - middle),
    }


def measure_writer() -> dict[str, Any]:
    """Memory and time to write one large segment: maps of the logs again and again, taken one by one."""
    base = MapIndex.open(FOLDER / "logs-default")
    some = [document for document, _ in zip(base.documents(), range(300), strict=False)]
    before, begin = resident_mb("VmHWM"), perf_counter()
    with TemporaryDirectory(dir=FOLDER) as folder:
        index = MapIndex.create(Path(folder) / "index", base.parameters)
        documents = (
            replace(some[k % len(some)], dataset="written", first_scan=k, last_scan=k) for k in range(WRITTEN)
        )
        index.replace("written", documents)
    seconds = perf_counter() - begin
    return {"maps": WRITTEN, "seconds": seconds, "before_mb": before, "peak_mb": resident_mb("VmHWM")}


def percentiles(times: list[float]) -> dict[str, float]:
    return {f"p{share}_ms": float(np.percentile(times, share)) * 1e3 for share in (50, 95)}


def terms(maps: int) -> dict[str, Any]:
    """What Whoosh's own classes take for the full-text field, by plain Whoosh, each in a process of its own."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        took = {f"{name}_ms": pool.submit(term_ms, name, maps).result() for name in TERMS}
    return {"maps": maps, **took}


def term_ms(asked: str, maps: int) -> float:
    """The median of several tokens for ``term``, each the first of its x, else of one cold question."""
    folder = FOLDER / f"default-{maps}"
    document = MapIndex.open(folder).document("visits/000007")
    tokens = {token.split("_")[0]: token for token in str(document.text).split()}
    searcher = open_dir(folder).searcher()
    times = []
    for token in list(tokens.values())[:9] if asked.startswith("term") else [""]:
        for _ in range(2 if asked == "term_again" else 1):
            begin = perf_counter()
            if asked == "lexicon":
                sum(1 for _ in searcher.reader().lexicon("text"))
            elif asked == "wildcard":
                len(searcher.search(Wildcard("text", "x12_*_a5")))
            else:
                searcher.search(Term("text", token))
            took = perf_counter() - begin
        times.append(took * 1e3)
    return float(np.median(times))


def resident_mb(what: str = "RssAnon") -> float:
    """Memory of this process that no file backs, in megabytes; VmHWM is the most of all memory so far."""
    status = Path("/proc/self/status")
    if not status.exists():
        return float("nan")
    lines = dict(line.split(":", 1) for line in status.read_text().splitlines())
    return int(lines[what].split()[0]) / 1e3


def bytes_per_second() -> float:
    """How fast all cores read memory together."""
    parts = np.ones((cores(None), 1 << 24))
    begin = perf_counter()
    with ThreadPoolExecutor(len(parts)) as pool:
        for _ in range(4):
            list(pool.map(np.sum, parts))
    return 4 * parts.nbytes / (perf_counter() - begin)


def verify_ms() -> float:
    """To align the best hits of a search with the query, median."""
    index = MapIndex.open(FOLDER / "logs-default")
    times = []
    for text in queries(index, 40):
        hits = index.search(text, VERIFIED)
        begin = perf_counter()
        verify_hits(index, Query(text), hits)
        times.append(perf_counter() - begin)
    return float(np.median(times)) * 1e3


def describe_ms() -> float:
    """To describe one local map, median."""
    parameters = MapIndex.open(FOLDER / "logs-default").parameters
    log = read_log(LOGS / "freiburg-101-corrected.log.gz")
    times = []
    for local_map in local_maps(survey(log, parameters.mapping), parameters.mapping):
        begin = perf_counter()
        describe(local_map, log.name, parameters)
        times.append(perf_counter() - begin)
    return float(np.median(times)) * 1e3


def cold_search_seconds() -> float:
    """Of the command line in a new process, the best of three."""
    index = FOLDER / "logs-default"
    map_id = MapIndex.open(index).ids[1000]
    command = [sys.executable, "-m", "m2t_text", "search", map_id, "--index", str(index)]
    times = []
    for _ in range(3):
        begin = perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        times.append(perf_counter() - begin)
    return min(times)


def first_search_seconds() -> float:
    """Of the command line where nothing was ever compiled."""
    index = FOLDER / "logs-default"
    command = [
        sys.executable,
        "-m",
        "m2t_text",
        "search",
        MapIndex.open(index).ids[1000],
        "--index",
        str(index),
    ]
    with TemporaryDirectory() as nothing:
        begin = perf_counter()
        subprocess.run(command, check=True, capture_output=True, env={**os.environ, "NUMBA_CACHE_DIR": nothing})
        return perf_counter() - begin


def print_tables(result: dict[str, Any]) -> None:
    print("| maps | engine | p50, ms | p95, ms | a second | memory, MB | floor, ms |")
    print("| ---: | --- | ---: | ---: | ---: | ---: | ---: |")
    rows = [(row, row["engine"]) for row in result["search"]]
    rows += [(row, "m2t, profile default") for row in result["search_default"]]
    for row, engine in rows:
        numbers = (row["p50_ms"], row["p95_ms"], row["queries_per_second"], row["resident_mb"], row["floor_ms"])
        print(f"| {row['maps']:,} | {engine} | " + " | ".join(f"{number:,.1f}" for number in numbers) + " |")
    for row in result["other_visits"]:
        print(
            f"| {row['maps']:,} | m2t, profile default, other visits (tenth best {row['last_score']:.2f}) | "
            f"{row['p50_ms']:,.1f} | {row['p95_ms']:,.1f} | | | |"
        )
    for row in result["batch"]:
        single, many = row["one_by_one_per_second"], row["batch_per_second"]
        print(
            f"\nbatch of {row['queries']} among {row['maps']:,} maps: {many:.1f} queries a second, "
            f"{single:.1f} one by one, {many / single:.2f} times"
        )
    for name in ("find", "writer"):
        if name in result:
            print(f"\n{name}: {result[name]}")
    print("\n| maps | a Term, ms | the same again | Wildcard x12_*_a5 | the whole lexicon |")
    print("| ---: | ---: | ---: | ---: | ---: |")
    for row in result["terms"]:
        print(f"| {row['maps']:,} | " + " | ".join(f"{row[f'{name}_ms']:,.1f}" for name in TERMS) + " |")
    for name in ("search", "search_default"):
        for one, other in pairwise(row for row in result[name] if row["engine"] == "m2t"):
            ratio = other["p50_ms"] / one["p50_ms"]
            print(f"\n{name}: {other['maps'] / one['maps']:.1f} times the maps take {ratio:.1f} times as long")
    for row in result["search"]:
        if row["engine"] != "m2t":
            mine = next(m for m in result["search"] if m["engine"] == "m2t" and m["maps"] == row["maps"])
            print(
                f"{row['maps']:,} maps: {row['p50_ms'] / mine['p50_ms']:,.0f} times as fast as {row['engine']}"
            )
    for name in ("index", "verify_ms", "describe_ms", "cold_search_seconds", "first_search_seconds"):
        if name in result:
            print(f"{name}: {result[name]}")


def draw(result: dict[str, Any], path: Path) -> None:
    from matplotlib.figure import Figure

    axes = (figure := Figure(figsize=(6, 4), layout="constrained")).subplots()
    for engine in ENGINES:
        rows = [row for row in result["search"] if row["engine"] == engine]
        axes.plot([r["maps"] for r in rows], [r["p50_ms"] for r in rows], "o-", label=engine)
    rows = result["search_default"]
    axes.plot([r["maps"] for r in rows], [r["p50_ms"] for r in rows], "s--", label="m2t, profile default")
    rows = [row for row in result["search"] if row["engine"] == "m2t"]
    axes.plot(
        [r["maps"] for r in rows], [r["floor_ms"] for r in rows], ":", c="0.5", label="reading all keypoints"
    )
    axes.set(xscale="log", yscale="log", xlabel="maps in the index", ylabel="a search, median, ms")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small", loc="lower right")
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main()
