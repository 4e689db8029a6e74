"""What a search for the best maps asks of a scorer."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from m2t_text.index.kernels.scores import Scores
from m2t_text.util.types import Floats

Documents = NDArray[np.int64]


class Scorer(Protocol):
    """How well one query fits documents of a segment, which is named. Compiled code lets other threads run."""

    @property
    def estimates_are_bounds(self) -> bool:
        """Whether `estimate` returns upper bounds already."""

    @property
    def sieves(self) -> bool:
        """Whether `unlikeness` and `may_reach` say something, and are quick."""

    def unlikeness(self, name: str, documents: Documents) -> NDArray[np.int32]:
        """How unlike the query documents (K,) look at a glance, 0 or more; a search begins with the least."""

    def may_reach(self, name: str, documents: Documents, threshold: float) -> NDArray[np.int32]:
        """0 for each of the documents (K,) whose score cannot reach the threshold; for the others 1 or
        more, and more where it is likelier that they do."""

    def estimate(self, name: str, documents: Documents) -> Floats:
        """A guess of the scores of documents (K,), which decides where to begin; it may be wrong."""

    def bound(self, name: str, documents: Documents, threshold: float) -> Floats:
        """Upper bounds of the scores of documents (K,); those below the threshold may be 0."""

    def fine_bound(self, name: str, documents: Documents, threshold: float) -> Floats:
        """Tighter bounds; where the score is below the threshold, any value below the threshold will do."""

    def score(self, name: str, documents: Documents, threshold: float = 0.0) -> Scores:
        """The scores of documents (K,); below the threshold they may be 0."""
