"""The trajectory: wheel odometry refined by scan matching (paper, IV-A). The ground truth is never read.

Every scan is registered against the few key scans before it. Only the recent past is used, so that the error
stays small over the length of a local map and a robot could do the same while it drives.
"""

from collections.abc import Iterator

import numpy as np

from m2t_text.config import MappingParameters
from m2t_text.logs.log import Log
from m2t_text.mapping.free_space import Beams
from m2t_text.mapping.local_map import Survey, travelled
from m2t_text.mapping.scan_cloud import scan_points
from m2t_text.mapping.scan_matcher import ScanMatcher
from m2t_text.util.geometry import travel
from m2t_text.util.types import Floats, Ints, Progress


def survey(log: Log, parameters: MappingParameters, progress: Progress | None = None) -> Survey:
    """A log's hits and its refined trajectory, for local maps. ``progress`` is called with (done, total)."""
    poses = []
    for pose in refined_poses(log):
        poses.append(pose)
        if progress:
            progress(len(poses), len(log.scans))
    beams = Beams.of(log, parameters.range_limit)
    return Survey(*hits(log, parameters.range_limit), np.array(poses).reshape(-1, 3), log.cuts, beams)


def hits(log: Log, range_limit: float) -> tuple[Floats, Ints]:
    """``points`` and ``starts`` of a log's `Survey`."""
    points = [scan_points(scan, log.laser_pose, range_limit) for scan in log.scans]
    starts = np.concatenate([[0], np.cumsum([len(part) for part in points])]).astype(np.int64)
    return np.concatenate([np.empty((0, 2)), *points]), starts


def refined_poses(log: Log) -> Iterator[Floats]:
    """The robot's pose (3,) at each scan, in the frame of the first scan; matched as they are asked for.

    A drive whose odometry never moves is matched by its scans alone.
    """
    matcher = ScanMatcher(log.laser_pose, without_wheels(log))
    for scan in log.scans:
        yield matcher.add(scan)


def travel_of(log: Log) -> Floats:
    """(S,) metres of travel up to each scan: by wheel odometry, or where a drive has none by scan matching."""
    if without_wheels(log):
        return np.fromiter(travelled(refined_poses(log)), float, len(log.scans))
    return travel(log.odometry)


def without_wheels(log: Log) -> set[int]:
    """The drives whose odometry never moves."""
    firsts = {scan.drive: scan.odometry for scan in reversed(log.scans)}
    moving = {scan.drive for scan in log.scans if (scan.odometry != firsts[scan.drive]).any()}
    return set(firsts) - moving
