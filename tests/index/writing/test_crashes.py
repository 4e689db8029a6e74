"""Whatever stops a writer, an index holds what was last committed, and the next writer cleans up."""

import errno
import os
import sys
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

import crashes
import pytest
from crashes import BEFORE, CHANGE, MERGE, WHOLE
from states import Change, built, changes, contents, copied, expected, litter

from m2t_text.index.map_index import MapIndex
from m2t_text.index.writing.folder import holds_index

STRIDE = 7  # of the steps of a commit; `make stress` takes all of them

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="watches processes as Linux shows them")


@pytest.fixture
def index(tmp_path: Path) -> MapIndex:
    return built(tmp_path / "index", BEFORE)


def test_killed_at_random_moments(tmp_path: Path) -> None:
    counts = crashes.survive_kills(tmp_path, 6, seed=1)
    assert counts["survived"] == 6 and counts["interrupted"] > 0


@pytest.mark.parametrize("change", WHOLE.values(), ids=WHOLE)
def test_killed_at_steps(index: MapIndex, tmp_path: Path, change: Change) -> None:
    steps = crashes.steps_of(copied(index, tmp_path / "counted").path, change)
    seen = [crashes.killed_at(index, tmp_path / "killed", change, step) for step in range(0, steps, STRIDE)]
    assert steps > 20 and seen == sorted(seen)  # one step makes the change, and no later one unmakes it


def test_killed_while_an_index_is_made(tmp_path: Path) -> None:
    first, path, step = next(changes(5, {})), tmp_path / "new" / "index", 0
    while crashes.killed_before(path, first, step):
        step += 3
        held = contents(crashes.opened(path)) if holds_index(path) else {}
        assert held in ({}, expected(first.after))
    assert step > 9 and contents(MapIndex.open(path)) == expected(first.after)


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EIO], ids=["full", "broken"])
def test_a_disk_that_refuses_steps(index: MapIndex, tmp_path: Path, code: int) -> None:
    steps = crashes.steps_of(copied(index, tmp_path / "counted").path, CHANGE)
    told = [
        crashes.refused_at(index, tmp_path / "full", CHANGE, step, code) for step in range(0, steps, STRIDE)
    ]
    assert all(one in (None, f"cannot write to {tmp_path / 'full'}: {os.strerror(code)}") for one in told)
    assert told[len(told) // 2] is not None and told[-1] is None  # what fails in the end does not matter


def test_a_limit_for_the_size_of_files(index: MapIndex, tmp_path: Path) -> None:
    path = tmp_path / "limited"
    told = [crashes.limited(index, path, CHANGE, size) for size in range(0, 8000, 1000)]
    assert told[0] == f"cannot write to {path}: File too large" and told[-1] is None


def test_a_folder_that_may_only_be_read(index: MapIndex) -> None:
    with TemporaryDirectory() as folder:  # pytest's own are for its user alone
        Path(folder).chmod(0o755)
        path = Path(folder) / "index"
        assert crashes.forbidden(index, path, CHANGE) == f"cannot write to {path}: Permission denied"


@pytest.mark.parametrize("change", WHOLE.values(), ids=WHOLE)
def test_power_lost_at_every_step(index: MapIndex, change: Change) -> None:
    counts = crashes.lose_power(index.path, change, BEFORE, tries=2, seed=2)
    assert counts["folders"] > 50 and counts["wrong"] == 0


def test_the_model_of_a_disk_tells_what_is_not_flushed(
    index: MapIndex, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("m2t_text.index.writing.segment_writer.flush", lambda path: None)
    assert crashes.lose_power(index.path, CHANGE, BEFORE, tries=2, seed=2)["wrong"] > 0
    monkeypatch.undo()
    monkeypatch.setattr("m2t_text.index.storage.directory.os.fsync", lambda descriptor: None)
    assert crashes.lose_power(index.path, MERGE, BEFORE, tries=2, seed=2)["wrong"] > 0


def test_changes_are_what_they_say(tmp_path: Path) -> None:
    index = built(tmp_path / "index", {})
    for change in islice(changes(7, {}), 12):
        change.apply(index)
        assert contents(index) == expected(change.after) and litter(index.path) == []
