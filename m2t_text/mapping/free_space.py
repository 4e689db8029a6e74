"""What the robot saw to be free: the cells that beams passed before they met something.

A beam that did not return says nothing: black cloth may have swallowed it, or a mirror sent it away. Nor does
one that is about as long as the longest so far, as some lasers then report nearly their maximum. A beam
passes glass that others hit, and people walk through where other beams saw nothing: so cells near anything that
was hit on the run are not free, whatever passed them; see `free_squares`.
"""

import math
from collections.abc import Iterable, Sequence
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
MARGIN = 50  # cells about what a run's scans saw, where later ones may see, too
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

    def part(self, begin: int, end: int) -> "Beams":
        """Those of the scans from ``begin`` to before ``end``."""
        starts = self.starts[begin : end + 1]
        part = slice(starts[0], starts[-1])
        return Beams(starts - starts[0], self.bearings[part], self.lengths[part], self.laser)


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
    """What the scans of a survey saw to be free, run by run.

    Runs that overlap share most of their scans. So it is counted how many scans of the run passed each cell,
    and for the next run only those are counted off, or in, that are not in both.

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
        self._boxes: dict[int, tuple[int, int, int, int]] = {}  # of the same scans
        self._corner, self._counts = (0, 0), np.zeros((0, 0), dtype=np.int32)

    def together(self, scans: NDArray[np.int64]) -> FreeSpace:
        """What was seen on a run, in the robot frame of its first scan."""
        run = set(scans.tolist())
        for scan in self._passed.keys() - run:
            self._count(self._passed.pop(scan), self._boxes.pop(scan), -1)
        for scan in sorted(run - self._passed.keys()):
            part = self._of(scan)
            box = (part.x, part.y, part.x + part.cells.shape[0], part.y + part.cells.shape[1])
            self._make_room(box)
            self._count(part, box, 1)
            self._passed[scan], self._boxes[scan] = part, box
        box = _around(self._boxes.values())
        corner = np.array([box[0] * self._cell, box[1] * self._cell, 0.0])
        return FreeSpace(self._part(box) > 0, between(self._trajectory[scans[0]], corner), self._cell)

    def _of(self, scan: int) -> CellGrid:
        part, laser = slice(*self._beams.starts[scan : scan + 2]), self._lasers[scan]
        return _passed(laser, self._beams.bearings[part], self._beams.lengths[part], self._cell)

    def _count(self, part: CellGrid, box: tuple[int, int, int, int], times: int) -> None:
        counts = self._part(box)
        counts += times * part.cells.view(np.int8)

    def _part(self, box: tuple[int, int, int, int]) -> NDArray[np.int32]:
        """The counts of a part of the plane."""
        x, y = self._corner
        return self._counts[box[0] - x : box[2] - x, box[1] - y : box[3] - y]

    def _make_room(self, box: tuple[int, int, int, int]) -> None:
        """Counts anew in a larger part of the plane, unless this one holds a box."""
        x, y = self._corner
        width, height = self._counts.shape
        if x <= box[0] and y <= box[1] and box[2] <= x + width and box[3] <= y + height:
            return
        left, low, right, high = _around([*self._boxes.values(), box])
        self._corner = (left - MARGIN, low - MARGIN)
        self._counts = np.zeros((right - left + 2 * MARGIN, high - low + 2 * MARGIN), dtype=np.int32)
        for scan, part in self._passed.items():
            self._count(part, self._boxes[scan], 1)


def _around(boxes: Iterable[tuple[int, int, int, int]]) -> tuple[int, int, int, int]:
    """The least box that holds some."""
    left, low, right, high = zip(*boxes, strict=True)
    return min(left), min(low), max(right), max(high)


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
        gap = abs(bearing - bearing_before)
        for amid in range(2 if before > 0 and gap > 0 else 1):
            towards, begin, end = bearing, 0.0, length
            if amid:
                towards, begin, end = (bearing + bearing_before) / 2, 1 / gap, min(length, before, GAP / gap)
            _walk(cells, x, y, towards, begin, end)
        before, bearing_before = length, bearing


@inner
def _walk(cells: Mask, x: float, y: float, bearing: float, begin: float, end: float) -> None:
    """Marks the cells at every step of one cell along a beam."""
    c, s = math.cos(bearing), math.sin(bearing)
    for step in range(math.ceil(begin), math.floor(end) + 1 if end > 0 else 0):
        cells[math.floor(x + step * c), math.floor(y + step * s)] = True
