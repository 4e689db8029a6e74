"""The Whoosh schema of map documents; it carries the parameters of the index."""

from collections.abc import Iterator
from functools import cache
from typing import Any
from zlib import crc32

import numpy as np
from whoosh.analysis import SpaceSeparatedTokenizer
from whoosh.columns import Column
from whoosh.fields import ID, FieldType, Schema
from whoosh.formats import Frequency
from whoosh.qparser.common import QueryParserError
from whoosh.query import Query

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.description.text import Text, parse
from m2t_text.errors import DamageError
from m2t_text.index.column import ArrayColumn, KeypointColumn, NameColumn

RECORD: list[Any] = [
    ("first_scan", "<i8"),
    ("last_scan", "<i8"),
    ("travel", "<f8", (2,)),
    ("pose", "<f8", (3,)),
    ("viewpoint", "<f8", (3,)),
    ("centre_of_gravity", "<f8", (2,)),
    ("points", "<i8"),
]


class PlainField(FieldType):
    """A field without postings, each of which costs Whoosh 60 µs and more to write; it may have a column."""

    indexed = False
    analyzer = format = vector = None
    scorable = unique = False
    multitoken_query = "default"

    def __init__(self, column: Any = None, stored: bool = False) -> None:
        self.column_type = column
        self.stored = stored

    def self_parsing(self) -> bool:
        return True

    def supports(self, name: str) -> bool:
        return False

    def from_column_value(self, value: Any) -> Any:
        return value

    def parse_query(self, fieldname: str, qstring: str, boost: float = 1.0) -> Query:
        """Raises QueryParserError, as Whoosh expects, for what is not to be looked up in this field."""
        raise QueryParserError(f"{fieldname!r} cannot be searched")

    def process_text(self, qstring: str, mode: str = "", **kwargs: Any) -> Any:
        """What the parser asks for phrases and ranges of words, which have no meaning here."""
        raise QueryParserError(f"{qstring!r} is not something to look up in this field")


class TokenFormat(Frequency):
    """Of the tokens of a text; those of a `Text` need not be listed, as they follow from the column."""

    def word_values(
        self, value: Any, analyzer: Any, **kwargs: Any
    ) -> Iterator[tuple[bytes, int, float, bytes]]:
        return iter(()) if isinstance(value, Text) else super().word_values(value, analyzer, **kwargs)


class TextField(FieldType):
    """The texts of the maps: each token is a term, as if Whoosh had split the text at its blanks.

    ``hit["text"]`` is the text of a map.

    Attributes:
        parameters: of the profile that the texts were made with. They are part of the table of contents, so
            that they change with the maps in one step, or not at all.
        drives: (scans, metres of travel) of each dataset's whole log, which its maps alone do not tell.
    """

    def __init__(self, parameters: Parameters) -> None:
        self.format = self.vector = TokenFormat()
        self.analyzer = SpaceSeparatedTokenizer()
        self.column_type = KeypointColumn()
        self.scorable, self.stored, self.unique = True, False, False
        self.parameters = parameters
        self.drives: dict[str, tuple[int, float]] = {}

    def index(self, value: Any, **kwargs: Any) -> Iterator[tuple[bytes, int, float, bytes]]:
        return iter(()) if isinstance(value, Text) else super().index(value, **kwargs)

    def to_column_value(self, value: Text | str) -> Text:
        return value if isinstance(value, Text) else parse(value)

    def from_column_value(self, value: Text) -> str:
        return str(value)


class RecordField(PlainField):
    """All that is known of a map beside its text, in one column."""

    def to_column_value(self, value: Any) -> Any:
        return value


class NumberField(PlainField):
    """Numbers in a column: `travel:12.5`, `travel:[10 to 20]`, and sorting."""

    def __init__(self, dtype: str) -> None:
        super().__init__(ArrayColumn(dtype))

    def to_column_value(self, value: float) -> float:
        return value

    def parse_query(self, fieldname: str, qstring: str, boost: float = 1.0) -> Query:
        return self.parse_range(fieldname, qstring, qstring, False, False, boost)

    def parse_range(
        self,
        fieldname: str,
        start: str | None,
        end: str | None,
        startexcl: bool,
        endexcl: bool,
        boost: float = 1.0,
    ) -> Query:
        from m2t_text.index.search.query import NumberRange

        try:
            first, last = (None if bound is None else float(bound) for bound in (start, end))
        except ValueError as error:
            raise QueryParserError(f"{fieldname} takes numbers: {error}") from error
        return NumberRange(fieldname, first, last, startexcl, endexcl, boost)


def schema(parameters: Parameters) -> Schema:
    """Fields of a map document: those to search by, the record that holds the rest, and its checksum."""
    return Schema(
        map_id=ID(unique=True, stored=True),
        dataset=ID(stored=True, sortable=NameColumn()),
        first_scan=NumberField("<i8"),
        last_scan=NumberField("<i8"),
        travel=NumberField("<f8"),
        text=TextField(parameters),
        record=RecordField(ArrayColumn(RECORD)),
        checksum=NumberField("<u4"),
    )


@cache
def schema_columns() -> dict[str, Column]:
    """The columns of a segment, by the names of their fields."""
    fields = schema(Parameters()).items()
    return {name: field.column_type for name, field in fields if field.column_type is not None}


def to_fields(document: Document) -> dict[str, Any]:
    """What Whoosh's `add_document` takes; `from_record` gives the document back exactly.

    The checksum is of all that the document holds. Merging copies it, so it shows damage at any time since.
    """
    record = tuple(getattr(document, name) for name in np.dtype(RECORD).names or ())
    text, free = document.text, document.text.free
    words = (text.wx, text.wy, text.wa, free.wx, free.wy, free.size)
    numbers = np.array(record, dtype=RECORD).tobytes()
    parts = (document.map_id.encode(), numbers, *(word.astype("<i2").tobytes() for word in words))
    return {
        "map_id": document.map_id,
        "dataset": document.dataset,
        "first_scan": document.first_scan,
        "last_scan": document.last_scan,
        "travel": document.middle,
        "text": document.text,
        "record": record,
        "checksum": crc32(b"".join(parts)),
    }


def from_record(dataset: str, record: Any, text: Text) -> Document:
    """The document of this row of the column of records.

    Raises:
        DamageError: if its numbers are not finite, or its counts negative.
    """
    first, last, travel, pose, viewpoint, centre, points = record
    numbers = (travel, pose, viewpoint, centre)
    if min(first, last, points) < 0 or not np.isfinite(np.concatenate(numbers)).all():
        raise DamageError("the records of the maps are damaged")
    arrays = map(np.array, numbers)
    return Document(dataset, int(first), int(last), *arrays, int(points), text)  # type: ignore[arg-type, call-arg]
