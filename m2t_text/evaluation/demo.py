"""The demonstration: two drives through a simulated building, one indexed, the other looked up in it."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter

import numpy as np

from m2t_text.description.document import Document
from m2t_text.index.map_index import MapIndex
from m2t_text.logs import Log, read_log
from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen
from m2t_text.pipeline import describe_log
from m2t_text.plotting.canvas import walls_of
from m2t_text.plotting.pictures import Visit, plot_match, plot_overview
from m2t_text.recognition.answer import Answer, SearchOptions, search
from m2t_text.recognition.finding import find
from m2t_text.recognition.queries import Query
from m2t_text.sources.indexing import IndexRequest, index_sources
from m2t_text.util.files import make_folder
from m2t_text.util.geometry import transform
from m2t_text.util.types import Floats, SourceProgress

TRAVEL = 120.0  # m of the tour on the first drive: once round the building and back through its middle
LATER, FARTHER = 0.5, 1.5  # the second begins half way and goes that much farther: also the other way round
QUERY_SPACING = 2.0  # m of travel between two queries
KNOWN = 1.0  # m; a place was visited before if a map of the first drive lies so near
RIGHT_DISTANCE = 3.0  # m; a hit is right if it lies so near
SHOWN = 2  # hits in the picture


@dataclass(frozen=True)
class DemoReport:
    """What the demonstration did.

    Attributes:
        folder: holds both logs, the index and the pictures.
        scans: of both drives.
        maps: in the index.
        visits: the places looked up, and what was found.
        best: one search, the one that is drawn.
        seconds: for one search, on average.
    """

    folder: Path
    scans: tuple[int, int]
    maps: int
    visits: list[Visit]
    best: Answer
    seconds: float

    def lines(self, program: str) -> list[str]:
        """What to print: what was done, and how to go on; ``program`` is how the command line is called."""
        folder, right = self.folder, sum(visit.right for visit in self.visits)
        sure = [visit.right for visit in self.visits if visit.answered]
        assert self.best.query.document is not None
        query, hit = self.best.query.document, self.best.finding.results[0].hit
        return [
            f"Drove twice through a simulated building: {self.scans[0]} and {self.scans[1]} laser scans.",
            f"Indexed the first drive: {self.maps} local maps as text in {folder}/index.",
            f"Looked up a place of the second drive every {QUERY_SPACING:g} m: "
            f"{right} of {len(self.visits)} found within {RIGHT_DISTANCE:g} m, "
            f"{1000 * self.seconds:.0f} ms each.",
            f"Of {len(sure)} with the verdict `match`, {sum(sure)} are right.",
            f"Drew {folder}/overview.png (all of them) and {folder}/match.png (one that was found).",
            "",
            "Go on with",
            f"  {program} search {folder}/second-visit.log#{query.first_scan} --index {folder}/index",
            f"  {program} inspect {hit.map_id} --index {folder}/index",
            f"  {program} info --index {folder}/index",
            f"  {program} index YOUR.log && {program} search YOUR.log@35 --exclude-travel 10",
            *([f"  {program} serve --index {folder}/index"] if find_spec("starlette") else []),
        ]


def run_demo(folder: Path, seed: int, jobs: int, progress: SourceProgress) -> DemoReport:
    """Simulates, indexes, searches and draws, all in one folder; what an earlier run left is replaced.

    Raises:
        M2TError: if the folder cannot be written.
    """
    make_folder(folder)
    first, second = _drives(folder, seed, progress)
    index_sources(IndexRequest([folder / f"{first.name}.log"], folder / "index", jobs=jobs), progress)
    index = MapIndex.open(folder / "index")
    queries = list(_apart(describe_log(second, index.parameters, jobs, partial(progress, second.name))))
    find(index, Query.of(queries[0]))  # the first search of a process loads the compiled code; it is not timed
    begin = perf_counter()
    findings = [find(index, Query.of(query), 1) for query in queries]
    seconds = (perf_counter() - begin) / len(queries)
    known = np.array([_place(first, document) for document in index.documents(first.name)])
    visits, right = [], []
    for query, finding in zip(queries, findings, strict=True):
        place, hit = _place(second, query), _place(first, finding.results[0].hit.document)
        if _near(place, known, KNOWN):
            visits.append(
                Visit(place, hit, _near(place, hit[None], RIGHT_DISTANCE), finding.verdict == "match")
            )
            if visits[-1].right:
                right.append(query)
    walls = np.concatenate([_walls(first), _walls(second)])
    plot_overview(walls, _way(first), _way(second), visits, folder / "overview.png")
    drawn = right or queries
    scan = drawn[len(drawn) // 2].first_scan
    best = search(f"{folder}/{second.name}.log#{scan}", index, SearchOptions())
    shown = [(found, index.document(found.hit.map_id).text) for found in best.finding.results[:SHOWN]]
    plot_match(best.query.text, best.query.title, shown, index.parameters, folder / "match.png")
    return DemoReport(folder, (len(first.scans), len(second.scans)), len(index), visits, best, seconds)


def _drives(folder: Path, seed: int, progress: SourceProgress) -> tuple[Log, Log]:
    """Both logs, as they are read back from the files that they were written to."""
    drives = (
        ("first-visit", Simulation(seed=seed, drive=1, travel=TRAVEL)),
        ("second-visit", Simulation(seed=seed, drive=2, start=LATER * TRAVEL, travel=FARTHER * TRAVEL)),
    )
    logs = []
    for name, simulation in drives:
        path = folder / f"{name}.log"
        write_carmen(simulate(simulation, partial(progress, name, "simulating")), path)
        logs.append(read_log(path))
    return logs[0], logs[1]


def _apart(documents: Iterable[Document]) -> Iterator[Document]:
    """Documents that begin at least QUERY_SPACING metres of travel one after the other."""
    after = 0.0
    for document in documents:
        if document.travel[0] >= after:
            after = document.travel[0] + QUERY_SPACING
            yield document


def _place(log: Log, document: Document) -> Floats:
    """(2,) where a map's centre of gravity truly lies: the ground truth judges, it does not describe."""
    assert log.ground_truth is not None
    return transform(log.ground_truth[document.first_scan], document.centre_of_gravity[None])[0]


def _near(place: Floats, others: Floats, metres: float) -> bool:
    return bool(np.hypot(*(others - place).T).min() <= metres)


def _walls(log: Log) -> Floats:
    assert log.ground_truth is not None
    return walls_of(log, log.ground_truth)


def _way(log: Log) -> Floats:
    assert log.ground_truth is not None
    return log.ground_truth[:, :2]
