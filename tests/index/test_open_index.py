"""Opening an index that may not be there: reading makes no folder, and a name that is misspelt is an error."""

from pathlib import Path

import pytest
from states import built

from m2t_text.config import PROFILES
from m2t_text.errors import MapIndexError
from m2t_text.index.map_index import MapIndex, open_index


def test_reading_what_is_not_there_makes_nothing(tmp_path: Path) -> None:
    index = open_index(tmp_path / "typo")
    with pytest.raises(MapIndexError, match=r"no index in .*typo"):
        len(index)
    assert not (tmp_path / "typo").exists()


def test_the_first_commit_makes_it(tmp_path: Path) -> None:
    index = open_index(tmp_path / "new" / "index", PROFILES["paper"])
    with index.writer():
        pass
    assert len(index) == 0 and MapIndex.open(index.path).parameters == PROFILES["paper"]


def test_an_index_prints_as_what_it_is(tmp_path: Path) -> None:
    path = tmp_path / "index"
    assert repr(open_index(path)) == f"MapIndex({str(path)!r}, not made yet, default)"
    held = len(built(path, {"a": 3}))
    assert repr(open_index(path)) == f"MapIndex({str(path)!r}, {held} maps, default)"
    for segment in path.glob("*.seg"):
        segment.write_bytes(b"")
    assert repr(open_index(path)) == f"MapIndex({str(path)!r}, unreadable, default)"
