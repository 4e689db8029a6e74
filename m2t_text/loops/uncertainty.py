"""Relative poses with their covariances, and how fast a trajectory drifts.

A covariance belongs to a small motion ``e`` = (x, y, theta) in the frame of the pose itself: the true pose is
``compose(pose, e)``, as in g2o's ``EDGE_SE2`` and GTSAM's ``BetweenFactor``. Such poses are chained as by
Smith, Self and Cheeseman, "Estimating uncertain spatial relationships in robotics" (1990).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m2t_text.util.geometry import between, compose, inverse
from m2t_text.util.rows import Rows
from m2t_text.util.types import Floats

# Variances of a trajectory from wheel odometry and scan matching: the most likely ones on the five logs of the
# Radish repository, over 3 to 200 m of travel, rounded up.
MOVE = 0.02**2  # m² per m of travel, in every direction
HEADING = 0.005**2  # rad² per m of travel
TURN_VARIANCE = 0.01**2  # rad² per rad of turning
BIAS = 0.0003**2  # rad² per m² of travel: part of the error in heading is the same all the way
STILL = (0.001**2, 0.001**2)  # m² and rad² of a step on which nothing moves
UNKNOWN_STEP = (100.0**2, np.pi**2)  # m² and rad² of the step from one drive to the next


@dataclass(frozen=True)
class PoseWithCovariance:
    """Relative poses (..., 3), metres and radians, and their covariances (..., 3, 3)."""

    pose: Floats
    covariance: Floats

    def compose(self, following: "PoseWithCovariance") -> "PoseWithCovariance":
        """``following`` is given in the frame of this pose: both in one; their errors are independent."""
        back = adjoint(inverse(following.pose))
        moved = back @ self.covariance @ np.swapaxes(back, -1, -2)
        return PoseWithCovariance(compose(self.pose, following.pose), moved + following.covariance)

    def inverse(self) -> "PoseWithCovariance":
        """The frame's origin as seen from the pose."""
        there = adjoint(self.pose)
        return PoseWithCovariance(inverse(self.pose), there @ self.covariance @ np.swapaxes(there, -1, -2))

    def distance(self, other: "PoseWithCovariance") -> Floats:
        """(...) squared Mahalanobis distances between two independent estimates of the same poses."""
        error = between(self.pose, other.pose)
        joint = self.covariance + other.covariance
        return np.einsum("...i,...i", error, np.linalg.solve(joint, error[..., None])[..., 0])

    @property
    def information(self) -> Floats:
        """(..., 3, 3) inverse covariances."""
        return np.linalg.inv(self.covariance).astype(float)

    @property
    def reach(self) -> Floats:
        """(...) metres: the standard deviation of the place in its loosest direction."""
        return np.sqrt(np.linalg.eigvalsh(self.covariance[..., :2, :2])[..., -1])


def exact(pose: Floats) -> PoseWithCovariance:
    """A relative pose that is known."""
    return PoseWithCovariance(pose, np.zeros((*pose.shape, 3)))


