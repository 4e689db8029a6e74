"""Constraints between key scans that lie near each other, each measured by registration.

Scans of one visit tie the trajectory together; scans of two visits close loops, as in Cartographer's backend
(Hess et al., "Real-time loop closure in 2D lidar SLAM", ICRA 2016), where a scan is matched with a submap. Only
pairs are compared whose relative place is known already: each new constraint lets its neighbours follow.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from m2t_text.mapping.registration import SIDE_LENGTH, fit, register
from m2t_text.mapping.scan_cloud import ScanCloud
from m2t_text.slam.key_scans import KeyScans
from m2t_text.slam.optimisation import Constraints
from m2t_text.slam.reach import WEAK, reached
from m2t_text.util.geometry import between, compose, inverse, wrap
from m2t_text.util.types import Floats, Ints, Progress

BEHIND = 3  # key scans before a scan to which it is tied
MAX_DISTANCE = 2.5  # m between what two key scans of different visits look at, where they are compared
MIN_TRAVEL_APART = 3.0  # m of travel between two visits, at least
VISIT = 3  # key scans by which two of one visit may be apart
KNOWN = 0.3  # m; standard deviation of a relative place up to which it is searched for
WINDOW = (0.6, np.radians(6.0))  # m and rad; the search about the place that is known
LOOSE, TIGHT = np.array([0.5, 0.1]), np.array([0.3, 0.1])  # m and rad; standard deviations of that place
INLIERS = 0.5  # share of the scan's points that find a partner
SHIFT = (0.5, 0.15)  # m and rad; scans of one visit that move by more were confused
# Errors of the registration beyond those of the fit:
REMAINDER = np.array([0.01, 0.01, 0.003])  # m, m, rad
NOISE, CORRELATION = 0.01, 10.0  # m, least noise of points; so many points count as one
FALSE_HOLD = 0.01  # share of walls across a direction that may be noise of normals


@dataclass(frozen=True)
class _Measured:
    pose: Floats
    information: Floats
    inliers: float
    shift: Floats


def pairs_behind(keys: KeyScans) -> Ints:
    """(P, 2) each key scan, and the few before it on the same drive."""
    later = np.arange(len(keys))
    pairs = np.concatenate([np.column_stack([later[k:], later[:-k]]) for k in range(1, BEHIND + 1)])
    pairs = pairs[keys.drives[pairs[:, 0]] == keys.drives[pairs[:, 1]]]
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def pairs_nearby(keys: KeyScans, poses: Floats, steps: Floats, known: Constraints) -> Ints:
    """(P, 2) each key scan, and the one most like it of each earlier visit near its place.

    Of key scans at ``poses`` (K, 3), those whose relative place is known, by ``steps`` (K - 1,) and ``known``
    constraints as `reached` takes them. Near are two that look at nearly the same, if from opposite sides.
    """
    centres = keys.looked_at(poses)
    tree = KDTree(centres)
    found = []
    for scan, tied in enumerate(reached(keys, steps, known, KNOWN)):
        near = np.sort(np.array(tree.query_ball_point(centres[scan], MAX_DISTANCE), dtype=np.int64))
        other = (keys.drives[near] != keys.drives[scan]) | (keys.way[scan] - keys.way[near] > MIN_TRAVEL_APART)
        near = near[(near < scan) & other]
        near = near[tied[near]]
        for visit in np.split(near, np.flatnonzero(np.diff(near) > VISIT) + 1):
            if len(visit):
                away = np.hypot(*(centres[visit] - centres[scan]).T)
                unlike = away + np.abs(wrap(poses[visit, 2] - poses[scan, 2]))
                found.append((scan, visit[np.argmin(unlike)]))
    return np.array(found, dtype=np.int64).reshape(-1, 2)


class Neighbours:
    """Measures pairs of key scans; what was measured at nearly the same place before is not measured again."""

    def __init__(self, keys: KeyScans, jobs: int) -> None:
        self._keys = keys
        self._jobs = jobs

    def behind(self, poses: Floats, progress: Progress) -> Constraints:
        """Those of one visit, at key scans' ``poses`` (K, 3)."""
        pairs = pairs_behind(self._keys)
        references = dict(enumerate(self._keys.clouds))
        measured = self._measured(pairs, references, poses, (0.0, 0.0), TIGHT, progress)
        kept = np.array(
            [
                one.inliers > INLIERS
                and bool(np.hypot(*one.shift[:2]) < SHIFT[0] and abs(one.shift[2]) < SHIFT[1])
                for one in measured
            ],
            dtype=bool,
        )
        return _constraints(pairs, measured, kept)

    def nearby(self, pairs: Ints, poses: Floats, search: bool, progress: Progress) -> Constraints:
        """Those of two visits, at key scans' ``poses`` (K, 3); with a search about the place that is known."""
        references = {int(k): self._keys.submap(int(k), poses) for k in np.unique(pairs[:, 1])}
        window = WINDOW if search else (0.0, 0.0)
        measured = self._measured(pairs, references, poses, window, LOOSE, progress)
        return _constraints(pairs, measured, np.array([one.inliers > INLIERS for one in measured], dtype=bool))

    def _measured(
        self,
        pairs: Ints,
        references: dict[int, ScanCloud],
        poses: Floats,
        window: tuple[float, float],
        sigma: Floats,
        progress: Progress,
    ) -> list[_Measured]:
        def one(pair: Ints) -> _Measured:
            scan, reference = int(pair[0]), int(pair[1])
            expected = between(poses[reference], poses[scan])
            return _registered(references[reference], self._keys.clouds[scan], expected, window, sigma)

        measured = []
        with ThreadPoolExecutor(self._jobs) as pool:  # compiled code lets the others run
            for result in pool.map(one, pairs):
                measured.append(result)
                progress(len(measured), len(pairs))
        return measured


