"""What the verdict's coefficients are fitted on: maps looked up, and how each of their alignments fits.

A source is a log with corrected poses, or a simulated building. Of each log these are looked up, as `search`
does: places visited before; places never visited; places all of whose maps are taken out of the index; maps in
an index of all other logs; and runs of its second half in a saved map of its first. The ground truth says which
alignments are right, and nothing else.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from whoosh.query import Not, Or, Term
from whoosh.query import Query as WhooshQuery

from m2t_text.config import PROFILES
from m2t_text.description.document import Document
from m2t_text.description.free_squares import NO_SQUARES
from m2t_text.evaluation.metrics import pose_error
from m2t_text.evaluation.protocol import MIN_TRAVEL_APART, POSE_RIGHT, UNVISITED, GroundTruth, draw
from m2t_text.evaluation.saved_maps import ON_WALL, SavedMap, build_map, write_map
from m2t_text.index.map_index import MapIndex
from m2t_text.logs import Log
from m2t_text.mapping.local_map import local_maps, run_starts
from m2t_text.mapping.trajectory import survey
from m2t_text.pipeline import describe, describe_log
from m2t_text.recognition.earlier import indexed_before
from m2t_text.recognition.finding import VERIFIED, elsewhere, symmetric, trail_of, verify_along
from m2t_text.recognition.fit import Fit
from m2t_text.recognition.found import Found
from m2t_text.recognition.queries import Query
from m2t_text.recognition.raster import Raster
from m2t_text.recognition.verification import relative_pose
from m2t_text.saved_maps.grid import OCCUPIED
from m2t_text.saved_maps.sampling import FEWEST
from m2t_text.util.geometry import compose, transform, travel
from m2t_text.util.types import Floats
from m2t_text.util.workers import cores

VISITED, NEVER, TAKEN_OUT, OTHER_LOG, IN_MAP, OFF_MAP = range(6)  # kinds of queries
KINDS = ("visited", "never visited", "taken out", "other log", "in a saved map", "beside it")
CELL = PROFILES["default"].mapping.cell
COVERED, UNCOVERED = (
    0.65,
    0.15,
)  # shares of a run's points on a saved map: at least, to be in it; at most, beside it
SEQUENCE = 10.0  # m of a drive that are looked up as one query
RUN = 3.0  # m of travel, of what is looked up in a saved map
MOST_MAPS = 1000  # of each log in the index of all
FIT = ("keypoints", "seen", "inliers", "conflicts", "grip", "distance", "patch")

Right = Callable[[Found, Floats], bool]  # whether a query that lies at a pose (3,) on a hit does so truly


@dataclass(frozen=True)
class Lookups:
    """The queries of one source, and all alignments of each with its hits.

    Attributes:
        name: of the source.
        building: sources of one building are left out together.
        kind: (Q,) of each query.
        query: (A,) number of each alignment's query.
        extra: (A,) whether it is none of a hit, but another pose on the best one, or on one more map elsewhere.
        place: (A, 5) dataset, travel at the middle of its map, and the query's place x, y, theta in its frame.
        right: (A,) whether its pose is.
        support: (A,) of earlier maps of the drive, 0 where the query is one map alone.
        fit: (A, 7) the figures FIT of its fit.
        blind: (A, 7) the same where the texts do not tell what is free.
    """

    name: str
    building: str
    kind: NDArray[np.int64]
    query: NDArray[np.int64]
    extra: NDArray[np.bool_]
    place: Floats
    right: NDArray[np.bool_]
    support: Floats
    fit: Floats
    blind: Floats

    def save(self, path: Path) -> None:
        np.savez_compressed(path, **self.__dict__)

    @classmethod
    def load(cls, path: Path) -> "Lookups":
        with np.load(path) as file:
            arrays = {name: file[name] for name in file.files}
        return cls(**{name: str(a) if a.ndim == 0 else a for name, a in arrays.items()})


@dataclass(frozen=True)
class Source:
    """A log to look up, and the building that it shows."""

    name: str
    building: str
    read: Callable[[], Log]

    @cached_property
    def log(self) -> Log:
        """The log, which bears the source's name."""
        return self.read()


