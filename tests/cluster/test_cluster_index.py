"""Several shards answer as one index would: ids, order, scores and verdicts, to the last bit."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from apart import Apart, apart
from hypothesis import given, settings
from hypothesis import strategies as st
from map_oracle import document, random_documents, random_text

from m2t_text.cluster import store as store_module
from m2t_text.cluster.carrier import InProcess
from m2t_text.cluster.cluster_index import ClusterIndex
from m2t_text.cluster.store import Store
from m2t_text.cluster.writing import sharded_writer
from m2t_text.config import PROFILES, MatchingParameters
from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.errors import ClusterError, DamageError, MapIndexError, QueryError
from m2t_text.index.map_index import MapIndex
from m2t_text.index.search import collection, top_k
from m2t_text.recognition.answer import SearchOptions
from m2t_text.recognition.answer import search as find_target
from m2t_text.recognition.finding import find, find_many
from m2t_text.recognition.queries import Query

WEIGHTED = replace(PROFILES["paper"], profile="weighted", matching=MatchingParameters(score="intersection"))
KINDS = {**PROFILES, "weighted": WEIGHTED}


def written(folder: Path, parameters, datasets: dict[str, list[Document]], shards: int) -> ClusterIndex:
    with sharded_writer(Store(folder), parameters, shards) as writer:
        for name, documents in datasets.items():
            writer.replace(name, documents)
    return ClusterIndex.open(folder)


def one_index(folder: Path, parameters, datasets: dict[str, list[Document]]) -> MapIndex:
    index = MapIndex.create(folder, parameters)
    with index.writer() as writer:
        for name, documents in datasets.items():
            writer.replace(name, documents)
    return index


def shown(hits) -> list[tuple]:
    return [
        (hit.map_id, hit.score, hit.matched, hit.alignment.tolist(), str(hit.document.text)) for hit in hits
    ]


def many(seed: int, count: int = 7) -> dict[str, list[Document]]:
    """Datasets of different sizes, with maps of the same text here and there: scores that tie."""
    datasets = {f"d{k}": random_documents(seed * 100 + k, f"d{k}", 3 + 9 * k) for k in range(count)}
    twins = [document("d0", 500 + k, datasets[f"d{k}"][1].text) for k in range(1, count)]
    datasets["d0"] += twins
    return datasets


@pytest.fixture(scope="module", params=KINDS)
def both(request, tmp_path_factory) -> tuple[MapIndex, ClusterIndex]:
    folder, datasets = tmp_path_factory.mktemp("both"), many(1)
    parameters = KINDS[request.param]
    return one_index(folder / "one", parameters, datasets), written(folder / "many", parameters, datasets, 4)


FILTERS = (None, "dataset:d3 OR dataset:d6", "travel:[4 TO 12]", "x1_y2_a0~4", "NOT dataset:d5")


@settings(max_examples=12, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0, 1, 3, 10, 40, 1000]),
    st.sampled_from(FILTERS),
    st.booleans(),
    st.sampled_from([1, 2, 3, 4]),
)
def test_every_search_is_that_of_one_index(both, seed, top, filter, bag, each):
    one, many = both
    many = apart(many, each)
    rng = np.random.default_rng(seed)
    text = random_text(rng, int(rng.integers(0, 60)))
    exclude = None if seed % 2 else (f"d{rng.integers(0, 7)}", float(rng.uniform(0, 20)), 5.0)
    arguments = {"top": top, "exclude": exclude, "filter": filter, "texts": seed % 3 == 0}
    arguments["method"] = "bow" if bag else "m2t"
    assert shown(many.search(text, **arguments)) == shown(one.search(text, **arguments))


@pytest.mark.parametrize("loose", [0.0, 1.0])  # never sieved, and always
@pytest.mark.parametrize("each", [1, 3, 4])
def test_so_it_is_where_shards_are_sampled_and_sieved_first(both, monkeypatch, loose, each):
    small = {"SIEVED": 2, "SAMPLES": (20, 40), "FEW": 10, "LOOSE": loose, "LIKELY": 10 * each}
    for name, value in small.items():
        monkeypatch.setattr(top_k, name, value)
    monkeypatch.setattr(collection, "ALONE", 0)
    one, many = both
    carrier = Apart(Store(many.path), each)
    many = ClusterIndex(carrier, many.path)
    for seed in range(0, 6, 2):
        text = random_text(np.random.default_rng(seed), 5 + 8 * seed)
        for top in (1, 4, 30):
            assert shown(many.search(text, top)) == shown(one.search(text, top))
    sampled = one.parameters.matching.score == "agreement"
    steps = {"begin", "narrow", "finish"} if sampled else {"begin", "finish"}
    assert carrier.steps == ({"begin"} if each == 4 else steps)  # a server of all shards asks nobody


def test_maps_that_tie_are_in_the_order_of_their_ids_across_shards(both):
    one, many = both
    for index in (many, apart(many, 1)):
        for name in ("d3", "d6"):
            text = one.document(f"{name}/000001").text
            assert shown(index.search(text, 2)) == shown(one.search(text, 2))


def test_it_holds_what_one_index_holds(both):
    one, many = both
    assert len(many) == len(one) and many.datasets() == one.datasets()
    assert many.info().keypoints == one.info().keypoints
    assert many.lacking("d9").split("; ")[1] == one.lacking("d9").split("; ")[1]
    for name in ("d0", "d4", "none"):
        assert [part.tolist() for part in many.runs(name)] == [part.tolist() for part in one.runs(name)]
    assert str(many.document("d4/000007").text) == str(one.document("d4/000007").text)
    assert many.find_document("d4/999999") is None and many.find_document("x") is None
    with pytest.raises(QueryError, match="no map 'd9/000001'"):
        many.document("d9/000001")
    with pytest.raises(QueryError, match="is not a query"):
        many.search(Text.of([], [], []), filter="x1_y2_a0 NOT NOT")


def test_words_are_weighted_by_the_statistics_of_all_shards(both):
    one, many = both
    statistics = one.statistics()
    assert many.manifest.statistics.maps == statistics.maps
    assert np.array_equal(many.manifest.statistics.frequency, statistics.frequency)


@pytest.fixture(scope="module")
def driven(simulated_index: Path, tmp_path_factory) -> tuple[MapIndex, ClusterIndex]:
    """A simulated drive cut into four, as one index and as three shards, one of them with two of the parts."""
    folder = tmp_path_factory.mktemp("driven")
    whole = sorted(MapIndex.open(simulated_index).documents(), key=lambda one: one.first_scan)
    parts = np.array_split(np.arange(len(whole)), 4)
    datasets = {f"p{k}": [replace(whole[n], dataset=f"p{k}") for n in part] for k, part in enumerate(parts)}
    parameters = MapIndex.open(simulated_index).parameters
    return one_index(folder / "one", parameters, datasets), written(folder / "many", parameters, datasets, 3)


def test_verdicts_and_poses_are_those_of_one_index(driven):
    one, many = driven
    for number, map_id in enumerate(one.ids):
        if number % 90 == 0:
            options = SearchOptions(top=5, exclude_travel=4.0, sequence=None if number % 4 else 10.0)
            answers = [find_target(map_id, index, options) for index in (one, many, apart(many, 1))]
            told = [answer.to_json() | {"seconds": None, "index": None} for answer in answers]
            assert told[0] == told[1] == told[2]


def test_many_queries_at_once_are_answered_as_one_by_one(driven):
    one, many = driven
    queries = [Query.of(one.document(map_id)) for map_id in one.ids[::40]]
    found = [list(find_many(index, queries, 5, exclude_travel=4.0)) for index in (one, many)]
    assert [shown(result.hit for result in finding.results) for finding in found[0]] == [
        shown(result.hit for result in finding.results) for finding in found[1]
    ]
    assert [finding.assessment for finding in found[0]] == [finding.assessment for finding in found[1]]


def test_without_verification_the_order_is_the_same(driven):
    one, many = driven
    query = Query.of(next(one.documents("p2")))
    found = [find(index, query, 50, verify=False).results for index in (one, many)]
    assert shown(result.hit for result in found[0]) == shown(result.hit for result in found[1])


def test_the_texts_that_came_along_are_not_asked_for_again(driven, monkeypatch):
    _, many = driven
    query = Query.of(many.document("p1/" + f"{many.runs('p1')[0][3]:06d}"))
    asked: list[str] = []
    original = InProcess.ask

    def ask(self, method, *arguments, **options):
        asked.append(method)
        return original(self, method, *arguments, **options)

    monkeypatch.setattr(InProcess, "ask", ask)
    find(many.pinned(), query)
    assert set(asked) <= {"begin", "narrow", "finish"}


def test_a_search_keeps_the_generation_that_it_began_with(tmp_path):
    datasets = many(2, 4)
    index = written(tmp_path / "shards", PROFILES["default"], datasets, 2)
    pinned, text = index.pinned(), datasets["d3"][2].text
    before = shown(pinned.search(text, 20))
    for generation in (1, 2, 3):
        with sharded_writer(Store(index.path), PROFILES["default"]) as writer:
            name = f"new{generation}"
            writer.replace(name, [replace(one, dataset=name) for one in datasets["d3"]])
        assert shown(pinned.search(text, 20)) == before
        assert index.search(text, 20)[1].document.dataset.startswith("new") and len(index) > len(pinned)


def test_a_generation_that_is_gone_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(store_module, "KEPT", -1.0)
    datasets = many(2, 3)
    index = written(tmp_path / "shards", PROFILES["default"], datasets, 2)
    pinned = index.pinned()  # nothing is opened yet
    for name in ("d0", "d1"):
        with sharded_writer(Store(index.path), PROFILES["default"]) as writer:
            writer.replace(name, datasets[name])
    with pytest.raises(ClusterError, match=r"generation 0 of .* is gone"):
        pinned.search(datasets["d1"][0].text)
    folders = [file for file in (tmp_path / "shards").iterdir() if file.is_dir()]
    assert len(folders) == 2  # what no generation names any more is removed


def test_datasets_are_replaced_and_removed_where_they_lie_and_shards_are_added(tmp_path):
    datasets = many(3, 5)
    index = written(tmp_path / "shards", PROFILES["default"], datasets, 2)
    places = dict(index.manifest.places)
    datasets["d1"] = random_documents(77, "d1", 30)
    datasets["new"] = random_documents(78, "new", 12)
    with sharded_writer(Store(index.path), PROFILES["default"], 3) as writer:
        writer.replace("d1", datasets["d1"])
        writer.replace("new", datasets["new"])
        writer.remove("d4")
    del datasets["d4"]
    del places["d4"]
    assert index.manifest.places == {**places, "new": 2}
    one = one_index(tmp_path / "one", PROFILES["default"], datasets)
    for text in (datasets["d1"][3].text, datasets["new"][5].text):
        assert shown(index.search(text, 0)) == shown(one.search(text, 0))
    with (
        pytest.raises(ClusterError, match="has 3 shards, and cannot have fewer"),
        sharded_writer(Store(index.path), PROFILES["default"], 2),
    ):
        pass
    with (
        pytest.raises(MapIndexError, match="other parameters"),
        sharded_writer(Store(index.path), PROFILES["paper"]),
    ):
        pass


def test_datasets_are_removed_all_or_none(tmp_path):
    datasets = many(7, 4)
    index = written(tmp_path / "shards", PROFILES["default"], datasets, 2)
    with pytest.raises(MapIndexError, match="no dataset 'none'"):
        index.remove("d1", "none")
    assert len(index) == sum(map(len, datasets.values()))
    index.remove("d1", "d3")
    assert [one.name for one in index.datasets()] == ["d0", "d2"]
    with pytest.raises(MapIndexError, match="has shards, which this cannot read"):
        MapIndex.open(index.path)


def test_a_change_that_fails_leaves_the_generation_before(tmp_path):
    datasets = many(4, 3)
    index = written(tmp_path / "shards", PROFILES["default"], datasets, 2)
    before = index.manifest

    def broken():
        yield datasets["d1"][0]
        raise RuntimeError("cut short")

    with (
        pytest.raises(RuntimeError, match="cut short"),
        sharded_writer(Store(index.path), PROFILES["default"]) as writer,
    ):
        writer.replace("d0", datasets["d0"][:1])
        writer.replace("d1", broken())
    assert index.manifest == before and len(index) == sum(map(len, datasets.values()))
    with sharded_writer(Store(index.path), PROFILES["default"]) as writer:
        writer.replace("d0", datasets["d0"][:1])
    named = {shard.folder for number in (0, 1) for shard in Store(index.path).manifest(number).shards}
    assert {file.name for file in index.path.iterdir() if file.is_dir()} == named


def damaged_manifests(data: bytes):
    yield data[:-1]
    yield data[: len(data) // 2]
    yield data.replace(b'"maps": ', b'"maps":1', 1)
    yield b""


def test_damage_is_said(tmp_path):
    datasets = many(5, 3)
    index = written(tmp_path / "shards", PROFILES["default"], datasets, 2)
    file = index.path / index.manifest.name
    data = file.read_bytes()
    for damaged in damaged_manifests(data):
        file.write_bytes(damaged)
        with pytest.raises(DamageError, match="manifest"):
            ClusterIndex.open(index.path)
    file.write_bytes(data)
    shard = index.manifest.shards[1]
    segment = next(name for name in shard.files if name.endswith(".seg"))
    with (index.path / shard.folder / segment).open("ab") as opened:
        opened.write(b"x")
    with pytest.raises(DamageError, match="is not the shard that its manifest names"):
        index.search(datasets["d1"][0].text)
    (index.path / shard.folder / segment).unlink()
    with pytest.raises(DamageError, match="lacks a file"):
        index.search(datasets["d1"][0].text)
    shutil.rmtree(index.path / shard.folder)
    shutil.copytree(index.path / index.manifest.shards[0].folder, index.path / shard.folder)
    with pytest.raises(DamageError):
        index.search(datasets["d1"][0].text)


def test_folders_that_hold_something_else(tmp_path):
    MapIndex.create(tmp_path / "plain", PROFILES["default"])
    with (
        pytest.raises(MapIndexError, match="holds an index without shards"),
        sharded_writer(Store(tmp_path / "plain"), PROFILES["default"], 2),
    ):
        pass
    with pytest.raises(ClusterError, match="no sharded index"):
        ClusterIndex.open(tmp_path / "plain")
    (tmp_path / "letter").write_text("dear")
    with (
        pytest.raises(MapIndexError, match="holds other files"),
        sharded_writer(Store(tmp_path), PROFILES["default"], 2),
    ):
        pass


class Deaf(InProcess):
    """One of the shards never answers."""

    def ask(self, method, generation, numbers, *arguments, partial=False):
        numbers = list(numbers)
        if 1 in numbers and not partial:
            raise ClusterError("shard 1 does not answer")
        return super().ask(method, generation, [number for number in numbers if number != 1], *arguments)


def test_an_answer_without_a_shard_is_given_only_where_it_is_allowed(tmp_path):
    datasets = many(6, 5)
    whole = written(tmp_path / "shards", PROFILES["default"], datasets, 3)
    text = datasets["d3"][2].text
    carrier = Deaf(Store(whole.path))
    with pytest.raises(ClusterError, match="shard 1"):
        ClusterIndex(carrier, whole.path).search(text)
    partial = ClusterIndex(carrier, whole.path, partial=True).pinned()
    expected = [hit for hit in whole.search(text, 0) if whole.manifest.places[hit.document.dataset] != 1]
    assert shown(partial.search(text, 10)) == shown(expected[:10])
    assert partial.missing == {1: whole.manifest.shards[1].maps}


def test_a_server_that_did_not_begin_a_search_can_finish_it(tmp_path):
    """As when the one that began it was killed in between."""
    datasets = many(8, 4)
    index = written(tmp_path / "shards", PROFILES["default"], datasets, 2)
    text, store = datasets["d2"][2].text, Store(index.path)

    class Forgetful(Apart):
        def ask(self, method, *arguments, **options):
            if method == "finish":
                self._servers.clear()
            return super().ask(method, *arguments, **options)

    forgetful = Forgetful(store, 1)
    assert shown(ClusterIndex(forgetful, store.path).search(text)) == shown(index.search(text))
    assert forgetful.steps == {"begin", "finish"}
