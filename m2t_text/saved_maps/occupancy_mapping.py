"""Drawing a map from a log whose poses are known."""

import math

import numpy as np
from numpy.typing import NDArray

from m2t_text.errors import M2TError
from m2t_text.logs.log import Log
from m2t_text.mapping.scan_cloud import scan_points
from m2t_text.saved_maps.grid import FREE, OCCUPIED, UNKNOWN, Grid
from m2t_text.saved_maps.rays import add_along
from m2t_text.util.compiling import kernel
from m2t_text.util.geometry import compose, transform
from m2t_text.util.types import Floats, Ints

MARGIN = 1.0  # m about what was seen
HIT, MISS = (
    0.9,
    -0.3,
)  # log-odds that a scan adds to a cell in which a beam of it ends, and to one that it passes
LARGEST = 4e8  # cells


def build_map(log: Log, poses: Floats, scans: Ints, resolution: float = 0.05, reach: float = 20.0) -> Grid:
    """The map that some scans of a log show: occupied where the log-odds of hits and misses are above 0.

    Each scan counts once for a cell: as a hit if any of its beams ends there, else as a miss if any passes, so
    that beams that graze a wall do not clear it. People who walk by leave more misses than hits behind.
    (Moravec and Elfes, "High resolution maps from wide angle sonar", ICRA 1985; the rule for one scan is that
    of Hornung et al., "OctoMap", Autonomous Robots 2013.)

    Args:
        poses: (S, 3) of the robot at every scan of the log, in the frame of the map to be drawn.
        scans: (K,) which scans, K >= 1.
        resolution: metres, side of a cell.
        reach: metres; longer readings are not used.

    Raises M2TError if the map would have more than LARGEST cells.
    """
    lasers = compose(poses[scans], log.laser_pose)
    still = np.zeros(3)
    ends = [
        transform(laser, scan_points(log.scans[k], still, reach))
        for k, laser in zip(scans, lasers, strict=True)
    ]
    starts = np.concatenate([[0], np.cumsum([len(part) for part in ends])]).astype(np.int64)
    hits = np.concatenate(ends)
    seen = np.concatenate([hits, lasers[:, :2]])
    low = np.floor((seen.min(axis=0) - MARGIN) / resolution) * resolution
    columns, rows = np.ceil((seen.max(axis=0) + MARGIN - low) / resolution).astype(int)
    if int(columns) * int(rows) > LARGEST:
        raise M2TError(
            f"{log.name}: a map of {columns:,} x {rows:,} cells is too large; choose a coarser --resolution"
        )
    odds = np.zeros((rows, columns), dtype=np.float32)
    stamps = np.zeros((rows, columns), dtype=np.int32)
    _add_scans(odds, stamps, (lasers[:, :2] - low) / resolution, (hits - low) / resolution, starts)
    states = np.where(stamps == 0, UNKNOWN, np.where(odds > 0, OCCUPIED, FREE)).astype(np.int8)
    return Grid(states, resolution, np.array([*low, 0.0]))


@kernel
def _add_scans(
    odds: NDArray[np.float32], stamps: NDArray[np.int32], lasers: Floats, hits: Floats, starts: Ints
) -> None:
    """Adds scans to the log-odds (rows, columns): ``lasers`` (K, 2) and their ``hits`` (P, 2), in cells.

    The hits of scan k are ``hits[starts[k]:starts[k + 1]]``. A cell's stamp is that of the last scan that
    counted for it.
    """
    for k in range(len(lasers)):
        for p in range(starts[k], starts[k + 1]):
            column, row = int(math.floor(hits[p, 0])), int(math.floor(hits[p, 1]))
            if stamps[row, column] != k + 1:
                stamps[row, column] = k + 1
                odds[row, column] += HIT
        for p in range(starts[k], starts[k + 1]):
            add_along(odds, stamps, k + 1, lasers[k], hits[p], MISS)
