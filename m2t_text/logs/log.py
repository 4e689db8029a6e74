"""A laser log in memory: scans with raw odometry, and the ground truth kept apart."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from m2t_text.errors import LogError
from m2t_text.util.types import Floats

ARM = 20.0  # m; no laser sits farther from its robot, and a map would be as wide as the robot
ALONE = "nothing in the log tells how the robot moved: its trajectory is that of scan matching alone"


@dataclass(frozen=True)
class Scan:
    """One sweep of the laser.

    Attributes:
        ranges: (B,) float64, metres; ``inf`` where the beam did not return (maximum reading, dropout).
        angles: (B,) float64, radians in the laser's frame, x forward, counter-clockwise.
        odometry: (3,) x, y, theta of the robot from raw wheel odometry, metres and radians.
        timestamp: seconds; 0 where the log has none.
        line: number of its line, or of its message, in the file, from 1.
        drive: number of the drive, from 0. Nothing is known of the way from the last scan of one drive to the
            first of the next: the clock or the odometry began again, or leapt. No local map spans two drives.
    """

    ranges: Floats
    angles: Floats
    odometry: Floats
    timestamp: float = 0.0
    line: int = 0
    drive: int = 0


@dataclass(frozen=True)
class LogOptions:
    """How to read a log, where its file leaves that open.

    Attributes:
        scan: topics of a bag with the scans of lasers that are read as one; none for the only one. Of a CARMEN
            log, the first word of the scans' lines.
        odometry: topic of a bag; None for the only one, ``"none"`` to go by scan matching alone.
        laser_pose: (3,) metres and radians, the laser's on the robot, instead of what the log says.
        upside_down: whether the laser hangs upside down, instead of what the log says.
        height: metres above the ground, or in the robot's frame if it is given: the band to which clouds of
            points are cut.

    Raises LogError if the band is none, or the pose is not finite.
    """

    scan: tuple[str, ...] = ()
    odometry: str | None = None
    laser_pose: tuple[float, float, float] | None = None
    upside_down: bool = False
    height: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.height is not None and not self.height[0] < self.height[1]:  # nor is it with a NaN
            raise LogError("--height takes two heights in metres, the lower one first, as --height 0.3 1.5")
        if self.laser_pose is not None and not all(abs(value) <= ARM for value in self.laser_pose):
            raise LogError(
                f"--laser-pose takes metres, {ARM:g} at most, and degrees, as --laser-pose 0.2 0 180"
            )


@dataclass(frozen=True)
class Log:
    """A whole run of one robot.

    Attributes:
        name: the dataset's name.
        scans: in the order of the log.
        laser_pose: (3,) pose of the laser in the robot's frame.
        ground_truth: (S, 3) corrected robot poses, or None. For judging only: nothing that describes,
            indexes or searches may read it.
        warnings: one line for each kind of damage that was skipped, with counts and line numbers.
        has_odometry: False if nothing in the log tells how the robot moved; all odometry poses are equal then,
            and the trajectory is that of scan matching alone.

    Raises LogError if the laser sits nowhere on a robot.
    """

    name: str
    scans: tuple[Scan, ...]
    laser_pose: Floats = field(default_factory=lambda: np.zeros(3))
    ground_truth: Floats | None = None
    warnings: tuple[str, ...] = ()
    has_odometry: bool = True

    def __post_init__(self) -> None:
        away = float(np.hypot(*self.laser_pose[:2]))
        if not away <= ARM:  # nor is it with a NaN
            raise LogError(
                f"{self.name}: the laser is said to sit {away:,.0f} m away from the robot; {ARM:g} m at most"
            )

    @property
    def odometry(self) -> Floats:
        """(S, 3) raw odometry of every scan."""
        return np.array([scan.odometry for scan in self.scans]).reshape(-1, 3)

    @property
    def cuts(self) -> NDArray[np.int64]:
        """The scans at which a new drive begins, but for the first: indices in ascending order."""
        drives = np.array([scan.drive for scan in self.scans])
        return np.flatnonzero(np.diff(drives)) + 1
