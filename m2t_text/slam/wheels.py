"""What wheel odometry says of the steps between key scans, as far as it deserves belief.

Its systematic errors, a length that is off in proportion and a heading that turns with way and turning, are
told by the trajectory and taken out (Borenstein and Feng, "Measurement and correction of systematic odometry
errors in mobile robots", IEEE Transactions on Robotics and Automation 12, 1996); the rest counts as noise.
"""

import numpy as np

from m2t_text.logs.odometry import chain
from m2t_text.slam.key_scans import KeyScans
from m2t_text.slam.optimisation import Constraints
from m2t_text.util.geometry import between, wrap
from m2t_text.util.types import Floats, Ints

SPANS = (1, 10, 30, 100)  # key scans over which wheels are compared with scan matching
MEDIAN = 1.4826  # the standard deviation of normal errors, in medians of their absolute values
STILL = 0.01  # m of travel that are taken for granted
METRES_PER_RADIAN = 0.1  # m of slip that one radian of turning counts as
WINDOW = 10  # key scans over which systematic errors are looked for
REWEIGHTED = 10  # times, so that the fit follows the most of them, not the few that slip
LEAST_ERRORS = np.array([1e-3, 1e-3])  # m and rad; smaller ones weigh alike
HELD = 0.03  # m; standard deviation of a step from which it says half as much of the wheels' lengths
GUESS = np.array([1.0, 1.0, 3.0])  # m, m and rad of driving that say no error, so that little of it says little


def wheel_steps(wheels: Floats, robot: Floats, keys: KeyScans, held: Floats) -> Constraints:
    """From each key scan to the next of its drive, as the wheels have it; nothing for drives without wheels.

    How far they err is told by how far they leave the trajectory as it is known, over 0.3 to 30 m: wheels with
    a bias, or much worse ones than scan matching, say little. Good ones hold what it does not, along a wall
    without features.

    Args:
        wheels: (K, 3) poses of the key scans by the wheels alone.
        robot: (K, 3) their poses as far as they are known.
        held: (K - 1,) m², how uncertain the ways to the next key scans are by scan matching alone. Where it
            does not hold them, the robot is where the wheels put it, which says nothing of their errors.
    """
    turned = np.concatenate([[0.0], np.cumsum(np.abs(wrap(np.diff(robot[:, 2]))))])
    moves = np.array(
        [np.ptp(wheels[keys.drives == drive], axis=0).any() for drive in range(keys.drives[-1] + 1)]
    )
    steps = _pairs(keys, moves, 1)
    if not len(steps):
        return Constraints(steps, np.empty((0, 3)), np.empty((0, 3, 3)), np.empty(0, dtype=bool))
    wheels = _calibrated(wheels, robot, keys, moves, held)
    noise = np.zeros(2)
    for span in SPANS:
        pairs = _pairs(keys, moves, span)
        if len(pairs):
            errors = between(between(*robot[pairs.T]), between(*wheels[pairs.T]))
            place, heading = _spread(keys.way, turned, pairs)
            scaled = MEDIAN * np.median(np.abs(errors[:, :2]) / np.sqrt(place)[:, None])
            noise = np.maximum(noise, [scaled, MEDIAN * np.median(np.abs(errors[:, 2]) / np.sqrt(heading))])
    place, heading = _spread(keys.way, turned, steps)
    noise = np.maximum(noise, 1e-4)
    information = np.zeros((len(steps), 3, 3))
    information[:, [0, 1], [0, 1]] = (1 / (noise[0] ** 2 * place))[:, None]
    information[:, 2, 2] = 1 / (noise[1] ** 2 * heading)
    return Constraints(steps, between(*wheels[steps.T]), information, np.zeros(len(steps), dtype=bool))


def _calibrated(wheels: Floats, robot: Floats, keys: KeyScans, moves: np.ndarray, held: Floats) -> Floats:
    """(K, 3) the wheels' poses without the systematic errors of each drive that has wheels."""
    steps, true = between(wheels[:-1], wheels[1:]), between(robot[:-1], robot[1:])
    better = steps.copy()
    for drive in np.flatnonzero(moves):
        own = np.flatnonzero((keys.drives[:-1] == drive) & (keys.drives[1:] == drive))
        if len(own) > WINDOW:
            way = np.abs(steps[own, 0])
            say = 1.0 / (1.0 + held[own] / HELD**2)
            slow = _fitted(steps[own, :1], (true - steps)[own, 0], say, LEAST_ERRORS[0], GUESS[:1])
            turns = np.column_stack([way, steps[own, 2]])
            bias = _fitted(turns, wrap((true - steps)[own, 2]), np.ones(len(own)), LEAST_ERRORS[1], GUESS[1:])
            better[own, :2] *= 1.0 + slow[0]
            better[own, 2] += turns @ bias
    return chain(wheels[0], better)


def _fitted(causes: Floats, errors: Floats, say: Floats, least: float, guess: Floats) -> Floats:
    """(C,) by how much each of the causes (S, C) makes the errors (S,), over WINDOW steps, in the least sum.

    The steps have more or less of a ``say`` (S,).
    """
    ones = np.ones(WINDOW)
    of = np.column_stack([np.convolve(column, ones, "valid") for column in causes.T])
    off = np.convolve(errors, ones, "valid")
    least_say = np.lib.stride_tricks.sliding_window_view(say, WINDOW).min(axis=1)
    found = np.zeros(causes.shape[1])
    for _ in range(REWEIGHTED):
        weights = 1.0 / np.maximum(np.abs(off - of @ found), least)
        share = least_say * weights / weights.mean()
        found = np.linalg.solve(of.T @ (of * share[:, None]) + np.diag(guess**2), of.T @ (off * share))
    return found


def _pairs(keys: KeyScans, moves: np.ndarray, span: int) -> Ints:
    """(P, 2) key scans so many apart on one drive that has wheels."""
    first = np.arange(max(len(keys) - span, 0))
    same = keys.drives[first] == keys.drives[first + span]
    first = first[same & moves[keys.drives[first]]]
    return np.column_stack([first, first + span])


def _spread(way: Floats, turned: Floats, pairs: Ints) -> tuple[Floats, Floats]:
    """(P,) what the variances of place and heading grow with, between pairs (P, 2): metres."""
    first, last = pairs.T
    travel, turn = way[last] - way[first] + STILL, turned[last] - turned[first]
    return travel + METRES_PER_RADIAN * turn, travel + turn
