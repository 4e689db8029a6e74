"""How well runs of a robot are found in a map of the same building that was drawn before.

The ground truth of a log's first half (by travel) draws a map. Runs of the second half, built from raw odometry
and scans alone, are looked up in it, and the ground truth judges where they are found.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from m2t_text.config import PROFILES, Parameters
from m2t_text.description.document import Document
from m2t_text.errors import LogError
from m2t_text.evaluation.metrics import median, pose_error
from m2t_text.evaluation.run import read_with_truth
from m2t_text.index.map_index import MapIndex
from m2t_text.logs import Log
from m2t_text.mapping.local_map import Survey, local_maps, run_starts
from m2t_text.mapping.trajectory import survey
from m2t_text.pipeline import describe
from m2t_text.recognition.finding import find
from m2t_text.recognition.queries import Query
from m2t_text.saved_maps.grid import FREE, OCCUPIED, Grid
from m2t_text.saved_maps.occupancy_mapping import build_map
from m2t_text.saved_maps.sampling import FEWEST
from m2t_text.saved_maps.writing import write_map
from m2t_text.sources.opening import SourceOptions, dataset_names
from m2t_text.sources.saved_map import SavedMap
from m2t_text.util.geometry import transform, travel
from m2t_text.util.types import Floats, SourceProgress

ON_WALL = 0.25  # m; a point of a run so near to an occupied cell is on the map
POSE_TOLERANCE = (0.5, np.radians(5.0))  # m and rad by which a right pose may err


@dataclass(frozen=True)
class MapEvaluationRequest:
    """What to evaluate, and how.

    Attributes:
        sources: log files with ground truth.
        run: metres of travel in a query; 0 for single scans.
        queries: how many runs of each log are drawn.
        covered: share of a run's points that must lie on the map, at their true pose.
        seed: of the draw.
        jobs: processes.
        folder: where the maps are kept; None to keep none.
        options: how to read the logs; a name where there is one only.
    """

    sources: Sequence[Path]
    run: float = 3.0
    queries: int = 200
    covered: float = 0.65
    seed: int = 0
    jobs: int = 1
    folder: Path | None = None
    options: SourceOptions = field(default_factory=SourceOptions)


@dataclass(frozen=True)
class Placed:
    """What became of one query: the verdict, and metres and radians by which its pose in the map errs."""

    scan: int
    verdict: str
    error: tuple[float, float]

    @property
    def right(self) -> bool:
        return self.error[0] <= POSE_TOLERANCE[0] and self.error[1] <= POSE_TOLERANCE[1]


@dataclass(frozen=True)
class EvaluatedMap:
    """One log: the map of its first half, how many local maps were sampled there, and all queries' fates."""

    name: str
    grid: Grid
    maps: int
    placed: list[Placed]

    @property
    def right(self) -> NDArray[np.bool_]:
        """(Q,) which queries were placed right."""
        return np.array([one.right for one in self.placed])

    @property
    def match(self) -> NDArray[np.bool_]:
        """(Q,) which queries got the verdict `match`."""
        return np.array([one.verdict == "match" for one in self.placed])

    def to_json(self) -> dict[str, Any]:
        """One of the datasets of ``evaluate-map --json``; percentages are 0...100."""
        errors = np.array([one.error for one in self.placed])[self.right].reshape(-1, 2)
        precision = self.right[self.match]
        return {
            "dataset": self.name,
            "free": float((self.grid.states == FREE).sum() * self.grid.resolution**2),
            "maps": self.maps,
            "queries": len(self.placed),
            "right": 100 * float(self.right.mean()),
            "translation_error_median": median(errors[:, 0]),
            "rotation_error_median": median(errors[:, 1]),
            "match": 100 * float(self.match.mean()),
            "match_right": 100 * float(precision.mean()) if len(precision) else None,
        }


def evaluate(request: MapEvaluationRequest, progress: SourceProgress | None = None) -> list[EvaluatedMap]:
    """Evaluates each log by itself; the same request gives the same figures.

    Raises:
        SourceError: if a log cannot be read, has no ground truth, or no run that its map covers.
        M2TError: if two sources would be one dataset, or a map cannot be written.
    """
    tell = progress or (lambda what, stage, done, of: None)
    named = zip(request.sources, dataset_names(request.sources, "evaluated", request.options.name), strict=True)
    logs = [read_with_truth(path, name, tell, request.options) for path, name in named]
    with TemporaryDirectory(prefix="m2t-text-") as temporary:
        return [_evaluated(log, Path(temporary), PROFILES["default"], request, tell) for log in logs]


def _evaluated(
    log: Log, folder: Path, parameters: Parameters, request: MapEvaluationRequest, tell: SourceProgress
) -> EvaluatedMap:
    assert log.ground_truth is not None
    way = travel(log.ground_truth)
    half = int(np.searchsorted(way, way[-1] / 2, side="right"))
    grid = build_map(log, log.ground_truth, np.arange(half))
    path = (request.folder or folder) / f"{log.name}-map.yaml"
    write_map(grid, path)
    index = MapIndex.create(folder / log.name, parameters)
    source = SavedMap.read(path)
    described = source.describe(parameters, request.jobs, partial(tell, log.name))
    index.replace(source.name, described.documents, described.drive)
    whole = survey(log, parameters.mapping, partial(tell, log.name, "scans"))
    placed = []
    for document in islice(_queries(log, whole, half, grid, parameters, request), request.queries):
        placed.append(_placed(index, document, log.ground_truth[document.first_scan]))
        tell(log.name, "judging queries", len(placed), request.queries)
    tell(log.name, "judging queries", request.queries, request.queries)
    if not placed:
        share = f"{request.covered:.0%}"
        raise LogError(f"{log.name}: the map of its first half covers {share} of no run of its second half")
    return EvaluatedMap(log.name, grid, len(index), placed)


def _queries(
    log: Log, whole: Survey, half: int, grid: Grid, parameters: Parameters, request: MapEvaluationRequest
) -> Iterator[Document]:
    """Runs of the scans from ``half`` on that the map covers, in a random order."""
    assert log.ground_truth is not None
    parameters = replace(parameters, mapping=replace(parameters.mapping, run_length=request.run))
    starts = run_starts(whole, request.run)
    walls = KDTree(grid.centres(OCCUPIED))
    for start in np.random.default_rng(request.seed).permutation(starts[starts >= half]):
        (run,) = local_maps(whole, parameters.mapping, np.array([start]))
        away, _ = walls.query(transform(log.ground_truth[start], run.points))
        if len(run.points) >= FEWEST and np.mean(away <= ON_WALL) >= request.covered:
            yield describe(run, log.name, parameters)


def _placed(index: MapIndex, document: Document, truth: Floats) -> Placed:
    finding = find(index, Query(document.text, document))
    pose = finding.results[0].dataset_pose if finding.results else None
    error = (np.inf, np.pi) if pose is None else pose_error(pose, truth)
    return Placed(document.first_scan, finding.verdict, error)
