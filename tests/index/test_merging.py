"""Several indexes: listed, merged, thinned out and written anew, without a map lost or a change half made."""

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from calling import Call
from map_oracle import random_documents
from states import Contents, contents

from m2t_text.config import PROFILES, Parameters
from m2t_text.errors import MapIndexError
from m2t_text.index.map_index import MapIndex, open_index
from m2t_text.index.merging import Unreadable, indexes_in, merge
from m2t_text.index.results import IndexInfo

pytestmark = pytest.mark.usefixtures("own_folder")

DRIVE = (1000, 123.5)  # scans and metres, more than the maps alone tell


def made(path: str, profile: str = "default", **datasets: int) -> Path:
    """An index of random maps; each dataset is told by its seed."""
    index = MapIndex.create(path, PROFILES[profile])
    for name, seed in datasets.items():
        index.replace(name, random_documents(seed, name, 5 + seed), DRIVE)
    return index.path


def held(path: str | Path) -> Contents:
    """All that an index keeps of each map."""
    return contents(MapIndex.open(path))


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def damage(path: Path) -> None:
    """Nothing of an index can be read any more."""
    for file in path.iterdir():
        file.write_bytes(b"x")


# --- merge


def test_merged_indexes_hold_all_maps_exactly() -> None:
    sources = [made("indexes/a", one=1, two=2), made("indexes/b", three=3), made("indexes/c")]
    before = [files(source) for source in sources]
    merged = merge(sources, "indexes/all")
    assert [(one.dataset.name, one.source.name) for one in merged] == [
        ("one", "a"),
        ("two", "a"),
        ("three", "b"),
    ]
    assert held("indexes/all") == held("indexes/a") | held("indexes/b") and len(held("indexes/all")) == 21
    assert [(d.name, d.scans, d.travel) for d in MapIndex.open("indexes/all").datasets()] == [
        (name, *DRIVE) for name in ("one", "three", "two")
    ]
    assert [files(source) for source in sources] == before


def test_merging_into_an_index_keeps_what_it_holds() -> None:
    target, source = made("target", one=1, two=2), made("source", three=3)
    both = held(target) | held(source)
    merge([source], target)
    assert held(target) == both


def test_a_dataset_of_the_same_name_is_an_error_unless_it_is_to_be_replaced() -> None:
    target, a, b = made("target", one=1, two=2), made("a", two=3), made("b", two=4, three=5)
    before = held(target)
    with pytest.raises(
        MapIndexError, match="target and those to merge hold datasets of the same name: 'two'; with"
    ):
        merge([a], target)
    with pytest.raises(MapIndexError, match="the indexes to merge hold datasets of the same name: 'two'"):
        merge([a, b], "new")
    assert held(target) == before and not Path("new").exists()
    merge([a, b], target, replace=True)
    kept = {map_id: one for map_id, one in before.items() if map_id.startswith("one/")}
    assert held(target) == kept | held(b)


def test_other_parameters_are_refused() -> None:
    default, paper = made("default", one=1), made("paper", "paper", two=2)
    message = r"paper \(profile 'paper'\) and default \(profile 'default'\) were made with other parameters"
    with pytest.raises(MapIndexError, match=message):
        merge([default, paper], "new")
    with pytest.raises(MapIndexError, match="the index in paper was made with other parameters"):
        merge([default], paper)
    assert not Path("new").exists() and len(held(paper)) == 7
    merge([paper], "new")
    assert MapIndex.open("new").parameters == PROFILES["paper"]


@pytest.mark.parametrize(
    ("sources", "message"),
    [
        (["a", "./a"], "a is named twice"),
        (["b", "../{here}/b"], "b is named twice"),
        (["a", "target"], "target is the index to merge into"),
        (["a", "missing"], "no index in missing"),
        ([], "no index to merge"),
    ],
)
def test_what_cannot_be_merged_changes_nothing(own_folder: Path, sources: list[str], message: str) -> None:
    for name, seed in (("a", 1), ("b", 2), ("target", 3)):
        made(name, **{name: seed})
    before = held("target")
    with pytest.raises(MapIndexError, match=message):
        merge([source.format(here=own_folder.name) for source in sources], "target")
    assert held("target") == before


