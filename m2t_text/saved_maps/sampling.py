"""Local maps sampled over the free space of a saved map: what a laser would see on short runs through it.

A robot that looks ahead sees other walls than one that turns, and a run along a corridor others than one out of
a room. So places that lie densely in the free space are looked at in several ways: on a run straight ahead, in
each of some directions, and all around. Most of these views are nearly the same; few that differ are kept.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import ceil, pi, radians

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.spatial import KDTree

from m2t_text.config import MappingParameters
from m2t_text.description.free_cells import FreeSpace
from m2t_text.mapping.local_map import LocalMap, occupied
from m2t_text.saved_maps.grid import FREE, OCCUPIED, Grid
from m2t_text.saved_maps.rays import Beams, nearest_open, passed_free, seen
from m2t_text.util.geometry import between, compose, inverse, transform
from m2t_text.util.types import Floats, Progress

SPACING = 0.7  # m between the places
HEADINGS = 8  # directions looked in at each place, beside all around
CLEARANCE = 0.3  # m from a robot's centre to the nearest wall
AHEAD = pi  # rad; field of view on a run
STEP = 0.25  # m between the scans of a run
BEAM = radians(0.5)  # between two beams of a scan
VEIL = 1.0  # m of unknown space that a beam passes; behind more of it nothing is said to be seen
FEWEST = 30  # occupied cells of a view that says anything
ALIKE = 0.3  # share of the cells of two views, of all that either has, from which one of both is enough
NEAR = 0.9  # m between the centres of gravity of two views within which one may stand for the other
CHUNK = 64  # views between two steps of a progress bar

Cells = NDArray[np.int32]


@dataclass(frozen=True)
class Views:
    """Ways to look at places of a grid.

    Attributes:
        poses: (K, 3) of the robot at the begin of its run, in the grid's own frame, metres and radians.
        around: (K,) whether it looks all around from there, instead of straight ahead on a run.
    """

    poses: Floats
    around: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.poses)

    def __getitem__(self, chosen: NDArray[np.int64]) -> "Views":
        return Views(self.poses[chosen], self.around[chosen])

    def of(self, numbers: NDArray[np.int64]) -> Iterator[tuple[Floats, bool]]:
        """The views of these numbers, one by one."""
        for number in numbers:
            yield self.poses[number], bool(self.around[number])


@dataclass(frozen=True)
class Sampler:
    """A grid made ready for looking at it.

    Attributes:
        grid: the map.
        open: (rows, columns) where a robot's centre can be: free, and CLEARANCE from all that is occupied.
        parameters: run length, range limit and cell of the local maps.
    """

    grid: Grid
    open: NDArray[np.bool_]
    parameters: MappingParameters

    @classmethod
    def of(cls, grid: Grid, parameters: MappingParameters) -> "Sampler":
        walls = grid.states == OCCUPIED
        clear = np.ones(walls.shape, dtype=np.bool_)
        if walls.any():
            clear = distance_transform_edt(~walls) * grid.resolution >= CLEARANCE
        return cls(grid, clear & (grid.states == FREE), parameters)

    def views(self) -> Views:
        """All ways to look at all places: in each square of SPACING the open cell nearest to its middle."""
        side = max(1, round(SPACING / self.grid.resolution))
        places = nearest_open(self.open, side) * self.grid.resolution
        headings = np.arange(HEADINGS + 1) * (2 * pi / HEADINGS)
        headings[-1] = 0.0  # all around
        poses = np.column_stack([np.repeat(places, len(headings), axis=0), np.tile(headings, len(places))])
        return Views(poses, np.tile(np.arange(len(headings)) == HEADINGS, len(places)))

    def look(self, pose: Floats, around: bool) -> tuple[Floats, Floats]:
        """What a view sees, and the poses (S, 3) of its scans, both in the robot's frame at its begin.

        The points (N, 2) are where beams meet walls.
        """
        resolution = self.grid.resolution
        run = 0.0 if around else self.parameters.run_length
        begin = pose / np.array([resolution, resolution, 1.0])
        beams = self._beams(pose[2], around)
        met, scans = seen(self.grid.states, self.open, begin, beams, int(run / STEP), STEP / resolution)
        poses = np.arange(scans)[:, None] * np.array([STEP, 0.0, 0.0])
        return transform(inverse(pose), met * resolution), poses

    def free(self, pose: Floats, around: bool, poses: Floats) -> FreeSpace:
        """What is free on a view whose scans have the ``poses`` (S, 3), in the robot's frame at its begin."""
        resolution = self.grid.resolution
        places = transform(pose, poses[:, :2]) / resolution
        cells, column, row = passed_free(self.grid.states, places, self._beams(pose[2], around))
        corner = np.array([column * resolution, row * resolution, 0.0])
        return FreeSpace(cells, between(pose, corner), resolution)

    def _beams(self, heading: float, around: bool) -> Beams:
        """The beams of each scan of a view, in units of the grid's cells."""
        field = 2 * pi if around else AHEAD
        return Beams(
            angles=heading + np.arange(-field / 2, field / 2, BEAM),
            reach=self.parameters.range_limit / self.grid.resolution,
            veil=VEIL / self.grid.resolution,
        )

    def local_map(self, number: int, pose: Floats, around: bool) -> LocalMap:
        """A view as a local map. It has a number instead of scans, and nobody travelled."""
        points, poses = self.look(pose, around)
        parts, origin = np.array([0, len(points)]), np.zeros((1, 3))
        return LocalMap(
            points=occupied(points, parts, parts[:1], origin, self.parameters.cell),
            trajectory=poses,
            first_scan=number,
            last_scan=number,
            travel=np.zeros(2),
            pose=compose(self.grid.origin, pose),
            free=self.free(pose, around, poses),
        )

    def cells(self, pose: Floats, around: bool) -> Cells:
        """(N,) where in the grid a view sees something, in cells of the local maps' size; none if too few.

        A cell is the number ``row * columns + column``; they rise.
        """
        points, _ = self.look(pose, around)
        columns, rows = np.floor(transform(pose, points) / self.parameters.cell).astype(np.int32).T
        cells = np.unique(rows * self.columns + columns)
        return cells if len(cells) >= FEWEST else cells[:0]

    @property
    def columns(self) -> int:
        """How many cells of the local maps' size lie side by side in the grid."""
        return ceil(self.grid.states.shape[1] * self.grid.resolution / self.parameters.cell)

    def local_maps(self, views: Views, numbers: NDArray[np.int64]) -> Iterator[LocalMap]:
        """The views of these numbers as local maps."""
        for number, view in zip(numbers.tolist(), views.of(numbers), strict=True):
            yield self.local_map(number, *view)