@dataclass(frozen=True)
class _Task:
    kind: int
    query: Query
    right: Right
    exclude: tuple[str, float, float] | None = None
    filter: WhooshQuery | None = None


def visits(source: Source, folder: Path, count: int) -> Lookups:
    """At most ``count`` places that were visited before, and two thirds as many of those that were not.

    Indexes are kept in the folder."""
    index = _index(source, folder)
    return _joined(source, [_row(index, task) for task in _tasks(source, index, count)])


def sequences(source: Source, folder: Path, count: int) -> Lookups:
    """The same queries as `visits`, each with the maps of the last SEQUENCE metres of the drive."""
    index = _index(source, folder)
    return _joined(source, [_row(index, _along(index, task)) for task in _tasks(source, index, count)])


def _along(index: MapIndex, task: _Task) -> _Task:
    document = task.query.document
    assert document is not None
    return replace(task, query=replace(task.query, earlier=indexed_before(index, document, SEQUENCE)))


def in_other_logs(source: Source, logs: Sequence[Source], folder: Path, count: int) -> Lookups:
    """At most ``count`` maps, looked up among those of the other ``logs``; some of each."""
    index, together = _index(source, folder), _index_of_all(logs, folder)
    strangers = Or([Term("dataset", one.name) for one in logs if one.name != source.name])
    documents = [index.document(index.ids[k]) for k in draw(np.arange(len(index)), count, 0)]
    tasks = [_Task(OTHER_LOG, Query.of(one), lambda found, pose: False, filter=strangers) for one in documents]
    return _joined(source, [_row(together, task) for task in tasks])


def in_saved_map(source: Source, count: int) -> Lookups:
    """At most ``count`` runs of a log's second half in a map that was drawn from its first, and beside it."""
    with TemporaryDirectory(prefix="m2t-text-") as folder:
        return _joined(source, list(_in_saved_map(source, Path(folder), count)))


def _index(source: Source, folder: Path) -> MapIndex:
    def fill(index: MapIndex) -> None:
        index.replace(source.name, describe_log(source.log, PROFILES["default"], cores(None)))

    return _made(folder / source.name, fill)


