"""Scores and ranking against the plain Whoosh index, on every layout that an index can have."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from map_oracle import Oracle, document, random_documents, random_text

from m2t_text.config import MatchingParameters, Parameters
from m2t_text.index.map_index import MapIndex
from m2t_text.index.schema import to_fields
from m2t_text.index.search.query import MapQuery
from m2t_text.index.search.weighting import HistogramIntersection


def turn_of(alignment: np.ndarray) -> int:
    """Quarter turns of an alignment without an offset."""
    assert not alignment[:2].any()
    return round(alignment[2] / (np.pi / 2))


def segments_of(index: MapIndex) -> list[tuple[int, int]]:
    return [(segment.doc_count_all(), segment.deleted_count()) for segment in index.whoosh._segments()]


def layouts(path: Path, parameters: Parameters):
    """An index and its documents: one segment, several, with deletions, merged."""
    index = MapIndex.create(path, parameters)
    first, second, third = (
        random_documents(seed, name, n) for seed, name, n in [(1, "a", 18), (2, "b", 8), (3, "c", 5)]
    )
    index.replace("a", first)
    yield "one", index, first
    index.replace("b", second)
    index.replace("c", third)
    assert len(segments_of(index)) == 3
    yield "several", index, first + second + third
    newer = random_documents(4, "b", 3)
    index.replace("b", newer)
    with index.writer() as writer:
        writer.replace("c", third[:4])
    yield "replaced", index, first + newer + third[:4]
    whoosh = index.whoosh.writer()
    for number in (2, 3, 19):
        whoosh.delete_document(number)
    before = set(index.ids)
    whoosh.commit(merge=False)
    left = set(index.ids)
    assert len(before - left) == 3 and any(dead for _, dead in segments_of(index))
    kept = [one for one in first + newer + third[:4] if one.map_id in left]
    yield "deleted", index, kept
    index.optimize()
    assert segments_of(index) == [(len(kept), 0)]
    yield "merged", index, kept


@pytest.mark.parametrize("weighted", [False, True])
def test_scores_and_ranking_are_those_of_the_definitions(tmp_path, weighted):
    matching = MatchingParameters(score="intersection", window=10, weighted=weighted)
    rng = np.random.default_rng(0)
    for name, index, documents in layouts(tmp_path / "index", Parameters(matching=matching)):
        oracle = Oracle(documents)
        assert index.ids == sorted(oracle.ids)
        for query in (documents[-1].text.turned(1), random_text(rng, 40)):
            for method, window, turns in (("m2t", 10, (0, 1, 2, 3)), ("bow", None, (0,))):
                wanted = oracle.scores(query, window, turns, weighted)
                got = index.scores(query, method)
                for place, map_id in enumerate(index.ids):
                    score, matched, turn = wanted[map_id]
                    assert got.score[place] == (pytest.approx(score, rel=1e-8) if weighted else score), name
                    assert (got.matched[place], turn_of(got.alignment[place])) == (matched, turn), (
                        name,
                        map_id,
                    )
                ranked = sorted(index.ids, key=lambda map_id: (-got.score[index.ids.index(map_id)], map_id))
                assert [hit.map_id for hit in index.search(query, top=0, method=method)] == ranked


@pytest.mark.parametrize("turns", [(0,), (2,), (1, 3), (3, 0)])
def test_any_choice_of_turns(tmp_path, turns):
    index = MapIndex.create(
        tmp_path, Parameters(matching=MatchingParameters(score="intersection", turns=turns, weighted=False))
    )
    documents = random_documents(5, "a", 12)
    index.replace("a", documents)
    wanted = Oracle(documents).scores(documents[3].text, 10, turns, False)
    for hit in index.search(documents[3].text, top=0):
        assert (hit.score, hit.matched, turn_of(hit.alignment)) == wanted[hit.map_id]


@pytest.mark.parametrize("keypoints", [64, 65, 200])
def test_more_keypoints_of_one_word_than_a_machine_word_has_bits(tmp_path, keypoints):
    rng = np.random.default_rng(keypoints)
    documents = [document("a", n, random_text(rng, keypoints, span=40, words=1)) for n in range(4)]
    query = random_text(rng, keypoints, span=40, words=1)
    index = MapIndex.create(
        tmp_path, Parameters(matching=MatchingParameters(score="intersection", weighted=False))
    )
    index.replace("a", documents)
    wanted = Oracle(documents).scores(query, 10, (0, 1, 2, 3), False)
    for hit in index.search(query, top=0):
        assert (hit.score, hit.matched, turn_of(hit.alignment)) == wanted[hit.map_id]


@pytest.mark.parametrize("score", ["intersection", "agreement"])
def test_the_layout_does_not_change_a_bit_of_the_scores(tmp_path, score):
    parameters = Parameters(matching=MatchingParameters(score=score))
    documents = random_documents(6, "a", 40)
    query = documents[7].text
    one = MapIndex.create(tmp_path / "one", parameters)
    one.replace("a", documents)
    many = MapIndex.create(tmp_path / "many", parameters)
    many.replace("gone", random_documents(7, "gone", 4))
    for n in range(0, 40, 10):
        whoosh = many.whoosh.writer()
        for each in documents[n : n + 10]:
            whoosh.add_document(**to_fields(each))
        whoosh.commit(merge=False)
    whoosh = many.whoosh.writer()
    whoosh.delete_by_term("dataset", "gone")
    whoosh.commit(merge=False)
    assert len(segments_of(many)) == 5
    assert np.array_equal(one.scores(query).score, many.scores(query).score)


@pytest.mark.parametrize("score", ["intersection", "agreement"])
def test_whooshs_own_search_gives_the_same_scores(tmp_path, score):
    parameters = Parameters(matching=MatchingParameters(score=score))
    for _, index, documents in layouts(tmp_path / "index", parameters):
        query = documents[1].text
        with index.searcher() as searcher:
            found = {hit["map_id"]: hit.score for hit in searcher.search(MapQuery(query), limit=None)}
            top = searcher.search(MapQuery(query), limit=5)
            assert [hit.score for hit in top] == sorted(found.values(), reverse=True)[:5]
        hits = index.search(query, top=10**6)
        assert found == {hit.map_id: hit.score for hit in hits}


def test_models_are_values():
    assert HistogramIntersection() == HistogramIntersection(10, (0, 1, 2, 3), True)
    assert replace(HistogramIntersection(), window=None) != HistogramIntersection()
