"""An index from a stranger runs nothing, leads nowhere, and takes no more memory than it has bytes."""

import pickle
import sys
from pathlib import Path

import children
import hostile
import numpy as np
import pytest
from map_oracle import document, random_text
from states import built, contents, copied, expected
from whoosh.index import open_dir

from m2t_text.errors import MapIndexError
from m2t_text.index.map_index import MapIndex
from m2t_text.index.search.weighting import HistogramIntersection, OffsetAgreement

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="watches processes as Linux shows them")

STATE = {"a": 5, "b": 11}
BAGS = HistogramIntersection(None)


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> MapIndex:
    index = built(tmp_path_factory.mktemp("hostile") / "index", STATE)
    index.optimize()
    index.search(next(index.documents()).text)  # loads what the processes need
    return index


@pytest.mark.parametrize("name", hostile.ATTACKS)
def test_a_hostile_index_is_refused(index: MapIndex, tmp_path: Path, name: str) -> None:
    told = hostile.suffer(index, tmp_path / "index", tmp_path / "canary", hostile.ATTACKS[name])
    assert told is not None and told.isprintable() and str(tmp_path / "index") in told


def test_the_tools_of_the_attacks_harm_nothing_by_themselves(index: MapIndex, tmp_path: Path) -> None:
    for tool in (hostile.forge, hostile.reassemble):
        copy = copied(index, tmp_path / "index")
        tool(copy.path)
        assert hostile.suffer(copy, tmp_path / "again", tmp_path / "canary", lambda path, canary: None) is None
        assert contents(copy) == expected(STATE)


@pytest.mark.parametrize("protocol", [0, 2, 5])
def test_the_pickles_that_whoosh_keeps_are_never_read(index: MapIndex, tmp_path: Path, protocol: int) -> None:
    """They are there for plain Whoosh; here a call in one runs nothing, and the next commit removes it."""
    canary = tmp_path / "canary"
    copy = copied(index, tmp_path / "index")
    hostile.forge(copy.path, whooshs=pickle.dumps(hostile.Runs(canary), protocol))
    assert hostile.suffer(copy, tmp_path / "again", canary, lambda path, canary: None) is None
    assert contents(copy) == expected(STATE) and not canary.exists()
    copy.replace("a", [])
    assert b"touch" not in hostile.table(copy.path).read_bytes()


def test_plain_whoosh_opens_a_sound_index(index: MapIndex) -> None:
    with open_dir(index.path).searcher() as searcher:
        assert {fields["map_id"] for fields in searcher.documents()} == set(expected(STATE))


def test_a_linked_folder_for_what_is_not_committed_keeps_its_files(index: MapIndex, tmp_path: Path) -> None:
    copy = copied(index, tmp_path / "index")
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "letter").write_text("dear")
    (copy.path / "MAIN.tmp").symlink_to(tmp_path / "letters")
    copy.replace("a", [])
    assert [file.name for file in (tmp_path / "letters").iterdir()] == ["letter"]
    assert contents(copy) == expected({"b": 11})


@pytest.mark.parametrize("seed", range(4))
def test_random_keypoints_lead_no_search_astray(index: MapIndex, tmp_path: Path, seed: int) -> None:
    copy = copied(index, tmp_path / "index")
    wide = [document("b", k, random_text(np.random.default_rng(k), 150, span=300, words=3)) for k in range(3)]
    copy.replace("b", wide)
    copy.optimize()
    hostile.reassemble(copy.path, {"text": lambda data: hostile.scrambled(data, seed)})

    def work() -> None:
        attacked = MapIndex.open(copy.path)
        with pytest.raises(MapIndexError, match="cannot be read"):
            contents(attacked)
        for text in (wide[0].text, random_text(np.random.default_rng(seed), 40)):
            for model in (OffsetAgreement(), OffsetAgreement(window=20), HistogramIntersection(), BAGS):
                with attacked._reading() as snapshot:
                    scores = snapshot.scores(text, model)
                    every = [segment.live for segment in snapshot.segments]
                    best = snapshot.ranking(text, model, 2, every).best()[1]
                assert (scores.matched >= 0).all() and (scores.matched <= len(text)).all()
                assert np.isfinite(scores.score).all() and len(best.score) <= len(scores.score)

    children.call(work)
