"""Several hosts on this machine, as network namespaces on one bridge: `CLUSTER_HOSTS=1 make cluster-test`.

Root alone may make them. Prints how long an exact answer takes after a server is killed in the middle of a
search, and after a link is cut; and what becomes of logs that three hosts describe, one of which is killed.
LOGS=100 is how many, QUERIES=500 how many answers are compared with those of one index.
"""

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from time import monotonic, perf_counter, sleep

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

import numpy as np
from clusters import kill, processes
from map_oracle import random_documents, random_text

from m2t_text.cluster import running
from m2t_text.cluster.cluster_index import ClusterIndex
from m2t_text.cluster.connection import TOKEN_FILE
from m2t_text.cluster.indexing import index_on_cluster
from m2t_text.cluster.ray_carrier import cluster_index, cluster_status
from m2t_text.cluster.store import Store
from m2t_text.cluster.writing import sharded_writer
from m2t_text.config import PROFILES
from m2t_text.index.map_index import MapIndex
from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen
from m2t_text.sources.indexing import IndexRequest

TAG = f"m2t{os.getpid() % 10_000}"
NET = os.environ.get("M2T_NET") or f"10.{64 + os.getpid() % 64}.7"
HOSTS = 4  # that of the head, two more that serve, and one that asks
HEAD = f"{NET}.1:6399"
LOGS, QUERIES = int(os.environ.get("LOGS", "100")), int(os.environ.get("QUERIES", "500"))


def ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True)


def make_network(blocks: ExitStack) -> None:
    """A bridge, and hosts on it, each with its own loopback."""
    ip("link", "add", TAG, "type", "bridge")
    blocks.callback(ip, "link", "del", TAG)
    ip("link", "set", TAG, "up")
    for k in range(1, HOSTS + 1):
        name = f"{TAG}h{k}"
        ip("netns", "add", name)
        blocks.callback(ip, "netns", "del", name)
        ip("link", "add", f"{TAG}v{k}", "type", "veth", "peer", "name", "eth0", "netns", name)
        ip("link", "set", f"{TAG}v{k}", "master", TAG, "up")
        ip("-n", name, "addr", "add", f"{NET}.{k}/24", "dev", "eth0")
        ip("-n", name, "link", "set", "lo", "up")
        ip("-n", name, "link", "set", "eth0", "up")


def on(host: int, *arguments: str) -> subprocess.CompletedProcess[str]:
    """What a command line of this file, or of the program, does on a host."""
    return subprocess.run(
        ["ip", "netns", "exec", f"{TAG}h{host}", sys.executable, *arguments],
        check=False, capture_output=True, text=True, env=os.environ | {"M2T_NET": NET},
    )  # fmt: skip


