"""The evaluation of whole logs: each is indexed by itself, for as long as it takes, and looked up in itself.

Several logs are also looked up in each other, where every `match` is wrong."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from m2t_text.config import Parameters, parameters_of
from m2t_text.description.document import Document
from m2t_text.errors import LogError
from m2t_text.evaluation.examples import Pair, examples
from m2t_text.evaluation.judging import Judgement, count_matches, judge_all
from m2t_text.evaluation.protocol import MIN_TRAVEL_APART, RELEVANT_DISTANCE, GroundTruth, draw
from m2t_text.index.map_index import MapIndex
from m2t_text.logs import Log
from m2t_text.pipeline import describe_log
from m2t_text.sources.opening import SourceOptions, dataset_names, open_log
from m2t_text.util.types import SourceProgress


@dataclass(frozen=True)
class EvaluationRequest:
    """What to evaluate, and how.

    Attributes:
        sources: log files with ground truth, each one dataset.
        profile: the parameters' name.
        queries: number of queries drawn of each dataset; None for all.
        seed: of that draw.
        jobs: processes.
        options: how to read the sources; a name where there is one source only.
    """

    sources: Sequence[Path]
    profile: str = "default"
    queries: int | None = None
    seed: int = 0
    jobs: int = 1
    options: SourceOptions = field(default_factory=SourceOptions)


@dataclass(frozen=True)
class EvaluatedLog:
    """One dataset: its log, the truth about its maps, what became of each query, and two pairs to look at.

    Attributes:
        travel: metres, up to the end of the last map.
        unvisited: maps of places that were never seen before that were looked up, and how many got a `match`.
        elsewhere: queries looked up in all other logs, and how many got a `match`.
    """

    log: Log
    travel: float
    truth: GroundTruth
    judgements: list[Judgement]
    unvisited: tuple[int, int]
    elsewhere: tuple[int, int]
    pairs: list[Pair]


@dataclass(frozen=True)
class Evaluation:
    """All datasets, in the order of their sources."""

    parameters: Parameters
    datasets: list[EvaluatedLog]


def evaluate(request: EvaluationRequest, progress: SourceProgress | None = None) -> Evaluation:
    """Evaluates each log by itself. Nothing is left on disk, and the same request gives the same figures.

    Raises:
        LogError: if a log cannot be read, has no ground truth, or comes to no place twice; told before any
            query is judged.
        M2TError: if there is no such profile, or two sources would be one dataset.
    """
    tell = progress or (lambda what, stage, done, of: None)
    parameters = parameters_of(request.profile)
    named = zip(request.sources, dataset_names(request.sources, "evaluated", request.options.name), strict=True)
    logs = [read_with_truth(path, name, tell, request.options) for path, name in named]
    with TemporaryDirectory(prefix="m2t-text-") as folder:
        prepared = [
            _prepared(log, Path(folder) / str(n), parameters, request, partial(tell, log.name))
            for n, log in enumerate(logs)
        ]
        together = _together(prepared, Path(folder) / "together", parameters)
        return Evaluation(parameters, [_evaluated(one, together, request, tell) for one in prepared])


@dataclass(frozen=True)
class _Prepared:
    log: Log
    index: MapIndex
    truth: GroundTruth
    queries: NDArray[np.int64]


def read_with_truth(path: Path, name: str, tell: SourceProgress, options: SourceOptions | None = None) -> Log:
    """The log of a file. Raises SourceError if it cannot be read, LogError if it has no ground truth."""
    log = open_log(path, options, partial(tell, name, "reading"))
    if log.ground_truth is None:
        raise LogError(
            f"{str(path)!r} has no ground truth to judge by: name a log with corrected poses and raw odometry"
        )
    return log


def _prepared(
    log: Log,
    path: Path,
    parameters: Parameters,
    request: EvaluationRequest,
    tell: Callable[[str, int, int], None],
) -> _Prepared:
    index = MapIndex.create(path, parameters)
    index.replace(log.name, describe_log(log, parameters, request.jobs, tell))
    assert log.ground_truth is not None
    truth = GroundTruth.of(index.documents(), log.ground_truth)
    queries = truth.queries()
    if not len(queries):
        raise LogError(
            f"{log.name}: none of its {len(truth)} maps lies within {RELEVANT_DISTANCE:g} m of another that is "
            f"more than {MIN_TRAVEL_APART:g} m of travel away; name a log that comes back to places"
        )
    return _Prepared(log, index, truth, draw(queries, request.queries, request.seed))


def _together(prepared: Sequence[_Prepared], path: Path, parameters: Parameters) -> MapIndex | None:
    """All logs in one index; None of a single log."""
    if len(prepared) < 2:
        return None
    index = MapIndex.create(path, parameters)
    with index.writer() as writer:
        for one in prepared:
            writer.replace(one.log.name, one.index.documents())
    return index


def _evaluated(
    one: _Prepared, together: MapIndex | None, request: EvaluationRequest, tell: SourceProgress
) -> EvaluatedLog:
    stage = partial(tell, one.log.name)
    judgements = judge_all(
        one.index.path, one.truth, one.queries, request.jobs, partial(stage, "judging queries")
    )
    ids = one.index.ids
    drawn = draw(one.truth.unvisited(), len(one.queries), request.seed)
    lonely = [one.index.document(ids[k]) for k in drawn]
    progress = partial(stage, "looking up unvisited places")
    unvisited = count_matches(one.index.path, lonely, MIN_TRAVEL_APART, request.jobs, progress)
    asked: list[Document] = []
    elsewhere = 0
    if together is not None:
        asked = [one.index.document(ids[k]) for k in one.queries]
        progress = partial(stage, "looking elsewhere")
        elsewhere = count_matches(together.path, asked, np.inf, request.jobs, progress)
    return EvaluatedLog(
        log=one.log,
        travel=one.index.datasets()[0].travel,
        truth=one.truth,
        judgements=judgements,
        unvisited=(len(lonely), unvisited),
        elsewhere=(len(asked), elsewhere),
        pairs=examples(one.index, one.truth, judgements),
    )
