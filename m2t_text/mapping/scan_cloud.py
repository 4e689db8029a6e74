"""A scan as scan matching sees it: points, and the directions of the walls that they lie on."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m2t_text.logs.log import Scan
from m2t_text.mapping.normals import normals
from m2t_text.util.geometry import transform, wrap
from m2t_text.util.types import Floats, Ints

MATCH_RANGE = 20.0  # m; farther hits hit the beam's divergence more than the wall
THIN = 0.05  # m; neighbouring points nearer than this are one
FILL = 0.1  # m; between the points that fill a wall
STRAIGHT, LONGEST = np.radians(3.0), 3.0  # rad by which a wall bends from gap to gap, and m of a gap, at most
NORMAL_REACH = 0.35  # m; largest gap between neighbours on one wall


@dataclass(frozen=True)
class ScanCloud:
    """``points`` (N, 2) of a scan, metres, and unit ``normals`` (N, 2) of their walls, zero where unknown."""

    points: Floats
    normals: Floats

    def moved(self, pose: Floats) -> "ScanCloud":
        """The same in the frame in which ``pose`` (3,), that of the cloud's own frame, is given."""
        turn = np.array([0.0, 0.0, pose[2]])
        return ScanCloud(transform(pose, self.points), transform(turn, self.normals))

    def chosen(self, kept: NDArray[np.bool_] | Ints) -> "ScanCloud":
        """The points of a mask (N,) or of numbers."""
        return ScanCloud(self.points[kept], self.normals[kept])

    def facing(self, viewpoint: Floats) -> "ScanCloud":
        """The same with normals that point to the side of its wall from which ``viewpoint`` (2,) sees it."""
        away = ((self.points - viewpoint) * self.normals).sum(axis=1) > 0
        return ScanCloud(self.points, np.where(away[:, None], -self.normals, self.normals))

    @property
    def solid(self) -> "ScanCloud":
        """The same with more points between neighbours on one wall, also where it runs away from the laser.

        Sparse points of a wall would fit those of another scan best where both were taken from one place, as if
        the robot had not moved.
        """
        gaps = np.diff(self.points, axis=0)
        lengths = np.hypot(gaps[:, 0], gaps[:, 1])
        bends = np.abs(wrap(np.diff(np.arctan2(gaps[:, 1], gaps[:, 0])))) < STRAIGHT
        straight = np.zeros(len(gaps), dtype=bool)
        straight[1:] |= bends
        straight[:-1] |= bends
        filled = (lengths <= NORMAL_REACH) | (straight & (lengths <= LONGEST))
        more = np.where(filled, np.ceil(lengths / FILL), 1).astype(np.int64)
        begin = np.repeat(np.arange(len(gaps)), more)
        share = (np.arange(len(begin)) - np.repeat(np.cumsum(more) - more, more)) / np.repeat(more, more)
        across = gaps[begin][:, ::-1] * [-1.0, 1.0] / lengths[begin][:, None]
        walls = np.where((share > 0)[:, None], across, self.normals[begin])
        points = self.points[begin] + share[:, None] * gaps[begin]
        return ScanCloud(np.concatenate([points, self.points[-1:]]), np.concatenate([walls, self.normals[-1:]]))


def joined(clouds: Sequence[ScanCloud], poses: Floats) -> ScanCloud:
    """All of some clouds in the frame in which their ``poses`` (K, 3) are given; as if each were moved."""
    sizes = [len(cloud.points) for cloud in clouds]
    points, walls = np.empty((sum(sizes), 2)), np.empty((sum(sizes), 2))
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turns = np.stack([c, s, -s, c], axis=1).reshape(-1, 2, 2)
    end = 0
    for cloud, turn, size in zip(clouds, turns, sizes, strict=True):
        part, end = slice(end, end + size), end + size
        np.matmul(cloud.points, turn, out=points[part])
        np.matmul(cloud.normals, turn, out=walls[part])
    points += np.repeat(poses[:, :2], sizes, axis=0)
    return ScanCloud(points, walls)


def scan_points(scan: Scan, laser_pose: Floats, range_limit: float) -> Floats:
    """(N, 2) hits of a scan within the range limit, in the robot's frame, in beam order."""
    hit = (scan.ranges > 0) & (scan.ranges <= range_limit)
    ranges, angles = scan.ranges[hit], scan.angles[hit]
    return transform(laser_pose, np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=1))


def scan_cloud(scan: Scan, laser_pose: Floats) -> ScanCloud:
    """A scan in the robot's frame: thinned, and cut at MATCH_RANGE."""
    points = scan_points(scan, laser_pose, MATCH_RANGE)
    kept = _thinned(points)
    return ScanCloud(points[kept], normals(points, NORMAL_REACH)[kept])


def _thinned(points: Floats) -> Ints:
    """Indices of points that are at least THIN apart along the scan."""
    if not len(points):
        return np.empty(0, dtype=np.int64)
    steps = np.diff(points, axis=0)
    place = np.zeros(len(points))
    np.cumsum(np.hypot(steps[:, 0], steps[:, 1]), out=place[1:])
    slots = np.floor(place / THIN)
    return np.flatnonzero(np.concatenate([[True], slots[1:] > slots[:-1]]))
