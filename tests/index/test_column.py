"""Keypoints in a column: nothing is lost, and little is stored."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from map_oracle import random_text
from whoosh.filedb.filestore import RamStorage

from m2t_text.description.free_squares import FreeSquares
from m2t_text.description.text import Text
from m2t_text.errors import MapIndexError
from m2t_text.index import column
from m2t_text.index.column import KeypointColumn
from m2t_text.index.kernels.packed import Texts, pack_words, unpack_words

narrow = st.integers(-130, 130)
any_cell = st.integers(-32767, 32767) | st.sampled_from([-32767, -129, -128, -1, 0, 127, 128, 32767])
words = st.integers(0, 1023) | st.sampled_from([0, 5, 1023])
keypoints = st.one_of(st.lists(st.tuples(cells, cells, words), max_size=80) for cells in (narrow, any_cell))
corner = st.integers(-130, 130) | st.sampled_from([-2048, -129, -128, 127, 128, 1025])
squares = st.lists(st.tuples(corner, corner, st.integers(4, 40) | st.just(1023)), max_size=80)


def text_of(keypoints: list[tuple[int, int, int]], squares: list[tuple[int, int, int]]) -> Text:
    """Whatever its squares hold: that is not for the column to judge."""
    text = Text.of(*np.array(keypoints, dtype=np.int64).reshape(-1, 3).T)
    return replace(text, free=FreeSquares.of(*np.array(squares, dtype=np.int64).reshape(-1, 3).T))


texts = st.builds(text_of, keypoints, squares)


def column_of(rows: dict[int, Text], documents: int) -> tuple[KeypointColumn.Reader, int]:
    storage = RamStorage()
    file = storage.create_file("column")
    file.write(b"before")
    writer = KeypointColumn().writer(file)
    for document, text in rows.items():
        writer.add(document, text)
    writer.finish(documents)
    file.close()
    size = storage.file_length("column") - 6
    return KeypointColumn().reader(storage.open_file("column"), 6, size, documents), size


def same(one: Text, other: Text) -> bool:
    pairs = [(one.wx, other.wx), (one.wy, other.wy), (one.wa, other.wa)]
    pairs += [(getattr(one.free, name), getattr(other.free, name)) for name in ("wx", "wy", "size")]
    return all(a.dtype == b.dtype and np.array_equal(a, b) for a, b in pairs)


@given(st.lists(texts, max_size=6))
def test_texts_come_back_exactly(rows):
    reader, _ = column_of(dict(enumerate(rows)), len(rows))
    assert all(same(text, row) for text, row in zip(reader, rows, strict=True))
    packed = Texts.of(rows)
    assert all(np.array_equal(one, other) for one, other in zip(reader.texts, packed, strict=True))
    assert reader.texts.counts.tolist() == [len(row) for row in rows]
    assert reader.squares.counts.tolist() == [len(row.free) for row in rows]


@given(st.lists(texts, max_size=6))
def test_all_tokens_of_a_segment_come_at_once(rows):
    reader, _ = column_of(dict(enumerate(rows)), len(rows))
    words = [(k, x, y, a) for k, row in enumerate(rows) for x, y, a in zip(row.wx, row.wy, row.wa, strict=True)]
    free = [
        (k, x, y, f)
        for k, row in enumerate(rows)
        for x, y, f in zip(row.free.wx, row.free.wy, row.free.size, strict=True)
    ]
    assert list(zip(*reader.texts.tokens(), strict=True)) == words
    assert list(zip(*reader.squares.tokens(), strict=True)) == free


@given(texts)
def test_what_the_reader_gives_the_writer_takes(text):
    first, _ = column_of({0: text}, 1)
    second, _ = column_of({0: first[0]}, 1)
    assert same(second[0], text)


def test_documents_without_a_text_have_an_empty_one():
    text = random_text(np.random.default_rng(0), 9)
    reader, _ = column_of({1: text, 4: text}, 7)
    assert [len(row) for row in reader] == [0, 9, 0, 0, 9, 0, 0]
    assert same(reader[4], text)


@given(st.lists(st.integers(0, 3), max_size=300))
def test_long_runs_of_words(values):
    wa = np.array(sorted(values), dtype=np.int16)
    assert np.array_equal(unpack_words(pack_words(wa)), wa)


def test_a_keypoint_takes_less_than_three_bytes():
    rng = np.random.default_rng(1)
    rows = {n: random_text(rng, 330, span=100, words=60) for n in range(50)}
    _, size = column_of(rows, 50)
    assert size / (50 * 330) < 3


@pytest.mark.parametrize("documents, cut", [(1, 1), (2, 0)])
def test_damage_is_noticed(documents, cut):
    storage = RamStorage()
    file = storage.create_file("column")
    writer = KeypointColumn().writer(file)
    writer.add(0, random_text(np.random.default_rng(0), 9))
    writer.finish(1)
    file.close()
    size = storage.file_length("column")
    with pytest.raises(MapIndexError, match="damaged"):
        KeypointColumn().reader(storage.open_file("column"), 0, size - cut, documents)


def test_what_is_collected_on_disk_is_written_all_the_same(monkeypatch, tmp_path):
    """A writer holds little of a long column in memory, and leaves no file behind."""
    rng = np.random.default_rng(3)
    rows = {k: random_text(rng, int(rng.integers(0, 200)), span=200) for k in range(40)}
    whole, size = column_of(rows, 41)
    monkeypatch.setattr(column, "HELD", 256)
    monkeypatch.setattr(KeypointColumn.Writer, "folder", tmp_path)
    parts, in_parts = column_of(rows, 41)
    assert in_parts == size and not list(tmp_path.iterdir())
    assert all(same(parts[k], whole[k]) and same(parts[k], rows.get(k, whole[40])) for k in range(41))
