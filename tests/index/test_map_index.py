"""An index on disk: documents come back, commits are atomic, and what cannot be opened is said."""

import json
import random
import re
from dataclasses import asdict, replace

import numpy as np
import pytest
from map_oracle import document, random_documents, text_of
from states import litter
from whoosh import index as whoosh_index
from whoosh.fields import TEXT, Schema
from whoosh.query import Term

from m2t_text.config import PROFILES, Parameters, from_dict
from m2t_text.errors import MapIndexError, QueryError
from m2t_text.index import map_index
from m2t_text.index.map_index import MapIndex
from m2t_text.index.writing import folder
from m2t_text.index.writing import toc as table


@pytest.fixture
def index(tmp_path):
    return MapIndex.create(tmp_path / "index", Parameters())


def same(one, other) -> bool:
    arrays = ("travel", "pose", "viewpoint", "centre_of_gravity")
    plain = ("dataset", "first_scan", "last_scan", "points", "map_id")
    return (
        all(np.array_equal(getattr(one, name), getattr(other, name)) for name in arrays)
        and all(getattr(one, name) == getattr(other, name) for name in plain)
        and str(one.text) == str(other.text)
    )


def contents(index: MapIndex) -> dict[str, str]:
    return {one.map_id: str(one.text) for one in index.documents()}


def test_documents_come_back_exactly(index):
    documents = [*random_documents(0, "a", 8), document("a", 999_999, text_of("x-300_y32767_a1023 x0_y0_a0"))]
    index.replace("a", documents)
    again = MapIndex.open(index.path)
    assert len(again) == 9
    for one in documents:
        assert same(again.document(one.map_id), one)
    assert [one.map_id for one in again.documents("a")] == again.ids and not list(again.documents("b"))
    with pytest.raises(QueryError, match="no map 'a/000500'"):
        again.document("a/000500")


def test_what_is_appended_is_what_is_put_in_at_once(index, tmp_path):
    documents, other = random_documents(1, "a", 40), random_documents(2, "b", 4)
    documents = sorted(documents, key=lambda one: one.first_scan)
    index.replace("b", other)
    for begin in range(0, 40, 7):
        index.append("a", documents[begin : begin + 7])
        assert len(index) == 4 + min(begin + 7, 40)
    whole = MapIndex.create(tmp_path / "whole", Parameters())
    whole.replace("b", other)
    whole.replace("a", documents)
    assert contents(index) == contents(whole) and index.datasets() == whole.datasets()
    for query in (documents[3].text, other[1].text):
        hits = [(hit.map_id, hit.score, hit.matched) for hit in index.search(query, top=0)]
        assert hits == [(hit.map_id, hit.score, hit.matched) for hit in whole.search(query, top=0)]


def test_what_comes_instead_of_others_replaces_them_at_once(index):
    documents, other = random_documents(1, "a", 12), random_documents(2, "b", 4)
    documents = sorted(documents, key=lambda one: one.first_scan)
    index.replace("b", other)
    index.append("a", documents[:6])
    pinned = index.pinned()
    index.append("a", documents[6:], [documents[2], other[1], other[3]])
    left = [one for one in (*documents, *other) if one not in (documents[2], other[1], other[3])]
    assert contents(index) == {one.map_id: str(one.text) for one in left}
    assert len(pinned) == 10  # a search that has begun goes on
    with pytest.raises(MapIndexError):
        index.append("a", documents[:1], [other[0]])
    assert len(index) == len(left)
    index.append("a", [], [one for one in left if one.dataset == "b"])
    assert [one.name for one in index.datasets()] == ["a"]


def test_what_cannot_be_appended_changes_nothing(index):
    documents = sorted(random_documents(1, "a", 6), key=lambda one: one.first_scan)
    index.append("a", documents[:4])
    before = contents(index)
    for wrong in (documents[3:], [documents[5], documents[4]], [replace(documents[5], dataset="b")]):
        with pytest.raises(MapIndexError):
            index.append("a", wrong)
    assert contents(index) == before


def test_a_dataset_is_replaced_and_nothing_else_changes(index):
    first, other = random_documents(1, "a", 6), random_documents(2, "b", 4)
    index.replace("a", first)
    index.replace("b", other)
    newer = random_documents(3, "a", 3)
    index.replace("a", newer)
    assert contents(index) == {one.map_id: str(one.text) for one in newer + other}
    index.replace("b", [])
    assert contents(index) == {one.map_id: str(one.text) for one in newer}
    with index.writer() as writer:
        writer.remove("a")
    assert len(index) == 0 and index.search(first[0].text, top=0) == []


