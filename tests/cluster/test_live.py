"""A live cluster of two nodes on this host: exact answers, whatever is killed, or an error; never less.

`make cluster-test` runs these. Without Ray they are skipped.
"""

import json
import os
import signal
import subprocess
import threading
from dataclasses import replace
from pathlib import Path
from time import monotonic, sleep

import pytest
from calling import PROGRAM
from clusters import free_port, kill, listening, own_state, processes, wait_for
from map_oracle import random_documents, random_text

pytest.importorskip("ray", reason="Ray is not installed")

import numpy as np

from m2t_text.cluster import ray_carrier, running
from m2t_text.cluster.cluster_index import ClusterIndex
from m2t_text.cluster.connection import TOKEN_FILE
from m2t_text.cluster.indexing import index_on_cluster
from m2t_text.cluster.ray_carrier import cluster_index
from m2t_text.cluster.store import Store
from m2t_text.cluster.writing import sharded_writer
from m2t_text.config import PROFILES
from m2t_text.errors import ClusterError, QueryError
from m2t_text.index.map_index import MapIndex
from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen
from m2t_text.sources.indexing import IndexRequest, index_sources

pytestmark = [pytest.mark.cluster, pytest.mark.filterwarnings("ignore")]
DATASETS = {f"d{k}": random_documents(k, f"d{k}", 40) for k in range(9)}


def shown(hits) -> list[tuple]:
    return [(one.map_id, one.score, one.matched, one.alignment.tolist()) for one in hits]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("live")


@pytest.fixture(scope="module")
def one(folder) -> MapIndex:
    index = MapIndex.create(folder / "one", PROFILES["default"])
    with index.writer() as writer:
        for name, documents in DATASETS.items():
            writer.replace(name, documents)
    return index


@pytest.fixture(scope="module")
def cluster(folder, one):
    """A head and another node, each shard on both of them."""
    with sharded_writer(Store(folder / "shards"), PROFILES["default"], 3) as writer:
        for name, documents in DATASETS.items():
            writer.replace(name, documents)
    with own_state(folder):
        head = running.start(folder / "shards", replicas=2, port=free_port(), cpus=1)
        running.join(head.address, cpus=1)
        wait_for(head.address, whole)
        yield head


def whole(status) -> bool:
    """Whether two nodes serve, and each shard is open on both."""
    hosts = {name.rpartition("-")[0] for name in status.servers}
    return (
        len(status.nodes) == len(hosts) == 2
        and status.served is not None
        and all(len(names) == 2 for names in status.served.table.values())
        and all(name in status.servers for names in status.served.table.values() for name in names)
    )


def joined() -> running.Started:
    return next(one for one in running.all_started() if not one.folder)


def queries(count: int):
    rng = np.random.default_rng(5)
    return [random_text(rng, int(rng.integers(5, 60))) for _ in range(count)]


def test_answers_are_those_of_one_index(cluster, one):
    with cluster_index(cluster.address) as index:
        assert len(index) == len(one) and index.datasets() == one.datasets()
        for number, text in enumerate(queries(40)):
            options = {
                "top": (0, 1, 10, 40)[number % 4],
                "exclude": None if number % 3 else (f"d{number % 9}", 9.0, 5.0),
                "filter": (None, "travel:[2 TO 15]", "NOT dataset:d5")[number % 3],
                "method": "bow" if number % 5 == 0 else "m2t",
            }
            assert shown(index.search(text, **options)) == shown(one.search(text, **options))
        with pytest.raises(QueryError, match="no map"):
            index.document("d0/999999")


def test_a_server_that_is_killed_in_the_middle_of_a_search(cluster, one):
    (text,) = queries(1)
    expected = shown(one.search(text, 10))
    with cluster_index(cluster.address) as index:
        for root in (cluster.pid, joined().pid, cluster.pid):
            killer = threading.Timer(0.005, lambda root=root: kill(processes(root, "ray::Server")))
            killer.start()
            begin = monotonic()
            for _ in range(20):
                assert shown(index.search(text, 10)) == expected
            killer.join()
            assert shown(index.search(text, 10)) == expected and monotonic() - begin < 10.0
            wait_for(cluster.address, whole)
    for root in (cluster.pid, joined().pid):
        end = monotonic() + 60
        while not processes(root, "ray::Server"):  # Ray starts it again
            assert monotonic() < end
            sleep(0.5)


def test_servers_that_hang_are_an_error_or_left_out_where_that_is_allowed(cluster, one, monkeypatch):
    monkeypatch.setattr(ray_carrier, "ANSWERED", 3.0)
    monkeypatch.setattr(ray_carrier, "PARTIAL", 3.0)
    monkeypatch.setattr(ray_carrier, "PATIENCE", 0.5)
    (text,) = queries(1)
    stopped = processes(cluster.pid, "ray::Server") + processes(joined().pid, "ray::Server")
    with cluster_index(cluster.address) as index, cluster_index_again(index, partial=True) as partial:
        assert shown(index.search(text)) == shown(one.search(text))
        kill(stopped[:1], signal.SIGSTOP)
        try:
            assert shown(index.search(text)) == shown(one.search(text))  # the other one answers
            kill(stopped, signal.SIGSTOP)
            with pytest.raises(ClusterError, match="cannot answer for all maps"):
                index.search(text)
            assert partial.search(text) == [] and partial.missing_maps == len(one)
        finally:
            kill(stopped, signal.SIGCONT)
        assert shown(index.search(text)) == shown(one.search(text))


def cluster_index_again(index: ClusterIndex, partial: bool):
    from contextlib import nullcontext

    return nullcontext(ClusterIndex(index._carrier, index.path, partial).pinned())


