"""Key scans: those that stand for the scans around them, so that a graph of a long drive stays small."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from m2t_text.logs.log import Log
from m2t_text.mapping.scan_cloud import ScanCloud, scan_cloud
from m2t_text.util.geometry import between, compose, travel, wrap
from m2t_text.util.types import Floats, Ints

KEY_STEP = (0.3, np.radians(20.0))  # m and rad from one key scan to the next
METRES_PER_RADIAN = 0.3  # m of way that one radian of turning counts as, where a correction is spread
VIEW = 8.0  # m; points farther away do not count for what a scan looks at
SUBMAP_RADIUS = 3.0  # m; key scans farther away are not drawn into a submap
SUBMAP = 3  # key scans before and after the one in a submap's middle


@dataclass(frozen=True)
class KeyScans:
    """The key scans of a drive.

    Attributes:
        numbers: (K,) indices into the log.
        clouds: their points, and the normals of the walls' sides that they saw.
        way: (K,) metres of travel up to each.
        drives: (K,) number of the drive that each belongs to.
    """

    numbers: Ints
    clouds: Sequence[ScanCloud]
    way: Floats
    drives: Ints

    def __len__(self) -> int:
        return len(self.numbers)

    def chosen(self, own: NDArray[np.bool_]) -> "KeyScans":
        """Those of a mask (K,) that leaves out whole drives; travel and numbers of drives begin anew."""
        clouds = [self.clouds[k] for k in np.flatnonzero(own).tolist()]
        _, drives = np.unique(self.drives[own], return_inverse=True)
        return KeyScans(self.numbers[own], clouds, self.way[own] - self.way[own][0], drives)

    def looked_at(self, poses: Floats) -> Floats:
        """(K, 2) the middle of what each sees, at ``poses`` (K, 3).

        A scan that looks back sees the same from elsewhere.
        """
        return compose(poses, self._middles)[:, :2]

    @cached_property
    def _middles(self) -> Floats:
        """(K, 3) the same in the frame of each."""
        middles = np.zeros((len(self), 3))
        for k, cloud in enumerate(self.clouds):
            near = cloud.points[np.hypot(cloud.points[:, 0], cloud.points[:, 1]) < VIEW]
            if len(near):
                middles[k, :2] = near.mean(axis=0)
        return middles

    def submap(self, middle: int, poses: Floats) -> ScanCloud:
        """What was seen shortly before and after a key scan, in its frame, all at ``poses`` (K, 3)."""
        first, last = max(middle - SUBMAP, 0), min(middle + SUBMAP, len(self) - 1)
        near = np.arange(first, last + 1)
        away = between(poses[middle], poses[near])
        kept = (np.hypot(away[:, 0], away[:, 1]) <= SUBMAP_RADIUS) & (self.drives[near] == self.drives[middle])
        parts = [self.clouds[k].moved(pose) for k, pose in zip(near[kept], away[kept], strict=True)]
        return ScanCloud(
            np.concatenate([part.points for part in parts]), np.concatenate([part.normals for part in parts])
        )


def key_scans(log: Log, trajectory: Floats) -> KeyScans:
    """The key scans of a log whose robot drove along a trajectory (S, 3)."""
    drives = np.array([scan.drive for scan in log.scans], dtype=np.int64)
    numbers = [0]
    for i, pose in enumerate(trajectory):
        last = trajectory[numbers[-1]]
        far = np.hypot(*(pose - last)[:2]) > KEY_STEP[0] or abs(wrap(pose[2] - last[2])) > KEY_STEP[1]
        if far or drives[i] != drives[numbers[-1]]:
            numbers.append(i)
    chosen = np.array(numbers, dtype=np.int64)
    clouds = [scan_cloud(log.scans[k], log.laser_pose).facing(log.laser_pose[:2]) for k in numbers]
    return KeyScans(chosen, clouds, travel(trajectory)[chosen], drives[chosen])


def spread(trajectory: Floats, keys: KeyScans, corrected: Floats) -> Floats:
    """The trajectory (S, 3) bent so that its key scans lie at their ``corrected`` poses (K, 3).

    A scan between two key scans keeps its place as seen from both, the nearer one counting more.
    """
    scans = np.arange(len(trajectory))
    before = np.searchsorted(keys.numbers, scans, side="right") - 1
    after = np.minimum(before + 1, len(keys) - 1)
    after = np.where(keys.drives[after] == keys.drives[before], after, before)
    begin, end = keys.numbers[before], keys.numbers[after]
    ahead = compose(corrected[before], between(trajectory[begin], trajectory))
    behind = compose(corrected[after], between(trajectory[end], trajectory))
    turned = np.concatenate([[0.0], np.cumsum(np.abs(wrap(np.diff(trajectory[:, 2]))))])
    way = travel(trajectory) + METRES_PER_RADIAN * turned
    share = np.clip((way - way[begin]) / np.maximum(way[end] - way[begin], 1e-9), 0.0, 1.0)
    return compose(ahead, between(ahead, behind) * share[:, None])