def test_datasets_and_info(index):
    index.replace("b", random_documents(1, "b", 5))
    index.replace("a", random_documents(2, "a", 3))
    assert [(each.name, each.maps, each.scans, each.travel) for each in index.datasets()] == [
        ("a", 3, 10, 4.0), ("b", 5, 12, 5.0),
    ]  # fmt: skip
    info = index.info()
    assert info.maps == 8 and info.keypoints == sum(len(one.text) for one in index.documents())
    assert info.bytes == sum((index.path / name).stat().st_size for name in folder.names(index.path))
    assert info.parameters == Parameters()


def drives(index: MapIndex) -> dict[str, tuple[int, float]]:
    return {each.name: (each.scans, each.travel) for each in index.datasets()}


def test_scans_and_travel_are_those_of_the_whole_log(index):
    for name in "ab":
        index.replace(name, random_documents(1, name, 3), (100, 25.5))
    reader = MapIndex.open(index.path)
    assert drives(reader) == {"a": (100, 25.5), "b": (100, 25.5)}
    with pytest.raises(ZeroDivisionError), index.writer() as writer:
        writer.replace("a", random_documents(2, "a", 3), (7, 7.0))
        raise ZeroDivisionError
    assert drives(index) == {"a": (100, 25.5), "b": (100, 25.5)}
    with index.writer() as writer:
        writer.replace("a", random_documents(2, "a", 3), (50, 12.0))
        writer.remove("b")
        writer.replace("c", random_documents(1, "c", 3))
        assert drives(reader) == {"a": (100, 25.5), "b": (100, 25.5)}
    index.optimize()
    assert drives(reader) == drives(index) == {"a": (50, 12.0), "c": (10, 4.0)}
    index.replace("a", [])
    assert drives(MapIndex.open(index.path)) == {"c": (10, 4.0)}
    index.replace("c", [])
    assert drives(MapIndex.open(index.path)) == {}


def test_hits_tell_all_but_the_text(index):
    documents = random_documents(1, "a", 6)
    index.replace("a", documents)
    hit = index.search(documents[4].text, top=1)[0]
    assert hit.map_id == documents[4].map_id and hit.score == pytest.approx(1.0) and not hit.alignment.any()
    assert hit.matched == len(documents[4].text) and len(hit.document.text) == 0
    assert same(replace(hit.document, text=documents[4].text), documents[4])


def test_equal_scores_are_ordered_by_id_wherever_they_lie(index):
    text = text_of("x0_y0_a5 x9_y9_a6")
    for name in ("d", "a", "c", "b"):
        index.replace(
            name, [document(name, n, text) for n in (2, 1)] + [document(name, 3, text_of("x0_y0_a9"))]
        )
    matching = sorted(map_id for map_id in index.ids if not map_id.endswith("3"))
    assert [hit.map_id for hit in index.search(text)] == matching
    assert [hit.map_id for hit in index.search(text, top=5)] == matching[:5]
    every = index.search(text, top=0)
    assert [hit.map_id for hit in every] == matching + [f"{name}/000003" for name in "abcd"]
    assert [hit.score for hit in every[8:]] == [0.0] * 4 and {hit.matched for hit in every[8:]} == {0}


def test_neighbours_in_travel_are_left_out(index):
    text = text_of("x0_y0_a5")
    index.replace(
        "a",
        [document("a", n, text, travel=travel) for n, travel in enumerate([0.0, 9.9, 10.0, 20.0, 30.0, 30.1])],
    )
    index.replace("b", [document("b", 0, text, travel=20.0)])
    hits = index.search(text, exclude=("a", 20.0, 10.0))
    assert [hit.map_id for hit in hits] == ["a/000000", "a/000001", "a/000005", "b/000000"]
    assert len(index.search(text, exclude=("a", 20.0, -1.0))) == 7


def test_scores_are_in_the_order_of_ids(index):
    documents = random_documents(1, "a", 9)
    index.replace("a", documents[::-1])
    scores = index.scores(documents[2].text)
    assert index.ids[int(scores.score.argmax())] == documents[2].map_id
    hits = {hit.map_id: hit.score for hit in index.search(documents[2].text, top=0)}
    assert [hits[map_id] for map_id in index.ids] == scores.score.tolist()


def test_a_search_sees_the_latest_commit_and_a_searcher_its_own(index):
    index.replace("a", random_documents(1, "a", 3))
    reader = MapIndex.open(index.path)
    assert len(reader) == 3
    with reader.searcher() as searcher:
        with index.writer() as writer:
            writer.replace("a", random_documents(2, "a", 5))
            assert len(reader) == 3
        assert searcher.doc_count() == 3
        assert len(list(searcher.documents(dataset="a"))) == 3
    assert len(reader) == 5


