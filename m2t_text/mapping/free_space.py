"""What the robot saw to be free: the cells that beams passed before they met something.

A beam that did not return says nothing: black cloth may have swallowed it, or a mirror sent it away. Nor does
one that is about as long as the longest so far, as some lasers then report nearly their maximum. A beam
passes glass that others hit, and people walk through where other beams saw nothing: so cells near anything that
was hit on the run are not free, whatever passed them; see `free_squares`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.free_cells import FreeSpace, Mask, bounding_box
from m2t_text.description.free_squares import CellGrid
from m2t_text.logs.log import Log, Scan
from m2t_text.util.compiling import inner, kernel
from m2t_text.util.geometry import between, compose
from m2t_text.util.types import Floats

SHORT_OF_HIT = 0.25  # m before what a beam hit: its error, and that of the poses on one run
NEAR_MAXIMUM = 0.98  # of the longest reading so far; longer ones may mean that nothing came back
GAP = 2.0  # cells between two beams that both pass, within which nothing is thought to hide


@dataclass(frozen=True)
class Beams:
    """How far the beams of all scans of a log passed what is free.

    Attributes:
        starts: (S + 1,) the beams of scan i are those from ``starts[i]`` to ``starts[i + 1]``.
        bearings: (R,) radians in the laser's frame, in the order of each scan.
        lengths: (R,) metres from the laser; 0 where nothing is known.
        laser: (3,) its pose in the robot's frame.
    """

    starts: NDArray[np.int64]
    bearings: Floats
    lengths: Floats
    laser: Floats

    @classmethod
    def of(cls, log: Log, range_limit: float, longest: float = 0.0) -> "Beams":
        """Up to ``range_limit`` metres; ``longest`` is the longest reading before the log, if it is a part.

        What a scan saw depends on no later one, so that a robot that drives sees the same.
        """
        lengths = []
        for scan in log.scans:
            longest = max(longest, longest_reading(scan))
            lengths.append(clear_lengths(scan.ranges, longest, range_limit))
        return cls.joined([scan.angles for scan in log.scans], lengths, log.laser_pose)

    @classmethod
    def joined(cls, bearings: Sequence[Floats], lengths: Sequence[Floats], laser: Floats) -> "Beams":
        """Of scans whose ``bearings`` and ``lengths`` (B,) are given."""
        starts = np.cumsum([0, *(len(part) for part in lengths)]).astype(np.int64)
        none = np.empty(0)
        return cls(starts, np.concatenate([none, *bearings]), np.concatenate([none, *lengths]), laser)


def clear_lengths(ranges: Floats, longest: float, range_limit: float) -> Floats:
    """How far each beam (B,) of a scan is known to have passed nothing but free space, metres.

    That is no farther than what its neighbours hit, between which a wall may lie that is seen at a flat angle.
    ``longest`` is the longest reading up to this scan.
    """
    hit = np.concatenate([[np.inf], np.where(ranges > 0, ranges, np.inf), [np.inf]])
    nearest = np.minimum(np.minimum(hit[:-2], hit[2:]), ranges)
    trusted = ranges < NEAR_MAXIMUM * longest
    return np.where(trusted, np.clip(nearest - SHORT_OF_HIT, 0.0, range_limit), 0.0)


def longest_reading(scan: Scan) -> float:
    """Of the beams of a scan that returned, metres."""
    return float(scan.ranges.max(initial=0.0, where=np.isfinite(scan.ranges)))


class FreeScans:
    """What each scan of a survey saw to be free, made when it is first asked for: maps that overlap share it.

    Args:
        beams: of the scans.
        trajectory: (S, 3) robot poses in one frame; the cells are those of this frame.
        cell: metres.
    """

    def __init__(self, beams: Beams, trajectory: Floats, cell: float) -> None:
        self._beams = beams
        self._trajectory = trajectory
        self._lasers = compose(trajectory, beams.laser)
        self._cell = cell
        self._passed: dict[int, CellGrid] = {}

    def together(self, scans: NDArray[np.int64]) -> FreeSpace:
        """What was seen on a run, in the robot frame of its first scan. Earlier scans are forgotten."""
        for scan in [scan for scan in self._passed if scan < scans[0]]:
            del self._passed[scan]
        parts = [self._of(scan) for scan in scans.tolist()]
        x, y = min(part.x for part in parts), min(part.y for part in parts)
        width = max(part.x + part.cells.shape[0] for part in parts) - x
        height = max(part.y + part.cells.shape[1] for part in parts) - y
        cells = np.zeros((width, height), dtype=np.bool_)
        for part in parts:
            _add(cells, part.cells, part.x - x, part.y - y)
        corner = np.array([x * self._cell, y * self._cell, 0.0])
        return FreeSpace(cells, between(self._trajectory[scans[0]], corner), self._cell)

    def _of(self, scan: int) -> CellGrid:
        if scan not in self._passed:
            part, laser = slice(*self._beams.starts[scan : scan + 2]), self._lasers[scan]
            bearings, lengths = self._beams.bearings[part], self._beams.lengths[part]
            self._passed[scan] = _passed(laser, bearings, lengths, self._cell)
        return self._passed[scan]


def _passed(laser: Floats, bearings: Floats, lengths: Floats, cell: float) -> CellGrid:
    """The cells that a scan's beams pass, in a part of the plane that holds them all."""
    half = int(lengths.max(initial=0.0) / cell) + 2
    low = np.floor(laser[:2] / cell).astype(int) - half
    x, y = (laser[:2] / cell - low).tolist()
    cells = np.zeros((2 * half + 1, 2 * half + 1), dtype=np.bool_)
    _walk_beams(cells, x, y, laser[2], bearings, lengths, cell)
    left, below, right, high = bounding_box(cells)
    return CellGrid(int(low[0]) + left, int(low[1]) + below, cells[left:right, below:high].copy())


@kernel
def _walk_beams(
    cells: Mask, x: float, y: float, direction: float, bearings: Floats, lengths: Floats, cell: float
) -> None:
    """Marks the cells that beams from (x, y) pass, in cells.

    Where neighbouring beams are one to GAP cells apart, one between them is thought to pass as far as both.
    """
    before, bearing_before = 0.0, 0.0
    for k in range(len(bearings)):
        length, bearing = lengths[k] / cell, bearings[k] + direction
        _walk(cells, x, y, bearing, 0.0, length)
        gap = abs(bearing - bearing_before)
        if before > 0 and gap > 0:
            end = min(length, before, GAP / gap)
            _walk(cells, x, y, (bearing + bearing_before) / 2, 1 / gap, end)
        before, bearing_before = length, bearing


@inner
def _walk(cells: Mask, x: float, y: float, bearing: float, begin: float, end: float) -> None:
    """Marks the cells at every step of one cell along a beam."""
    c, s = np.cos(bearing), np.sin(bearing)
    for step in range(int(np.ceil(begin)), int(end) + 1 if end > 0 else 0):
        cells[int(x + step * c), int(y + step * s)] = True


@kernel
def _add(cells: Mask, part: Mask, x: int, y: int) -> None:
    """Marks the cells of a part that begins at the cell (x, y)."""
    for i in range(part.shape[0]):
        whole, added = cells[x + i, y : y + part.shape[1]], part[i]
        for j in range(len(added)):
            whole[j] |= added[j]
