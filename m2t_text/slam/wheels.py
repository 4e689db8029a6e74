"""What wheel odometry says of the steps between key scans, as far as it deserves belief."""

import numpy as np

from m2t_text.slam.key_scans import KeyScans
from m2t_text.slam.optimisation import Constraints
from m2t_text.util.geometry import between, wrap
from m2t_text.util.types import Floats, Ints

SPANS = (1, 10, 30, 100)  # key scans over which wheels are compared with scan matching
MEDIAN = 1.4826  # the standard deviation of normal errors, in medians of their absolute values
STILL = 0.01  # m of travel that are taken for granted
TURN = 0.1  # m of slip that one radian of turning counts as


def wheel_steps(wheels: Floats, robot: Floats, keys: KeyScans) -> Constraints:
    """From each key scan to the next of its drive, as the wheels have it; nothing for drives without wheels.

    How far they err is told by how far they leave the trajectory as it is known, over 0.3 to 30 m: wheels with
    a bias, or much worse ones than scan matching, say little. Good ones hold what it does not, along a wall
    without features.

    Args:
        wheels: (K, 3) poses of the key scans by the wheels alone.
        robot: (K, 3) their poses as far as they are known.
    """
    turned = np.concatenate([[0.0], np.cumsum(np.abs(wrap(np.diff(robot[:, 2]))))])
    moves = np.array(
        [np.ptp(wheels[keys.drives == drive], axis=0).any() for drive in range(keys.drives[-1] + 1)]
    )
    steps = _pairs(keys, moves, 1)
    if not len(steps):
        return Constraints(steps, np.empty((0, 3)), np.empty((0, 3, 3)), np.empty(0, dtype=bool))
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
    return travel + TURN * turn, travel + turn
