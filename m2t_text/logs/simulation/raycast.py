"""What a laser sees of a plane of walls."""

import numpy as np

from m2t_text.util.geometry import inverse, transform
from m2t_text.util.types import Floats

ROUNDING = 1e-9  # rad; a beam at a wall's end meets it


def cast(pose: Floats, angles: Floats, walls: Floats) -> Floats:
    """Distances (B,) from a pose (3,) to the nearest of walls (W, 4); ``inf`` where a beam meets none.

    The angles (B,) in the pose's frame must rise and lie within 90 degrees of straight ahead.
    """
    seen_from = inverse(pose)
    start, end = transform(seen_from, walls[:, :2]), transform(seen_from, walls[:, 2:])
    ahead = (start[:, 0] > 0) | (end[:, 0] > 0)
    start, end = start[ahead], end[ahead]
    start, end = _cut(start, end), _cut(end, start)
    bearings = np.sort(np.arctan2([start[:, 1], end[:, 1]], [start[:, 0], end[:, 0]]), axis=0)
    first = np.searchsorted(angles, bearings[0] - ROUNDING)
    count = np.searchsorted(angles, bearings[1] + ROUNDING, side="right") - first
    wall = np.repeat(np.arange(len(start)), count)
    beam = np.arange(count.sum()) + np.repeat(first - np.cumsum(count) + count, count)
    start, along, c, s = start[wall], (end - start)[wall], np.cos(angles[beam]), np.sin(angles[beam])
    with np.errstate(divide="ignore", invalid="ignore"):  # of a beam along a wall
        distance = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / (c * along[:, 1] - s * along[:, 0])
    ranges = np.full(len(angles), np.inf)
    np.minimum.at(ranges, beam, np.where(distance > 0, distance, np.inf))
    return ranges


def _cut(start: Floats, end: Floats) -> Floats:
    """The starts (W, 2) of segments, moved along them to x = 0 where they lie behind it."""
    behind = start[:, 0] < 0
    place = np.where(behind, start[:, 0] / np.where(behind, start[:, 0] - end[:, 0], 1.0), 0.0)
    return start + place[:, None] * (end - start)
