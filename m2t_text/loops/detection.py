"""The loops of a log, with its own past or with the maps of an index."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from m2t_text.config import PROFILES
from m2t_text.description.document import Document
from m2t_text.errors import LogError
from m2t_text.index.map_index import MapIndex
from m2t_text.logs.log import Log
from m2t_text.loops.gate import Loop
from m2t_text.loops.lookup import is_query, look_up
from m2t_text.loops.online import OnlineLoops
from m2t_text.loops.uncertainty import Drift
from m2t_text.mapping.local_map import Survey
from m2t_text.mapping.trajectory import survey
from m2t_text.pipeline import describe_survey
from m2t_text.util.types import StageProgress

MAP_SPACING = 0.5  # m of travel between the maps of the past; nearer ones show the same


@dataclass(frozen=True)
class LoopDetection:
    """What came of a detection.

    Attributes:
        log: the drive.
        survey: its trajectory before any loop.
        index: folder of the index that it was looked up in; None for its own past.
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
        """How many queries had a likely match."""
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
    documents = list(describe_survey(whole, log.name, parameters, jobs, tell, MAP_SPACING))
    if not documents:
        least = f"{parameters.mapping.run_length:g} m of one map"
        raise LogError(f"{log.name}: the robot travels less than the {least}; name a longer log")
    with TemporaryDirectory(prefix="m2t-text-") as folder:
        searched = index or MapIndex.create(folder, parameters)
        if index is None:
            searched.replace(log.name, documents)
        # All are in the index now, so that some are looked up at once; each among its own past alone.
        queries: list[Document] = []
        for document in documents:
            if is_query(document, queries[-1] if queries else None):
                queries.append(document)
        found = look_up(searched.path, queries, jobs, partial(tell, "looking back"))
        online = OnlineLoops(log.name, searched, look_up=lambda query: next(found))
        online.move(whole.trajectory, whole.way, whole.cuts.tolist())
        for document in documents:
            online.add(document)
    path = index.path if index else None
    verdicts = (online.loops, online.refused, online.waiting)
    return LoopDetection(log, whole, path, online.queries, *verdicts, online.drifts, online.maps)


def _check(log: Log, index: MapIndex) -> None:
    for held in index.datasets():
        if held.name == log.name and held.scans != len(log.scans):
            raise LogError(
                f"{index.path} holds another log called {log.name!r}, of {held.scans} scans and not "
                f"{len(log.scans)}; tell them apart with --name"
            )
