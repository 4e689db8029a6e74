"""How a segment is stored: in columns, as Whoosh does it, but without all that it keeps in pickles.

The terms of a map are its id, its dataset and the tokens of its text, which are columns, too. So the postings
follow from the columns, and are not stored; nor are stored fields, lengths and vectors.
"""

import secrets
from collections import Counter
from contextlib import closing
from functools import cached_property
from pathlib import Path
from shutil import copyfileobj
from typing import Any

import numpy as np
from numpy.typing import NDArray
from whoosh.codec.base import FieldWriter
from whoosh.codec.whoosh3 import W3Codec, W3PerDocReader, W3PerDocWriter, W3Segment

from m2t_text.description.document import map_id_of
from m2t_text.errors import DamageError
from m2t_text.index.column import KeypointColumn
from m2t_text.index.kernels.packed import MOST
from m2t_text.index.schema import schema_columns
from m2t_text.index.storage.directory import MapStorage, fingerprint
from m2t_text.index.storage.segment_file import Part, SegmentFile
from m2t_text.index.terms import NAMES, TEXT, MapTerms, TermMatcher, rounded


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
                if not storage.file_exists(name):  # no map was written
                    continue
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

    def _create_column(self, fieldname: str, column: Any) -> None:
        super()._create_column(fieldname, column)
        writer = self._colwriters[fieldname]
        if isinstance(writer, KeypointColumn.Writer):
            writer.folder = Path(self._storage.folder)  # what it collects lies on the disk of the index

    def add_field(self, fieldname: str, fieldobj: Any, value: Any, length: int) -> None:
        """Stored fields and lengths follow from the columns."""

    def add_vector_items(self, fieldname: str, fieldobj: Any, items: Any) -> None:
        """So do vectors."""

    def add_vector_matcher(self, fieldname: str, fieldobj: Any, vmatcher: Any) -> None:
        """So do vectors."""

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
        return dataset if field == "dataset" else map_id_of(dataset, int(self.first_scans[docnum]))

    @cached_property
    def first_scans(self) -> NDArray[np.int64]:
        """(D,) of each map, from the column that the maps themselves are read from."""
        return np.ascontiguousarray(self.stored("record").array["first_scan"])

    def stored_fields(self, docnum: int) -> dict[str, Any]:
        """Of a map; its text is a column alone, as it is long: ``hit["text"]`` reads it."""
        return {field: self.name(field, docnum) for field in NAMES}

    def lengths(self, fieldname: str) -> NDArray[np.int64]:
        """(D,) number of tokens of each map; no other field has a length."""
        return self._text_lengths if fieldname == TEXT else np.zeros(self.doc_count_all(), dtype=np.int64)

    @cached_property
    def _text_lengths(self) -> NDArray[np.int64]:
        column = self.stored(TEXT)
        counts: NDArray[np.int64] = column.texts.counts + column.squares.counts
        return counts

    def doc_field_length(self, docnum: int, fieldname: str, default: int = 0) -> int:
        length = int(self.lengths(fieldname)[docnum])
        return rounded(length) if length else default

    def field_length(self, fieldname: str) -> int:
        return int(self.lengths(fieldname).sum())

    def min_field_length(self, fieldname: str) -> int:
        return rounded(int(self.lengths(fieldname).min(initial=MOST)))

    def max_field_length(self, fieldname: str) -> int:
        return rounded(int(self.lengths(fieldname).max(initial=0)))

    def has_vector(self, docnum: int, fieldname: str) -> bool:
        return fieldname == TEXT

    def vector(self, docnum: int, fieldname: str, format_: Any) -> TermMatcher:
        """The tokens of one map, and how often it has each."""
        counts = Counter(str(self.stored(TEXT)[docnum]).split())
        tokens = sorted(counts)
        return TermMatcher(tokens, [counts[token] for token in tokens], format_)


class NoTerms(FieldWriter):
    """Writes no postings: they follow from the columns."""

    is_closed = False

    def add_postings(self, schema: Any, lengths: Any, items: Any) -> None:
        """Leaves them."""

    def close(self) -> None:
        self.is_closed = True