def said(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def shown(hits) -> list[tuple]:
    return [(one.map_id, one.score, one.matched, one.alignment.tolist()) for one in hits]


def datasets() -> dict:
    return {f"d{k}": random_documents(k, f"d{k}", 60) for k in range(12)}


def compare(root: str) -> None:
    """Answers equal to those of one index, of every kind, and of a profile each."""
    one = MapIndex.open(Path(root) / "one")
    rng, equal, seconds = np.random.default_rng(3), 0, []
    with cluster_index(HEAD) as index:
        for number in range(QUERIES):
            options = {
                "top": (10, 1, 40)[number % 3],
                "exclude": None if number % 4 else (f"d{number % 9}", 9.0, 5.0),
                "filter": (None, "travel:[2 TO 15]", None, "NOT dataset:d5", "x1_y2_a0~4")[number % 5],
                "method": "bow" if number % 7 == 0 else "m2t",
            }
            text = random_text(rng, int(rng.integers(5, 60)))
            begin = perf_counter()
            hits = index.search(text, **options)
            seconds.append(perf_counter() - begin)
            equal += shown(hits) == shown(one.search(text, **options))
    print(f"{equal} of {QUERIES} answers equal to one index; p50 {np.median(seconds) * 1e3:.0f} ms")
    assert equal == QUERIES


def fault(root: str, command: str, kind: str) -> None:
    """How long answers take while something is broken by a shell command, in the middle of searches."""
    one, text = MapIndex.open(Path(root) / "one"), random_text(np.random.default_rng(1), 40)
    expected = shown(one.search(text, 10))
    with cluster_index(HEAD) as index:
        for _ in range(3):
            assert shown(index.search(text, 10)) == expected
        slowest, broken, end = 0.0, threading.Event(), monotonic() + 25.0

        def breaking() -> None:
            sleep(0.5)
            subprocess.run(["sh", "-c", command], check=True)
            broken.set()

        threading.Thread(target=breaking).start()
        count = 0
        while monotonic() < end:
            begin = monotonic()
            assert shown(index.search(text, 10)) == expected
            if broken.is_set() or monotonic() - begin > 0.5:
                slowest, count = max(slowest, monotonic() - begin), count + 1
    print(f"{kind}: {count} exact answers after it, the slowest after {slowest:.1f} s")


def start(folder: str) -> None:
    print(running.start(Path(folder), 2, f"{NET}.1", cpus=1).pid)


def join(kind: str) -> None:
    print(running.join(HEAD, cpus=1, serves=kind == "serve").pid)


def nodes() -> None:
    """Prints how many hosts serve, once each shard is served by two."""
    status = cluster_status(HEAD)
    full = status.served and all(len(names) == 2 for names in status.served.table.values())
    print(len(status.nodes) if full else 0)


def main() -> None:
    if sys.argv[1:]:  # on one of the hosts
        work = {one.__name__: one for one in (start, join, nodes, compare, fault, describe)}
        work[sys.argv[1]](*sys.argv[2:])
        return
    if os.getuid() != 0 or subprocess.run(["ip", "netns"], check=False).returncode:
        print("hosts: network namespaces cannot be made here; this is skipped")
        return
    with ExitStack() as blocks:
        folder = Path(blocks.enter_context(tempfile.TemporaryDirectory(prefix="m2t-hosts-")))
        os.environ[TOKEN_FILE], os.environ["XDG_STATE_HOME"] = str(folder / "token"), str(folder / "state")
        make_network(blocks)
        blocks.callback(lambda: [running.stop(one) for one in running.all_started()])
        measure(folder)


def measure(folder: Path) -> None:
    me, data = str(Path(__file__)), datasets()
    one = MapIndex.create(folder / "one", PROFILES["default"])
    with one.writer() as writer, sharded_writer(Store(folder / "many"), PROFILES["default"], 4) as shards:
        for name, documents in data.items():
            writer.replace(name, documents)
            shards.replace(name, documents)
    said(on(1, me, "start", str(folder / "many")))
    others = {k: json.loads(said(on(k, me, "join", "serve"))) for k in (2, 3)}
    said(on(4, me, "join", "ask"))
    wait_for_nodes(me, 3)
    print(said(on(4, me, "compare", str(folder))), end="")
    servers = " ".join(str(pid) for pid in processes(others[2], "ray::Server"))
    print(said(on(4, me, "fault", str(folder), f"kill -9 {servers}", "server killed")), end="")
    wait_for_nodes(me, 3)
    cut = f"nsenter --net=/proc/{os.getpid()}/ns/net ip link set {TAG}v2 down"
    print(said(on(4, me, "fault", str(folder), cut, "link cut")), end="")
    ip("link", "set", f"{TAG}v2", "up")
    wait_for_nodes(me, 3)
    print("the host whose link was cut serves again")
    logs = folder / "logs"
    logs.mkdir()
    for seed in range(LOGS):
        write_carmen(
            simulate(Simulation(seed=seed, length=24.0, travel=9.0, step=0.3)), logs / f"log{seed}.log"
        )
    print(said(on(1, me, "describe", str(folder), str(others[3]))), end="")


def wait_for_nodes(me: str, count: int) -> None:
    end = monotonic() + 150
    while True:
        done = on(4, me, "nodes")
        if done.returncode == 0 and int(done.stdout or 0) == count:
            return
        assert monotonic() < end, done.stdout + done.stderr
        sleep(1.0)


def describe(root: str, victim: str) -> None:
    """Logs described by all hosts, one of which is killed once a third of them is done."""
    folder, killed = Path(root), list[int]()
    logs = sorted((folder / "logs").glob("*.log"))

    def tell(what: str, stage: str, done: int, of: int) -> None:
        if stage == "describing" and done >= of // 3 and not killed:
            killed.extend(processes(int(victim)))
            kill(killed)

    begin = monotonic()
    report = index_on_cluster(IndexRequest(logs, folder / "described"), 3, HEAD, tell)
    seconds = monotonic() - begin
    index = ClusterIndex.open(folder / "described")
    lost, maps = 0, Counter()
    for shard in index.manifest.shards:
        maps.update(Store(folder / "described").opened(shard).ids)
    from m2t_text.logs import read_log
    from m2t_text.pipeline import describe_log

    for log in logs:
        for document in describe_log(read_log(log), PROFILES["default"]):
            found = index.find_document(document.map_id)
            lost += found is None or str(found.text) != str(document.text)
            maps[document.map_id] -= 1
    doubled = sum(count > 0 for count in maps.values())
    print(
        f"{len(report.indexed)} logs, {len(index)} maps over 3 hosts in {seconds:.0f} s, one host "
        f"({len(killed)} processes) killed meanwhile: {lost} maps lost, {doubled} doubled"
    )
    assert not lost and not doubled and not report.failed and killed


if __name__ == "__main__":
    main()
