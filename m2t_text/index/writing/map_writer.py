"""Putting documents into an index: checked before Whoosh sees them, and merged so that segments stay few."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
from whoosh.query import And, Term

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.description.text import WORDS, Text
from m2t_text.errors import MapIndexError, SourceError
from m2t_text.index.codec import MapSegment
from m2t_text.index.kernels.packed import MOST
from m2t_text.index.schema import to_fields
from m2t_text.index.search.query import NumberRange
from m2t_text.index.writing.folder import damage_errors, open_whoosh
from m2t_text.index.writing.merge_policy import merge_all, merge_small
from m2t_text.index.writing.segment_writer import SegmentMaker
from m2t_text.util.names import checked_name


@contextmanager
def open_writer(folder: Path, parameters: Parameters, seconds: float) -> Iterator["MapWriter"]:
    """Changes to an index that are committed together when the block ends, or not at all if it raises.

    What a killed writer left is removed first. After a failure nothing is left of what was not committed.

    Args:
        parameters: of the index; an empty one takes them.
        seconds: to wait for another writer.

    Raises:
        MapIndexError: if another process keeps writing, the index has other parameters, or the disk refuses.
    """
    whoosh, _ = open_whoosh(folder)
    with damage_errors(folder), disk_errors(folder):
        maker = whoosh.writer(seconds)
    try:
        field = maker.schema["text"]
        if field.parameters != parameters and maker.segments:
            raise other_parameters(folder, field.parameters, parameters)
        field.parameters = parameters
        writer = MapWriter(maker, folder)
        yield writer
        writer.commit()
    finally:
        if not maker.is_closed:
            maker.cancel()


@contextmanager
def disk_errors(folder: Path) -> Iterator[None]:
    """A disk that refuses is a MapIndexError."""
    try:
        yield
    except OSError as error:
        raise MapIndexError(f"cannot write to {folder}: {error.strerror or error}") from error


def other_parameters(folder: Path | str, stored: Parameters, wanted: Parameters) -> MapIndexError:
    """What to tell who asks for a profile that an index does not have."""
    return MapIndexError(
        f"the index in {folder} was made with other parameters (profile {stored.profile!r}, asked for "
        f"{wanted.profile!r}); choose another folder or profile"
    )


class MapWriter:
    """Collects changes to an index for one commit; `open_writer` makes one."""

    def __init__(self, whoosh: SegmentMaker, path: Path) -> None:
        self._whoosh = whoosh
        self._path = path
        self._replaced: set[str] = set()
        self._drives = whoosh.schema["text"].drives  # written with the table of contents, if it is
        self.optimize = False
        self.progress: Callable[[int], None] | None = None

    def replace(self, name: str, documents: Iterable[Document], drive: tuple[int, float] | None = None) -> None:
        """These documents instead of all that the dataset had.

        Args:
            name: of the dataset.
            documents: taken one by one.
            drive: scans and metres of travel of the whole log; None to count up to the end of the last map.

        Raises:
            MapIndexError: if a document cannot be kept, or the dataset is replaced twice in one commit.
        """
        self.remove(name)
        seen: set[int] = set()
        scans, metres = drive or (0, 0.0)
        for document in documents:
            check(document, name)
            if document.first_scan in seen:
                raise MapIndexError(f"two maps have the id {document.map_id!r}")
            seen.add(document.first_scan)
            self._add(document)
            if drive is None:
                scans, metres = max(scans, document.last_scan + 1), max(metres, float(document.travel[1]))
        if seen:
            self._drives[name] = (int(scans), float(metres))

    def append(self, name: str, documents: Iterable[Document], last: int = -1) -> None:
        """These documents besides those that the dataset has.

        Args:
            name: of the dataset.
            documents: in the order of their first scans.
            last: first scan of the last map that the dataset has.

        Raises:
            MapIndexError: if a document cannot be kept, or does not come after those before it.
        """
        scans, metres = self._drives.get(name, (0, 0.0))
        for document in documents:
            check(document, name)
            if document.first_scan <= last:
                raise MapIndexError(
                    f"map {document.map_id!r} cannot be appended: dataset {name!r} has maps up to scan {last}"
                )
            last = document.first_scan
            self._add(document)
            scans, metres = max(scans, document.last_scan + 1), max(metres, float(document.travel[1]))
            self._drives[name] = (int(scans), float(metres))

    def _add(self, document: Document) -> None:
        with disk_errors(self._path):
            self._whoosh.add_document(**to_fields(document))

    def rebuild(self, segment: MapSegment, documents: Iterable[Document]) -> None:
        """These documents, which are left of a damaged segment, instead of it."""
        self._whoosh.segments.remove(segment)
        for document in documents:
            check(document, document.dataset)
            self._add(document)
        left = {name for one in (*self._whoosh.segments, self._whoosh.newsegment) for name in one.maps}
        for name in set(self._drives) - left:
            del self._drives[name]

    def remove(self, name: str) -> None:
        """Removes all maps of a dataset."""
        if name in self._replaced:  # Whoosh cannot delete what is not committed yet
            raise MapIndexError(f"dataset {name!r} is replaced twice in one commit")
        self._replaced.add(name)
        self._drives.pop(name, None)
        with damage_errors(self._path):
            self._whoosh.delete_by_query(Term("dataset", name))

    def remove_map(self, document: Document) -> None:
        """Removes one map that was committed before."""
        scan = document.first_scan
        one = And([Term("dataset", document.dataset), NumberRange("first_scan", scan, scan)])
        with damage_errors(self._path):
            self._whoosh.delete_by_query(one)

    def commit(self) -> None:
        """Makes all changes visible at once.

        ``progress`` is called with the number of maps in the new segment while old ones are merged into it.
        """
        policy = merge_all if self.optimize else merge_small
        with disk_errors(self._path):
            self._whoosh.commit(mergetype=partial(policy, progress=self.progress))


def check(document: Document, name: str) -> None:
    """Raises MapIndexError unless the document can be stored and found: Whoosh does not survive an error in its
    `add_document`, which leaves terms behind that stick to the next document."""
    if document.dataset != name:
        raise MapIndexError(f"a map of dataset {document.dataset!r} cannot be put into dataset {name!r}")
    try:
        checked_name(name)
    except SourceError as error:
        raise MapIndexError(str(error)) from error
    scans = (document.first_scan, document.last_scan, document.points)
    if not all(isinstance(number, int | np.integer) and 0 <= number < 2**62 for number in scans):
        raise MapIndexError(f"a map of dataset {name!r} has broken scan numbers or points: {scans}")
    parts = ((document.travel, 2), (document.pose, 3), (document.viewpoint, 3), (document.centre_of_gravity, 2))
    for numbers, size in parts:
        if np.shape(numbers) != (size,) or not np.isfinite(numbers).all():
            raise MapIndexError(f"map {document.map_id!r} has numbers that are missing or not finite")
    if not isinstance(document.text, Text) or not in_order(document.text):
        raise MapIndexError(
            f"map {document.map_id!r} has no text of ordered words and squares; make it with Text.of"
        )
    if max(len(document.text), len(document.text.free)) > MOST:
        raise MapIndexError(f"map {document.map_id!r} has {len(document.text):,} keypoints, more than {MOST:,}")


def in_order(text: Text) -> bool:
    """Whether a text is what `Text.of` makes."""
    arrays = (text.wx, text.wy, text.wa)
    same = all(array.dtype == np.int16 and array.shape == text.wa.shape for array in arrays)
    return (
        same
        and (not len(text) or bool(text.wa[0] >= 0 and text.wa[-1] < WORDS and (np.diff(text.wa) >= 0).all()))
        and text.free.valid
        and not text.contradicts_itself
    )
