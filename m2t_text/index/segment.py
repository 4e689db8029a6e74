"""One segment of a committed state, and where its maps lie."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from whoosh.reading import TermNotFound

from m2t_text.description.document import Document, map_id_of
from m2t_text.description.text import Text
from m2t_text.index.schema import from_record
from m2t_text.index.search.collection import live_documents

EMPTY = Text.of([], [], [])


class Segment:
    """One segment of a state; its arrays are over all its documents, deleted ones too."""

    def __init__(self, searcher: Any, offset: int) -> None:
        self.reader = searcher.reader()
        self.name = str(self.reader.segment().segment_id())
        self.offset = offset
        self.live = live_documents(self.reader)

    def open(self) -> None:
        """Opens the texts; raises DamageError if they are damaged."""
        self.texts  # noqa: B018

    def number_of(self, map_id: str) -> int | None:
        """The number of the live map of this id, or None."""
        try:
            return int(self.reader.first_id("map_id", map_id))
        except (TermNotFound, UnicodeEncodeError):
            return None

    @cached_property
    def texts(self) -> Any:
        """The column of the texts."""
        return self.reader.column_reader("text", translate=False)

    @cached_property
    def records(self) -> NDArray[Any]:
        """(D,) what is known of each map."""
        return self.reader.column_reader("record", translate=False).array

    @cached_property
    def datasets(self) -> Any:
        """The column of the datasets' names."""
        return self.reader.column_reader("dataset", translate=False)

    def ids(self) -> list[str]:
        """The ids of all documents."""
        names, codes = self.datasets.names, self.datasets.codes.tolist()
        scans = self.records["first_scan"].tolist()
        return [map_id_of(names[code], scan) for code, scan in zip(codes, scans, strict=True)]

    def of_dataset(self, name: str) -> NDArray[np.bool_]:
        """(D,) which documents belong to a dataset."""
        return self.datasets.codes == self.datasets.code(name)

    @cached_property
    def middles(self) -> NDArray[np.float64]:
        """(D,) travel at the middle of each map, metres."""
        return self.reader.column_reader("travel", translate=False).array


@dataclass(frozen=True)
class Address:
    """Where a map lies: its segment, and its number there."""

    segment: Segment
    number: int

    @property
    def dataset(self) -> str:
        """The name of the map's dataset."""
        return str(self.segment.datasets.names[self.segment.datasets.codes[self.number]])

    @property
    def map_id(self) -> str:
        """The map's id."""
        return map_id_of(self.dataset, int(self.segment.records["first_scan"][self.number]))

    def document(self, text: bool = False) -> Document:
        """The map, with its text or an empty one."""
        segment, number = self.segment, self.number
        return from_record(self.dataset, segment.records[number], segment.texts[number] if text else EMPTY)
