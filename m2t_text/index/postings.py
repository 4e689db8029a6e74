"""The keypoints of one segment, map by map as they are stored, and word by word (paper, III-C, IV-D)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.text import WORDS, Text


@dataclass(frozen=True)
class Postings:
    """All keypoints of a segment, sorted by (word, document); deleted documents are still among them.

    Attributes:
        documents: number of documents of the segment.
        starts: (1025,) int64; the postings of word a are starts[a]:starts[a + 1].
        doc: (N,) int32 document numbers in the segment.
        wx, wy: (N,) int16 pose words, in cells.
    """

    documents: int
    starts: NDArray[np.int64]
    doc: NDArray[np.int32]
    wx: NDArray[np.int16]
    wy: NDArray[np.int16]

    @classmethod
    def of(cls, documents: int, doc: NDArray[np.int32], text: Text) -> "Postings":
        """From keypoints in the order of documents. The stable sort of 16 bit words is a radix sort."""
        order = np.argsort(text.wa, kind="stable")
        starts = np.append(0, np.cumsum(np.bincount(text.wa, minlength=WORDS))).astype(np.int64)
        return cls(documents, starts, doc[order], text.wx[order], text.wy[order])


@dataclass(frozen=True)
class Texts:
    """All keypoints of a segment in the order of documents; deleted documents are still among them.

    Attributes:
        counts: (documents,) int64 number of keypoints of each.
        text: all keypoints, one document's after the other's.
    """

    counts: NDArray[np.int64]
    text: Text

    @cached_property
    def starts(self) -> NDArray[np.int64]:
        """(documents + 1,) where each document's keypoints begin."""
        return np.append(0, np.cumsum(self.counts))

    @cached_property
    def postings(self) -> Postings:
        """The inverted index of the segment, made when it is first asked for."""
        document = np.repeat(np.arange(len(self.counts), dtype=np.int32), self.counts)
        return Postings.of(len(self.counts), document, self.text)
