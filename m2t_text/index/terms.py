"""The terms of a segment, as Whoosh asks for them: names of maps and datasets, and the tokens of the texts."""

import heapq
from bisect import bisect_left
from collections.abc import Iterator
from copy import copy
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray
from whoosh.codec.base import TermsReader
from whoosh.matching import ListMatcher, ReadTooFar
from whoosh.reading import TermInfo, TermNotFound
from whoosh.system import pack_uint
from whoosh.util.numeric import byte_to_length, length_to_byte

from m2t_text.description.document import map_id_of
from m2t_text.index.postings import TokenTerms

Term = tuple[str, bytes]

NAMES = ("dataset", "map_id")  # the fields with one term a map, in the order of terms
TEXT = "text"  # the field with one term a token, after them


def rounded(length: int) -> int:
    """The length of a field of a document as Whoosh knows it: it keeps one byte of it."""
    return int(byte_to_length(length_to_byte(length)))


def _counted(documents: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Ascending documents, each once, and how often each is there."""
    begins = np.flatnonzero(np.diff(documents, prepend=-1))
    return documents[begins], np.diff(begins, append=len(documents))


class TermMatcher(ListMatcher):
    """Postings that are at hand. Whoosh's own class looks at each of them, and its copies forget the term."""

    def __init__(
        self,
        ids: list[Any],
        counts: list[int],
        format_: Any,
        scorer: Any = None,
        term: Any = None,
        info: Any = None,
    ) -> None:
        values = [pack_uint(count) for count in counts]
        super().__init__(ids, counts, values, format_, scorer, term=term, terminfo=info)

    def copy(self) -> "TermMatcher":
        return copy(self)

    def skip_to(self, id: int) -> None:
        if not self.is_active():
            raise ReadTooFar
        self._i: int = bisect_left(self._ids, id, self._i)

    def supports_block_quality(self) -> bool:
        """All postings are one block, so that nothing could be skipped."""
        return False

    def block_max_weight(self) -> float:
        return float(super().block_max_weight() if self._terminfo is None else self._terminfo.max_weight())


class MapTerms(TermsReader):
    """The terms of the indexed fields of a segment, and the documents that have them.

    Args:
        columns: the reader of the segment's columns, from which all terms follow.
    """

    def __init__(self, columns: Any) -> None:
        self._columns = columns
        self._terms: dict[str, list[bytes]] = {}

    @cached_property
    def _tokens(self) -> tuple[TokenTerms, TokenTerms]:
        """The tokens of keypoints, and those of free squares."""
        column = self._columns.stored(TEXT)
        return TokenTerms(column.texts, "a"), TokenTerms(column.squares, "f")

    def __contains__(self, term: Term) -> bool:
        return len(self._documents(*term)) > 0

    def indexed_field_names(self) -> tuple[str, ...]:
        return (*NAMES, TEXT)

    def terms(self) -> Iterator[Term]:
        for field in self.indexed_field_names():
            yield from self.terms_from(field, b"")

    def terms_from(self, fieldname: str, prefix: bytes) -> Iterator[Term]:
        """The terms of a field; Whoosh needs no others, even if it says so."""
        if fieldname == TEXT:
            return ((TEXT, token) for token in heapq.merge(*(one.names(prefix) for one in self._tokens)))
        terms = self._sorted(fieldname)
        return ((fieldname, text) for text, _ in groupby(terms[bisect_left(terms, prefix) :]))

    def items(self) -> Iterator[tuple[Term, TermInfo]]:
        return ((term, self.term_info(*term)) for term in self.terms())

    def items_from(self, fieldname: str, prefix: bytes) -> Iterator[tuple[Term, TermInfo]]:
        return ((term, self.term_info(*term)) for term in self.terms_from(fieldname, prefix))

    def term_info(self, fieldname: str, text: bytes) -> TermInfo:
        return self._info(fieldname, *_counted(self._documents(fieldname, text)))

    def frequency(self, fieldname: str, text: bytes) -> float:
        return float(len(self._documents(fieldname, text)))

    def doc_frequency(self, fieldname: str, text: bytes) -> int:
        return len(_counted(self._documents(fieldname, text))[0])

    def matcher(self, fieldname: str, text: bytes, format_: Any, scorer: Any = None) -> TermMatcher:
        documents, counts = _counted(self._documents(fieldname, text))
        info = self._info(fieldname, documents, counts)
        return TermMatcher(documents.tolist(), counts.tolist(), format_, scorer, (fieldname, text), info)

    def _info(self, fieldname: str, documents: NDArray[Any], counts: NDArray[Any]) -> TermInfo:
        """What Whoosh wants to know of a term: the lengths are those of the documents that have it."""
        if not len(documents):
            raise TermNotFound(f"no such term in {fieldname}")
        lengths = self._columns.lengths(fieldname)[documents]
        shortest, longest = rounded(int(lengths.min())), rounded(int(lengths.max()))
        most, ends = float(counts.max()), (int(documents[0]), int(documents[-1]))
        return TermInfo(float(counts.sum()), len(documents), shortest, longest, most, *ends)

    def _documents(self, fieldname: str, text: bytes) -> NDArray[Any]:
        """The documents with this term, ascending, each as often as it has it."""
        if fieldname == TEXT:
            return np.concatenate([one.documents(text) for one in self._tokens])  # only one has it
        names = self._columns.stored("dataset")
        name = text.decode(errors="replace")
        if fieldname == "dataset":
            return np.flatnonzero(names.codes == names.code(name))
        dataset, _, number = name.rpartition("/")  # a map's id is a dataset's name and a scan's number
        if fieldname != "map_id" or not number.isdecimal() or map_id_of(dataset, int(number[:20])) != name:
            return np.zeros(0, dtype=np.int64)
        found = np.flatnonzero(self._columns.first_scans == int(number))
        return found[names.codes[found] == names.code(dataset)]

    def _sorted(self, fieldname: str) -> list[bytes]:
        """The names of all documents."""
        if fieldname not in self._terms:
            every = range(self._columns.doc_count_all())
            self._terms[fieldname] = sorted(self._columns.name(fieldname, number).encode() for number in every)
        return self._terms[fieldname]

    def close(self) -> None:
        self._columns.close()
