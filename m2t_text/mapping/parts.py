"""A drive in parts, which can be described side by side: a few runs, and the scans that they take."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from m2t_text.config import MappingParameters
from m2t_text.logs.log import Log
from m2t_text.mapping.free_space import Beams
from m2t_text.mapping.local_map import LocalMap, Odometer, Survey, local_maps, run_ends, run_starts
from m2t_text.mapping.trajectory import hits, refined_poses
from m2t_text.util.types import Floats, Ints, Progress

RUNS = 64  # in a part


@dataclass(frozen=True)
class Part:
    """Some runs of a drive.

    Attributes:
        survey: of the scans that they take; travel is counted from the begin of the drive.
        starts: (K,) the scans of the survey at which they begin.
        first: number of its first scan in the drive.
    """

    survey: Survey
    starts: Ints
    first: int

    def __len__(self) -> int:
        return len(self.starts)

    def local_maps(self, parameters: MappingParameters) -> Iterator[LocalMap]:
        """What was seen on each run."""
        for found in local_maps(self.survey, parameters, self.starts):
            first, last = found.first_scan + self.first, found.last_scan + self.first
            yield replace(found, first_scan=first, last_scan=last)


def parts_of(survey: Survey, starts: Ints, run_length: float, first: int = 0) -> Iterator[Part]:
    """The runs of a survey that begin at the scans ``starts``, ascending; its first scan has the number
    ``first``."""
    for some in np.split(starts, range(RUNS, len(starts), RUNS)):
        if len(some):
            begin, end = int(some[0]), int(run_ends(survey, some, run_length)[-1]) + 1
            yield Part(survey.part(begin, end), some - begin, first + begin)


class Matching:
    """The scans of a log as they are matched, and the parts of the drive that are complete by then.

    Args:
        spacing: metres of travel after a run's begin within which no other begins.
        progress: called with (scans done, total).

    Attributes:
        travel: metres up to the last scan that was matched.
    """

    def __init__(
        self,
        log: Log,
        parameters: MappingParameters,
        spacing: float = 0.0,
        progress: Progress | None = None,
    ) -> None:
        self.travel = 0.0
        self._log, self._run_length, self._spacing = log, parameters.run_length, spacing
        self._progress = progress or (lambda done, of: None)
        points, starts = hits(log, parameters.range_limit)
        beams = Beams.of(log, parameters.range_limit)
        self._scans = Survey(points, starts, np.empty((0, 3)), log.cuts, beams)  # all; their poses come later

    def parts(self) -> Iterator[Part]:
        """All parts, in their order; together they have the runs of `run_starts`."""
        odometer, begin, after = Odometer(), 0, 0.0  # the next run begins not before this scan and travel
        scans = len(self._log.scans)
        poses: list[Floats] = []  # of the scans from there on, as all that follows
        way: list[float] = []
        moved: list[bool] = []
        for done, pose in enumerate(refined_poses(self._log), start=1):
            self.travel, moves = odometer.add(pose)
            poses.append(pose)
            way.append(self.travel)
            moved.append(moves)
            self._progress(done, scans)
            far = self.travel - way[0] >= self._run_length
            if done == scans or (far and done % RUNS == 0):
                survey = self._scans.cut(begin, done, np.array(poses))
                survey = survey.counted(np.array(way), np.array(moved))
                starts = run_starts(survey, self._run_length, self._spacing, after)
                if done < scans:
                    starts = starts[self._complete(survey, starts)]
                yield from parts_of(survey, starts, self._run_length, begin)
                if len(starts):
                    after, gone = way[starts[-1]] + self._spacing, int(starts[-1]) + 1
                    begin += gone
                    del poses[:gone], way[:gone], moved[:gone]

    def _complete(self, survey: Survey, starts: Ints) -> Ints:
        """Which of the runs have all their scans, whatever comes after these."""
        ends, scans = survey.drive_ends[starts], len(survey.trajectory)
        reached = survey.way[ends] >= survey.way[starts] + self._run_length
        return np.flatnonzero(reached | (ends < scans - 1))
