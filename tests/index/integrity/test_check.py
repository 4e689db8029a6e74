"""`check` finds all damage, says whom it hurts, and repairs what can be repaired."""

from pathlib import Path

import flips
import numpy as np
import pytest
from states import MAPS, built, contents, expected, maps

from m2t_text.errors import DamageError, MapIndexError
from m2t_text.index.integrity.check import DatasetCheck, check_index, repair_index
from m2t_text.index.map_index import MapIndex
from m2t_text.index.schema import RECORD
from m2t_text.index.snapshot import Snapshot

STATE = {"a": MAPS - 1, "b": 2 * MAPS - 1, "c": 3, "d": 16}


@pytest.fixture
def index(tmp_path: Path) -> MapIndex:
    index = built(tmp_path / "index", STATE | {"gone": 5})
    with index.writer() as writer:
        writer.remove("gone")
    return index


def segment_with(index: MapIndex, dataset: str) -> Path:
    """The segment file that holds a dataset."""
    (found,) = [one for one in index.whoosh._segments() if dataset in one.maps]
    return index.path / found.filename


def hurt(index: MapIndex, map_id: str, column: str) -> Path:
    """Changes what a column holds of a map; returns the file."""
    file = segment_with(index, map_id[0])
    (leaf,) = [leaf for leaf in index.whoosh.reader().leaf_readers() if leaf[0].segment().filename == file.name]
    number = leaf[0].first_id("map_id", map_id)
    before = {"record": np.dtype(RECORD).itemsize * number, "dataset": 4 * number}
    begin, _ = leaf[0].segment().parts[column]
    data = bytearray(file.read_bytes())
    data[begin + before[column]] ^= 1
    file.write_bytes(data)
    return file


def test_a_sound_index(index: MapIndex) -> None:
    found = check_index(index.path)
    assert found.sound and found.leftovers == ()
    assert found.datasets == tuple(DatasetCheck(name, len(maps(seed, name)), 0) for name, seed in STATE.items())
    assert {file.name: file.bytes for file in found.files} == {
        file.name: file.stat().st_size for file in index.path.iterdir() if file.name != "MAIN_WRITELOCK"
    }
    assert repair_index(index.path, 1.0) == []


def test_a_hurt_map_is_named_by_its_dataset_and_the_others_are_saved(index: MapIndex) -> None:
    hurt(index, "b/000002", "record")
    found = {one.name: (one.maps, one.lost) for one in check_index(index.path).datasets}
    assert found == {
        name: (len(maps(seed, name)) - (name == "b"), int(name == "b")) for name, seed in STATE.items()
    }
    told = repair_index(index.path, 1.0)
    assert told[1:] == [f"removed 1 of {MAPS} maps of b; index its log again to have them back"]
    left = {map_id: one for map_id, one in expected(STATE).items() if map_id != "b/000002"}
    assert check_index(index.path).sound and contents(MapIndex.open(index.path)) == left


def test_a_hurt_name_is_rebuilt(index: MapIndex) -> None:
    hurt(index, "b/000002", "dataset")
    found = check_index(index.path)
    assert not found.sound and not any(one.lost for one in found.datasets)
    (told,) = repair_index(index.path, 1.0)
    assert told.startswith("rebuilt ") and contents(MapIndex.open(index.path)) == expected(STATE)


def test_a_missing_segment(index: MapIndex) -> None:
    segment_with(index, "c").unlink()
    with pytest.raises(MapIndexError, match=r"cannot be read .*check --index"):
        len(MapIndex.open(index.path))
    found = {one.name: one.lost for one in check_index(index.path).datasets}
    lost = {name for name in STATE if segment_with(index, name) == segment_with(index, "c")}
    assert found == {name: len(maps(seed, name)) * (name in lost) for name, seed in STATE.items()}
    repair_index(index.path, 1.0)
    left = {name: seed for name, seed in STATE.items() if name not in lost}
    assert contents(MapIndex.open(index.path)) == expected(left)
    assert [each.name for each in MapIndex.open(index.path).datasets()] == sorted(left)


def test_hurt_texts_are_found_when_a_snapshot_is_opened(index: MapIndex) -> None:
    """Else some searches would go on as if nothing were wrong, and others fail."""
    file = segment_with(index, "c")
    (segment,) = [one for one in index.whoosh._segments() if one.filename == file.name]
    data = bytearray(file.read_bytes())
    data[segment.parts["text"][0]] ^= 1  # the number of maps
    file.write_bytes(data)
    with pytest.raises(DamageError, match="damaged"):
        Snapshot.open(index.whoosh.searcher())


@pytest.mark.parametrize("name", ["_MAIN_6.toc", "_MAIN_6.copy.toc"])
def test_a_hurt_table_of_contents_is_written_anew(index: MapIndex, name: str) -> None:
    other = {"_MAIN_6.toc": "_MAIN_6.copy.toc"}.get(name, "_MAIN_6.toc")
    for nonsense in (b"nonsense", b""):
        (index.path / name).write_bytes(nonsense)
        assert not check_index(index.path).sound and check_index(index.path).legible
        assert repair_index(index.path, 1.0) == [f"wrote {name} anew from {other}"]
        assert contents(MapIndex.open(index.path)) == expected(STATE)
    for each in (name, other):
        (index.path / each).write_bytes(b"nonsense")
    assert check_index(index.path).datasets == () and not check_index(index.path).legible
    with pytest.raises(MapIndexError, match="nothing is known of its maps"):
        repair_index(index.path, 1.0)


def test_a_damaged_segment_is_not_copied(index: MapIndex, caplog: pytest.LogCaptureFixture) -> None:
    file = hurt(index, "c/000000", "record")
    index.optimize()
    assert f"{file.name} is damaged and was left as it is" in caplog.text
    assert {one.name: one.lost for one in check_index(index.path).datasets} == {"a": 0, "b": 0, "c": 1, "d": 0}


def test_flipped_bytes_are_found_or_without_effect(index: MapIndex, tmp_path: Path) -> None:
    counts = flips.flip(index, tmp_path / "flipped", 30, seed=1)
    assert counts["found"] + counts["harmless"] == counts["flips"] == 30
    assert counts["repaired"] == 3


def test_what_a_killed_writer_left_is_told_and_harms_nobody(index: MapIndex) -> None:
    half = "MAIN_0123456789abcdef.seg"
    (index.path / half).write_bytes(b"half")
    (index.path / "MAIN.tmp").mkdir()
    found = check_index(index.path)
    assert found.sound and found.leftovers == ("MAIN.tmp", half)
    with pytest.raises(MapIndexError, match="no index"):
        check_index(index.path / "MAIN.tmp")