def test_a_source_is_copied_as_it_was_when_merging_began() -> None:
    target, source = made("target", one=1), made("source", two=2, three=3)
    both = held(target) | held(source)
    changed: list[str] = []

    def change(what: str, stage: str, done: int, of: int) -> None:
        if not changed:  # another process, once
            changed.append(what)
            index = MapIndex.open(source)
            index.remove("three")
            index.replace("two", random_documents(9, "two", 2))
            index.optimize()

    merge([source], target, progress=change)
    assert changed and len(MapIndex.open(source)) == 2
    assert held(target) == both


def test_progress_of_merging_counts_all_maps() -> None:
    told: list[tuple[str, int, int]] = []
    merge(
        [made("a", one=1), made("b", two=2)],
        "all",
        progress=lambda what, _, done, of: told.append((what, done, of)),
    )
    assert told == [("one", k, 6) for k in range(1, 7)] + [("two", k, 7) for k in range(1, 8)]


# --- remove and optimize


def test_removed_datasets_are_gone_and_all_others_stay() -> None:
    path = made("index", one=1, two=2, three=3)
    rest = {map_id: one for map_id, one in held(path).items() if map_id.startswith("two/")}
    index = MapIndex.open(path)
    with pytest.raises(MapIndexError, match="no dataset 'four' in index; it holds one, three, two"):
        index.remove("one", "four")
    assert len(held(path)) == 21
    index.remove("one", "three", "one")
    assert held(path) == rest and [dataset.name for dataset in index.datasets()] == ["two"]
    index.remove("two")
    assert held(path) == {} and index.parameters == Parameters()


def test_optimizing_drops_only_what_was_removed() -> None:
    path = made("index", one=9, two=1, three=1, four=2)
    index = MapIndex.open(path)
    index.remove("two")
    before, told = held(path), []
    searcher = index.searcher()
    assert len(searcher.leaf_searchers()) > 1
    searcher.close()
    index.optimize(lambda done, of: told.append((done, of)))
    searcher = index.searcher()
    assert len(searcher.leaf_searchers()) == 1 and not searcher.reader().has_deletions()
    searcher.close()
    assert held(path) == before and told == [(done + 1, len(before)) for done in range(len(before))]


BLOCKED = """
import sys
from m2t_text.index.writing import map_writer, merge_policy
from m2t_text.cli import main

def block(*arguments):
    print("working", flush=True)
    sys.stdin.read()  # until the test has ended

if sys.argv.pop(1) == "copying":
    merge_policy._WatchedReader.iter_docs = block
else:
    map_writer.MapWriter.commit = block
main()
"""


@pytest.mark.parametrize(
    ("ending", "moment", "line"),
    [
        (signal.SIGINT, "committing", "merge other --index target --replace"),
        (signal.SIGKILL, "committing", "merge other --index target --replace"),
        (signal.SIGKILL, "committing", "remove one --index target"),
        (signal.SIGKILL, "copying", "optimize --index target"),
    ],
)
def test_an_ended_command_changes_nothing(ending: signal.Signals, moment: str, line: str) -> None:
    """And it can be run again."""
    made("target", one=9, two=1)
    made("other", two=3)
    before = held("target")
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    process = subprocess.Popen([sys.executable, "-c", BLOCKED, moment, *line.split()], text=True, **pipes)
    assert process.stdout is not None and process.stdout.readline() == "working\n", process.communicate()
    process.send_signal(ending)
    assert process.wait(20) == (130 if ending == signal.SIGINT else -ending)
    message = process.communicate()[1]
    assert message == ("m2t-text: interrupted; nothing was left half done\n" if ending == signal.SIGINT else "")
    assert held("target") == before
    made("third", four=4)
    merge(["third"], "target")
    assert held("target") == before | held("third")


# --- Side by side


def test_the_indexes_of_a_folder() -> None:
    made("indexes/b", one=1, two=2)
    made("indexes/a", "paper")
    damage(made("indexes/c", one=1))
    Path("indexes/no index").mkdir()
    Path("indexes/README.md").write_text("")
    a, b, c = indexes_in("indexes")
    assert isinstance(a, IndexInfo) and (a.path, a.maps) == (Path("indexes/a"), 0)
    assert isinstance(b, IndexInfo) and (b.path, b.maps) == (Path("indexes/b"), 13)
    assert isinstance(c, Unreadable) and c.path == Path("indexes/c") and "cannot be read" in c.reason
    assert indexes_in("missing") == []


def test_open_index_opens_or_makes() -> None:
    index = open_index("new/index", PROFILES["paper"])
    index.replace("one", random_documents(1, "one", 3))
    assert len(open_index("new/index")) == 3 and open_index("new/index").parameters.profile == "paper"
    with pytest.raises(MapIndexError, match="made with other parameters"):
        open_index("new/index", Parameters())


