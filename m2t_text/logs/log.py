"""A laser log in memory: scans with raw odometry, and the ground truth kept apart."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m2t_text.errors import LogError, PartError
from m2t_text.logs.beams import beams_in_a_turn
from m2t_text.logs.readings import bearings, returned
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

    @classmethod
    def from_ranges(
        cls,
        ranges: ArrayLike,
        angle_min: float,
        angle_increment: float,
        *,
        range_min: float = 0.0,
        range_max: float = 0.0,
        odometry: ArrayLike = (0.0, 0.0, 0.0),
        timestamp: float = 0.0,
        drive: int = 0,
        upside_down: bool = False,
    ) -> "Scan":
        """A scan as lasers send it, for one in ROS's `LaserScan`: what is no return becomes ``inf``.

        Args:
            ranges: (B,) metres; no returns are those not finite, below ``range_min``, or at ``range_max``.
            angle_min: radians of the first beam.
            angle_increment: radians from each beam to the next; may be negative.
            range_min: metres; 0 where the laser says nothing.
            range_max: metres; 0 where the laser says nothing.
            odometry: (3,) of the robot when the scan was taken.
            upside_down: whether the laser hangs so, which mirrors the beams.

        Raises:
            LogError: if it is no scan: fewer than two beams, or an impossible field of view.

        Examples:
            >>> import m2t_text as m2t
            >>> scan = m2t.Scan.from_ranges([1.0, float("nan"), 30.0], -0.5, 0.5, range_max=30.0)
            >>> scan.ranges.tolist(), scan.angles.tolist()
            ([1.0, inf, inf], [-0.5, 0.0, 0.5])
        """
        pose = np.asarray(odometry, dtype=float)
        readings = returned(ranges, range_min, range_max)
        if readings.ndim != 1 or pose.shape != (3,) or not np.isfinite([*pose, timestamp]).all():
            raise LogError("a scan has a row of readings, a time, and a pose x, y, theta, all finite")
        try:
            count = beams_in_a_turn(angle_min, angle_increment, len(readings))
        except PartError as error:
            raise LogError(f"a scan {error}") from error
        angles = bearings(angle_min, angle_increment, count)
        readings = readings[:count]
        if upside_down:
            angles = -angles
        if angles[0] > angles[-1]:
            readings, angles = readings[::-1], angles[::-1]
        return cls(readings, angles, pose, float(timestamp), 0, drive)


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
