"""From log files to an index: several sources in one commit."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from time import perf_counter

from m2t_text.config import PROFILES, Parameters, parameters_of
from m2t_text.description.document import Document
from m2t_text.errors import LogError, M2TError
from m2t_text.index.folder import holds_index
from m2t_text.index.store import MapIndex
from m2t_text.index.writing import MapWriter
from m2t_text.logs import Log, checked_name, dataset_name, read_log
from m2t_text.mapping.trajectory import survey
from m2t_text.pipeline import describe_survey

Progress = Callable[[str, str, int, int], None]  # what, stage, done, all


@dataclass(frozen=True)
class Request:
    """What to index, and how.

    Attributes:
        sources: log files, each one dataset.
        index: folder; an index is made there if there is none.
        profile: None for that of the index, or the default one.
        jobs: processes that describe maps.
        name: of the dataset, where there is one source; else the file's name.
    """

    sources: Sequence[Path]
    index: Path
    profile: str | None = None
    jobs: int = 1
    name: str | None = None


@dataclass(frozen=True)
class Indexed:
    """A dataset that went into the index, and what was skipped in its log."""

    name: str
    scans: int
    seconds: float
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Report:
    """What became of the sources; ``failed`` holds one line for each that could not be read."""

    indexed: list[Indexed] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)


def index_sources(request: Request, progress: Progress | None = None) -> Report:
    """Describes every map of every source; each dataset replaces the one of the same name, all in one commit.

    A source that cannot be read is left out, and what the index held of it stays. Documents are written as
    they are made, so memory does not grow with the number of maps.

    Raises:
        M2TError: if the request cannot be met; nothing is written then.
    """
    tell = progress or (lambda what, stage, done, of: None)
    names = _names(request)
    parameters = _parameters(request)
    report = Report()
    with ExitStack() as commit:
        writer: MapWriter | None = None
        for source, name in zip(request.sources, names, strict=True):
            begin = perf_counter()
            try:
                log = read_log(source, name, partial(tell, name, "reading"))
                documents, drive = _described(log, parameters, request.jobs, partial(tell, name))
            except LogError as error:
                report.failed.append(str(error))
                continue
            # The index is made, and locked, not before there is something to put into it.
            writer = writer or commit.enter_context(MapIndex.open_or_create(request.index, parameters).writer())
            writer.replace(name, documents, drive)
            report.indexed.append(Indexed(name, len(log.scans), perf_counter() - begin, log.warnings))
        tell("index", "writing", 0, 1)
    tell("index", "writing", 1, 1)
    return report


def _names(request: Request) -> list[str]:
    """The dataset of each source. Told before the work: what is missing, and what would replace itself."""
    if request.name is not None and len(request.sources) > 1:
        raise M2TError("--name names one dataset, but there are several sources; index them one by one")
    for source in request.sources:
        if not source.is_file():
            wrong = "is a folder; name the logs in it" if source.is_dir() else "does not exist"
            raise LogError(f"{str(source)!r} {wrong}; nothing was indexed")
    if request.name is not None:
        return [checked_name(request.name)]
    names = [dataset_name(source) for source in request.sources]
    for name, count in Counter(names).items():
        if count > 1:
            raise M2TError(f"{count} sources would be the dataset {name!r}; index them one by one with --name")
    return names


def _parameters(request: Request) -> Parameters:
    """Of the index if there is one, which must be those asked for, if any are."""
    wanted = parameters_of(request.profile) if request.profile is not None else None
    if holds_index(request.index):
        return MapIndex.open(request.index, wanted).parameters
    return wanted or PROFILES["default"]


def _described(
    log: Log, parameters: Parameters, jobs: int, tell: Callable[[str, int, int], None]
) -> tuple[Iterator[Document], tuple[int, float]]:
    """The maps of a log, and its scans and travel. A log without any map must not empty its dataset."""
    whole = survey(log, parameters.mapping, partial(tell, "scans"))
    documents = describe_survey(whole, log.name, parameters, jobs, tell)
    first = next(documents, None)
    if first is None:
        length = parameters.mapping.run_length
        raise LogError(
            f"{log.name}: the robot travels less than the {length:g} m of one map; record a longer log"
        )
    return chain([first], documents), (len(log.scans), float(whole.way[-1]))
