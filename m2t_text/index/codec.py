"""How a segment is stored: in columns, as Whoosh does it, but without all that it keeps in pickles.

Every map has one term in each indexed field, and that is the value of the field's column. So the postings
follow from the columns, and are not stored; nor are the stored fields, which are columns, too.
"""

import secrets
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import closing
from itertools import groupby
from pathlib import Path
from shutil import copyfileobj
from typing import Any

import numpy as np
from whoosh.codec.base import FieldWriter, TermsReader
from whoosh.codec.whoosh3 import W3Codec, W3PerDocReader, W3PerDocWriter, W3Segment
from whoosh.matching import ListMatcher
from whoosh.reading import TermInfo, TermNotFound

from m2t_text.description.document import map_id_of
from m2t_text.errors import DamageError
from m2t_text.index.schema import schema_columns
from m2t_text.index.storage.directory import MapStorage, fingerprint
from m2t_text.index.storage.segment_file import Part, SegmentFile

Term = tuple[str, bytes]

NAMES = ("dataset", "map_id")  # the fields with terms, in the order of terms


class MapSegment(W3Segment):
    """A segment as the table of contents names it, with what tells whether its file is as it was written.

    Attributes:
        size, digest: bytes and checksum of its file.
        maps: number of live maps of each dataset.
        parts: where each column lies in the file, by the name of its field.
    """

    def __init__(self, codec: W3Codec, indexname: str, **attributes: Any) -> None:
        super().__init__(codec, indexname, **attributes)
        self.size = 0
        self.digest = ""
        self.maps: dict[str, int] = {}
        self.parts: dict[str, Part] = {}

    @classmethod
    def _random_id(cls, size: int = 16) -> str:
        """Two segments must not share an id, also where programs seed their random numbers alike."""
        return secrets.token_hex(size // 2)

    def count(self, dataset: str, change: int) -> None:
        """Counts so many maps of a dataset more."""
        maps = self.maps.pop(dataset, 0) + change
        if maps:
            self.maps[dataset] = maps

    @property
    def filename(self) -> str:
        return str(self.make_filename(self.COMPOUND_EXT))

    def create_compound_file(self, storage: MapStorage) -> None:
        """Joins the files of the columns; Whoosh would write a directory of them, which is a pickle."""
        with closing(self.create_file(storage, self.COMPOUND_EXT)) as joined:
            for column in schema_columns():
                name = MapCodec.column_filename(self, column)
                self.parts[column] = (joined.tell(), storage.file_length(name))
                with storage.open_plain(name) as file:
                    copyfileobj(file, joined)
            self.size = joined.tell()
        for name in self.list_files(storage):
            if name != self.filename:
                storage.delete_file(name)
        with storage.open_plain(self.filename) as file:
            self.digest = fingerprint(file)

    def open_compound_file(self, storage: Any) -> SegmentFile:
        """Raises DamageError if the file cannot be what was written, as its size shows."""
        storage = MapStorage(Path(storage.folder))  # where Whoosh opens an index by itself, it has another one
        size = storage.file_length(self.filename)
        if size != self.size:
            raise DamageError(f"{self.filename} has {size} bytes instead of {self.size}")
        return self.open_columns(storage)

    def open_columns(self, storage: MapStorage) -> SegmentFile:
        """The columns, even if something else of the file is damaged; a DamageError if it is too short."""
        parts = {MapCodec.column_filename(self, name): part for name, part in self.parts.items()}
        with storage.open_plain(self.filename) as file:
            return SegmentFile(file, self.filename, parts)

    def is_sound(self, storage: MapStorage) -> bool:
        """Whether every byte of the file is as it was written."""
        with storage.open_plain(self.filename) as file:
            return fingerprint(file) == self.digest


class MapCodec(W3Codec):
    """Whoosh's codec with other readers and writers of what it would pickle."""

    length_stats = False

    def per_document_writer(self, storage: Any, segment: MapSegment) -> "MapDocWriter":
        return MapDocWriter(self, storage, segment)

    def per_document_reader(self, storage: Any, segment: MapSegment) -> "MapDocReader":
        return MapDocReader(storage, segment)

    def field_writer(self, storage: Any, segment: MapSegment) -> "NoTerms":
        return NoTerms()

    def terms_reader(self, storage: Any, segment: MapSegment) -> "MapTerms":
        return MapTerms(MapDocReader(storage, segment))

    def new_segment(self, storage: Any, indexname: str) -> MapSegment:
        return MapSegment(self, indexname)


class MapDocWriter(W3PerDocWriter):
    """Writes the columns of a segment, and counts the maps of each dataset."""

    def __init__(self, codec: MapCodec, storage: Any, segment: MapSegment) -> None:
        super().__init__(codec, storage, segment)
        self._fieldlengths: dict[str, int] = {}

    def add_field(self, fieldname: str, fieldobj: Any, value: Any, length: int) -> None:
        """Stored fields are columns, and no field has a length."""

    def add_column_value(self, fieldname: str, column: Any, value: Any) -> None:
        super().add_column_value(fieldname, column, value)
        if fieldname == "dataset":
            self._segment.count(value.decode(), 1)


class MapDocReader(W3PerDocReader):
    """Reads the columns of a segment. Raises DamageError if one is missing."""

    def __init__(self, storage: Any, segment: MapSegment) -> None:
        super().__init__(storage, segment)
        for name in schema_columns():
            if not self.has_column(name):
                raise DamageError(f"{segment.filename} has no column {name!r}")

    def stored(self, name: str) -> Any:
        """The reader of a column."""
        return self._cached_reader(name, schema_columns()[name])

    def name(self, field: str, docnum: int) -> str:
        """A map's id, or the name of its dataset."""
        dataset = str(self.stored("dataset")[docnum].decode())
        return dataset if field == "dataset" else map_id_of(dataset, int(self.first_scans()[docnum]))

    def first_scans(self) -> Any:
        """(D,) of each map, from the column that the maps themselves are read from."""
        return self.stored("record").array["first_scan"]

    def stored_fields(self, docnum: int) -> dict[str, Any]:
        return {field: self.name(field, docnum) for field in NAMES}


class NoTerms(FieldWriter):
    """Writes no postings: they follow from the columns."""

    is_closed = False

    def add_postings(self, schema: Any, lengths: Any, items: Any) -> None:
        """Leaves them."""

    def close(self) -> None:
        self.is_closed = True


class MapTerms(TermsReader):
    """The terms of the indexed fields of a segment, and the documents that have them."""

    def __init__(self, columns: MapDocReader) -> None:
        self._columns = columns
        self._terms: dict[str, list[bytes]] = {}

    def __contains__(self, term: Term) -> bool:
        return len(self._documents(*term)) > 0

    def indexed_field_names(self) -> tuple[str, ...]:
        return NAMES

    def terms(self) -> Iterator[Term]:
        for field in NAMES:
            yield from self.terms_from(field, b"")

    def terms_from(self, fieldname: str, prefix: bytes) -> Iterator[Term]:
        terms = self._sorted(fieldname)
        for text, _ in groupby(terms[bisect_left(terms, prefix) :]):
            yield fieldname, text

    def items(self) -> Iterator[tuple[Term, TermInfo]]:
        return ((term, self.term_info(*term)) for term in self.terms())

    def items_from(self, fieldname: str, prefix: bytes) -> Iterator[tuple[Term, TermInfo]]:
        return ((term, self.term_info(*term)) for term in self.terms_from(fieldname, prefix))

    def term_info(self, fieldname: str, text: bytes) -> TermInfo:
        found = self._documents(fieldname, text)
        if not found:
            raise TermNotFound(f"no term {fieldname}:{text!r}")
        return TermInfo(len(found), len(found), 0, 0, 1.0, found[0], found[-1])

    def frequency(self, fieldname: str, text: bytes) -> float:
        return float(self.doc_frequency(fieldname, text))

    def doc_frequency(self, fieldname: str, text: bytes) -> int:
        return len(self._documents(fieldname, text))

    def matcher(self, fieldname: str, text: bytes, format_: Any, scorer: Any = None) -> ListMatcher:
        info, found = self.term_info(fieldname, text), self._documents(fieldname, text)
        return ListMatcher(found, format=format_, scorer=scorer, term=(fieldname, text), terminfo=info)

    def _documents(self, fieldname: str, text: bytes) -> list[int]:
        """The documents with this name, ascending. A map's id is a dataset's name and a scan's number."""
        names = self._columns.stored("dataset")
        name = text.decode(errors="replace")
        if fieldname == "dataset":
            return np.flatnonzero(names.codes == names.code(name)).tolist()
        dataset, _, number = name.rpartition("/")
        if fieldname != "map_id" or not number.isdecimal() or map_id_of(dataset, int(number[:20])) != name:
            return []
        scans = self._columns.first_scans()
        return np.flatnonzero((scans == int(number)) & (names.codes == names.code(dataset))).tolist()

    def _sorted(self, fieldname: str) -> list[bytes]:
        """The names of all documents."""
        if fieldname not in self._terms:
            every = range(self._columns.doc_count_all())
            self._terms[fieldname] = sorted(self._columns.name(fieldname, number).encode() for number in every)
        return self._terms[fieldname]

    def close(self) -> None:
        self._columns.close()
