"""Reading a segment that may be damaged, map by map: each is verified by its own checksum."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.errors import MapIndexError
from m2t_text.index.codec import MapCodec, MapSegment
from m2t_text.index.schema import from_record, schema_columns, to_fields
from m2t_text.index.storage.directory import MapStorage

BROKEN = (MapIndexError, ValueError, TypeError, LookupError, NameError, OverflowError, struct.error)


@dataclass(frozen=True)
class Salvaged:
    """One live map of a segment.

    Attributes:
        document: None if it is lost.
        exact: whether all that is stored of it is right, also what follows from the rest.
    """

    document: Document | None
    exact: bool


def maps_of(storage: MapStorage, segment: MapSegment) -> Iterator[Salvaged]:
    """All live maps of a segment; those that cannot be verified are lost."""
    columns = _columns(storage, segment)
    for number in range(segment.doc_count_all()):
        if not segment.is_deleted(number):
            stored = {name: _value(column, number) for name, column in columns.items()}
            document = _verified(stored, segment)
            yield Salvaged(document, document is not None and _exact(document, stored))


def _columns(storage: MapStorage, segment: MapSegment) -> dict[str, Any]:
    """The readers of all columns that can be opened."""
    readers: dict[str, Any] = {}
    try:
        parts = segment.open_columns(storage)
    except (*BROKEN, OSError):
        return readers
    for name, column in schema_columns().items():
        try:
            part = MapCodec.column_filename(segment, name)
            size = parts.file_length(part)
            readers[name] = column.reader(parts.open_file(part), 0, size, segment.doc_count_all())
        except BROKEN:
            continue
    return readers


def _value(column: Any, number: int) -> Any:
    try:
        return column[number]
    except BROKEN:
        return None


def _verified(stored: dict[str, Any], segment: MapSegment) -> Document | None:
    """The document that has the stored checksum. The segment knows its datasets, too."""
    record, text = stored.get("record"), stored.get("text")
    if record is None or not isinstance(text, Text):
        return None
    for name in (_text(stored.get("dataset")), *segment.maps):
        try:
            document = from_record(name, record, text)
            if name in segment.maps and to_fields(document)["checksum"] == stored.get("checksum"):
                return document
        except BROKEN:
            continue
    return None


def _exact(document: Document, stored: dict[str, Any]) -> bool:
    """Whether all columns hold what the document says."""
    fields = to_fields(document)
    numbers = all(stored.get(name) == fields[name] for name in ("first_scan", "last_scan", "travel"))
    return numbers and stored.get("dataset") == document.dataset.encode()


def _text(name: Any) -> str:
    return name.decode(errors="replace") if isinstance(name, bytes) else ""