def adjoint(pose: Floats) -> Floats:
    """(..., 3, 3) what takes a small motion in the frame of ``pose`` (..., 3) to the frame it is given in."""
    c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    zero, one = np.zeros_like(c), np.ones_like(c)
    rows = [[c, -s, pose[..., 1]], [s, c, -pose[..., 0]], [zero, zero, one]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


class Drift:
    """A trajectory (S, 3), and how uncertain its poses are as seen from each other.

    Each step errs by itself: in x and y alike, and in heading, which swings all that follows about the step's
    end. Besides, all steps err in heading by one unknown bias, in proportion to their lengths. The sums over
    all steps up to each pose give the covariance between any two poses at once.

    Attributes:
        trajectory: (S, 3).
        steps: (S - 1, 2) variances of each step, m² and rad².
        way: (S,) metres of travel up to each pose.

    ``cuts`` (C,) are the poses that begin a drive of which it is not known where.
    """

    def __init__(self, trajectory: Floats, cuts: Sequence[int] | NDArray[np.int64] = ()) -> None:
        self._poses, self._steps, self._way = Rows(3), Rows(2), Rows()
        self._moves, self._headings = Rows(), Rows()  # variances, summed up
        self._swings, self._firsts, self._seconds = Rows(2), Rows(2), Rows(2, 2)
        self.extend(trajectory, cuts)

    @property
    def trajectory(self) -> Floats:
        return self._poses.array

    @property
    def steps(self) -> Floats:
        return self._steps.array

    @property
    def way(self) -> Floats:
        return self._way.array

    def extend(self, poses: Floats, cuts: Sequence[int] | NDArray[np.int64] = ()) -> None:
        """The next poses (N, 3); those of the numbers ``cuts`` among all begin a drive."""
        first = len(self.trajectory)
        if not len(poses):
            return
        if not first:
            for sums in (self._way, self._moves, self._headings, self._swings, self._firsts, self._seconds):
                sums.extend(np.zeros_like(sums.array, shape=(1, *sums.array.shape[1:])))
        self._poses.extend(poses)
        if first + len(poses) < 2:
            return
        trajectory = self.trajectory[max(first - 1, 0) :]
        moves = between(trajectory[:-1], trajectory[1:])
        way, turn = np.hypot(moves[:, 0], moves[:, 1]), np.abs(moves[:, 2])
        steps = np.column_stack([STILL[0] + MOVE * way, STILL[1] + HEADING * way + TURN_VARIANCE * turn])
        steps[np.asarray(cuts, dtype=np.int64) - max(first, 1)] = UNKNOWN_STEP
        self._steps.extend(steps)
        ends = trajectory[1:, :2]
        move, heading = steps.T
        _sum_up(self._moves, move)
        _sum_up(self._headings, heading)
        _sum_up(self._way, way)
        _sum_up(self._swings, way[:, None] * ends)
        _sum_up(self._firsts, heading[:, None] * ends)
        _sum_up(self._seconds, heading[:, None, None] * ends[:, :, None] * ends[:, None, :])

    def relative(self, origin: NDArray[np.int64] | int, place: NDArray[np.int64] | int) -> PoseWithCovariance:
        """The poses ``place`` as seen from the poses ``origin``, both (...) indices into the trajectory."""
        origin, place = np.broadcast_arrays(origin, place)
        first, last = np.minimum(origin, place), np.maximum(origin, place)
        ahead = PoseWithCovariance(
            between(self.trajectory[first], self.trajectory[last]), self._covariance(first, last)
        )
        behind = ahead.inverse()
        forwards = place >= origin
        return PoseWithCovariance(
            np.where(forwards[..., None], ahead.pose, behind.pose),
            np.where(forwards[..., None, None], ahead.covariance, behind.covariance),
        )

    def _covariance(self, first: NDArray[np.int64], last: NDArray[np.int64]) -> Floats:
        """Of each pose ``last`` as seen from an earlier pose ``first``."""
        end = self.trajectory[last]
        moves, headings, levers, spreads = (
            sums.array for sums in (self._moves, self._headings, self._firsts, self._seconds)
        )
        heading = headings[last] - headings[first]
        lever = levers[last] - levers[first]
        spread = spreads[last] - spreads[first]
        # Sums of heading * r and heading * r rᵀ, r leading from the end of a step to the last pose.
        to_end = heading[..., None] * end[..., :2] - lever
        cross = end[..., :, None][..., :2, :] * lever[..., None, :]
        square = heading[..., None, None] * end[..., :2, None] * end[..., None, :2]
        square = square - cross - np.swapaxes(cross, -1, -2) + spread
        quarter = np.array([[0.0, -1.0], [1.0, 0.0]])  # an error of heading moves the pose across r
        covariance = np.zeros((*np.shape(first), 3, 3))
        move = (moves[last] - moves[first])[..., None, None]
        covariance[..., :2, :2] = quarter @ square @ quarter.T + move * np.eye(2)
        covariance[..., :2, 2] = covariance[..., 2, :2] = to_end @ quarter.T
        covariance[..., 2, 2] = heading
        covariance += BIAS * self._biased(first, last)
        to_frame = np.zeros_like(end)
        to_frame[..., 2] = -end[..., 2]
        turn = adjoint(to_frame)
        return turn @ covariance @ np.swapaxes(turn, -1, -2)

    def _biased(self, first: NDArray[np.int64], last: NDArray[np.int64]) -> Floats:
        """The covariance (..., 3, 3) of a bias of 1 rad per m, as `_covariance` has it."""
        swings = self._swings.array
        way = self.way[last] - self.way[first]
        to_end = way[..., None] * self.trajectory[last][..., :2] - (swings[last] - swings[first])
        slope = np.stack([-to_end[..., 1], to_end[..., 0], way], axis=-1)
        return slope[..., :, None] * slope[..., None, :]


def _sum_up(sums: Rows, values: Floats) -> None:
    """Adds the sums of the next steps' values (N, ...) up to each pose, one by one: the same to the bit
    however many come at once."""
    sums.extend(np.cumsum(np.concatenate([sums.array[-1:], values]), axis=0)[1:])
