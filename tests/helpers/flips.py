"""Single flipped bytes in an index: what `check` says of them, what readers do, and what repair saves."""

import random
from pathlib import Path
from typing import Any

import children
from map_oracle import random_documents
from states import Contents, contents, copied

from m2t_text.errors import MapIndexError
from m2t_text.index.integrity.check import check_index, repair_index
from m2t_text.index.map_index import MapIndex

REPAIRED = 10  # one in so many is repaired, too


def flip(index: MapIndex, path: Path, count: int, seed: int) -> dict[str, int]:
    """Flips bytes one after the other in copies of an index, in a process of their own.

    Returns how many there were, how many `check` found, how many it did not find that change no answer, how
    many indexes were repaired, and how many of those had lost nothing.
    """
    return dict(children.call(_flip, index, _answers(index), path, count, seed))


def _flip(index: MapIndex, before: Any, path: Path, count: int, seed: int) -> dict[str, int]:
    rng, counts = random.Random(seed), dict.fromkeys(("flips", "found", "harmless", "repaired", "whole"), 0)
    held, copy = contents(index), copied(index, path)
    files = [file for file in sorted(copy.path.iterdir()) if file.stat().st_size]
    for number in range(count):
        file = rng.choice(files)
        whole = file.read_bytes()
        place = rng.randrange(len(whole))
        flipped = whole[place] ^ rng.randrange(1, 256)
        file.write_bytes(whole[:place] + bytes([flipped]) + whole[place + 1 :])
        counts["flips"] += 1
        found, answers = not check_index(path).sound, _answers_of(path)
        counts["found"] += found
        counts["harmless"] += not found and answers == before
        if number % REPAIRED == 0:
            left = _repaired(path)
            assert left.items() <= held.items()
            counts["repaired"] += 1
            counts["whole"] += left == held
            copied(index, path)
        else:
            file.write_bytes(whole)
    return counts


def _answers_of(path: Path) -> Any:
    """The answers, or the one clear line that readers get instead. Anything else is an error."""
    try:
        return _answers(MapIndex.open(path))
    except MapIndexError as error:
        assert str(error).isprintable() and str(path) in str(error)
        return None


def _answers(index: MapIndex) -> Any:
    """All that an index can be asked."""
    texts = [one.text for one in random_documents(1, "query", 3, 20)]
    hits = [(hit.map_id, hit.score, hit.matched) for text in texts for hit in index.search(text, top=0)]
    return hits, index.datasets(), contents(index)


def _repaired(path: Path) -> Contents:
    """What an index holds after its repair; what is lost must be what was told."""
    lost = sum(dataset.lost for dataset in check_index(path).datasets)
    maps = sum(dataset.maps for dataset in check_index(path).datasets)
    repair_index(path, 1.0)
    after = check_index(path)
    assert after.sound and sum(dataset.maps for dataset in after.datasets) == maps
    left = contents(MapIndex.open(path))
    assert len(left) == maps and (lost or not after.leftovers)
    return left
