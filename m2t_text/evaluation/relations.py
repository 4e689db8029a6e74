"""The SLAM benchmark's metric: how well a trajectory keeps relative poses that people measured by hand.

Kümmerle et al., "On measuring the accuracy of SLAM algorithms", Autonomous Robots 27 (2009).
"""

import gzip
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from m2t_text.errors import SourceError
from m2t_text.logs.log import Log
from m2t_text.util.files import opened, shown
from m2t_text.util.geometry import between
from m2t_text.util.types import Floats, Ints

SLACK = 0.5  # s between a relation's time and the nearest scan, at most
COLUMNS = 8  # t1 t2 x y z roll pitch yaw

# Mean and standard deviation of the absolute translational error, metres, as others published them. Graph
# Mapping, GMapping and scan matching are from the paper above, quoted from a secondary source; Cartographer's
# are those of Hess et al., "Real-time loop closure in 2D lidar SLAM" (ICRA 2016), quoted from memory.
PUBLISHED: dict[str, dict[str, tuple[float, float]]] = {
    "aces": {
        "Cartographer (2016)": (0.0375, 0.0426),
        "Graph Mapping (2009)": (0.044, 0.044),
        "GMapping (2009)": (0.060, 0.049),
        "scan matching (2009)": (0.173, 0.614),
    },
    "intel": {
        "Cartographer (2016)": (0.0229, 0.0239),
        "Graph Mapping (2009)": (0.031, 0.026),
        "GMapping (2009)": (0.070, 0.083),
        "scan matching (2009)": (0.220, 0.296),
    },
    "mit-csail": {
        "Cartographer (2016)": (0.0319, 0.0363),
        "Graph Mapping (2009)": (0.004, 0.009),
        "GMapping (2009)": (0.049, 0.049),
        "scan matching (2009)": (0.106, 0.325),
    },
    "fr079": {
        "Cartographer (2016)": (0.0452, 0.0354),
        "Graph Mapping (2009)": (0.056, 0.042),
        "GMapping (2009)": (0.061, 0.044),
        "scan matching (2009)": (0.258, 0.427),
    },
}


@dataclass(frozen=True)
class Relations:
    """Relative poses of a robot at two times: ``times`` (R, 2) in seconds, ``poses`` (R, 3) of the later one as
    seen from the earlier one."""

    times: Floats
    poses: Floats


@dataclass(frozen=True)
class RelationErrors:
    """By how much a trajectory misses relations: mean and standard deviation of each kind of error.

    Attributes:
        relations: number of relations that were used.
        left_out: number of those whose times have no scan within SLACK seconds.
        translation, rotation: metres and degrees.
        translation_squared, rotation_squared: square metres and square degrees.
    """

    relations: int
    left_out: int
    translation: tuple[float, float]
    translation_squared: tuple[float, float]
    rotation: tuple[float, float]
    rotation_squared: tuple[float, float]

    def to_json(self) -> dict[str, Any]:
        """Numbers by name; a pair is [mean, standard deviation]."""
        return {
            name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()
        }


def read_relations(path: Path) -> Relations:
    """A file of lines ``t1 t2 x y z roll pitch yaw``, plain or gzipped; metres, radians, seconds.

    Raises SourceError with one line if it is none.
    """
    with opened(path, SourceError) as file:
        raw = file.read()
    try:
        text = (gzip.decompress(raw) if raw[:2] == b"\x1f\x8b" else raw).decode("ascii")
    except (OSError, EOFError, UnicodeDecodeError) as error:
        raise SourceError(f"{shown(path)} is no text of relations: {error}") from error
    rows = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = []
        if len(row) != COLUMNS or not np.isfinite(row).all():
            raise SourceError(
                f"{shown(path)}, line {number}: a relation is 8 numbers, t1 t2 x y z roll pitch yaw"
            )
        rows.append(row)
    if not rows:
        raise SourceError(f"{shown(path)} holds no relation: each line is t1 t2 x y z roll pitch yaw")
    table = np.array(rows)
    return Relations(table[:, :2], table[:, [2, 3, 7]])


def relation_errors(log: Log, trajectory: Floats, relations: Relations) -> RelationErrors:
    """How well a trajectory (S, 3) of a log's scans keeps relations.

    Raises SourceError if no relation has scans at its times.
    """
    first, second = (_nearest_scans(log, times) for times in relations.times.T)
    used = (first >= 0) & (second >= 0)
    if not used.any():
        raise SourceError(f"{log.name}: no relation has scans at its times: name the relations of this log")
    seen = between(trajectory[first[used]], trajectory[second[used]])
    errors = between(relations.poses[used], seen)
    translation, rotation = np.hypot(errors[:, 0], errors[:, 1]), np.degrees(np.abs(errors[:, 2]))
    figures = ((float(e.mean()), float(e.std())) for e in (translation, translation**2, rotation, rotation**2))
    return RelationErrors(int(used.sum()), int((~used).sum()), *figures)


def published(name: str) -> dict[str, tuple[float, float]]:
    """What others reached on the log of this name: translational error in m, mean and standard deviation."""
    return next((values for log, values in PUBLISHED.items() if name.startswith(log)), {})


def _nearest_scans(log: Log, times: Floats) -> Ints:
    """(R,) the scans whose stamps are nearest to the times (R,), -1 where none lies within SLACK."""
    stamps = np.array([scan.timestamp for scan in log.scans])
    order = np.argsort(stamps, kind="stable")  # stamps may run backwards
    ascending = stamps[order]
    after = np.clip(np.searchsorted(ascending, times), 1, len(stamps) - 1)
    nearest = after - (times - ascending[after - 1] < ascending[after] - times)
    return np.where(np.abs(ascending[nearest] - times) <= SLACK, order[nearest], -1)
