"""A run matched by itself: only the part of a log that one local map needs."""

from dataclasses import replace
from itertools import tee

import numpy as np

from m2t_text.config import MappingParameters
from m2t_text.logs.log import Log
from m2t_text.mapping.free_space import Beams, longest_reading
from m2t_text.mapping.local_map import LocalMap, Survey, local_maps, travelled
from m2t_text.mapping.scan_matcher import REFERENCE
from m2t_text.mapping.trajectory import hits, refined_poses, travel_of
from m2t_text.util.geometry import between
from m2t_text.util.types import Floats

# How much of the log before the run is matched, so that its scans have nearly the reference of the whole log:
BEFORE = 2 * REFERENCE[0]  # m of travel,
SCANS_BEFORE = 500  # but not all the scans of a robot that stood there, or whose wheels do not count


def local_map_at(log: Log, scan: int, parameters: MappingParameters) -> LocalMap:
    """The local map that begins at a scan; its run is shorter than ``run_length`` only where the log ends.

    Its points and trajectory are nearly those that the whole log gives. Its travel and pose are not, as they
    would take the whole log: it begins where wheel odometry alone puts the scan, travel counted from the log's
    first scan and the pose in that scan's robot frame. The travel's end is the refined run's length later.
    """
    odometry = log.odometry
    way = travel_of(log)
    begin = max(int(np.searchsorted(way, way[scan] - BEFORE)), scan - SCANS_BEFORE, 0)
    window = replace(log, scans=log.scans[begin:], ground_truth=None)
    trajectory = _until(window, scan - begin, parameters.run_length)
    window = replace(window, scans=window.scans[: len(trajectory)])
    longest = max((longest_reading(before) for before in log.scans[:begin]), default=0.0)
    beams = Beams.of(window, parameters.range_limit, longest)
    survey = Survey(*hits(window, parameters.range_limit), trajectory, window.cuts, beams)
    (found,) = local_maps(survey, parameters, np.array([scan - begin]))
    return replace(
        found,
        first_scan=found.first_scan + begin,
        last_scan=found.last_scan + begin,
        travel=found.travel - found.travel[0] + way[scan],
        pose=between(odometry[0], odometry[scan]),
    )


def _until(log: Log, first: int, run_length: float) -> Floats:
    """Refined poses (K, 3) of a log up to the one that completes the run that begins at scan ``first``.

    Travel is counted from the log's first scan, as `local_maps` counts it: small steps add up differently from
    another scan on, and the run might be cut short.
    """
    matched, again = tee(refined_poses(log))
    poses, way = [], []
    for pose, gone in zip(matched, travelled(again), strict=True):
        poses.append(pose)
        way.append(gone)
        if len(way) > first and gone >= way[first] + run_length:
            break
    return np.array(poses)
