"""A point cloud as one map: cut to a height band, checked for its units, seen from its centre of gravity."""

from dataclasses import dataclass

import numpy as np

from m2t_text.errors import CloudError, PartError
from m2t_text.logs.ros.point_scans import BAND, FLAT
from m2t_text.mapping.local_map import LocalMap
from m2t_text.mapping.registration import CELL, HALF
from m2t_text.util.types import Floats

MAX_COORDINATE = 1e9  # m; beyond it a number is damage
WIDEST = 1000.0  # m; a map is of one place, and hardly a building is wider
COMPARED = 2 * HALF * CELL  # m; of two maps no more is compared about their viewpoints when they are verified
FLOOR_PERCENTILE = 1.0  # % of the points that may lie below the floor, or above the ceiling
FEWEST, MOST = 10, 200_000  # occupied cells of a map


@dataclass(frozen=True)
class Cloud:
    """One map: ``points`` (N, 2) in metres, and in ``warnings`` what was left out of the file."""

    name: str
    points: Floats
    warnings: tuple[str, ...] = ()

    def local_map(self, cell: float) -> LocalMap:
        """The map in the cloud's own frame. Its trajectory is the centre of gravity alone, facing +x.

        Raises CloudError if it has too few occupied cells for a map, or too many.
        """
        points = occupied(self.points, cell)
        if not FEWEST <= len(points) <= MOST:
            raise CloudError(
                f"{self.name}: {len(points):,} cells of {cell:g} m are occupied, and a map has {FEWEST} to "
                f"{MOST:,}: is it the map of a place, in metres?"
            )
        way = np.array([[*points.mean(axis=0), 0.0]])
        return LocalMap(points, way, 0, 0, np.zeros(2), np.zeros(3))


def to_cloud(name: str, points: Floats, height: tuple[float, float] | None = None) -> Cloud:
    """The cloud of points (N, 2) or (N, 3), metres, z upwards.

    Raises PartError if they are not in metres, or none lies within the height band.
    """
    finite = points[(np.abs(points) < MAX_COORDINATE).all(axis=1)]  # false for NaN, too
    warnings = []
    if len(finite) < len(points):
        warnings.append(f"{len(points) - len(finite):,} of {len(points):,} points are not finite, and left out")
    if not len(finite):
        raise PartError("no point in it is finite" if len(points) else "no point in it")
    width, depth = np.ptp(finite[:, :2], axis=0)
    if max(width, depth) > WIDEST:
        raise PartError(
            f"it spans {width:,.6g} by {depth:,.6g} m, a map at most {WIDEST:,.0f}: is it in millimetres? "
            "scale it to metres, and leave out stray points"
        )
    if max(width, depth) > COMPARED:
        warnings.append(
            f"it spans {width:.0f} by {depth:.0f} m, and hits are verified by the middle {COMPARED:.0f} m alone"
        )
    if finite.shape[1] == 3:
        band = height or default_band(finite[:, 2])
        if band is not None and height is None:
            warnings.append(f"cut to heights of {band[0]:.2f} to {band[1]:.2f} m; --height names others")
        finite = finite if band is None else cut(finite, band)
    return Cloud(name, finite[:, :2], tuple(warnings))


def default_band(heights: Floats) -> tuple[float, float] | None:
    """Where a laser would see walls, by the heights (N,) of all points; None for a cloud that is flat."""
    floor, ceiling = np.percentile(heights, [FLOOR_PERCENTILE, 100 - FLOOR_PERCENTILE])
    return None if ceiling - floor <= FLAT else (float(floor + BAND[0]), float(floor + BAND[1]))


def cut(points: Floats, band: tuple[float, float]) -> Floats:
    """The points (N, 3) within a band of heights. Raises PartError if there is none."""
    heights = points[:, 2]
    kept = points[(heights >= band[0]) & (heights <= band[1])]
    if not len(kept):
        raise PartError(
            f"no point at heights of {band[0]:g} to {band[1]:g} m; they are {heights.min():.3g} to "
            f"{heights.max():.3g} m: name others by --height"
        )
    return kept


def occupied(points: Floats, cell: float) -> Floats:
    """The mean point of every occupied cell, (M, 2), ordered by cell; as `local_map.occupied`, but sparse."""
    cells = np.floor(points / cell).astype(np.int64)
    cells -= cells.min(axis=0)
    slots, which, counts = np.unique(
        cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1], return_inverse=True, return_counts=True
    )
    sums = [np.bincount(which, weights=axis, minlength=len(slots)) for axis in points.T]
    return np.stack(sums, axis=1) / counts[:, None]