@pytest.mark.parametrize(
    "broken",
    [
        {"dataset": "b"}, {"first_scan": None}, {"first_scan": -1}, {"last_scan": 1.5}, {"travel": np.zeros(3)},
        {"pose": np.array([0.0, np.nan, 0.0])}, {"text": "x0_y0_a0"}, {"viewpoint": np.zeros(2)},
        {"text": replace(text_of("x0_y0_a1 x0_y0_a2"), wa=np.array([2, 1], dtype=np.int16))},
    ],
)  # fmt: skip
def test_a_broken_document_changes_nothing(index, broken):
    index.replace("a", random_documents(1, "a", 4))
    before = contents(index)
    good = random_documents(2, "a", 3)
    with pytest.raises(MapIndexError):
        index.replace("a", [*good, replace(document("a", 50, text_of("x0_y0_a0")), **broken)])
    assert contents(index) == contents(MapIndex.open(index.path)) == before
    index.replace("a", good)
    assert contents(index) == {one.map_id: str(one.text) for one in good}


def test_names_and_ids_are_checked(index):
    two = [document("a", 1, text_of(""))] * 2
    with pytest.raises(MapIndexError, match="two maps"):
        index.replace("a", two)
    for name in ("", "a\x1b[2J", "a\nb"):
        with pytest.raises(MapIndexError):
            index.replace(name, [document(name, 1, text_of(""))])
    with pytest.raises(MapIndexError, match="twice"), index.writer() as writer:
        writer.replace("a", two[:1])
        writer.replace("a", two[:1])
    assert len(index) == 0


def test_an_error_or_an_interrupt_while_writing_cancels(index):
    index.replace("a", random_documents(1, "a", 4))
    before = contents(index)
    for error in (KeyboardInterrupt, ZeroDivisionError):
        with pytest.raises(error), index.writer() as writer:
            writer.replace("a", random_documents(2, "a", 2))
            raise error
    assert contents(index) == before
    index.replace("b", random_documents(3, "b", 2))  # the lock is free again
    assert litter(index.path) == []


def test_a_second_writer_is_told(index, monkeypatch, caplog):
    monkeypatch.setattr(map_index, "LOCK_SECONDS", 0.05)
    with index.writer(), pytest.raises(MapIndexError, match="being written"):
        MapIndex.open(index.path).replace("a", [])
    assert [record.message for record in caplog.records] == [
        f"waiting up to 0.05 s for another process that writes to {index.path}"
    ]


def test_segments_differ_where_random_numbers_are_the_same(index):
    for name in "abc":
        random.seed(1)
        index.replace(name, random_documents(ord(name), name, 9 - 3 * "abc".index(name)))
    assert len({segment.segment_id() for segment in index.whoosh._segments()}) == 3 and len(index) == 18


def test_segments_stay_few_and_deletions_are_cleared(index):
    for n in range(20):
        index.replace(f"log {n:02d}", random_documents(n, f"log {n:02d}", 3))
    assert len(index.whoosh._segments()) <= 5 and len(index) == 60
    for n in range(20):
        index.replace(f"log {n:02d}", [])
    assert index.whoosh._segments() == []
    index.replace("a", random_documents(0, "a", 8))
    index.replace("b", random_documents(0, "b", 3))
    index.optimize()
    assert [segment.doc_count_all() for segment in index.whoosh._segments()] == [11]
    generation = index.whoosh.latest_generation()
    before = contents(index)
    index.optimize()
    assert contents(index) == before and index.whoosh.latest_generation() == generation + 1


def test_opening_what_is_not_an_index(tmp_path):
    with pytest.raises(MapIndexError, match=r"no index in .*missing"):
        MapIndex.open(tmp_path / "missing")
    (tmp_path / "file").write_text("hello")
    for call in (MapIndex.open, lambda path: MapIndex.create(path, Parameters())):
        with pytest.raises(MapIndexError):
            call(tmp_path / "file")
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "_MAIN_1.toc").write_bytes(b"\x04\x08\x04nonsense")
    with pytest.raises(MapIndexError, match="cannot be read"):
        MapIndex.open(tmp_path / "broken")
    (tmp_path / "foreign").mkdir()
    whoosh_index.create_in(str(tmp_path / "foreign"), Schema(text=TEXT()))
    with pytest.raises(MapIndexError, match="not one of maps"):
        MapIndex.open(tmp_path / "foreign")
    for number, name in enumerate(("thesis.tex", "MAIN_thesis.tex", "MAIN_0123456789abcdef.seg")):
        used = tmp_path / str(number)
        used.mkdir()
        (used / name).write_text("")
        with pytest.raises(MapIndexError, match=re.escape(name)):
            MapIndex.create(used, Parameters())


