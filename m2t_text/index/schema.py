"""The Whoosh schema of map documents; it carries the format version and the parameters of the index."""

import struct
from typing import Any
from zlib import crc32

import numpy as np
from whoosh.columns import Column, FixedBytesColumn, NumericColumn
from whoosh.fields import ID, FieldType, Schema
from whoosh.qparser.common import QueryParserError
from whoosh.query import Query

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.description.text import Text, parse
from m2t_text.errors import TextError
from m2t_text.index.column import KeypointColumn
from m2t_text.index.names import NameColumn
from m2t_text.index.parameters import from_json, to_json

FORMAT_VERSION = 2
RECORD = struct.Struct("<2q2d3d3d2dq")


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


class TextField(PlainField):
    """The texts of the maps. A typed token finds the maps with this word within the window of this position.

    Attributes:
        version: FORMAT_VERSION of the writer. It and the parameters are part of the index's table of contents,
            so that they change with the maps in one step, or not at all.
        stored_parameters: of the profile that the texts were made with, as JSON.
        drives: (scans, metres of travel) of each dataset's whole log, which its maps alone do not tell.
    """

    def __init__(self, parameters: Parameters) -> None:
        super().__init__(KeypointColumn())
        self.version = FORMAT_VERSION
        self.stored_parameters = to_json(parameters)
        self.drives: dict[str, tuple[int, float]] = {}

    @property
    def parameters(self) -> Parameters:
        return from_json(self.stored_parameters)

    def to_column_value(self, value: Text | str) -> Text:
        return value if isinstance(value, Text) else parse(value)

    def parse_query(self, fieldname: str, qstring: str, boost: float = 1.0) -> Query:
        """The maps with this token or a neighbour of it, in their own frame: not turned."""
        from m2t_text.index.query import MapQuery  # the kernel is slow to import, and only searching needs it

        try:
            return MapQuery(parse(qstring), fieldname, turns=(0,), boost=boost)
        except TextError as error:
            raise QueryParserError(str(error)) from error


class NumberField(PlainField):
    """Numbers in a column: `travel:12.5`, `travel:[10 to 20]`, and sorting."""

    def __init__(self, typecode: str) -> None:
        super().__init__(NumericColumn(typecode))
        self.number = float if typecode == "d" else int

    def to_column_value(self, value: float) -> float:
        return self.number(value)

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
        from m2t_text.index.query import NumberRange

        try:
            first, last = (None if bound is None else float(bound) for bound in (start, end))
        except ValueError as error:
            raise QueryParserError(f"{fieldname} takes numbers: {error}") from error
        return NumberRange(fieldname, first, last, startexcl, endexcl, boost)


class RecordColumn(FixedBytesColumn):
    """The records of the maps."""

    _fixedlen = RECORD.size
    _default = bytes(RECORD.size)

    def __init__(self) -> None:
        """Nothing differs between two of them, so nothing is pickled."""


STORED: dict[str, Column] = {"map_id": NameColumn(), "dataset": NameColumn(), "record": RecordColumn()}
NAMES = ("map_id", "dataset")  # the fields with terms


def schema(parameters: Parameters) -> Schema:
    """Fields of a map document: those to search by, the record that holds the rest, and its checksum."""
    return Schema(
        map_id=ID(unique=True, stored=True, sortable=STORED["map_id"]),
        dataset=ID(stored=True, sortable=STORED["dataset"]),
        first_scan=NumberField("q"),
        last_scan=NumberField("q"),
        travel=NumberField("d"),
        text=TextField(parameters),
        record=PlainField(STORED["record"], stored=True),
        checksum=NumberField("I"),
    )


def schema_columns() -> dict[str, Column]:
    """The columns of a segment, by the names of their fields."""
    fields = schema(Parameters()).items()
    return {name: field.column_type for name, field in fields if field.column_type is not None}


def to_fields(document: Document) -> dict[str, Any]:
    """What Whoosh's `add_document` takes; `from_fields` gives the document back exactly.

    The checksum is of all that the document holds. Merging copies it, so it tells of damage at any time since.
    """
    numbers = (document.travel, document.pose, document.viewpoint, document.centre_of_gravity)
    record = RECORD.pack(document.first_scan, document.last_scan, *np.concatenate(numbers), document.points)
    words = (document.text.wx, document.text.wy, document.text.wa)
    parts = (document.map_id.encode(), record, *(word.astype("<i2").tobytes() for word in words))
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


def from_fields(stored: dict[str, Any], text: Text) -> Document:
    """The document of these stored fields and text."""
    first, last, *numbers, points = RECORD.unpack(stored["record"])
    travel, pose, viewpoint, centre = np.split(np.array(numbers), [2, 5, 8])
    return Document(stored["dataset"], first, last, travel, pose, viewpoint, centre, points, text)
