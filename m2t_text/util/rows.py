"""An array that grows at its end, at a cost that does not grow with it."""

import numpy as np

from m2t_text.util.types import Floats

FIRST = 64  # rows that there is room for at first; then always for twice as many as there are


class Rows:
    """Rows (N, ...) of numbers, all of one shape.

    Examples:
        >>> from m2t_text.util.rows import Rows
        >>> rows = Rows(2)
        >>> for k in range(3):
        ...     rows.extend([[k, k]])
        >>> rows.array.tolist()
        [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]
    """

    def __init__(self, *shape: int) -> None:
        self._held = np.empty((FIRST, *shape))
        self._count = 0

    @property
    def array(self) -> Floats:
        """(N, ...) those that are there; it stays as it is when more come."""
        return self._held[: self._count]

    def extend(self, rows: "Floats | list[list[float]]") -> None:
        """Adds rows (M, ...)."""
        count = self._count + len(rows)
        if count > len(self._held):
            held = np.empty((max(count, 2 * len(self._held)), *self._held.shape[1:]))
            held[: self._count] = self.array
            self._held = held
        self._held[self._count : count] = rows
        self._count = count
