"""Closings: where a drive came back, found by laying what it saw on some metres on what it saw there before.

Texts are looked up without a guess of where the robot is, and so need a place like no other. Where the
trajectory says that the robot is near a place, less is enough: a long submap is searched for within some
metres, as by Hess et al., "Real-time loop closure in 2D lidar SLAM" (ICRA 2016), and taken where it fits at one
place clearly better than at any other, and another submap of the same visits agrees.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from m2t_text.mapping.registration import CORRELATION, SIDE_LENGTH
from m2t_text.mapping.scan_cloud import ScanCloud
from m2t_text.mapping.wide_search import fitting_places
from m2t_text.slam.frames import frames
from m2t_text.slam.key_scans import KeyScans
from m2t_text.slam.neighbours import VISIT, certainty
from m2t_text.slam.optimisation import Constraints
from m2t_text.slam.reach import reached
from m2t_text.util.geometry import between, compose, inverse, wrap
from m2t_text.util.types import Floats, Ints, Progress

EVERY = 3.0  # m of travel from one submap to the next
HALF, MORE = 6.0, 4.0  # m of travel to both sides of a submap's middle, and so many more of what it is laid on
WINDOW = (6.0, np.radians(11.5))  # m and rad; half-width of the search
TIED = 0.09  # m; standard deviation of a relative place from which it may be off
MIN_TRAVEL_APART = 25.0  # m of travel between two visits, at least
REACH = 16.0  # m; points farther away are left out
SPACING = (0.1, 0.03)  # m between the points of a submap, and of what it is laid on
ON_WALL, OPPOSITE = 0.2, 0.5  # m to a wall, and cosine of the angle between its normals: it is seen from behind
INLIERS = 0.6  # share of its points that find a partner
CLEAR, HINT = 4.0, 1.0  # by which the log-likelihood is above that of any other place: to be taken, to agree
OTHER = (0.3, 0.1)  # m and rad between two places
BORDER = 0.3  # m; so near to the window's border the best place may lie beyond it
TOGETHER = (5.0, 30.0)  # m of travel between two closings that agree, least and most
AGREED = (0.5, np.radians(2.5))  # m and rad by which they may differ
LOOSE = np.diag([0.05, 0.05, 0.01]) ** 2  # m², m², rad²; as long submaps are bent


@dataclass(frozen=True)
class _Closing:
    """The key scan ``scan`` as seen from ``place``, and how clear that is."""

    scan: int
    place: int
    pose: Floats
    information: Floats
    clear: float


def closings(
    keys: KeyScans, poses: Floats, steps: Floats, known: Constraints, jobs: int, progress: Progress
) -> Constraints:
    """Between key scans at ``poses`` (K, 3) whose relative place is not known.

    By ``steps`` (K - 1,) and ``known`` constraints, as `reached` takes them.
    """
    pairs = list(_pairs(keys, poses, steps, known))
    found: list[_Closing] = []
    with ThreadPoolExecutor(jobs) as pool:
        for done, one in enumerate(pool.map(lambda pair: _laid(keys, poses, *pair), pairs), start=1):
            found += [one] if one else []
            progress(done, len(pairs))
    clear = [one for one in found if one.clear >= CLEAR]
    taken = [one for one in clear if any(_agree(one, other, keys, poses) for other in found)]
    return _constraints(taken)


def _pairs(keys: KeyScans, poses: Floats, steps: Floats, known: Constraints) -> Iterator[tuple[int, int]]:
    """A key scan every EVERY metres, and of each earlier visit the one that looks at nearly the same."""
    centres = keys.looked_at(poses)
    tree = KDTree(centres)
    frame = frames(keys, known)
    after = -np.inf
    for scan, tied in enumerate(reached(keys, steps, known, TIED)):
        if keys.way[scan] < after:
            continue
        after = keys.way[scan] + EVERY
        near = np.sort(np.array(tree.query_ball_point(centres[scan], WINDOW[0]), dtype=np.int64))
        other = (keys.drives[near] != keys.drives[scan]) | (keys.way[scan] - keys.way[near] > MIN_TRAVEL_APART)
        near = near[(near < scan) & other & ~tied[near]]
        near = near[frame[keys.drives[near]] == frame[keys.drives[scan]]]
        for visit in np.split(near, np.flatnonzero(np.diff(near) > VISIT) + 1):
            if len(visit):
                yield scan, int(visit[np.argmin(np.hypot(*(centres[visit] - centres[scan]).T))])


def _submap(keys: KeyScans, poses: Floats, middle: int, half: float, spacing: float) -> ScanCloud:
    """What was seen on the way ``half`` metres before and after a key scan, in its frame."""
    first, last = np.searchsorted(keys.way, [keys.way[middle] - half, keys.way[middle] + half])
    near = np.arange(first, last)
    near = near[keys.drives[near] == keys.drives[middle]]
    away = between(poses[middle], poses[near])
    parts = [keys.clouds[k].moved(pose) for k, pose in zip(near, away, strict=True)]
    points = np.concatenate([part.points for part in parts])
    cloud = ScanCloud(points, np.concatenate([part.normals for part in parts]))
    cloud = cloud.chosen(np.abs(points).max(axis=1, initial=0.0) < SIDE_LENGTH / 2)
    _, one = np.unique(np.floor(cloud.points / spacing).astype(np.int64), axis=0, return_index=True)
    return cloud.chosen(np.sort(one))


def _laid(keys: KeyScans, poses: Floats, scan: int, place: int) -> _Closing | None:
    """Where the submap about a key scan fits best near that of an earlier one."""
    expected = between(poses[place], poses[scan])
    seen = _submap(keys, poses, place, HALF + MORE, SPACING[1]).moved(inverse(expected))
    seen = seen.chosen(np.abs(seen.points).max(axis=1, initial=0.0) < SIDE_LENGTH / 2)
    about = _submap(keys, poses, scan, HALF, SPACING[0])
    about = about.chosen(np.abs(about.points).max(axis=1, initial=0.0) < REACH)
    if not len(seen.points) or not len(about.points):
        return None
    places, fits, inliers = fitting_places(seen.points, seen.normals, about.points, *WINDOW, np.array(WINDOW))
    behind = np.array([_back_to_back(seen, about.moved(pose)) for pose in places])
    fits, inliers = fits - behind * len(about.points) / CORRELATION, inliers - behind
    best = int(np.argmax(fits))
    off = places - places[best]
    others = (np.hypot(off[:, 0], off[:, 1]) > OTHER[0]) | (np.abs(wrap(off[:, 2])) > OTHER[1])
    clear = float(fits[best] - fits[others].max(initial=-np.inf)) if others.any() else np.inf
    inside = np.abs(places[best, :2]).max() < WINDOW[0] - BORDER
    if inliers[best] < INLIERS or clear < HINT or not inside:
        return None
    information, _ = certainty(seen, about, places[best], LOOSE)
    return _Closing(scan, place, compose(expected, places[best]), information, clear)


def _back_to_back(seen: ScanCloud, about: ScanCloud) -> float:
    """The share of points that lie on walls seen from the other side.

    Where a corridor branches off, the wall that is seen from here may look like the other one seen from there.
    """
    distance, nearest = KDTree(seen.points).query(about.points)
    facing = (about.normals * seen.normals[nearest]).sum(axis=1)
    return float(((distance < ON_WALL) & (facing < -OPPOSITE)).mean())


def _agree(one: _Closing, other: _Closing, keys: KeyScans, poses: Floats) -> bool:
    """Whether two closings are of the same visits, but not of the same spot, and say the same."""
    apart = abs(keys.way[one.scan] - keys.way[other.scan]), abs(keys.way[one.place] - keys.way[other.place])
    if not (TOGETHER[0] <= min(apart) and max(apart) <= TOGETHER[1]):
        return False
    there, back = between(poses[other.place], poses[one.place]), between(poses[one.scan], poses[other.scan])
    error = between(compose(compose(there, one.pose), back), other.pose)
    return bool(np.hypot(error[0], error[1]) < AGREED[0] and abs(error[2]) < AGREED[1])


def _constraints(taken: list[_Closing]) -> Constraints:
    pairs: Ints = np.array([(one.place, one.scan) for one in taken], dtype=np.int64).reshape(-1, 2)
    return Constraints(
        pairs,
        np.array([one.pose for one in taken]).reshape(-1, 3),
        np.array([one.information for one in taken]).reshape(-1, 3, 3),
        np.ones(len(taken), dtype=bool),
    )
