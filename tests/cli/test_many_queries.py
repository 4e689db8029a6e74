"""`search --queries`: many queries, each a line of a file, answered as one by one."""

import json
from pathlib import Path
from typing import Any

import pytest
from calling import Call

from m2t_text.index.map_index import MapIndex
from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen

pytestmark = pytest.mark.usefixtures("own_folder")


def without_seconds(document: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in document.items() if key != "seconds"}


def test_each_line_is_answered_as_by_itself(call: Call, simulated_index: Path) -> None:
    ids = MapIndex.open(simulated_index).ids[::40]
    Path("queries.txt").write_text("# some places\n" + "\n\n".join(ids) + "\n")
    options = ("--index", simulated_index, "--top", 3, "--exclude-travel", 5, "--json")
    status, out, _ = call("search", "--queries", "queries.txt", *options)
    assert status == 0
    found = json.loads(out)
    assert found["queries"] == len(ids) == len(found["answers"]) and found["queries_per_second"] > 0
    for map_id, answer in zip(ids, found["answers"], strict=True):
        single = json.loads(call("search", map_id, *options)[1])
        assert without_seconds(answer) == without_seconds(single)


def test_the_table_has_a_row_for_each(call: Call, simulated_index: Path) -> None:
    ids = MapIndex.open(simulated_index).ids[:2]
    Path("some").write_text("\n".join(ids))
    status, out, _ = call("search", "--queries", "some", "--index", simulated_index)
    assert status == 0 and "2 queries of some" in out and "a second" in out
    assert all(out.count(map_id) == 2 for map_id in ids)  # each finds itself


def test_queries_may_be_cut_from_logs(call: Call, simulated_index: Path) -> None:
    write_carmen(simulate(Simulation(seed=4, length=24.0, travel=10.0)), Path("new.log"))
    Path("queries").write_text("new.log@1\nnew.log#8\n")
    status, out, _ = call("search", "--queries", "queries", "--index", simulated_index, "--no-verify", "--json")
    titles = [answer["query"]["map_id"] for answer in json.loads(out)["answers"]]
    assert status == 0 and titles[1] == "new/000008" and titles[0].startswith("new/")


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("", "names no query"),
        ("# nothing\n\n", "names no query"),
        ("{id}\nnowhere/000001\n", "line 2 of queries"),
        ("-\n", "line 1 of queries: - is standard input"),
        ("\udcff", "cannot read the queries"),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_looked_up(
    call: Call, simulated_index: Path, lines: str, said: str
) -> None:
    first = MapIndex.open(simulated_index).ids[0]
    Path("queries").write_bytes(lines.format(id=first).encode(errors="surrogateescape"))
    status, out, err = call("search", "--queries", "queries", "--index", simulated_index)
    assert (status, out) == (2, "") and said in err and err.count("\n") == 1


def test_one_query_or_a_file_of_them(call: Call, simulated_index: Path) -> None:
    plotted = ("--queries", "f", "--plot", "p.png")
    for arguments in ((), ("a/000001", "--queries", "f"), plotted, ("--queries", "none")):
        status, out, err = call("search", *arguments, "--index", simulated_index)
        assert (status, out) == (2, "") and err.startswith("m2t-text: ")