def test_new_generations_are_served_while_older_searches_go_on(cluster, one):
    (text,) = queries(1)
    store = Store(cluster.folder)
    with cluster_index(cluster.address) as index:
        pinned, before = index.pinned(), shown(one.search(text, 30))
        assert shown(pinned.search(text, 30)) == before
        added = [replace(document, dataset="new") for document in DATASETS["d0"]]
        with sharded_writer(store, PROFILES["default"]) as writer:
            writer.replace("new", added)
        end = monotonic() + 60
        while len(index) == len(one):
            assert shown(index.search(text, 30)) == before  # the whole of one generation, never a mixture
            assert monotonic() < end
        assert len(index) == len(one) + len(added)
        assert {hit.document.dataset for hit in index.search(DATASETS["d0"][3].text, 2)} == {"d0", "new"}
        assert shown(pinned.search(text, 30)) == before
        with sharded_writer(store, PROFILES["default"]) as writer:
            writer.remove("new")
        while len(index) != len(one):
            assert monotonic() < end + 60
            sleep(0.2)
        assert shown(index.search(text, 30)) == before


def test_nobody_else_can_reach_it(cluster, folder, monkeypatch):
    addresses = listening(processes(cluster.pid) + processes(joined().pid))
    assert addresses and addresses <= {"0100007F", "0000000000000000FFFF00000100007F"}
    assert oct((folder / "token").stat().st_mode)[-3:] == "600"
    (folder / "wrong").write_text("0" * 64)
    environment = os.environ | {TOKEN_FILE: str(folder / "wrong")}
    status, _, errors = called("cluster", "status", cluster.address, environment=environment)
    assert status == 2 and "cannot be asked from this host" in errors


def test_the_command_line(cluster, folder, one):
    text = folder / "place.txt"
    text.write_text(str(DATASETS["d3"][7].text))
    answers = []
    for options in (["--index", str(one.path)], ["--cluster", cluster.address]):
        status, output, errors = called("search", str(text), "--json", *options)
        assert (status, errors) == (0, "")
        answers.append(json.loads(output))
    assert answers[0]["results"] == answers[1]["results"] and answers[0]["verdict"] == answers[1]["verdict"]
    assert answers[1]["index"]["maps"] == len(one) and answers[1]["index"]["missing_maps"] == 0
    assert json.loads(called("cluster", "status", "--json", cluster.address)[1])["served"]["maps"] == len(one)
    status, _, errors = called("search", "d0/000001", "--cluster", "127.0.0.1:1")
    assert status == 2 and "no cluster at 127.0.0.1:1" in errors


def called(*arguments: str, environment=None) -> tuple[int, str, str]:
    """What a command of the command line does."""
    done = subprocess.run([*PROGRAM, *arguments], env=environment, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


def test_logs_are_described_once_each_whatever_is_killed(cluster, folder):
    logs = []
    for seed in range(6):
        logs.append(folder / f"log{seed}.log")
        write_carmen(simulate(Simulation(seed=seed, length=24.0, travel=12.0, step=0.3)), logs[-1])
    index_sources(IndexRequest(logs, folder / "whole"))
    told: list[tuple] = []

    def tell(*stage) -> None:
        told.append(stage)
        if stage[1:3] == ("describing", 2):
            kill([pid for pid in processes(joined().pid, "ray::") if pid not in servers])

    servers = processes(joined().pid, "ray::Server")
    request = IndexRequest(logs, folder / "described")
    report = index_on_cluster(request, 2, cluster.address, tell)
    assert [one.name for one in report.indexed] == [log.stem for log in logs] and not report.failed
    assert ("shards", "writing", 2, 2) in told
    made, expected = ClusterIndex.open(folder / "described"), MapIndex.open(folder / "whole")
    assert made.datasets() == expected.datasets()
    for document in expected.documents():
        assert str(made.document(document.map_id).text) == str(document.text)
    assert not (folder / "described" / "parts").exists()


def test_a_node_that_is_killed(cluster, one):
    texts = queries(5)
    expected = [shown(one.search(text, 10)) for text in texts]
    with cluster_index(cluster.address) as index:
        assert shown(index.search(texts[0], 10)) == expected[0]
        gone = joined()
        kill(processes(gone.pid))
        begin = monotonic()
        assert [shown(index.search(text, 10)) for text in texts] == expected
        assert monotonic() - begin < 20.0
        # Without it the head serves both replicas of all shards.
        wait_for(cluster.address, lambda status: len(status.nodes) == 1 and len(status.servers) == 2)
        assert [shown(index.search(text, 10)) for text in texts] == expected
    running.join(cluster.address, cpus=1)
    wait_for(cluster.address, whole)


def test_a_head_that_ends_is_started_again_and_the_others_join_it(cluster, one):
    (text,) = queries(1)
    expected = shown(one.search(text, 10))
    kill(processes(cluster.pid, "gcs_server"))
    end = monotonic() + 120
    answered = 0
    while answered < 3:
        try:
            with cluster_index(cluster.address) as index:
                assert shown(index.search(text, 10)) == expected
            answered += 1
        except ClusterError:  # said, and never less than all
            assert monotonic() < end
            sleep(1.0)
    wait_for(cluster.address, whole, 120)


def test_it_ends_with_all_its_processes(cluster):
    started = running.all_started()
    assert len(started) == 2
    pids = [pid for one in started for pid in processes(one.pid)]
    for one in started:
        running.stop(one)
    assert not running.all_started()
    end = monotonic() + 15.0  # a worker whose node has just ended ends by itself
    while any(running._alive(pid) for pid in pids):
        assert monotonic() < end
        sleep(0.2)
    with pytest.raises(ClusterError, match="no cluster runs on this host that"):
        running.chosen(None)
