"""How much the wheels of a drive slip: what is a likely difference from scan matching, and what is too much."""

import numpy as np

from m2t_text.util.types import Floats

MOST, LEAST = 0.2, 0.05  # m per m; standard deviation where nothing is known of the wheels, and at best
MEMORY, SIGMAS = 30, 2.0  # steps over which it is learnt, and how many times their mean is a standard deviation
WORTH = 0.15  # m of travel from which a step tells something
JITTER = 0.03  # m by which wheels and scans differ at any time, as they are not read at once
TOO_MUCH = 2.5  # standard deviations


class WheelSlip:
    """Learnt while the robot drives, from one key scan to the next."""

    def __init__(self) -> None:
        self._mean = MOST / SIGMAS

    @property
    def per_metre(self) -> float:
        """The standard deviation of the wheels' motion, m per m of travel."""
        return float(np.clip(SIGMAS * self._mean, LEAST, MOST))

    def learn(self, driven: Floats, matched: Floats) -> None:
        """Takes one motion (3,), as the wheels have it and as it was matched."""
        distance = float(np.hypot(*driven[:2]))
        if distance > WORTH:
            off = float(np.hypot(*(matched - driven)[:2])) / distance
            self._mean += (min(off, MOST) - self._mean) / MEMORY

    def doubts(self, driven: Floats, matched: Floats) -> bool:
        """Whether a motion (3,) was matched so differently from the wheels that the match may be wrong."""
        likely = JITTER + self.per_metre * float(np.hypot(*driven[:2]))
        return float(np.hypot(*(matched - driven)[:2])) > TOO_MUCH * likely
