"""Which segments a commit merges, so that they stay few."""

import logging
from collections.abc import Callable, Iterator
from typing import Any

from whoosh.reading import SegmentReader

DEAD = 0.25  # share of deleted documents from which a segment is written anew

log = logging.getLogger(__name__)


def merge_small(writer: Any, segments: list[Any], progress: Callable[[int], None] | None = None) -> list[Any]:
    """A merge policy of Whoosh: takes in every segment no larger than what is new, or with many deletions.

    Each segment that stays is larger than all later ones together, so their number grows with the logarithm
    of the maps, and so does the number of times that a map is copied.
    """
    fresh = writer.doc_count()
    kept = []
    for segment in sorted(segments, key=live):
        wanted = live(segment) <= fresh or segment.deleted_count() > DEAD * segment.doc_count_all()
        if wanted and _take_in(writer, segment, progress):
            fresh += live(segment)
        else:
            kept.append(segment)
    return kept[::-1]


def merge_all(writer: Any, segments: list[Any], progress: Callable[[int], None] | None = None) -> list[Any]:
    """A merge policy of Whoosh: one segment without deletions."""
    if len(segments) == 1 and not segments[0].has_deletions() and not writer.doc_count():
        return segments
    return [segment for segment in segments if not _take_in(writer, segment, progress)]


def _take_in(writer: Any, segment: Any, progress: Callable[[int], None] | None) -> bool:
    """Copies the live documents of a segment, unless it is damaged: the copy would look whole."""
    if not live(segment):
        return True
    if not segment.is_sound(writer.storage):
        log.warning("%s is damaged and was left as it is; `m2t-text check` says what is lost", segment.filename)
        return False
    reader = _WatchedReader(writer.storage, writer.schema, segment)
    reader.watch = (lambda: progress(writer.doc_count())) if progress is not None else None
    writer.add_reader(reader)
    reader.close()
    return True


class _WatchedReader(SegmentReader):
    """A reader that reports each document copied from it."""

    watch: Callable[[], None] | None = None

    def iter_docs(self) -> Iterator[Any]:
        for document in super().iter_docs():
            yield document
            if self.watch is not None:
                self.watch()

    def has_vector(self, docnum: int, fieldname: str) -> bool:
        """They follow from the columns, and are not copied."""
        return False


def live(segment: Any) -> int:
    """Number of documents of a segment that are not deleted."""
    return int(segment.doc_count_all() - segment.deleted_count())
