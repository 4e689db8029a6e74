"""Local maps: what the robot saw on the metres that follow each scan, 5 m by default (paper, IV-A)."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from m2t_text.config import MappingParameters
from m2t_text.description.free_cells import FreeSpace
from m2t_text.mapping.free_space import Beams, FreeScans
from m2t_text.util.compiling import kernel
from m2t_text.util.geometry import between, wrap
from m2t_text.util.types import Floats

STILL = (0.05, np.radians(2.0))  # m and rad; scan matching finds small motion even where there is none
LEAP = 20.0  # m between two scans that are no drive, whatever a log says of it


@dataclass(frozen=True)
class LocalMap:
    """What was seen on one run, in the robot frame of the run's first scan.

    Attributes:
        points: (N, 2) metres; one point for each occupied cell: the mean of the hits in it, which keeps the
            walls sharp when the map is turned to another frame.
        trajectory: (K, 3) robot poses of the run: the viewpoints.
        first_scan, last_scan: indices into the log.
        travel: (2,) metres of travel at the begin and the end of the run.
        pose: (3,) robot pose of the first scan in the frame of the whole trajectory.
        free: what was seen to be free; None where nothing is known of that, as in a point cloud.
    """

    points: Floats
    trajectory: Floats
    first_scan: int
    last_scan: int
    travel: Floats
    pose: Floats
    free: FreeSpace | None = None


@dataclass(frozen=True)
class Survey:
    """A log made ready for cutting local maps out of it.

    Attributes:
        points: (P, 2) hits of all scans within the range limit, robot frame, metres.
        starts: (S + 1,) the hits of scan i are ``points[starts[i]:starts[i + 1]]``.
        trajectory: (S, 3) robot poses in one frame, from odometry and scan matching.
        cuts: (C,) scans at which a new drive begins, in ascending order. Nothing is known of the way there.
        beams: of all scans; None if nothing is known of what they passed.
    """

    points: Floats
    starts: NDArray[np.int64]
    trajectory: Floats
    cuts: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    beams: Beams | None = None

    def counted(self, way: Floats, moved: NDArray[np.bool_]) -> "Survey":
        """The same with travel and motion that were counted otherwise than from its first scan."""
        found = replace(self)
        found.__dict__.update(way=way, moved=moved)  # in place of the properties
        return found

    def part(self, begin: int, end: int) -> "Survey":
        """The scans from ``begin`` to before ``end``; travel is counted as before."""
        found = self.cut(begin, end, self.trajectory[begin:end])
        return found.counted(self.way[begin:end], self.moved[begin:end])

    def cut(self, begin: int, end: int, trajectory: Floats) -> "Survey":
        """The scans from ``begin`` to before ``end`` with a trajectory (end - begin, 3) of their own."""
        points = self.points[self.starts[begin] : self.starts[end]]
        starts = self.starts[begin : end + 1] - self.starts[begin]
        cuts = self.cuts[(self.cuts > begin) & (self.cuts < end)] - begin
        beams = None if self.beams is None else self.beams.part(begin, end)
        return Survey(points, starts, trajectory, cuts, beams)

    @cached_property
    def drive_ends(self) -> NDArray[np.int64]:
        """(S,) the last scan of each scan's drive; a leap ends a drive, too."""
        scans = len(self.trajectory)
        leaps = np.flatnonzero(np.hypot(*np.diff(self.trajectory[:, :2], axis=0).T) > LEAP) + 1
        begins = np.union1d(self.cuts, leaps).astype(np.int64)
        ends = np.append(begins - 1, scans - 1)
        return ends[np.searchsorted(begins, np.arange(scans), side="right")]

    @cached_property
    def way(self) -> Floats:
        """(S,) metres travelled up to each scan."""
        return np.fromiter(travelled(self.trajectory), float, len(self.trajectory))

    @cached_property
    def moved(self) -> NDArray[np.bool_]:
        """(S,) which scans moved since the last one that did; the others add nothing to a map."""
        odometer = Odometer()
        return np.array([odometer.add(pose)[1] for pose in self.trajectory], dtype=np.bool_)


class Odometer:
    """Counts metres of travel pose by pose. A robot that stands or turns on the spot does not travel."""

    def __init__(self) -> None:
        self._stood: Floats | None = None  # where it last travelled to
        self._moved: Floats | None = None  # where it last moved to, be it by turning
        self._gone = 0.0

    def add(self, pose: Floats) -> tuple[float, bool]:
        """Metres travelled up to the next pose (3,), and whether it moved since the last one that did."""
        step = 0.0 if self._stood is None else _apart(self._stood, pose)
        if self._stood is None or step >= STILL[0]:
            self._stood, self._gone = pose, self._gone + step
        last = self._moved
        moved = last is None or _apart(last, pose) >= STILL[0] or abs(wrap(pose[2] - last[2])) >= STILL[1]
        if moved:
            self._moved = pose
        return self._gone, bool(moved)


def travelled(poses: Iterable[Floats]) -> Iterator[float]:
    """Metres travelled up to each pose (3,)."""
    odometer = Odometer()
    return (odometer.add(pose)[0] for pose in poses)


