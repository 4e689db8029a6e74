"""An index that grows for days: what is kept of a place that was seen before."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from m2t_text.config import PROFILES
from m2t_text.description.document import Document
from m2t_text.errors import MapIndexError
from m2t_text.index.map_index import MapIndex
from m2t_text.live.survey import LiveSurvey
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.loops.growing import PLACE, GrowingDataset, same_place
from m2t_text.pipeline import describe
from m2t_text.recognition.finding import VERIFIED
from m2t_text.util.geometry import compose

DEFAULT = PROFILES["default"]


def described(simulation: Simulation, name: str) -> tuple[list[Document], np.ndarray]:
    """The maps of a drive, and the true poses of its scans."""
    log = simulate(simulation)
    survey, documents = LiveSurvey(DEFAULT, log.laser_pose), []
    for scan in log.scans:
        survey.add(scan)
        documents += [describe(run, name, DEFAULT) for run in survey.new_runs()]
    assert log.ground_truth is not None
    return documents, log.ground_truth


@pytest.fixture(scope="module")
def days() -> list[tuple[list[Document], np.ndarray]]:
    """The same way through one building on three days."""
    base = Simulation(seed=3, length=24.0, travel=12.0, beams=90)
    return [described(replace(base, drive=day), f"day-{day}") for day in range(3)]


def grown(path: Path, days: list[list[Document]], keep: int | None) -> tuple[MapIndex, list[int]]:
    index, counts = MapIndex.create(path, DEFAULT), []
    for documents in days:
        past = GrowingDataset(index, documents[0].dataset, keep)
        for document in documents:
            past.add(document)
        past.commit()
        counts.append(len(index))
    return index, counts


def test_without_a_number_everything_is_kept(days: list, tmp_path: Path) -> None:
    maps = [documents for documents, _ in days]
    index, counts = grown(tmp_path / "all", maps, None)
    assert counts == np.cumsum([len(one) for one in maps]).tolist() and len(index) == counts[-1]


def test_an_index_that_knows_a_way_hardly_grows(days: list, tmp_path: Path) -> None:
    maps = [documents for documents, _ in days]
    index, counts = grown(tmp_path / "few", maps, 1)
    assert counts[0] == len(maps[0])
    assert counts[2] <= 1.5 * counts[0]
    assert index.ids == sorted(set(index.ids))


def test_the_same_place_is_where_it_was_seen_from(days: list, tmp_path: Path) -> None:
    (first, true), (second, truth) = days[:2]
    index = MapIndex.create(tmp_path / "first", DEFAULT)
    index.replace(first[0].dataset, first)
    seen = 0
    for document in second[::4]:
        for found in same_place(index, document):
            seen += 1
            hit = index.document(found.hit.map_id)
            ends = (_viewpoint(true, hit), _viewpoint(truth, document))
            assert np.hypot(*(ends[0] - ends[1])[:2]) <= PLACE + 0.3
    assert seen >= 5


def test_a_place_of_more_maps_than_are_verified(days: list, tmp_path: Path) -> None:
    """Where all the best hits show one place, it is asked whether another is as likely."""
    (first, _), (second, _), _ = days
    index = MapIndex.create(tmp_path / "often", DEFAULT)
    again = [replace(one, first_scan=one.first_scan + 1000 * k) for one in first[:4] for k in range(40)]
    index.replace(first[0].dataset, sorted(again, key=lambda one: one.first_scan))
    counts = [len(list(same_place(index, document))) for document in second[:4]]
    assert max(counts) == VERIFIED


def _viewpoint(truth: np.ndarray, document: Document) -> np.ndarray:
    return compose(truth[document.first_scan], document.viewpoint)


def test_one_visit_does_not_crowd_itself_out(days: list, tmp_path: Path) -> None:
    """The maps of the last metres show the place, too, and are no other visit."""
    (first, _), _, _ = days
    index = MapIndex.create(tmp_path / "first", DEFAULT)
    index.replace(first[0].dataset, first)
    for document in first[::6]:
        for found in same_place(index, document):
            assert abs(found.hit.document.middle - document.middle) > 5.0


def test_what_looks_otherwise_takes_the_place_of_the_most_alike(
    days: list, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As if no two maps looked the same: the number of maps stays, and what is there is the newest."""
    monkeypatch.setattr("m2t_text.loops.growing.EQUAL", 1.1)
    maps = [documents for documents, _ in days[:2]]
    index, counts = grown(tmp_path / "new", maps, 1)
    first, second = (sum(one.startswith(name) for one in index.ids) for name in ("day-0", "day-1"))
    assert first + second == counts[1] <= 1.5 * counts[0]
    assert first < 0.8 * counts[0] and second > 0.5 * len(maps[1])


def test_what_cannot_be_written_waits(days: list, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (first, _), _, _ = days
    index = MapIndex.create(tmp_path / "full", DEFAULT)
    past = GrowingDataset(index, first[0].dataset)
    past.add(first[0])

    def refuses(*arguments: object) -> None:
        raise MapIndexError("no space left")

    with monkeypatch.context() as full:
        full.setattr(index, "append", refuses)
        with pytest.raises(MapIndexError):
            past.commit()
    past.commit()
    assert index.ids == [first[0].map_id]


def test_places_of_which_nothing_is_seen(days: list, tmp_path: Path) -> None:
    document = replace(days[0][0][0], text=type(days[0][0][0].text).of([], [], []))
    index = MapIndex.create(tmp_path / "nothing", DEFAULT)
    past = GrowingDataset(index, document.dataset, 1)
    past.add(document)
    past.commit()
    past.add(replace(document, first_scan=5, last_scan=9))
    past.commit()
    assert len(index) == 2 and list(same_place(index, days[1][0][0])) == []
