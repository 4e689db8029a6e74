"""The texts as a full-text field: Whoosh's own classes say of it what they say of a field of plain tokens."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from map_oracle import document, random_documents
from whoosh.analysis import SpaceSeparatedTokenizer
from whoosh.fields import ID, TEXT, Schema
from whoosh.filedb.filestore import RamStorage
from whoosh.index import open_dir
from whoosh.qparser import QueryParser
from whoosh.query import And, Every, Not, Or, Prefix, Query, Term, TermRange, Wildcard

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.description.free_squares import FreeSquares
from m2t_text.description.text import Text
from m2t_text.index import postings
from m2t_text.index.map_index import MapIndex
from m2t_text.index.schema import to_fields

ORDINARY = Schema(
    map_id=ID(stored=True, unique=True),
    dataset=ID(stored=True),
    text=TEXT(analyzer=SpaceSeparatedTokenizer(), phrase=False, stored=True),
)
TYPED = (
    "x0_y0_a1",
    "x1* OR x-1_y0_a1",
    "x?_y0_a* NOT x0*",
    "[x0 TO x1_y1]",
    "text:* dataset:a",
    "x0_y0_a1^3 x1*",
)
FACTS = ("weight", "doc_frequency", "min_length", "max_length", "max_weight", "min_id", "max_id")
Commit = tuple[list[Document], list[str], bool]  # maps to add, ids of maps to delete, and whether all is merged


def built(path: Path, commits: list[Commit]) -> list[Any]:
    """The maps as an index of ours, opened in both ways, and then as an ordinary one."""
    ours = MapIndex.create(path, Parameters()).whoosh
    ordinary = RamStorage().create_index(ORDINARY)
    for maps, gone, merged in commits:
        for index in (ours, ordinary):
            writer = index.writer()
            for map_id in gone:
                writer.delete_by_term("map_id", map_id)
            for one in maps:
                plain = {"map_id": one.map_id, "dataset": one.dataset, "text": str(one.text)}
                writer.add_document(**(to_fields(one) if index is ours else plain))
            writer.commit(merge=False, optimize=merged)
    return [ours, open_dir(path), ordinary]


def told(index: Any, tokens: list[str], queries: list[Query]) -> dict[str, Any]:
    """All that Whoosh says of the texts in an index."""
    with index.searcher() as searcher:
        reader = searcher.reader()
        terms = list(reader.all_terms())
        known = [text for field, text in terms if field == "text"]
        every = [*tokens, *(text.decode() for text in known)]
        infos = [reader.term_info("text", text) for text in known]
        parser = QueryParser("text", index.schema)
        asked = [*queries, *map(parser.parse, TYPED), *(Term("text", token) for token in every[:15])]
        return {
            "terms": terms,
            "lexicon": list(reader.lexicon("text")),
            "from": [list(reader.expand_prefix("text", token[:4])) for token in every[:10]],
            "frequencies": [
                (reader.doc_frequency("text", one), reader.frequency("text", one), ("text", one) in reader)
                for one in every
            ],
            "infos": [[getattr(info, name)() for name in FACTS] for info in infos],
            "postings": [followed(reader.postings("text", text)) for text in known],
            "lengths": [reader.doc_field_length(k, "text", 0) or 0 for k in range(reader.doc_count_all())],
            "field length": reader.field_length("text"),
            "key terms": [searcher.key_terms([k], "text", 5) for k in reader.all_doc_ids()],
            "frequent": list(reader.most_frequent_terms("text", 3)),
            "hits": [hits(searcher.search(query, limit=None)) for query in asked],
            "best": [[score for _, score, _ in hits(searcher.search(query, limit=2))] for query in asked],
        }


def hits(results: Any) -> list[tuple[str, float, str]]:
    return [(hit["map_id"], round(hit.score, 9), hit["text"]) for hit in results]


def followed(matcher: Any) -> list[tuple[int, float, int]]:
    found = []
    while matcher.is_active():
        found.append((matcher.id(), matcher.weight(), matcher.value_as("frequency")))
        matcher.next()
    return found


def assert_same(path: Path, commits: list[Commit], tokens: list[str], queries: list[Query]) -> None:
    *ours, ordinary = built(path, commits)
    expected = told(ordinary, tokens, queries)
    for index in ours:
        found = told(index, tokens, queries)
        assert found.keys() == expected.keys()
        for name, facts in expected.items():
            assert found[name] == facts, name


CELLS = st.one_of(st.integers(-12, 12), st.sampled_from([-32768, -300, -129, -128, 127, 128, 1000, 32767]))
KEYPOINTS = st.lists(st.tuples(CELLS, CELLS, st.sampled_from([0, 1, 5, 10, 51, 1023])), max_size=5)

SIDES = st.integers(4, 12)
SQUARES = st.lists(st.tuples(st.sampled_from([100, 200, 201]), st.integers(-300, 10), SIDES), max_size=3)


@st.composite
def histories(draw: st.DrawFn) -> list[Commit]:
    """Commits that add maps to different segments, delete some, and merge at times."""
    commits: list[Commit] = []
    ids: list[str] = []
    for number in range(draw(st.integers(1, 3))):
        maps = []
        for k in range(draw(st.integers(0, 3))):
            words, squares = (
                np.array(draw(one), dtype=np.int64).reshape(-1, 3).T for one in (KEYPOINTS, SQUARES)
            )
            text = Text.of(*words, free=FreeSquares.of(*squares))
            maps.append(document("ab"[k % 2], 10 * number + k, text))
        gone = draw(st.lists(st.sampled_from(ids), unique=True)) if ids else []
        commits.append((maps, gone, draw(st.booleans())))
        ids += [one.map_id for one in maps]
    return commits


QUERIES: list[Query] = [
    Every(),
    Every("text"),
    Prefix("text", "x1"),
    Prefix("text", "x-1_"),
    Wildcard("text", "x1_*_a1"),
    Wildcard("text", "*_a1?"),
    Wildcard("text", "x20?_*_f?"),
    TermRange("text", "x1_y", "x2", startexcl=True),
    TermRange("text", None, "x1_y1_a1", endexcl=False),
    And([Prefix("text", "x1"), Not(Term("dataset", "a"))]),
    Or([Term("text", "x0_y0_a1"), Wildcard("text", "x?_*"), Term("text", "nothing")]),
]
STRANGE = ["", "x", "x1", "x01_y1_a1", "x-0_y0_a1", "x1_y1_a1024", "x1_y1_a1 ", "x99999_y0_a1", "x1_y1_b1", "é"]


@settings(max_examples=6)
@given(commits=histories())
def test_it_is_what_whoosh_says_of_an_ordinary_field(
    tmp_path_factory: pytest.TempPathFactory, commits: list[Commit]
) -> None:
    assert_same(tmp_path_factory.mktemp("full") / "index", commits, STRANGE, QUERIES)


@pytest.mark.parametrize(("block", "dense"), [(7, 1 << 28), (1 << 18, 0)])
def test_in_small_blocks_and_without_a_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int, dense: int
) -> None:
    monkeypatch.setattr(postings, "BLOCK", block)
    monkeypatch.setattr(postings, "DENSE", dense)
    monkeypatch.setattr(postings, "COLUMNS", 3)
    commits: list[Commit] = [
        (random_documents(1, "a", 6, 12), [], False),
        (random_documents(2, "b", 5, 12), ["a/000002", "a/000004"], False),
    ]
    assert_same(tmp_path / "index", commits, STRANGE, QUERIES)


def thinned(one: Document) -> Document:
    """The map with a few of its keypoints: Whoosh's own index takes its time."""
    return replace(one, text=Text.of(one.text.wx[::9], one.text.wy[::9], one.text.wa[::9]))


def test_the_maps_of_a_drive(tmp_path: Path, simulated_index: Path) -> None:
    maps = [thinned(one) for one in list(MapIndex.open(simulated_index).documents())[::40]]
    commits: list[Commit] = [(maps[:2], [], False), (maps[2:], [maps[1].map_id], False)]
    queries: list[Query] = [
        Prefix("text", "x12_"),
        Wildcard("text", "x12_*_a5*"),
        TermRange("text", "x1_", "x10_"),
    ]
    tokens = str(maps[2].text).split()[:20]
    assert_same(tmp_path / "index", commits, tokens, queries)
