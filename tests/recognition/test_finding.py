"""What speaks against an answer: maps elsewhere are looked for among all, with one question to the index."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from m2t_text.config import PROFILES
from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.index.map_index import MapIndex
from m2t_text.recognition import finding
from m2t_text.recognition.finding import LIKELY, RIVALS, VERIFIED, find, verify_hits
from m2t_text.recognition.found import Found, differs
from m2t_text.recognition.queries import Query


def room(rng: np.random.Generator, noise: float) -> Text:
    """A room with walls that no turn brings to each other, of which a share of the cells is not seen."""
    along = np.arange(-40, 40)
    cells = np.concatenate(
        [np.stack([along, 0 * along - 25], 1), np.stack([along, 0 * along + 25], 1)]
        + [np.stack([0 * along[15:66] + x, along[15:66]], 1) for x in (-40, 39)]
        + [
            np.stack([0 * along[:20] + 20, along[:20] + 50], 1),
            np.stack([along[:30] + 2, 0 * along[:30] + 8], 1),
        ]
        + [np.stack([along[:25] + 5, along[:25] + 40], 1)]
    )
    cells = cells[rng.random(len(cells)) >= noise]
    return Text.of(cells[:, 0], cells[:, 1], (cells[:, 0] + 40) // 9 * 5 + (cells[:, 1] + 40) // 9)


def drive(dataset: str, texts: list[Text], place: float) -> list[Document]:
    """Maps all of one place."""
    zeros = np.zeros(3)
    return [
        Document(
            dataset, k, k, np.array([0.1 * k, 0.1 * k + 3]), np.array([place, 0, 0]), zeros, zeros[:2], 9, text
        )
        for k, text in enumerate(texts)
    ]


@pytest.fixture
def index(tmp_path) -> MapIndex:
    """One place with more maps than are verified, and two others that look like it, but less so."""
    rng = np.random.default_rng(1)
    index = MapIndex.create(tmp_path / "index", PROFILES["default"])
    index.replace("here", drive("here", [room(rng, 0.02) for _ in range(VERIFIED + 25)], 0.0))
    index.replace("there", drive("there", [room(rng, 0.12) for _ in range(5)], 0.0))
    index.replace("far", drive("far", [room(rng, 0.6) for _ in range(5)], 90.0))
    return index


def widening(index: MapIndex, query: Query, verified: list[Found], floor: float) -> list[str]:
    """The same with more and more hits, until there are enough."""
    count, known = 1, {one.hit.map_id for one in verified}
    while True:
        hits = index.search(query.text, count)
        others = [hit for hit in hits if hit.score >= floor and hit.map_id not in known]
        others = [hit for hit in others if differs(verified[0], Found(hit))][:RIVALS]
        if len(others) == RIVALS or len(hits) < count or hits[-1].score < floor:
            return [hit.map_id for hit in others]
        count += 1


def test_rivals_elsewhere_are_those_that_a_widening_search_finds(index: MapIndex, monkeypatch) -> None:
    query = Query(room(np.random.default_rng(2), 0.02))
    verified = verify_hits(index, query, index.search(query.text, VERIFIED))
    assert {one.hit.document.dataset for one in verified} == {"here"}
    search = partial(index.search, query.text)
    for share in (LIKELY, 0.2, 1.2):
        monkeypatch.setattr(finding, "LIKELY", share)
        found = [one.hit for one in finding.elsewhere(index, query, verified, search)]
        ids = [hit.map_id for hit in sorted(found, key=lambda hit: (-hit.score, hit.map_id))]
        assert ids == widening(index, query, verified, share * verified[0].hit.score)
        assert (not ids) == (share > 1)


def test_a_place_with_many_maps_has_rivals_behind_them(index: MapIndex) -> None:
    query = Query(room(np.random.default_rng(2), 0.02))
    answer = find(index, query)
    assert answer.verdict == "ambiguous" and str(answer.assessment.reason.rival).startswith("there/")
    alone = find(index, query, filter=index.parse("dataset:here"))
    assert alone.assessment.reason.code != "elsewhere"


def test_nothing_more_is_asked_where_nothing_else_is_likely(index: MapIndex, monkeypatch) -> None:
    query = Query(room(np.random.default_rng(2), 0.02))
    verified = verify_hits(index, query, index.search(query.text, VERIFIED))
    worse = [*verified[:-1], replace(verified[-1], hit=replace(verified[-1].hit, score=0.1))]

    def search(*_: object, **__: object) -> list[finding.Hit]:
        raise AssertionError

    assert finding.elsewhere(index, query, worse, search) == []
    assert finding.elsewhere(index, query, verified[:20], search) == []
