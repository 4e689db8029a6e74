"""An index with shards at a URL: written there, and copied to this host where it is opened."""

from dataclasses import replace
from pathlib import Path

import pytest
from map_oracle import random_documents

from m2t_text.cluster.cluster_index import ClusterIndex
from m2t_text.cluster.remote import CACHE, RemoteStore, open_store
from m2t_text.cluster.store import Store
from m2t_text.cluster.writing import sharded_writer
from m2t_text.config import PROFILES
from m2t_text.errors import ClusterError, DamageError
from m2t_text.index.map_index import MapIndex
from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen

pytest.importorskip("fsspec", reason="fsspec is not installed")
DATASETS = {f"d{k}": random_documents(k, f"d{k}", 20) for k in range(4)}


@pytest.fixture(params=["memory", "file"])
def url(request, tmp_path, monkeypatch) -> str:
    """A store that is not this host's, and a folder for copies."""
    monkeypatch.setenv(CACHE, str(tmp_path / "copies"))
    return f"memory://{tmp_path.name}/fleet" if request.param == "memory" else f"file://{tmp_path}/fleet"


def shown(hits) -> list[tuple]:
    return [(one.map_id, one.score) for one in hits]


def test_it_is_written_searched_and_changed_there(url, tmp_path):
    with sharded_writer(open_store(url), PROFILES["default"], 2) as writer:
        for name, documents in DATASETS.items():
            writer.replace(name, documents)
    index = ClusterIndex.open(url)
    assert index.path == url and len(index) == 80 and url in repr(index)
    one = MapIndex.create(tmp_path / "one", PROFILES["default"])
    with one.writer() as writer:
        for name, documents in DATASETS.items():
            writer.replace(name, documents)
    text = DATASETS["d2"][5].text
    pinned, before = index.pinned(), shown(one.search(text))
    assert shown(index.search(text)) == before
    added = [replace(document, dataset="new") for document in DATASETS["d2"]]
    with sharded_writer(open_store(url), PROFILES["default"]) as writer:
        writer.replace("new", added)
    one.replace("new", added)
    assert shown(index.search(text)) == shown(one.search(text)) and shown(pinned.search(text)) == before


def test_copies_are_made_once_and_checked(url, tmp_path):
    with sharded_writer(open_store(url), PROFILES["default"], 2) as writer:
        writer.replace("d1", DATASETS["d1"])
    text = DATASETS["d1"][5].text
    ClusterIndex.open(url).search(text)
    copies = {file: file.stat().st_mtime_ns for file in (tmp_path / "copies").rglob("*.seg")}
    assert copies and ClusterIndex.open(url).search(text)
    assert {file: file.stat().st_mtime_ns for file in (tmp_path / "copies").rglob("*.seg")} == copies
    expected = {file: file.read_bytes() for file in copies}
    for file, data in expected.items():
        file.write_bytes(data[:-1])
    assert ClusterIndex.open(url).search(text)  # copied anew
    assert {file: file.read_bytes() for file in copies} == expected
    store = open_store(url)
    for shard in store.manifest().shards:
        for name in shard.files:
            store._files.pipe_file(f"{store._root}/{shard.folder}/{name}", b"something else")
    for file in copies:
        file.unlink()
    with pytest.raises(DamageError, match="is not the shard that its manifest names"):
        ClusterIndex.open(url).search(text)


def test_two_hosts_that_write_at_once_are_told(url):
    with sharded_writer(open_store(url), PROFILES["default"], 1) as writer:
        writer.replace("d0", DATASETS["d0"])
    with (
        pytest.raises(ClusterError, match="was written to by another host meanwhile"),
        sharded_writer(open_store(url), PROFILES["default"]) as writer,
    ):
        writer.replace("d1", DATASETS["d1"])
        manifest = open_store(url).manifest()
        open_store(url)._put(f"manifest-{manifest.generation + 1:08d}.json", manifest.to_bytes())


def test_what_is_a_url_and_what_a_path(tmp_path):
    assert type(open_store(tmp_path / "fleet")) is Store and type(open_store("a:b/c")) is Store
    store = open_store(Path(f"file://{tmp_path}/fleet"))  # a path has lost a slash
    assert isinstance(store, RemoteStore) and store.path == f"file://{tmp_path}/fleet"
    with pytest.raises(ClusterError, match="no sharded index in file://"):
        ClusterIndex.open(f"file://{tmp_path}/nothing")
    with pytest.raises(ClusterError, match="cannot be opened"):
        open_store("nonsense://bucket/fleet")


def test_the_command_line_takes_urls(tmp_path, call, monkeypatch):
    monkeypatch.setenv(CACHE, str(tmp_path / "copies"))
    log, where = tmp_path / "drive.log", f"file://{tmp_path}/fleet"
    write_carmen(simulate(Simulation(seed=3, length=24.0, travel=9.0)), log)
    for arguments in (
        ["index", log, "--index", where, "--shards", "2", "--jobs", "1"],
        ["search", "drive/000000", "--index", where, "--json"],
        ["info", "--index", where],
    ):
        status, output, errors = call(*arguments)
        assert status == 0, errors
    assert where in output
