"""Measures what a search among shards takes of the processor, against one index: `make cluster-bench`.

MAPS=13600 picks how many maps, which `make bench` has made or this makes; four shards are made of them, kept in
indexes/bench and used again. With Ray all of its processes count, and the one that asks; without it that row is
left out. Queries are those of `make bench`; the scores of all answers must be those of one index. All are asked
in turns, ROUNDS times, as the machine is quicker at one time than at another.
"""

import os
import sys
from collections.abc import Callable
from contextlib import ExitStack
from copy import copy
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

from apart import apart
from bench import FOLDER, TOP, base_indexes
from databases import database, queries

from m2t_text.cluster.cluster_index import ClusterIndex
from m2t_text.cluster.remote import holds_shards
from m2t_text.cluster.store import Store
from m2t_text.cluster.writing import sharded_writer
from m2t_text.description.text import Text
from m2t_text.index.map_index import MapIndex
from m2t_text.index.searchable import Searchable

SHARDS, QUERIES = 4, 60
ENOUGH = 8  # searches before those that are measured: all servers have tiles then
ROUNDS = 3
Seconds = Callable[[], float]


def main() -> None:
    base_indexes()
    maps = int(os.environ.get("MAPS", "100000"))
    for profile in ("default", "paper"):
        base = MapIndex.open(FOLDER / f"logs-{profile}")
        one, texts = database(base, maps, FOLDER), queries(base, ENOUGH + ROUNDS * QUERIES)
        shards = sharded(one)
        compared: dict[str, tuple[Searchable, Seconds]] = {
            "one index": (one.pinned(), nothing),
            "one process": (apart(shards, SHARDS).pinned(), nothing),
            "two servers": (apart(shards, 2).pinned(), nothing),
            "four servers": (apart(shards, 1).pinned(), nothing),
        }
        with ExitStack() as stack:
            if find_spec("ray"):
                compared["Ray"] = served(shards, stack)
            took, scores = measured(compared, texts)
        print(f"{profile}, {maps:,} maps, the mean of {ROUNDS} times {QUERIES} searches")
        for title, ms in took.items():
            assert scores[title] == scores["one index"], f"{title}: not the scores of one index"
            print(f"  {title}: {ms:.1f} ms of the processor, {ms / took['one index']:.2f} times", flush=True)


def sharded(one: MapIndex) -> ClusterIndex:
    """The maps of an index in as many datasets as shards, which take turns."""
    folder = one.path.with_name(f"{one.path.name}-shards")
    if not holds_shards(folder):
        with sharded_writer(Store(folder), one.parameters, SHARDS) as writer:
            for shard in range(SHARDS):
                name = f"visits-{shard}"
                maps = (document for n, document in enumerate(one.documents()) if n % SHARDS == shard)
                writer.replace(name, (replace(document, dataset=name) for document in maps))
    return ClusterIndex.open(folder)


def measured(
    compared: dict[str, tuple[Searchable, Seconds]], texts: list[Text]
) -> tuple[dict[str, float], dict[str, list[list[float]]]]:
    """Milliseconds of the processor a search takes, in this process and in others; and all scores."""
    took: dict[str, float] = dict.fromkeys(compared, 0.0)
    scores: dict[str, list[list[float]]] = {title: [] for title in compared}
    for number in range(ROUNDS + 1):
        asked = texts[ENOUGH + number - 1 :: ROUNDS] if number else texts[:ENOUGH]
        for title, (index, others) in compared.items():
            begin = process_time() + others()
            for text in asked:  # copied, as the tables of the query that was asked for last are kept
                hits = index.search(copy(text), TOP, texts=True)
                scores[title].append([hit.score for hit in hits])
            if number:
                took[title] += (process_time() + others() - begin) / (ROUNDS * QUERIES) * 1e3
    return took, scores


def nothing() -> float:
    """What other processes take where there are none."""
    return 0.0


def served(shards: ClusterIndex, stack: ExitStack) -> tuple[Searchable, Seconds]:
    """The same shards, served by one host until the end of the stack; and what its processes have taken."""
    from clusters import free_port, own_state, processes, wait_for

    from m2t_text.cluster import running
    from m2t_text.cluster.ray_carrier import cluster_index

    stack.enter_context(own_state(Path(stack.enter_context(TemporaryDirectory()))))
    head = running.start(shards.path, replicas=1, port=free_port())
    wait_for(head.address, lambda status: status.served is not None)
    index = stack.enter_context(cluster_index(head.address))
    return index.pinned(), lambda: seconds(processes(head.pid))


def seconds(pids: list[int]) -> float:
    """Of the processor that processes have taken."""
    ticks = 0
    for pid in pids:
        try:
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main()
