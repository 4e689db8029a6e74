"""Scan matching while the robot drives: a pose for each scan as it comes, from the few key scans before it."""

from collections import deque
from collections.abc import Container
from dataclasses import dataclass

import numpy as np

from m2t_text.logs.log import Scan
from m2t_text.mapping.registration import fit, register
from m2t_text.mapping.scan_cloud import ScanCloud, joined, scan_cloud
from m2t_text.mapping.wheel_slip import WheelSlip
from m2t_text.mapping.wide_search import register_widely
from m2t_text.util.geometry import between, compose, wrap
from m2t_text.util.types import Floats

KEY_STEP = (0.3, np.radians(20.0))  # m and rad from the last key scan to the next
REFERENCE = (4.0, 2, 8)  # m of travel looked back, least and greatest number of key scans
WORTH_A_SEARCH = (0.05, 0.03)  # m and rad of motion below which odometry is near enough for ICP alone
SEARCH_SIGMAS = 2.5  # half-width of the search, in standard deviations of the prediction
WIDEST = (2.0, 2.0)  # m and rad; no wider, however far odometry leaps: five real logs need 0.95 m and 1.7 rad
SLIP = 0.2  # m per m by which bad wheels err from one scan to the next
DENSE = (0.15, np.radians(10.0))  # m and rad from one scan to the next, at most: both see nearly the same
WALKERS = 0.15  # share of a scan that people may be who walk along with the robot
LOOK_BACK = 1.0  # m of travel over which it is seen whether scans and wheels differ by too much
HELD = (0.005, 0.015)  # share of walls across a direction below which nothing holds it, and above which they do
# Without wheels, the last motion is the guess for the next:
SURPRISE = np.array([0.5, 0.4])  # m and rad by which that errs, before anything is known of the drive;
MEMORY = 30  # scans over which it is learnt how much,
MIN_SEARCH = np.array([0.2, 0.1])  # m and rad; no less than this, or a change of speed is missed,
TRUSTED = 2.0  # times that is its standard deviation;
LOST_INLIERS = 0.5  # share of inliers below which a wider search is tried,
WIDER, CLEARLY = 3.0, 0.1  # so many times as wide, and taken if so many more fit


@dataclass(frozen=True)
class KeyScan:
    """A scan that later ones are matched against: its cloud, pose (3,), odometry (3,), and metres of travel."""

    cloud: ScanCloud
    pose: Floats
    odometry: Floats
    way: float


