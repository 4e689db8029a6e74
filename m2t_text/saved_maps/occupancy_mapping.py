"""Drawing a map from a log whose poses are known."""

import numpy as np
from numpy.typing import NDArray

from m2t_text.logs.log import Log
from m2t_text.mapping.trajectory import scan_points
from m2t_text.saved_maps.grid import FREE, OCCUPIED, UNKNOWN, Grid
from m2t_text.saved_maps.rays import count
from m2t_text.util.geometry import compose, transform
from m2t_text.util.types import Floats

MARGIN = 1.0  # m about what was seen
SOLID = 0.25  # share of the beams that come to a cell; if more of them meet something there, it is occupied


def draw_map(
    log: Log, poses: Floats, scans: NDArray[np.int64], resolution: float = 0.05, reach: float = 20.0
) -> Grid:
    """The map that some scans of a log show, by the reflection counts of their beams.

    This is the rule of grid mapping with known poses (Hähnel et al., "Map building with mobile robots in
    dynamic environments", ICRA 2003): a cell is occupied where enough of the beams that came to it ended in it.

    Args:
        poses: (S, 3) of the robot at every scan of the log, in the frame of the map to be drawn.
        scans: (K,) which scans, K >= 1.
        resolution: metres, side of a cell.
        reach: metres; longer readings are not used.
    """
    lasers = compose(poses[scans], log.laser_pose)
    still = np.zeros(3)
    ends = [
        transform(laser, scan_points(log.scans[k], still, reach))
        for k, laser in zip(scans, lasers, strict=True)
    ]
    seen = np.concatenate([*ends, lasers[:, :2]])
    low = np.floor((seen.min(axis=0) - MARGIN) / resolution) * resolution
    columns, rows = np.ceil((seen.max(axis=0) + MARGIN - low) / resolution).astype(int)
    passed, met = np.zeros((rows, columns), dtype=np.int32), np.zeros((rows, columns), dtype=np.int32)
    for laser, hit in zip(lasers, ends, strict=True):
        cells = (hit - low) / resolution
        count(passed, (laser[:2] - low) / resolution, cells)
        i, j = np.floor(cells).astype(int).T
        np.add.at(met, (j, i), 1)
    came = passed + met
    states = np.where(came == 0, UNKNOWN, np.where(met > SOLID * came, OCCUPIED, FREE)).astype(np.int8)
    return Grid(states, resolution, np.array([*low, 0.0]))
