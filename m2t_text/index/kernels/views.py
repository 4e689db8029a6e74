"""A query as it is seen in each of the directions that are tried."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.text import Text, quarter_turned
from m2t_text.description.viewpoint import likely_directions

QUARTER = np.pi / 2


@dataclass(frozen=True)
class Views:
    """A query's keypoints under V turns of its frame.

    Attributes:
        angles: (V,) by which the keypoints are turned, counter-clockwise, radians.
        wx, wy: (V, N) int64 cells of the keypoints under each turn; the order is the same for all.
        wa: (N,) int64 appearance words, which no turn changes; ascending.
    """

    angles: NDArray[np.float64]
    wx: NDArray[np.int64]
    wy: NDArray[np.int64]
    wa: NDArray[np.int64]

    def __getitem__(self, chosen: slice) -> "Views":
        """Some of the turns."""
        return Views(self.angles[chosen], self.wx[chosen], self.wy[chosen], self.wa)


def views(text: Text, turns: tuple[int, ...], directions: int = 1) -> Views:
    """The query under all quarter ``turns`` of each of its likely directions, ``directions`` at most.

    They are ordered by direction, then by turn.

    The planned direction is the first, and its turns map cells onto cells. Where the walls of a place run in
    several directions, a similar map may have been seen along another of them: those are found again from the
    text alone, and the keypoints are cut into cells anew.
    """
    angles, xs, ys = [], [], []
    for direction in likely_directions(text.positions(), directions):
        c, s = np.cos(direction), np.sin(direction)
        positions = text.positions() @ np.array([[c, -s], [s, c]])
        x, y = np.floor(positions).astype(np.int64).T
        for turn in sorted(turns):
            turned_x, turned_y = quarter_turned(x, y, turn)
            angles.append(turn * QUARTER - direction)
            xs.append(turned_x)
            ys.append(turned_y)
    return Views(np.array(angles), np.array(xs), np.array(ys), text.wa.astype(np.int64))