def _registered(
    reference: ScanCloud, scan: ScanCloud, expected: Floats, window: tuple[float, float], sigma: Floats
) -> _Measured:
    seen = reference.moved(inverse(expected))
    near = np.abs(seen.points).max(axis=1, initial=0.0) < SIDE_LENGTH / 2
    points, normals = seen.points[near], seen.normals[near]
    shift, _ = register(points, normals, scan.points, *window, sigma)
    information, inliers = certainty(ScanCloud(points, normals), scan, shift, np.diag(REMAINDER**2))
    return _Measured(compose(expected, shift), information, inliers, shift)


def certainty(reference: ScanCloud, scan: ScanCloud, pose: Floats, remainder: Floats) -> tuple[Floats, float]:
    """The information (3, 3) of the ``pose`` (3,) of a scan in a reference's frame, and the share of inliers.

    The ``remainder`` (3, 3) is its covariance beyond that of the fit.
    """
    hessian, noise, inliers = fit(reference.points, reference.normals, scan.points, pose)
    variance = max(noise, NOISE) ** 2 * CORRELATION
    covariance = np.linalg.inv(hessian / variance + WEAK) + remainder + _unheld(hessian, variance)
    return np.linalg.inv(covariance).astype(float), inliers


def _unheld(hessian: Floats, variance: float) -> Floats:
    """(3, 3) covariance to be added along walls, where what seems to hold a scan may be noise."""
    weight = hessian[0, 0] + hessian[1, 1]
    if weight <= 0:
        return np.zeros((3, 3))
    values, directions = np.linalg.eigh(hessian[:2, :2])
    seeming, held = values[0], max(values[0] - FALSE_HOLD * weight, 0.0)
    more = 1.0 / (held / variance + WEAK[0, 0]) - 1.0 / (seeming / variance + WEAK[0, 0])
    added = np.zeros((3, 3))
    added[:2, :2] = more * np.outer(directions[:, 0], directions[:, 0])
    return added


def _constraints(pairs: Ints, measured: list[_Measured], kept: NDArray[np.bool_]) -> Constraints:
    return Constraints(
        pairs[kept, ::-1],
        np.array([one.pose for one in measured]).reshape(-1, 3)[kept],
        np.array([one.information for one in measured]).reshape(-1, 3, 3)[kept],
        np.ones(int(kept.sum()), dtype=bool),
    )
