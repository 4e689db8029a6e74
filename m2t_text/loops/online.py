"""A drive that looks for its own loops while it goes on: the whole method in one place."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.errors import M2TError
from m2t_text.index.map_index import MapIndex
from m2t_text.loops.gate import Gate, Loop
from m2t_text.loops.growing import GrowingDataset
from m2t_text.loops.lookup import MIN_TRAVEL_APART, Candidate, is_query, look_up_one
from m2t_text.loops.uncertainty import Drift, exact
from m2t_text.util.geometry import between, compose, inverse
from m2t_text.util.rows import Rows
from m2t_text.util.types import Floats


class OnlineLoops:
    """Takes the poses and the maps of a drive as they come, and says which loops are known by then.

    A map is looked up among those of an index: those of other datasets, and those of the drive itself that lie
    more than MIN_TRAVEL_APART metres of travel behind it. The loops of a whole log are found with this, too.

    Args:
        name: of the drive's dataset.
        index: where maps are looked up.
        past: takes the drive's own maps, and puts them into that index in time; None if the index holds them
            already, or is to be without them.
        look_up: what finds a map; None to look it up in the index at once.

    Attributes:
        queries: number of maps that were looked up.
        loops, refused, waiting: what became of the matches; see `Gate`.
        drifts: by dataset, the trajectories that loops lead to; the drive's own always.
        maps: the ids of the maps of each other dataset, in the order of its trajectory.

    Examples:
        >>> import m2t_text as m2t
        >>> log, index = m2t.read_log("drive.log"), m2t.open_index("indexes/past")
        >>> survey = m2t.LiveSurvey(index.parameters, log.laser_pose)
        >>> online = m2t.OnlineLoops("drive", index, m2t.GrowingDataset(index, "drive"))
        >>> known = []
        >>> for scan in log.scans:
        ...     pose = survey.add(scan)
        ...     online.move(pose, survey.travel)
        ...     for run in survey.new_runs():
        ...         known += online.add(m2t.describe(run, "drive", index.parameters))
        >>> known == online.loops
        True
    """

    def __init__(
        self,
        name: str,
        index: MapIndex,
        past: GrowingDataset | None = None,
        look_up: Callable[[Document], Candidate | None] | None = None,
    ) -> None:
        self._name = name
        self._index = index
        self._past = past
        self._look_up = look_up or partial(look_up_one, index)
        self._drive = Drift(np.empty((0, 3)))
        self._way = Rows()
        self._last: Document | None = None  # that was looked up
        self.drifts = {name: self._drive}
        self.maps: dict[str, list[str]] = {}
        self.queries = 0
        self._gate = Gate(name, self.drifts)

    @property
    def loops(self) -> list[Loop]:
        return self._gate.loops

    @property
    def refused(self) -> list[Loop]:
        return self._gate.refused

    @property
    def waiting(self) -> list[Loop]:
        return self._gate.waiting

    def move(self, poses: ArrayLike, way: ArrayLike, cuts: Sequence[int] = ()) -> None:
        """Takes the robot's poses at the next scans.

        Args:
            poses: (3,) or (S, 3) in the frame of the first scan.
            way: metres of travel up to each, a number or (S,).
            cuts: those of these scans that begin a drive of which it is not known where, counted from the
                first scan of all.
        """
        self._drive.extend(np.reshape(np.asarray(poses, dtype=float), (-1, 3)), cuts)
        self._way.extend(np.reshape(np.asarray(way, dtype=float), -1))

    def add(self, document: Document) -> list[Loop]:
        """The loops that are known once the next map is looked up, those of earlier maps that it confirms too.

        One map for each metre of travel is looked up; all become part of the past.

        Raises:
            M2TError: if the poses of its scans did not come before it.
        """
        if document.last_scan >= len(self._way.array):
            raise M2TError(f"map {document.map_id!r} comes before the pose of its scan {document.last_scan}")
        if self._past is not None:
            self._past.add(document)
        if not is_query(document, self._last):
            return []
        self._last, self.queries = document, self.queries + 1
        if self._past is not None:
            self._past.commit_up_to(document.middle - MIN_TRAVEL_APART)
        candidate = self._look_up(document)
        known = len(self.loops)
        if candidate is not None:
            self._gate.offer(self._loop(candidate))
        return self.loops[known:]

    def _loop(self, candidate: Candidate) -> Loop:
        """The loop of a match. It joins poses: of the drive the scan in the middle of a run, which its map fits
        best; of another dataset the first scan of a map, as an index knows no other."""
        query, found = candidate.query, candidate.found
        candidate = replace(candidate, query=_bare(query), found=_bare(found))  # loops are kept for ever
        scan, first = self._middle(query)
        if found.dataset == self._name:
            place, begin = self._middle(found)
        else:
            place, begin = self._ranked(found), np.zeros(3)
        pose = exact(compose(begin, found.viewpoint)).compose(candidate.pose)
        pose = pose.compose(exact(inverse(compose(first, query.viewpoint))))
        return Loop(scan, found.dataset, place, pose, candidate, query.last_scan)

    def _middle(self, document: Document) -> tuple[int, Floats]:
        """The scan in the middle of a run of the drive, and the run's first scan as seen from there."""
        trajectory = self._drive.trajectory
        scan = int(np.searchsorted(self._way.array, document.middle))
        return scan, between(trajectory[scan], trajectory[document.first_scan])

    def _ranked(self, document: Document) -> int:
        """The place of another dataset's map in the dataset's trajectory, which is read when first needed."""
        name = document.dataset
        if name not in self.maps:
            documents = list(self._index.documents(name))
            self.maps[name] = [one.map_id for one in documents]
            self.drifts[name] = Drift(np.array([one.pose for one in documents]))
        return self.maps[name].index(document.map_id)


def _bare(document: Document) -> Document:
    """A document without its text."""
    return replace(document, text=Text.of([], [], []))
