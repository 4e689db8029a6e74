"""How well a query fits maps, as arrays."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Scores:
    """How well a query fits each of (N,) maps.

    Attributes:
        score: (N,) float64.
        matched: (N,) int32, the smaller of both maps' numbers of matched keypoints: the sum over the words of
            min(|Q'_a|, |M'_a|), or min(|Q'|, |M'|) at the agreed offset.
        alignment: (N, 3) float64, the pose of the query's frame in the map's frame that gave the score, in
            cells and radians.
    """

    score: NDArray[np.float64]
    matched: NDArray[np.int32]
    alignment: NDArray[np.float64]

    @classmethod
    def none(cls, maps: int) -> "Scores":
        """Nothing matches."""
        return cls(np.zeros(maps), np.zeros(maps, dtype=np.int32), np.zeros((maps, 3)))

    @classmethod
    def joined(cls, parts: "Sequence[Scores]") -> "Scores":
        """The scores of all parts, one after the other."""
        fields = ("score", "matched", "alignment")
        return cls(
            *(np.concatenate([getattr(part, name) for part in (cls.none(0), *parts)]) for name in fields)
        )

    def __getitem__(self, chosen: NDArray[Any]) -> "Scores":
        return Scores(self.score[chosen], self.matched[chosen], self.alignment[chosen])