def _apart(a: Floats, b: Floats) -> float:
    return math.hypot(b[0] - a[0], b[1] - a[1])


def run_starts(
    survey: Survey, run_length: float, spacing: float = 0.0, after: float = 0.0
) -> NDArray[np.int64]:
    """Indices of the scans after which the robot travelled at least ``run_length`` metres on the same drive.

    Those less than ``spacing`` metres of travel after the one before are left out, and those before ``after``.
    """
    way, starts = survey.way, []
    for scan in np.flatnonzero(way[survey.drive_ends] - way >= run_length):
        if way[scan] >= after:
            starts.append(scan)
            after = way[scan] + spacing
    return np.array(starts, dtype=np.int64)


def run_ends(survey: Survey, starts: NDArray[np.int64], run_length: float) -> NDArray[np.int64]:
    """The scans that complete the runs, or the last ones of their drives."""
    ends = np.searchsorted(survey.way, survey.way[starts] + run_length)
    return np.maximum(starts, np.minimum(ends, survey.drive_ends[starts]))  # who stands does not travel


def local_maps(
    survey: Survey, parameters: MappingParameters, starts: NDArray[np.int64] | None = None
) -> Iterator[LocalMap]:
    """The local maps that begin at the scans ``starts``; without it, one for every complete run.

    A run ends with the scan that completes its length, as one cut short would move the viewpoint; but with its
    drive at the latest.
    """
    way, length = survey.way, parameters.run_length
    starts = run_starts(survey, length) if starts is None else starts
    free = None if survey.beams is None else FreeScans(survey.beams, survey.trajectory, parameters.cell)
    for first, last in zip(starts, run_ends(survey, starts, length), strict=True):
        run = first + np.flatnonzero(survey.moved[first : last + 1])
        if not len(run) or run[0] != first:
            run = np.concatenate([[first], run])
        poses = between(survey.trajectory[first], survey.trajectory[run])
        yield LocalMap(
            points=occupied(survey.points, survey.starts, run, poses, parameters.cell),
            trajectory=poses,
            first_scan=int(first),
            last_scan=int(last),
            travel=way[[first, last]],
            pose=survey.trajectory[first],
            free=None if free is None else free.together(run),
        )


def occupied(
    points: Floats, starts: NDArray[np.int64], scans: NDArray[np.int64], poses: Floats, cell: float
) -> Floats:
    """Mean hit of every occupied cell, (N, 2), ordered by cell, of the ``scans`` placed at ``poses`` (K, 3)."""
    count = int((starts[scans + 1] - starts[scans]).sum())
    if not count:
        return np.empty((0, 2))
    x, y = np.empty(count), np.empty(count)
    _place(np.ascontiguousarray(points), starts, scans, np.ascontiguousarray(poses), x, y)
    left, low, right, high = (math.floor(end / cell) for end in (x.min(), y.min(), x.max(), y.max()))
    width, height = right - left + 1, high - low + 1
    numbers = np.zeros(width * height, dtype=np.int32)
    sums, means = np.empty((count, 3)), np.empty((count, 2))
    return means[: _mean_hits(x, y, left, low, cell, height, numbers, sums, means)].copy()


@kernel
def _place(
    points: Floats, starts: NDArray[np.int64], scans: NDArray[np.int64], poses: Floats, x: Floats, y: Floats
) -> None:
    """Writes where all hits (N,) of the scans are, placed at their poses."""
    n = 0
    for k in range(len(scans)):
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        for i in range(starts[scans[k]], starts[scans[k] + 1]):
            x[n] = poses[k, 0] + c * points[i, 0] - s * points[i, 1]
            y[n] = poses[k, 1] + s * points[i, 0] + c * points[i, 1]
            n += 1


@kernel
def _mean_hits(
    x: Floats,
    y: Floats,
    left: int,
    low: int,
    cell: float,
    height: int,
    numbers: NDArray[np.int32],
    sums: Floats,
    means: Floats,
) -> int:
    """Writes the mean hit of each cell that has one, in their order, and returns the number of these cells.

    Args:
        numbers: (columns * height,) room for the numbers of the cells, in the order in which they are met, from
            1; 0 at first. The sums lie close together so.
        sums: (N, 3) room for the x, the y and the number of the hits in each.
    """
    met = 0
    for i in range(len(x)):
        slot = (math.floor(x[i] / cell) - left) * height + math.floor(y[i] / cell) - low
        if numbers[slot] == 0:
            sums[met, 0], sums[met, 1], sums[met, 2] = 0.0, 0.0, 0.0
            met += 1
            numbers[slot] = met
        k = numbers[slot] - 1
        sums[k, 0] += x[i]
        sums[k, 1] += y[i]
        sums[k, 2] += 1
    n = 0
    for slot in range(len(numbers)):
        if numbers[slot] > 0:
            k = numbers[slot] - 1
            means[n, 0], means[n, 1] = sums[k, 0] / sums[k, 2], sums[k, 1] / sums[k, 2]
            n += 1
    return met
