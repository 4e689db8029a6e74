"""The trajectory: wheel odometry refined by scan matching (paper, IV-A). The ground truth is never read.

Every scan is registered against the few key scans before it. Only the recent past is used, so that the error
stays small over the length of a local map and a robot could do the same while it drives.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m2t_text.config import MappingParameters
from m2t_text.logs.log import Log, Scan
from m2t_text.mapping.free_space import Beams
from m2t_text.mapping.local_map import Survey
from m2t_text.mapping.normals import normals
from m2t_text.mapping.registration import register
from m2t_text.util.geometry import between, compose, transform, wrap
from m2t_text.util.types import Floats, Progress

MATCH_RANGE = 20.0  # m; farther hits hit the beam's divergence more than the wall
THIN = 0.05  # m; neighbouring points nearer than this are one
NORMAL_REACH = 0.35  # m; largest gap between neighbours on one wall
KEY_STEP = (0.3, np.radians(20.0))  # m and rad from the last key scan to the next
REFERENCE = (4.0, 2, 8)  # m of travel looked back, least and greatest number of key scans
WORTH_A_SEARCH = (0.05, 0.03)  # m and rad of motion below which odometry is near enough for ICP alone
SEARCH_SIGMAS = 2.5  # half-width of the search, in standard deviations of the prediction
WIDEST = (2.0, 2.0)  # m and rad; no wider, however far odometry leaps: five real logs need 0.95 m and 1.7 rad


@dataclass(frozen=True)
class ScanCloud:
    """``points`` (N, 2) of a scan, metres, and unit ``normals`` (N, 2) of their walls, zero where unknown."""

    points: Floats
    normals: Floats

    def moved(self, pose: Floats) -> "ScanCloud":
        """The same in the frame in which ``pose`` (3,), that of the cloud's own frame, is given."""
        turn = np.array([0.0, 0.0, pose[2]])
        return ScanCloud(transform(pose, self.points), transform(turn, self.normals))


def survey(log: Log, parameters: MappingParameters, progress: Progress | None = None) -> Survey:
    """A log's hits and its refined trajectory, ready for local maps. ``progress`` is told (scans done, all)."""
    poses = []
    for pose in refined_poses(log):
        poses.append(pose)
        if progress:
            progress(len(poses), len(log.scans))
    beams = Beams.of(log, parameters.range_limit)
    return Survey(*hits(log, parameters.range_limit), np.array(poses).reshape(-1, 3), log.cuts, beams)


def hits(log: Log, range_limit: float) -> tuple[Floats, NDArray[np.int64]]:
    """``points`` and ``starts`` of a log's `Survey`."""
    points = [scan_points(scan, log.laser_pose, range_limit) for scan in log.scans]
    starts = np.concatenate([[0], np.cumsum([len(part) for part in points])]).astype(np.int64)
    return np.concatenate([np.empty((0, 2)), *points]), starts


def scan_points(scan: Scan, laser_pose: Floats, range_limit: float) -> Floats:
    """(N, 2) hits of a scan within the range limit, in the robot's frame, in beam order."""
    hit = (scan.ranges > 0) & (scan.ranges <= range_limit)
    ranges, angles = scan.ranges[hit], scan.angles[hit]
    return transform(laser_pose, np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=1))


def refined_poses(log: Log) -> Iterator[Floats]:
    """The robot's pose (3,) at each scan, in the frame of the first scan; matched as they are asked for."""
    matcher = ScanMatcher(log.laser_pose)
    for scan in log.scans:
        yield matcher.add(scan)


@dataclass(frozen=True)
class KeyScan:
    """A scan that later ones are matched against: its cloud, pose (3,), and metres of travel by odometry."""

    cloud: ScanCloud
    pose: Floats
    way: float


class ScanMatcher:
    """Matches scan after scan, of a log or of a robot that drives, and keeps only what later ones need.

    A new drive begins where the one before ends, as nothing is known of the way there, and matches none of it.
    """

    def __init__(self, laser_pose: Floats) -> None:
        self._laser_pose = laser_pose
        self._keys: deque[KeyScan] = deque(maxlen=REFERENCE[2])
        self._last: Scan | None = None
        self._pose = np.zeros(3)
        self._way = 0.0  # m of travel by odometry

    def add(self, scan: Scan) -> Floats:
        """The robot's pose (3,) at the next scan, in the frame of the first scan."""
        cloud = scan_cloud(scan, self._laser_pose)
        last, pose = self._last, self._pose
        if last is not None:
            self._way += float(np.hypot(*(scan.odometry - last.odometry)[:2]))
            if scan.drive != last.drive:
                self._keys.clear()
            else:
                motion = between(last.odometry, scan.odometry)
                predicted = compose(pose, motion)
                reference = [key.cloud.moved(between(predicted, key.pose)) for key in self._recent()]
                pose = compose(predicted, _correction(reference, cloud, motion))
        if not self._keys or _far(self._keys[-1].pose, pose):
            self._keys.append(KeyScan(cloud, pose, self._way))
        self._last, self._pose = scan, pose
        return pose

    def _recent(self) -> list[KeyScan]:
        reach, least, _ = REFERENCE
        keys = list(self._keys)
        near = [key for key in keys if self._way - key.way <= reach]
        return near if len(near) >= least else keys[-least:]


def scan_cloud(scan: Scan, laser_pose: Floats) -> ScanCloud:
    """A scan as scan matching sees it, in the robot's frame: thinned, and cut at MATCH_RANGE."""
    points = scan_points(scan, laser_pose, MATCH_RANGE)
    kept = _thinned(points)
    return ScanCloud(points[kept], normals(points, NORMAL_REACH)[kept])


def _thinned(points: Floats) -> NDArray[np.int64]:
    """Indices of points that are at least THIN apart along the scan."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))]) if len(points) else points
    return np.unique(np.floor(along / THIN), return_index=True)[1]


def _far(a: Floats, b: Floats) -> bool:
    return bool(np.hypot(*(b - a)[:2]) > KEY_STEP[0] or abs(wrap(b[2] - a[2])) > KEY_STEP[1])


def _correction(reference: list[ScanCloud], cloud: ScanCloud, motion: Floats) -> Floats:
    """What scan matching adds to a pose that odometry predicts, in the predicted frame."""
    distance, turn = float(np.hypot(*motion[:2])), abs(float(motion[2]))
    # A bad wheel odometry's errors: slip in proportion to the way, and heading errors from both.
    sigma = np.array([0.05 + 0.2 * distance, 0.03 + 0.3 * turn + 0.1 * distance])
    search = distance > WORTH_A_SEARCH[0] or turn > WORTH_A_SEARCH[1]
    window = np.minimum(SEARCH_SIGMAS * sigma, WIDEST) if search else np.zeros(2)
    points = np.concatenate([part.points for part in reference])
    point_normals = np.concatenate([part.normals for part in reference])
    return register(points, point_normals, cloud.points, window[0], window[1], sigma)[0]
