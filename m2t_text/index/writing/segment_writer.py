"""Whoosh's writer and index, so that what is committed stays, and what is not leaves nothing."""

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

from whoosh.index import TOC, FileIndex
from whoosh.writing import SegmentWriter

from m2t_text.index.codec import MapCodec
from m2t_text.index.storage.directory import MapStorage, flush
from m2t_text.index.writing.lock import clean, locked
from m2t_text.index.writing.toc import INDEX, generation, latest, write


class SafeIndex(FileIndex):
    """A Whoosh index that reads its files with distrust, and writes them to last.

    Raises:
        DamageError: if its table of contents is damaged; see `contents`.
    """

    def __init__(self, storage: MapStorage) -> None:
        self.storage = storage
        self.indexname = INDEX
        self._schema = None
        self._read_toc()

    def latest_generation(self) -> int:
        return generation(self.storage)

    def _read_toc(self) -> TOC:
        return latest(self.storage)

    def writer(self, timeout: float = 0.0) -> "SegmentMaker":
        """A Whoosh writer; see `SegmentMaker`."""
        return SegmentMaker(MapStorage(self.storage.path), timeout)


class NoPostings:
    """Collects no postings: they follow from the columns, and would take a third of a kilobyte a map."""

    def add(self, item: Any) -> None:
        """Leaves it."""

    def iter_postings(self) -> Iterator[Any]:
        return iter(())

    def cleanup(self) -> None:
        """There is nothing to clean up."""


class SegmentMaker(SegmentWriter):
    """Makes one segment of what is added and merged, and commits it.

    What a killed writer left is removed at the beginning, and what is not committed at the end.

    Args:
        storage: of this writer alone.
        timeout: seconds to wait for another writer.

    Raises:
        MapIndexError: if another one keeps writing.
        OSError: if the disk refuses, then or later.
    """

    def __init__(self, storage: MapStorage, timeout: float) -> None:
        with ExitStack() as ending:
            ending.enter_context(locked(storage.path, timeout))
            clean(storage)
            ending.callback(clean, storage)
            self._searcher: Any = None
            super().__init__(SafeIndex(storage), _lk=False, codec=MapCodec())
            self.pool = NoPostings()
            self._ending = ending.pop_all()

    def add_postings_to_pool(self, reader: Any, startdoc: int, docmap: Any) -> None:
        """They follow from the columns; see `codec`."""

    def delete_document(self, docnum: int, delete: bool = True) -> None:
        """Deletes a document, and counts it off: a segment knows how many live maps each dataset has in it."""
        segment, number = self._segment_and_docnum(docnum)
        if not segment.is_deleted(number):
            segment.count(self.searcher().stored_fields(docnum)["dataset"], -1)
        super().delete_document(docnum, delete)

    def _commit_toc(self, segments: list[Any]) -> None:
        """What the table of contents names is on disk before it is, with its name; then the table itself."""
        segments = [segment for segment in segments if segment.doc_count_all()]
        if self.newsegment in segments:
            flush(self.storage.path / self.newsegment.filename)
        flush(self.storage.path)
        write(self.storage, TOC(self.schema, segments, self.generation))

    def cancel(self) -> None:
        """Forgets all changes. Whoosh would write them out first, and the disk may be full."""
        self._finish()

    def _finish(self) -> None:
        searcher, self._searcher = self._searcher, None
        if searcher is not None:
            searcher._orig_close()
        self.is_closed = True
        self._ending.close()
