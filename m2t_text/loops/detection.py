"""A drive detection against its own past, or against an index: the whole method in one place."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from m2t_text.config import PROFILES
from m2t_text.description.document import Document
from m2t_text.errors import LogError
from m2t_text.index.map_index import MapIndex
from m2t_text.logs.log import Log
from m2t_text.loops.gate import Gate, Loop
from m2t_text.loops.lookup import EVERY, Candidate, look_up
from m2t_text.loops.uncertainty import Drift, exact
from m2t_text.mapping.local_map import Survey
from m2t_text.mapping.trajectory import survey
from m2t_text.pipeline import describe_survey
from m2t_text.util.geometry import between, compose, inverse
from m2t_text.util.types import Floats, StageProgress

KEPT = 0.5  # m of travel between the maps of the past; nearer ones show the same


@dataclass(frozen=True)
class LoopDetection:
    """What came of a detection.

    Attributes:
        log: the drive.
        survey: its trajectory before any loop.
        index: folder of the index that it was detection against; None for its own past.
        queries: number of maps that were looked up.
        loops, refused, waiting: what became of the matches; see `Gate`.
        drifts: by dataset, the trajectories that loops lead to; the drive's own always.
        maps: the ids of the maps of each other dataset, in the order of its trajectory.
    """

    log: Log
    survey: Survey
    index: Path | None
    queries: int
    loops: list[Loop]
    refused: list[Loop]
    waiting: list[Loop]
    drifts: dict[str, Drift]
    maps: dict[str, list[str]]

    @property
    def matches(self) -> int:
        """How many queries had the verdict ``match``."""
        return len(self.loops) + len(self.refused) + len(self.waiting)


def detect_loops(
    log: Log, index: MapIndex | None = None, jobs: int = 1, progress: StageProgress | None = None
) -> LoopDetection:
    """The loops of a drive: with its own past, or with the maps of an index and the past that it holds.

    Each loop follows from the scans up to its ``known`` alone: the loops of a log that ends there finds it too.

    Raises:
        LogError: if the robot travels less than one map takes, or the index holds another log of this name.
    """
    tell = progress or (lambda stage, done, of: None)
    parameters = index.parameters if index else PROFILES["default"]
    if index is not None:
        _check(log, index)
    whole = survey(log, parameters.mapping, partial(tell, "scans"))
    documents = list(describe_survey(whole, log.name, parameters, jobs, tell, KEPT))
    if not documents:
        least = f"{parameters.mapping.run_length:g} m of one map"
        raise LogError(f"{log.name}: the robot travels less than the {least}; name a longer log")
    queries = _queries(documents)
    places = _Places(log.name, whole, index)
    gate = Gate(log.name, places.drifts)
    with TemporaryDirectory(prefix="m2t-text-") as folder:
        searched = index or MapIndex.create(folder, parameters)
        if index is None:
            searched.replace(log.name, documents)
        for candidate in look_up(searched.path, queries, jobs, partial(tell, "looking back")):
            gate.offer(places.loop(candidate))
    path = index.path if index else None
    verdicts = (gate.loops, gate.refused, gate.waiting)
    return LoopDetection(log, whole, path, len(queries), *verdicts, places.drifts, places.maps)


def _check(log: Log, index: MapIndex) -> None:
    for held in index.datasets():
        if held.name == log.name and held.scans != len(log.scans):
            raise LogError(
                f"{index.path} holds another log called {log.name!r}, of {held.scans} scans and not "
                f"{len(log.scans)}; tell them apart with --name"
            )


def _queries(documents: list[Document]) -> list[Document]:
    """The maps that are looked up: EVERY so many metres of travel one."""
    chosen: list[Document] = []
    for document in documents:
        if not chosen or document.travel[0] >= chosen[-1].travel[0] + EVERY:
            chosen.append(document)
    return chosen


class _Places:
    """The poses that loops join: of the drive the scan in the middle of a run, which its map fits best; of
    another dataset the first scan of a map, as an index knows no other."""

    def __init__(self, drive: str, whole: Survey, index: MapIndex | None) -> None:
        self.drifts = {drive: Drift(whole.trajectory, whole.cuts)}
        self.maps: dict[str, list[str]] = {}
        self._drive = drive
        self._whole = whole
        self._index = index

    def loop(self, candidate: Candidate) -> Loop:
        query, found = candidate.query, candidate.found
        scan, first = self._middle(query)
        if found.dataset == self._drive:
            place, begin = self._middle(found)
        else:
            place, begin = self._ranked(found), np.zeros(3)
        pose = exact(compose(begin, found.viewpoint)).compose(candidate.pose)
        pose = pose.compose(exact(inverse(compose(first, query.viewpoint))))
        return Loop(scan, found.dataset, place, pose, candidate, query.last_scan)

    def _middle(self, document: Document) -> tuple[int, Floats]:
        """The scan in the middle of a run of the drive, and the run's first scan as seen from there."""
        trajectory = self._whole.trajectory
        scan = int(np.searchsorted(self._whole.way, document.middle))
        return scan, between(trajectory[scan], trajectory[document.first_scan])

    def _ranked(self, document: Document) -> int:
        """The place of another dataset's map in the dataset's trajectory, which is read when first needed."""
        name = document.dataset
        if name not in self.maps:
            assert self._index is not None
            documents = list(self._index.documents(name))
            self.maps[name] = [one.map_id for one in documents]
            self.drifts[name] = Drift(np.array([one.pose for one in documents]))
        return self.maps[name].index(document.map_id)