def _index_of_all(logs: Sequence[Source], folder: Path) -> MapIndex:
    """At most about MOST_MAPS of each log."""

    def fill(index: MapIndex) -> None:
        with index.writer() as writer:
            for one in logs:
                documents = list(_index(one, folder).documents())
                writer.replace(one.name, documents[:: max(1, len(documents) // MOST_MAPS)])

    return _made(folder / "all", fill)


def _made(folder: Path, fill: Callable[[MapIndex], None]) -> MapIndex:
    """The index in a folder, filled if it was not before."""
    if not (folder / "done").exists():
        fill(MapIndex.create(folder, PROFILES["default"]))
        (folder / "done").touch()
    return MapIndex.open(folder)


def _tasks(source: Source, index: MapIndex, count: int) -> Iterator[_Task]:
    assert source.log.ground_truth is not None
    documents, ids = list(index.documents()), index.ids
    numbers = {map_id: k for k, map_id in enumerate(ids)}
    truth = GroundTruth.of(documents, source.log.ground_truth)
    visited, never = truth.queries(), truth.unvisited()
    for kind, chosen in (
        (VISITED, draw(visited, count, 0)),
        (NEVER, draw(never, 2 * count // 3, 1)),
        (TAKEN_OUT, draw(visited, 2 * count // 3, 2)),
    ):
        for k in chosen.tolist():

            def right(found: Found, pose: Floats, k: int = k) -> bool:
                hit = numbers[found.hit.map_id]
                return truth.right(k, hit, relative_pose(documents[k], documents[hit], pose))

            query = Query.of(documents[k])
            near = Or([Term("map_id", ids[i]) for i in np.flatnonzero(truth.distances(k) <= UNVISITED)])
            yield _Task(
                kind, query, right, query.excluding(MIN_TRAVEL_APART), Not(near) if kind == TAKEN_OUT else None
            )


def _in_saved_map(source: Source, folder: Path, count: int) -> Iterator["_Row | None"]:
    """Runs of the second half of a log in a map that was drawn from its first."""
    truth, parameters = source.log.ground_truth, PROFILES["default"]
    assert truth is not None
    way = travel(truth)
    half = int(np.searchsorted(way, way[-1] / 2, side="right"))
    grid = build_map(source.log, truth, np.arange(half))
    write_map(grid, folder / "map.yaml")
    saved = SavedMap.read(folder / "map.yaml")
    index = MapIndex.create(folder / "index", parameters)
    described = saved.describe(parameters, 1, lambda stage, done, of: None)
    index.replace(saved.name, described.documents, described.drive)
    whole = survey(source.log, parameters.mapping)
    short = replace(parameters, mapping=replace(parameters.mapping, run_length=RUN))
    starts, walls = run_starts(whole, RUN), KDTree(grid.centres(OCCUPIED))
    left = {IN_MAP: count, OFF_MAP: count}
    for start in np.random.default_rng(0).permutation(starts[starts >= half])[: 8 * count].tolist():
        (run,) = local_maps(whole, short.mapping, np.array([start]))
        if len(run.points) < FEWEST:
            continue
        share = float(np.mean(walls.query(transform(truth[start], run.points))[0] <= ON_WALL))
        kind = IN_MAP if share >= COVERED else OFF_MAP
        if UNCOVERED < share < COVERED or not left[kind]:
            continue
        left[kind] -= 1
        document = describe(run, source.log.name, short)

        def right(found: Found, pose: Floats, document: Document = document, start: int = start) -> bool:
            there = relative_pose(document, found.hit.document, pose)
            away, turn = pose_error(compose(found.hit.document.pose, there), truth[start])
            return away <= POSE_RIGHT[0] and turn <= POSE_RIGHT[1]

        yield _row(index, _Task(kind, Query(document.text, document), right))


@dataclass(frozen=True)
class _Row:
    """One query: its kind, and of each alignment what `Lookups` holds."""

    kind: int
    extra: list[bool]
    place: list[Floats]
    right: list[bool]
    support: list[float]
    fit: list[list[float]]
    blind: list[list[float]]


def _row(index: MapIndex, task: _Task) -> _Row | None:
    """What becomes of one query; None if nothing shares a word with it."""
    search = partial(index.search, task.query.text, exclude=task.exclude, filter=task.filter, texts=True)
    hits = [hit for hit in search(VERIFIED) if hit.score > 0]
    if not hits:
        return None
    trail = trail_of(index, task.query, task.exclude, task.filter)
    verified = verify_along(index, task.query, hits, trail)
    others = [*symmetric(index, task.query, verified[0]), *elsewhere(index, task.query, verified, search)]
    more = list(map(trail.supported, others))
    here = _rasters(task.query)
    row = _Row(task.kind, [], [], [], [], [], [])
    names = sorted({one.hit.document.dataset for one in [*verified, *more]})
    for k, found in enumerate([*verified, *more]):
        document = found.hit.document
        there = _rasters(Query.of(index.document(document.map_id)))
        for alignment in found.alignments:
            place = compose(compose(document.pose, document.viewpoint), alignment.pose)
            row.extra.append(k >= len(verified))
            row.place.append(np.array([names.index(document.dataset), document.middle, *place]))
            row.right.append(task.right(found, alignment.pose))
            row.support.append(alignment.support)
            for query, other, figures in zip(here, there, (row.fit, row.blind), strict=True):
                fit = Fit.of(query, alignment.pose, other)
                figures.append([float(getattr(fit, name)) for name in FIT])
    return row


def _rasters(query: Query) -> tuple[Raster, Raster]:
    """With what is known to be free, and without."""
    return Raster.of(query.text, CELL), Raster.of(replace(query.text, free=NO_SQUARES), CELL)


def _joined(source: Source, found: Sequence[_Row | None]) -> Lookups:
    rows = [row for row in found if row is not None]
    return Lookups(
        source.name,
        source.building,
        np.array([row.kind for row in rows]),
        np.repeat(np.arange(len(rows)), [len(row.right) for row in rows]),
        np.array([one for row in rows for one in row.extra]),
        np.array([one for row in rows for one in row.place]),
        np.array([one for row in rows for one in row.right]),
        np.array([one for row in rows for one in row.support]),
        np.array([one for row in rows for one in row.fit]),
        np.array([one for row in rows for one in row.blind]),
    )
