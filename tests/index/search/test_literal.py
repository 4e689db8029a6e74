"""The fast query scores as the literal engine does, which is plain Whoosh: to the last bit."""

import doctest
import shutil
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from map_oracle import document, random_documents, random_text
from whoosh.analysis import SpaceSeparatedTokenizer
from whoosh.fields import ID, TEXT, Schema
from whoosh.filedb.filestore import RamStorage
from whoosh.formats import Frequency
from whoosh.index import open_dir

from m2t_text.config import PROFILES, Parameters
from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.index.map_index import MapIndex
from m2t_text.index.search import literal
from m2t_text.index.search.literal import LiteralIntersection, LiteralQuery
from m2t_text.index.search.query import MapQuery
from m2t_text.index.search.weighting import HistogramIntersection
from m2t_text.logs import read_log
from m2t_text.sources.opening import LogSource

TEXTS = Schema(
    map_id=ID(stored=True),
    text=TEXT(analyzer=SpaceSeparatedTokenizer(), phrase=False, vector=Frequency()),
)


def scores(index: Any, query: Any, weighting: Any) -> dict[str, float]:
    with index.searcher(weighting=weighting) as searcher:
        return {hit["map_id"]: hit.score for hit in searcher.search(query, limit=None)}


def assert_same(index: Any, text: Text, window: int, turns: tuple[int, ...]) -> dict[str, float]:
    literal = scores(index, LiteralQuery("text", text), LiteralIntersection(window, turns))
    fast = scores(index, MapQuery(text), HistogramIntersection(window, turns, weighted=False))
    assert fast == literal
    return fast


def in_segments(path: Path, maps: Iterable[Document]) -> MapIndex:
    index = MapIndex.create(path, Parameters())
    datasets: dict[str, list[Document]] = {}
    for one in maps:
        datasets.setdefault(one.dataset, []).append(one)
    for name, documents in datasets.items():
        index.replace(name, documents)
    return index


CELLS = st.tuples(st.integers(-9, 9), st.integers(-9, 9), st.integers(0, 2))


@settings(max_examples=15)
@given(
    maps=st.lists(st.lists(CELLS, max_size=6), min_size=1, max_size=5),
    query=st.lists(CELLS, max_size=6),
    window=st.integers(0, 4),
    turns=st.sets(st.integers(0, 3), min_size=1).map(tuple),
)
def test_random_maps(
    tmp_path_factory: pytest.TempPathFactory, maps: Any, query: Any, window: int, turns: tuple[int, ...]
) -> None:
    texts = [Text.of(*np.array(words, dtype=np.int64).reshape(-1, 3).T) for words in (*maps, query)]
    documents = [document("ab"[number % 2], number, text) for number, text in enumerate(texts[:-1])]
    index = in_segments(tmp_path_factory.mktemp("literal") / "index", documents)
    assert_same(index.whoosh, texts[-1], window, turns)


def test_deletions_and_several_segments(tmp_path: Path) -> None:
    index = in_segments(tmp_path / "index", [*random_documents(1, "a", 9), *random_documents(2, "b", 4)])
    with index.whoosh.writer() as writer:
        writer.delete_by_term("map_id", "a/000002")
        writer.merge = False
    for seed in range(2):
        text = random_text(np.random.default_rng(seed), 8)
        assert "a/000002" not in assert_same(index.whoosh, text, 10, (0, 1, 2, 3))


@pytest.mark.parametrize("profile", ["default", "paper"])
def test_maps_of_a_real_log(radish: Path, tmp_path: Path, profile: str) -> None:
    log = read_log(radish / "freiburg-101-corrected.log.gz")
    begin = replace(log, scans=log.scans[:90], ground_truth=None)
    index = MapIndex.create(tmp_path / "index", PROFILES[profile])
    index.add(LogSource(begin))
    some = [one.text for one in index.documents()][::45]
    assert len(some) >= 2
    for text in some:  # each token has 441 neighbours to look up
        sparse = Text.of(text.wx[::24], text.wy[::24], text.wa[::24])
        assert max(assert_same(open_dir(index.path), sparse, 10, (0, 3)).values()) == len(sparse)


def test_its_example(simulated_index: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(simulated_index, tmp_path / "indexes" / "default")
    monkeypatch.chdir(tmp_path)
    failed, tried = doctest.testmod(literal)
    assert tried == 5 and not failed


def test_the_literal_engine_needs_no_index_of_this_package() -> None:
    documents = random_documents(3, "a", 8)
    ordinary = RamStorage().create_index(TEXTS)
    with ordinary.writer() as writer:
        for one in documents:
            writer.add_document(map_id=one.map_id, text=str(one.text))
    text = random_text(np.random.default_rng(5), 15)
    with pytest.MonkeyPatch.context() as patch:
        patch.delattr(MapQuery, "matcher")
        found = scores(ordinary, LiteralQuery("text", text), LiteralIntersection())
    assert found and max(found.values()) <= len(text)