def test_every_cut_of_the_table_of_contents_is_one_clear_error(index):
    index.replace("a", random_documents(0, "a", 2))
    toc = index.path / "_MAIN_1.toc"
    whole = toc.read_bytes()
    for size in range(0, len(whole), 37):
        toc.write_bytes(whole[:size])
        with pytest.raises(MapIndexError, match="cannot be read"):
            MapIndex.open(index.path)


def test_whoosh_itself_opens_an_index(index):
    one, *others = random_documents(0, "a", 4)
    index.replace("a", [one, *others])
    with whoosh_index.open_dir(str(index.path)).searcher() as searcher:
        assert searcher.doc_count() == 4
        (hit,) = searcher.search(Term("map_id", one.map_id))
        assert hit["map_id"] == one.map_id and hit["dataset"] == "a"


def test_creating_twice_keeps_the_first(index):
    index.replace("a", random_documents(0, "a", 2))
    with pytest.raises(MapIndexError, match="already holds an index"):
        MapIndex.create(index.path, Parameters())
    assert len(MapIndex.open(index.path)) == 2


def test_a_folder_left_by_a_killed_creation(tmp_path):
    path = tmp_path / "index"
    path.mkdir()
    (path / "_MAIN_0.toc.1234.5").write_bytes(b"half")
    with pytest.raises(MapIndexError, match="no index"):
        MapIndex.open(path)
    MapIndex.create(path, Parameters()).replace("a", random_documents(0, "a", 2))
    assert len(MapIndex.open(path)) == 2


def test_other_versions_and_parameters_are_told(index, monkeypatch):
    index.replace("a", random_documents(0, "a", 2))
    assert MapIndex.open(index.path, Parameters()).parameters == Parameters()
    with pytest.raises(MapIndexError, match=r"profile 'default'.*'paper'"):
        MapIndex.open(index.path, PROFILES["paper"])
    now = table.FORMAT_VERSION
    monkeypatch.setattr(table, "FORMAT_VERSION", now + 1)
    with pytest.raises(MapIndexError, match=f"has format {now}, this program reads {now + 1}; index the logs"):
        MapIndex.open(index.path)
    (index.path / "_MAIN_1.toc").write_bytes(b"pickles" + table.FORMER_SEAL + bytes(table.DIGEST))
    with pytest.raises(MapIndexError, match=r"has format 3, this program reads .* again into another folder"):
        MapIndex.open(index.path)


def test_an_empty_index_takes_the_parameters_asked_for(index):
    paper = MapIndex.open(index.path, PROFILES["paper"])
    assert MapIndex.open(index.path).parameters == Parameters()  # until there are maps
    paper.replace("a", random_documents(0, "a", 2))
    assert MapIndex.open(index.path).parameters == PROFILES["paper"]
    with pytest.raises(MapIndexError, match="profile 'paper', asked for 'default'"):
        index.replace("b", random_documents(1, "b", 2))


@pytest.mark.parametrize("profile", PROFILES)
def test_parameters_survive(profile, tmp_path):
    assert from_dict(json.loads(json.dumps(asdict(PROFILES[profile])))) == PROFILES[profile]
    index = MapIndex.create(tmp_path, PROFILES[profile])
    index.replace("a", random_documents(0, "a", 2))
    index.replace("b", random_documents(0, "b", 2))
    assert MapIndex.open(tmp_path).parameters == PROFILES[profile]


def test_an_overview_has_every_live_map_once_and_in_order(index):
    """Also where segments hold maps that were deleted since, and names do not sort as ids do."""
    for name, seed, maps in (("b", 1, 6), ("a b", 2, 4), ("a", 3, 5), ("b", 4, 3)):
        index.replace(name, random_documents(seed, name, maps))
    overview = index.overview()
    assert overview.names == ["a", "a b", "b"] and len(overview) == 12
    listed = list(index.pinned().numbered(overview.numbers.tolist()))
    order = sorted(index.documents(), key=lambda one: (one.dataset, one.first_scan))
    assert all(same(one, other) for one, other in zip(listed, order, strict=True))
    for one, code, record in zip(listed, overview.codes, overview.records, strict=True):
        assert overview.names[code] == one.dataset and record["pose"].tolist() == one.pose.tolist()
    chosen = index.matching("dataset:b")
    assert [one.dataset == "b" for one in listed] == chosen.tolist()


def test_an_overview_of_nothing_is_empty(index):
    assert len(index.overview()) == 0 and index.overview().names == []
