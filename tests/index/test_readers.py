"""One writer and many readers, as threads and as processes: every answer is that of one committed state."""

import logging
import os
import signal
import sys
import time
from itertools import islice
from pathlib import Path
from threading import Event, Thread

import children
import pytest
import readers
from states import built, changes, contents, expected, maps

from m2t_text.errors import MapIndexError
from m2t_text.index import map_index
from m2t_text.index.map_index import MapIndex
from m2t_text.index.writing import lock

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="watches processes as Linux shows them")


@pytest.fixture(scope="module")
def cycle(tmp_path_factory: pytest.TempPathFactory) -> readers.Cycle:
    return readers.Cycle.of(tmp_path_factory.mktemp("cycle"), seed=3, length=4)


def test_readers_see_one_committed_state_each(tmp_path: Path, cycle: readers.Cycle) -> None:
    counts = readers.read_while_written(tmp_path, cycle, 400, processes=2)
    assert counts["searches"] == 400 and counts["wrong"] == 0 and counts["commits"] > 0


def test_a_long_run_takes_no_more_than_a_short_one(tmp_path: Path, cycle: readers.Cycle) -> None:
    counts = readers.run_long(tmp_path, cycle, 240, early=80, every=20)
    assert counts["wrong"] == 0
    assert counts["bytes after 240"] < 1.05 * counts["bytes after 80"]
    assert counts["files after 240"] == counts["files after 80"]
    assert counts["mappings after 240"] <= counts["mappings after 80"] + 3


def test_a_pinned_index_keeps_its_state_while_others_commit_and_merge(tmp_path: Path) -> None:
    index, views = built(tmp_path / "index", {}), []
    for change in islice(changes(7, {}), 10):
        change.apply(index)
        views.append((index.pinned(), change.after, index.search(readers.QUERIES[0])))
    for view, state, hits in views:
        assert contents(view.pinned()) == contents(view) == expected(state)
        assert [hit.score for hit in view.search(readers.QUERIES[0])] == [hit.score for hit in hits]


def test_a_second_writer_says_that_it_waits_for_the_first(tmp_path: Path) -> None:
    index, begun, waits = built(tmp_path / "index", {"a": 3}), Event(), Event()

    def hold() -> None:
        with index.writer() as writer:
            begun.set()
            waits.wait()
            writer.replace("b", maps(4, "b"))

    said = logging.Handler()
    said.emit = lambda record: waits.set() if "waiting up to" in record.msg else None  # type: ignore[method-assign]
    lock.log.addHandler(said)
    first = Thread(target=hold)
    first.start()
    begun.wait()
    MapIndex.open(index.path).replace("c", maps(5, "c"))
    first.join()
    lock.log.removeHandler(said)
    assert waits.is_set() and contents(index) == expected({"a": 3, "b": 4, "c": 5})


def test_a_writer_that_died_blocks_nobody(tmp_path: Path) -> None:
    index = built(tmp_path / "index", {"a": 3})

    def die() -> None:
        with MapIndex.open(index.path).writer() as writer:
            writer.remove("a")
            os.kill(os.getpid(), signal.SIGKILL)

    assert children.status(children.start(die)) == -signal.SIGKILL
    begin = time.monotonic()
    index.replace("b", maps(4, "b"))
    assert time.monotonic() - begin < map_index.LOCK_SECONDS / 2
    assert contents(index) == expected({"a": 3, "b": 4})


def test_a_second_writer_gives_up_in_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(map_index, "LOCK_SECONDS", 0.2)
    index = built(tmp_path / "index", {"a": 3})
    with index.writer():
        begin = time.monotonic()
        with pytest.raises(MapIndexError, match="is being written by another process; try again later"):
            MapIndex.open(index.path).replace("b", maps(4, "b"))
        assert 0.2 <= time.monotonic() - begin < 5
    assert contents(index) == expected({"a": 3})
