"""The maps of a drive on their way into an index, while others search it, and what keeps the index bounded.

A robot that drives the same ways for days sees each place over and over. Where a place has its number of maps
already, a new one that looks as one of them does is left out, as it tells nothing new; one that looks otherwise
takes the place of the one that it is most like. So what changes comes in, and what differs stays.
"""

from collections.abc import Iterator
from functools import partial
from itertools import groupby

import numpy as np
from whoosh.query import And, Term

from m2t_text.description.document import Document
from m2t_text.index.map_index import MapIndex
from m2t_text.index.writing.folder import holds_index
from m2t_text.loops.lookup import known_before
from m2t_text.recognition.finding import VERIFIED, judge, verify_hits
from m2t_text.recognition.found import Found, differs
from m2t_text.recognition.queries import Query
from m2t_text.recognition.sequence import Trail

TOGETHER = 20  # maps that wait for each other, as a commit costs as much for one as for all
PLACE = 0.5  # m between two viewpoints of one place
EQUAL = 0.9  # inlier ratio from which two maps look the same


class GrowingDataset:
    """Collects the maps of an unfinished drive, and commits some together: each commit is durable.

    Args:
        index: that they are appended to; it may be new.
        name: of the dataset.
        keep_per_place: how many maps of a place are kept, those of one visit aside; None for all.
    """

    def __init__(self, index: MapIndex, name: str, keep_per_place: int | None = None) -> None:
        self.index = index
        self.name = name
        self._keep = keep_per_place
        self._waiting: list[Document] = []
        self._replaced: dict[str, Document] = {}  # by those that wait
        if not holds_index(index.path):
            with index.writer():
                pass  # it is made, so that it can be searched

    def add(self, document: Document) -> None:
        """Takes the next map. Raises MapIndexError if it cannot be kept."""
        if self._keep is not None and not self._is_kept(document, self._keep):
            return
        self._waiting.append(document)
        if len(self._waiting) >= TOGETHER:
            self.commit()

    def commit_up_to(self, travel: float) -> None:
        """Commits if the middle of a run that waits is not beyond so many metres of travel."""
        if self._waiting and self._waiting[0].middle <= travel:
            self.commit()

    def commit(self) -> None:
        """Commits all that wait. Raises MapIndexError if the disk refuses; they wait on then."""
        if self._waiting:
            self.index.append(self.name, self._waiting, self._replaced.values())
        self._waiting, self._replaced = [], {}

    def _is_kept(self, document: Document, most: int) -> bool:
        """Whether a map is kept; where its place has ``most`` already, one of them is to go for it."""
        if not len(self.index) or not len(document.text):
            return True
        there = list(same_place(self.index, document))
        if len(there) < most:
            return True
        if max(found.inlier_ratio or 0.0 for found in there) >= EQUAL:
            return False
        left = [found for found in there if found.hit.map_id not in self._replaced]
        if not left:
            return False
        alike = max(left, key=lambda found: (found.inlier_ratio or 0.0, found.hit.map_id))
        self._replaced[alike.hit.map_id] = alike.hit.document
        return True


def same_place(index: MapIndex, document: Document) -> Iterator[Found]:
    """The maps of an index that were seen from where a map was on other visits, as far as that is sure.

    Each dataset is judged by itself, as their frames are unrelated: it must have a `match`, and its maps that
    lie there count.
    """
    index, query = index.pinned(), Query.of(document)
    known = known_before(document)
    hits = [hit for hit in index.search(document.text, VERIFIED, filter=known, texts=True) if hit.score > 0]
    verified = sorted(verify_hits(index, query, hits), key=lambda found: found.hit.document.dataset)
    for name, group in groupby(verified, key=lambda found: found.hit.document.dataset):
        there = list(group)
        within = And([Term("dataset", name), known])
        search = partial(index.search, document.text, filter=within)
        if judge(index, query, there, search, Trail(())).verdict == "match":
            yield from (found for found in there if _seen_from_there(there[0], found))


def _seen_from_there(best: Found, found: Found) -> bool:
    assert found.alignment is not None
    return not differs(best, found) and bool(np.hypot(*found.alignment.pose[:2]) <= PLACE)
