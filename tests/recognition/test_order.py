"""The order of verified hits: the more exact of what else fits alike comes first, then the smaller map id."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from m2t_text.config import PROFILES
from m2t_text.index.map_index import MapIndex
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.pipeline import describe_log
from m2t_text.recognition.finding import find, verify_hits
from m2t_text.recognition.queries import Query


@pytest.fixture(scope="module")
def dense(tmp_path_factory: pytest.TempPathFactory) -> MapIndex:
    """Maps that begin 5 cm apart, which all but equal each other."""
    log = replace(simulate(Simulation(seed=4, length=24.0, travel=6.5, step=0.05)), name="drive")
    index = MapIndex.create(tmp_path_factory.mktemp("order") / "index", PROFILES["default"])
    index.replace("drive", describe_log(log, PROFILES["default"]))
    return index


def test_a_map_that_is_looked_up_comes_first(dense: MapIndex) -> None:
    ids = dense.ids
    assert len(ids) > 20
    for map_id in ids:
        query = Query.of(dense.document(map_id))
        first = find(dense, query, top=1).results[0]
        assert first.hit.map_id == map_id
        assert first.pose == pytest.approx(np.zeros(3)) and first.inlier_ratio == 1.0


def test_its_neighbours_fit_as_completely_so_that_only_exactness_tells_it(dense: MapIndex) -> None:
    query = Query.of(dense.document(dense.ids[10]))
    first, *others = verify_hits(dense, query, dense.search(query.text, top=10))
    assert first.alignment is not None and first.alignment.fit.distance == 0.0
    complete = [one for one in others if one.inlier_ratio == 1.0 and one.alignment is not None]
    assert complete and all(one.alignment.fit.distance > 0.0 for one in complete if one.alignment)


def test_equal_maps_are_ordered_by_id(dense: MapIndex, tmp_path: Path) -> None:
    index = MapIndex.create(tmp_path / "index", PROFILES["default"])
    documents = list(dense.documents())[:5]
    for name in ("drive-b", "drive-a"):
        index.replace(name, [replace(one, dataset=name) for one in documents])
    query = Query.of(documents[2])
    found = [one.hit.map_id for one in verify_hits(index, query, index.search(query.text, top=10))]
    number = documents[2].map_id.removeprefix("drive")
    assert found[:2] == [f"drive-a{number}", f"drive-b{number}"]