class ScanMatcher:
    """Matches scan after scan, of a log or of a robot that drives, and keeps only what later ones need.

    A new drive begins where the one before ends, as nothing is known of the way there, and matches none of it.

    Attributes:
        inliers: the share of the last scan's points that fit what those before it saw; 1 where a drive begins.
    """

    def __init__(self, laser_pose: Floats, without_wheels: Container[int] = ()) -> None:
        """``laser_pose`` (3,) is the laser's on the robot; the drives ``without_wheels`` have no odometry."""
        self._laser_pose = laser_pose
        self._without_wheels = without_wheels
        self._keys: deque[KeyScan] = deque(maxlen=REFERENCE[2])
        self._last: Scan | None = None
        self._pose = np.zeros(3)
        self._way = 0.0  # m of travel, by odometry where there is any
        self.inliers = 1.0
        self._forget_motion()

    def add(self, scan: Scan) -> Floats:
        """The robot's pose (3,) at the next scan, in the frame of the first scan."""
        cloud = scan_cloud(scan, self._laser_pose)
        last, pose, self.inliers = self._last, self._pose, 1.0
        alone = scan.drive in self._without_wheels
        if last is not None and scan.drive != last.drive:
            self._keys.clear()
            self._forget_motion()
        elif last is not None and alone:
            pose, self.inliers = self._matched_alone(cloud)
        elif last is not None:
            self._way += float(np.hypot(*(scan.odometry - last.odometry)[:2]))
            motion = between(last.odometry, scan.odometry)
            pose, self.inliers = self._matched(cloud, scan.odometry, motion)
        if not self._keys or _far(self._keys[-1].pose, pose):
            if self._keys and not alone:
                key = self._keys[-1]
                self._slip.learn(between(key.odometry, scan.odometry), between(key.pose, pose))
            self._keys.append(KeyScan(cloud.solid if alone else cloud, pose, scan.odometry, self._way))
        self._last, self._pose = scan, pose
        return pose

    def _forget_motion(self) -> None:
        self._motion = np.zeros(3)
        self._surprise = SURPRISE**2
        self._slip = WheelSlip()

    def _matched(self, cloud: ScanCloud, odometry: Floats, motion: Floats) -> tuple[Floats, float]:
        """The pose (3,) of a scan at this ``odometry`` (3,), after this ``motion`` (3,), and its inliers.

        Where scans are dense, each may slip by all of its way: a person who walks ahead would hold the robot.
        So the way of a metre is compared with the wheels', and they are believed where they fit about as well.
        """
        pose, inliers = self._near(compose(self._pose, motion), cloud, motion)
        key = next((key for key in self._keys if self._way - key.way <= LOOK_BACK), self._keys[-1])
        driven = between(key.odometry, odometry)
        dense = float(np.hypot(*motion[:2])) < DENSE[0] and abs(float(motion[2])) < DENSE[1]
        if not dense or not self._slip.doubts(driven, between(key.pose, pose)):
            return pose, inliers
        by_wheels = compose(key.pose, driven)
        by_wheels[2] = pose[2]
        other, fitting = self._near(by_wheels, cloud, np.zeros(3))
        return (other, fitting) if fitting > inliers - WALKERS else (pose, inliers)

    def _near(self, predicted: Floats, cloud: ScanCloud, motion: Floats) -> tuple[Floats, float]:
        """The pose (3,) of a scan near a predicted one, after a motion (3,) by the wheels, and its inliers."""
        distance, turn = float(np.hypot(*motion[:2])), abs(float(motion[2]))
        # A bad wheel odometry's errors: slip in proportion to the way, and heading errors from both.
        sigma = np.array([0.05 + SLIP * distance, 0.03 + 0.3 * turn + 0.1 * distance])
        search = distance > WORTH_A_SEARCH[0] or turn > WORTH_A_SEARCH[1]
        window = np.minimum(SEARCH_SIGMAS * sigma, WIDEST) if search else np.zeros(2)
        seen = self._reference(predicted)
        shift, inliers = register(seen.points, seen.normals, cloud.points, window[0], window[1], sigma)
        return compose(predicted, _as_held(seen, cloud, shift)), inliers

    def _matched_alone(self, cloud: ScanCloud) -> tuple[Floats, float]:
        """The pose (3,) of a scan where nothing but the last motion predicts it, and its inliers."""
        predicted = compose(self._pose, self._motion)
        seen = self._reference(predicted)
        sigma = np.maximum(TRUSTED * np.sqrt(self._surprise), MIN_SEARCH)
        shift, inliers = _found(seen, cloud, sigma)
        if inliers < LOST_INLIERS:
            wide, more = _found(seen, cloud, WIDER * np.maximum(sigma, SURPRISE))
            if more > inliers + CLEARLY:
                shift, inliers = wide, more
        error = np.array([shift[0] ** 2 + shift[1] ** 2, shift[2] ** 2])
        self._surprise = self._surprise + (error - self._surprise) / MEMORY
        pose = compose(predicted, shift)
        self._motion = between(self._pose, pose)
        self._way += float(np.hypot(*self._motion[:2]))
        return pose, inliers

    def _reference(self, predicted: Floats) -> ScanCloud:
        """What the recent key scans saw, in the frame of the predicted pose (3,)."""
        reach, least, _ = REFERENCE
        keys = list(self._keys)
        near = [key for key in keys if self._way - key.way <= reach]
        recent = near if len(near) >= least else keys[-least:]
        poses = between(predicted, np.array([key.pose for key in recent]))
        return joined([key.cloud for key in recent], poses)


def _found(seen: ScanCloud, cloud: ScanCloud, sigma: Floats) -> tuple[Floats, float]:
    """The correction (3,) of a prediction that errs by ``sigma`` (2,), and the share of inliers."""
    window = np.minimum(SEARCH_SIGMAS * sigma, WIDEST)
    return register_widely(seen.points, seen.normals, cloud.points, window[0], window[1], sigma)


def _as_held(seen: ScanCloud, cloud: ScanCloud, shift: Floats) -> Floats:
    """A correction (3,) without what it adds along walls with nothing across: there the prediction holds."""
    hessian, _, _ = fit(seen.points, seen.normals, cloud.points, shift)
    weight = hessian[0, 0] + hessian[1, 1]
    if weight <= 0:
        return shift
    values, directions = np.linalg.eigh(hessian[:2, :2])
    share = float(np.clip((values[0] / weight - HELD[0]) / (HELD[1] - HELD[0]), 0.0, 1.0))
    c, s = np.cos(shift[2]), np.sin(shift[2])
    along = np.array([[c, -s], [s, c]]) @ directions[:, 0]
    held = shift.copy()
    held[:2] -= (1.0 - share) * (along @ shift[:2]) * along
    return held


def _far(a: Floats, b: Floats) -> bool:
    return bool(np.hypot(*(b - a)[:2]) > KEY_STEP[0] or abs(wrap(b[2] - a[2])) > KEY_STEP[1])
