"""Measures search, indexing, verification and start-up on this machine, in one run: `make bench`.

Prints a table, writes bench.json, and with --plot a picture of latency against database size. Databases are
kept in indexes/bench and used again. BENCH_SIZES chooses their sizes. Engines other than this project's are
left out where they would take minutes a query, unless BENCH_SLOW=1.
"""

import argparse
import json
import os
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np
from databases import database, queries
from engines import ENGINES
from whoosh.index import open_dir
from whoosh.query import Term, Wildcard

from m2t_text.index.map_index import MapIndex
from m2t_text.logs import read_log
from m2t_text.mapping.local_map import local_maps
from m2t_text.mapping.trajectory import survey
from m2t_text.pipeline import describe
from m2t_text.recognition.finding import VERIFIED, verify_hits
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
INDEXED = "freiburg-079-corrected"  # the log that is timed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plot", type=Path, help="draw latency against database size")
    arguments = parser.parse_args()
    if not LOGS.is_dir():
        sys.exit(f"bench: there are no logs in {LOGS}")
    sizes = [int(size) for size in os.environ.get("BENCH_SIZES", "").split(",") if size] or SIZES
    slow = os.environ.get("BENCH_SLOW") == "1"
    indexed = index_logs()
    result: dict[str, Any] = {"search": [], "search_default": [], "terms": []}
    bandwidth = bytes_per_second()
    for maps in sizes:
        database(MapIndex.open(FOLDER / "logs-paper"), maps, FOLDER)
        database(MapIndex.open(FOLDER / "logs-default"), maps, FOLDER)
        for engine in ENGINES:
            if slow or maps <= LIMITS[engine]:
                result["search"].append(alone(engine, "paper", maps, bandwidth))
        result["search_default"].append(alone("m2t", "default", maps, bandwidth))
        result["terms"].append(terms(maps))
    result |= {"index": indexed, "verify_ms": verify_ms(), "describe_ms": describe_ms()}
    result |= {"cold_search_seconds": cold_search_seconds(), "first_search_seconds": first_search_seconds()}
    result["bytes_per_second"] = bandwidth
    (ROOT / "bench.json").write_text(json.dumps(result, indent=2) + "\n")
    print_tables(result)
    if arguments.plot:
        draw(result, arguments.plot)


def index_logs() -> dict[str, Any]:
    """The logs as indexes of both profiles, and the time that one log took, everything included."""
    sources = sorted(LOGS.glob("*.log.gz"))
    timed = next(source for source in sources if source.name.startswith(INDEXED))
    index_sources(IndexRequest([timed], FOLDER / "timed", jobs=cores(None)))  # loads the compiled code
    begin = perf_counter()
    index_sources(IndexRequest([timed], FOLDER / "timed", jobs=cores(None)))
    seconds = perf_counter() - begin
    info = MapIndex.open(FOLDER / "timed").info()
    for profile in ("paper", "default"):
        if not (FOLDER / f"logs-{profile}").is_dir():
            index_sources(IndexRequest(sources, FOLDER / f"logs-{profile}", profile, cores(None)))
    return {
        "dataset": INDEXED,
        "maps": info.maps,
        "seconds": seconds,
        "maps_per_second": info.maps / seconds,
        "bytes_per_keypoint": info.bytes / info.keypoints,
    }


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
    searched.search(texts[0])
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


def resident_mb() -> float:
    """Memory of this process that no file backs, in megabytes."""
    status = Path("/proc/self/status")
    if not status.exists():
        return float("nan")
    lines = dict(line.split(":", 1) for line in status.read_text().splitlines())
    return int(lines["RssAnon"].split()[0]) / 1e3


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