# --- The commands


def test_info_lists_the_indexes_if_none_is_named(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    made("indexes/default", one=1)
    status, out, err = call("info")
    assert (status, err) == (0, "") and "one" in out and "indexes in" not in out  # there is only one
    made("indexes/office", "paper", two=2, three=3)
    status, out, err = call("info")
    assert (status, err) == (0, "") and out.startswith("indexes/default: 6 maps")
    assert "2 indexes in indexes" in out and re.search("indexes/office +paper +2 +15 ", out)
    document = json.loads(call("info", "--json")[1])
    assert document["path"] == "indexes/default" and document["maps"] == 6
    default, office = document["indexes"]
    assert default["path"] == "indexes/default" and default["bytes"] == document["bytes"]
    size = sum(file.stat().st_size for file in Path("indexes/office").iterdir())
    assert office == {
        "path": "indexes/office",
        "profile": "paper",
        "maps": 15,
        "bytes": size,
        "datasets": ["three", "two"],
    }
    assert "indexes" not in json.loads(call("info", "--index", "indexes/default", "--json")[1])
    assert "indexes in" not in call("info", "--index", "indexes/default")[1]
    monkeypatch.setenv("M2T_INDEX", "indexes/office")
    assert "indexes" not in json.loads(call("info", "--json")[1])


def test_info_without_a_default_index(call: Call) -> None:
    made("indexes/office", two=2)
    status, out, err = call("info")
    assert (status, err) == (0, "") and "1 indexes in indexes" in out and "indexes/office" in out
    status, out, err = call("info", "--json")
    assert (status, out) == (2, "") and "no index in indexes/default" in err


def test_info_tells_of_an_index_that_cannot_be_read(call: Call) -> None:
    made("indexes/default", one=1)
    damage(made("indexes/office", one=1))
    status, out, err = call("info")
    assert status == 0 and "unreadable" in out and err.startswith("warning: indexes/office: ")
    _, office = json.loads(call("info", "--json")[1])["indexes"]
    assert office["path"] == "indexes/office" and "cannot be read" in office["error"]


def test_merge_remove_optimize(call: Call) -> None:
    made("indexes/a", one=1)
    made("indexes/b", two=2)
    status, out, err = call("merge", "indexes/a", "indexes/b")
    assert (status, err) == (0, "") and "merged into indexes/default" in out
    assert "indexes/default holds 13 maps" in out
    assert call("merge", "indexes/a")[0] == 2
    document = json.loads(call("merge", "indexes/a", "--replace", "--json")[1])
    assert document["merged"] == [{"name": "one", "from": "indexes/a"}] and document["maps"] == 13
    status, out, err = call("remove", "two")
    assert (status, err) == (0, "") and out.startswith("removed two: 7 maps\nindexes/default holds 6 maps in ")
    status, out, err = call("optimize")
    assert (status, err) == (0, "") and "optimized indexes/default, which took" in out
    before = json.loads(call("info", "--json")[1])["bytes"]
    document = json.loads(call("optimize", "--json")[1])
    assert document["bytes_before"] == before and document["path"] == "indexes/default"
    document = json.loads(call("remove", "one", "--json")[1])
    assert document["removed"] == ["one"] and document["maps"] == 0 and document["datasets"] == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["merge"], "Missing argument"),
        (["merge", "missing"], "no index in missing; make one with"),
        (["merge", "a"], "b and those to merge hold datasets of the same name: 'one'; with --replace"),
        (["merge", "b"], "b is the index to merge into"),
        (["remove"], "Missing argument"),
        (["remove", "two"], "no dataset 'two' in b; it holds one"),
        (["remove", "one/000001"], "no dataset 'one/000001' in b; it holds one"),
        (["remove", "one", "--index", "missing"], "no index in missing"),
        (["optimize", "--index", "missing"], "no index in missing"),
        (["optimize", "b"], "unexpected extra argument"),
    ],
)
def test_a_wrong_call_gets_one_line(
    call: Call, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    made("a", one=1)
    made("b", one=1)
    before = files(Path("b"))
    monkeypatch.setenv("M2T_INDEX", "b")
    status, out, err = call(*arguments)
    assert (status, out) == (2, "") and message in err
    assert err.startswith("m2t-text: ") and err.count("\n") == 1
    assert files(Path("b")) == before
