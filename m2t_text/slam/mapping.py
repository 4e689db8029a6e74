"""From laser logs to a map of what they saw, with everything a robot needs: the whole method in one place."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from m2t_text.logs.joining import joined
from m2t_text.logs.log import Log
from m2t_text.loops.detection import LoopDetection, detect_loops
from m2t_text.saved_maps.grid import FREE, OCCUPIED, Grid
from m2t_text.saved_maps.occupancy_mapping import build_map
from m2t_text.slam.correction import Correction, correct
from m2t_text.util.types import Floats, StageProgress


@dataclass(frozen=True)
class MapOfLogs:
    """A map that logs show.

    Attributes:
        logs: that it was made of.
        detection: their drives with the loops found by text; the logs' scans follow each other.
        correction: of their trajectories.
        grid: the map.
    """

    logs: Sequence[Log]
    detection: LoopDetection
    correction: Correction
    grid: Grid

    def trajectories(self) -> list[Floats]:
        """Of each log, the corrected poses (S, 3) of its scans, in the frame of the map."""
        ends = np.cumsum([len(log.scans) for log in self.logs])
        return np.split(self.correction.trajectory, ends[:-1])

    @property
    def left_out(self) -> list[str]:
        """The logs of which no scan is in the map, as no loop tells where they were."""
        scans = np.cumsum([0, *(len(log.scans) for log in self.logs)])
        drives = np.array([scan.drive for scan in self.detection.log.scans])
        shown = self.correction.joined[drives]
        return [log.name for k, log in enumerate(self.logs) if not shown[scans[k] : scans[k + 1]].any()]

    def to_json(self) -> dict[str, Any]:
        """What was found, as ``map --json`` has it."""
        detection, correction = self.detection, self.correction
        firsts = np.cumsum([0, *(len(log.scans) for log in self.logs)])
        left_out = self.left_out
        return {
            "datasets": [
                {
                    "name": log.name,
                    "scans": len(log.scans),
                    "first_vertex": int(first),
                    "odometry": log.has_odometry,
                    "joined": log.name not in left_out,
                }
                for log, first in zip(self.logs, firsts, strict=False)
            ],
            "travel": float(detection.survey.way[-1]),
            "queries": detection.queries,
            "matches": detection.matches,
            "loops": correction.count("loop"),
            "neighbours": correction.count("neighbour"),
            "dropped": {"loops": correction.dropped[0], "neighbours": correction.dropped[1]},
            "map": {
                "resolution": self.grid.resolution,
                "columns": self.grid.states.shape[1],
                "rows": self.grid.states.shape[0],
                "origin": self.grid.origin.tolist(),
                "occupied": int((self.grid.states == OCCUPIED).sum()),
                "free": int((self.grid.states == FREE).sum()),
            },
        }


def map_logs(
    logs: Sequence[Log],
    name: str,
    resolution: float = 0.05,
    jobs: int = 1,
    progress: StageProgress | None = None,
) -> MapOfLogs:
    """The map that logs show together, where loops join them; it is called ``name``.

    Raises M2TError if the robot travels too little, or the map would be too large.

    Examples:
        >>> import m2t_text as m2t
        >>> whole = m2t.map_logs([m2t.read_log("drive.log")], "drive")
        >>> whole.correction.trajectory.shape[1], whole.grid.resolution
        (3, 0.05)
    """
    tell = progress or (lambda stage, done, of: None)
    detection = detect_loops(joined(logs, name), None, jobs, tell)
    correction = correct(detection, jobs, tell)
    drives = np.array([scan.drive for scan in detection.log.scans])
    scans = np.flatnonzero(detection.survey.moved & correction.joined[drives])
    tell("drawing the map", 0, 1)
    grid = build_map(detection.log, correction.trajectory, scans, resolution)
    tell("drawing the map", 1, 1)
    return MapOfLogs(logs, detection, correction, grid)
