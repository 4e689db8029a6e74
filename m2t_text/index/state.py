"""One committed state of an index, as arrays over its maps."""

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from whoosh.query import Query

from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.index.schema import from_fields

if TYPE_CHECKING:  # the compiled kernel is slow to import, and only searching needs it
    from m2t_text.index.weighting import MapWeighting, Scores


class State:
    """One committed state of an index. Arrays are in the order of map ids, and hold live maps only."""

    def __init__(self, searcher: Any) -> None:
        self.searcher = searcher
        self._columns: dict[str, NDArray[Any]] = {}
        self._latest: tuple[Text, MapWeighting, Scores] | None = None
        self._leaves = [(leaf, offset) for leaf, offset in searcher.leaf_searchers() if leaf.doc_count_all()]
        self._numbers = np.array(sorted(searcher.reader().all_doc_ids()), dtype=np.int64)
        names = np.array(self._column("map_id", translate=True), dtype=object)[self._numbers]
        order = np.argsort(names, kind="stable")
        self.ids: list[str] = names[order].tolist()
        self._numbers = self._numbers[order]

    @cached_property
    def datasets(self) -> NDArray[Any]:
        """(maps,) the dataset of each map."""
        return np.array([map_id.rpartition("/")[0] for map_id in self.ids], dtype=object)

    @cached_property
    def keypoints(self) -> NDArray[np.int64]:
        """(maps,) number of keypoints of each map."""
        columns = [leaf.reader().column_reader("text", translate=False) for leaf, _ in self._leaves]
        counts = [column.counts() for column in columns]
        return np.concatenate([np.zeros(0, dtype=np.int64), *counts])[self._numbers]

    def column(self, name: str) -> NDArray[Any]:
        """(maps,) the numbers of a column, read once."""
        if name not in self._columns:
            self._columns[name] = np.array(self._column(name))[self._numbers]
        return self._columns[name]

    def _column(self, name: str, translate: bool = False) -> list[Any]:
        """The values of all documents, also deleted ones."""
        readers = [leaf.reader().column_reader(name, translate=translate) for leaf, _ in self._leaves]
        return [value for reader in readers for value in reader]

    def scores(self, text: Text, model: "MapWeighting") -> "Scores":
        """How well the text fits each map. The latest answer is kept for whoever asks the same again."""
        from m2t_text.index.weighting import Scores

        if self._latest is not None and self._latest[0] is text and self._latest[1] == model:
            return self._latest[2]
        parts = [model.scorer(leaf, "text", text).scores for leaf, _ in self._leaves]
        scores = Scores.joined(parts)[self._numbers]
        self._latest = (text, model, scores)
        return scores

    def matching(self, query: Query) -> NDArray[np.bool_]:
        """(maps,) whether a Whoosh query matches."""
        matches = np.zeros(self.searcher.doc_count_all(), dtype=np.bool_)
        matches[list(self.searcher.docs_for_query(query))] = True
        return matches[self._numbers]

    def document(self, map_id: str) -> Document | None:
        """The map of this id with its text, or None."""
        number = self.searcher.document_number(map_id=map_id)
        return None if number is None else self._read(number, text=True)

    def read(self, place: int, text: bool = False) -> Document:
        """The map at a place in the order of ids."""
        return self._read(int(self._numbers[place]), text)

    def _read(self, number: int, text: bool) -> Document:
        leaf, offset = next((leaf, offset) for leaf, offset in reversed(self._leaves) if offset <= number)
        stored = leaf.stored_fields(number - offset)
        words = (
            leaf.reader().column_reader("text", translate=False)[number - offset]
            if text
            else Text.of([], [], [])
        )
        return from_fields(stored, words)