def distinct_views(sampler: Sampler, threads: int = 1, progress: Progress | None = None) -> Views:
    """Of all views few that stand for the others: no two from about one place show much the same.

    The views that see most come first, the first of equals. The same for any number of ``threads``.
    ``progress`` is called with (views done, total).
    """
    views = sampler.views()
    cells: list[Cells] = []
    chunks = [np.arange(k, min(k + CHUNK, len(views))) for k in range(0, len(views), CHUNK)]
    with ThreadPoolExecutor(threads) as pool:
        for part in pool.map(lambda chunk: [sampler.cells(*view) for view in views.of(chunk)], chunks):
            cells += part
            if progress:
                progress(len(cells), len(views))
    return views[_distinct(cells, sampler)]


def _distinct(cells: Sequence[Cells], sampler: Sampler) -> NDArray[np.int64]:
    """Which of the views that see these cells are kept, rising."""
    some = [view for view, seen in enumerate(cells) if len(seen)]
    rows_and_columns = [np.divmod(cells[view], sampler.columns) for view in some]
    centres = np.array([np.mean(both, axis=1) for both in rows_and_columns]).reshape(-1, 2)
    near = KDTree(centres * sampler.parameters.cell)
    kept: set[int] = set()
    for k in np.argsort([-len(cells[view]) for view in some], kind="stable").tolist():
        rivals = kept.intersection(near.query_ball_point(near.data[k], NEAR))
        if all(_likeness(cells[some[k]], cells[some[rival]]) < ALIKE for rival in rivals):
            kept.add(k)
    return np.array(some, dtype=np.int64)[sorted(kept)]


def _likeness(one: Cells, other: Cells) -> float:
    """The share of the cells of both that both have (Jaccard's index)."""
    common = len(np.intersect1d(one, other, assume_unique=True))
    return common / (len(one) + len(other) - common)
