"""Many queries in one go are answered as one by one."""

import shutil
from dataclasses import astuple

import numpy as np
import pytest

import m2t_text as m2t
from m2t_text.index.search import collection, top_k
from m2t_text.recognition.queries import Query

pytestmark = pytest.mark.usefixtures("two_threads")


@pytest.fixture(scope="module", params=["default", "paper"])
def index(request, tmp_path_factory) -> m2t.MapIndex:
    index = m2t.open_index(tmp_path_factory.mktemp("many") / "index", m2t.PROFILES[request.param])
    for seed in (1, 2):
        log = m2t.simulate(m2t.Simulation(length=24.0, travel=14.0, seed=seed, beams=90))
        index.add(m2t.LogSource(log))
    return index


def told(finding: m2t.Finding) -> object:
    rows = [
        (one.hit.map_id, one.hit.score, one.hit.alignment.tolist(), one.inlier_ratio, str(one.pose))
        for one in finding.results
    ]
    return finding.verdict, astuple(finding.assessment.reason), finding.assessment.probability, rows


def test_many_are_answered_as_one_by_one(index: m2t.MapIndex, monkeypatch) -> None:
    for name, value in {"SIEVED": 20, "SAMPLES": (4, 16), "AROUND": 1, "FEW": 8}.items():
        monkeypatch.setattr(top_k, name, value)
    monkeypatch.setattr(collection, "ALONE", 2)
    queries = [Query.of(document) for document in index.documents()][::6]
    assert len(queries) > 10
    for exclude, some in ((None, queries[::2]), (5.0, queries[1::2])):
        answers = [m2t.find(index, query, 5, query.excluding(exclude)) for query in some]
        many = list(m2t.find_many(index, iter(some), 5, exclude))
        assert [told(one) for one in many] == [told(one) for one in answers]
    texts = [query.text for query in queries]
    for method in ("m2t", "bow"):
        found = [[(hit.map_id, hit.score) for hit in hits] for hits in index.search_many(texts, 7, method)]
        single = [index.search(text, 7, method=method) for text in texts]
        assert found == [[(hit.map_id, hit.score) for hit in hits] for hits in single]


def test_all_queries_see_one_state(index: m2t.MapIndex, tmp_path) -> None:
    index = m2t.open_index(shutil.copytree(index.path, tmp_path / "index"))
    documents = list(index.documents())
    texts = [documents[0].text] * 40
    hits = index.search_many(texts, 1)
    assert next(hits)[0].map_id == documents[0].map_id
    index.remove(*[dataset.name for dataset in index.datasets()])
    assert [found[0].map_id for found in hits] == [documents[0].map_id] * 39
    assert np.size(index.ids) == 0
