"""From files to an index: several sources in one commit."""

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Protocol

from m2t_text.config import PROFILES, Parameters, parameters_of
from m2t_text.description.document import Document
from m2t_text.errors import SourceError
from m2t_text.index.map_index import MapIndex, open_index
from m2t_text.index.writing.folder import holds_index
from m2t_text.sources.opening import SourceOptions, dataset_names, open_source
from m2t_text.util.types import SourceProgress


@dataclass(frozen=True)
class IndexRequest:
    """What to index, and how.

    Attributes:
        sources: files, each one dataset.
        index: folder; an index is made there if there is none.
        profile: None for that of the index, or the default one.
        jobs: processes that describe maps.
        options: how to read the sources; a name where there is one source only.
    """

    sources: Sequence[Path]
    index: Path
    profile: str | None = None
    jobs: int = 1
    options: SourceOptions = field(default_factory=SourceOptions)


@dataclass(frozen=True)
class Indexed:
    """A dataset that went into the index, and what was skipped in its source."""

    name: str
    scans: int
    seconds: float
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Report:
    """What became of the sources; ``failed`` holds one line for each that could not be read."""

    indexed: list[Indexed] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)


class Writer(Protocol):
    """What takes the maps of datasets; see `MapWriter.replace`."""

    def replace(self, name: str, documents: Iterable[Document], drive: tuple[int, float] | None = None) -> None:
        """These documents instead of all that the dataset had."""


class Target(Protocol):
    """Where maps go."""

    def parameters(self, wanted: Parameters | None) -> Parameters | None:
        """Of what is there, which must be those that are wanted, if any are; None if nothing is there."""

    def writer(self, parameters: Parameters) -> AbstractContextManager[Writer]:
        """Changes that are made together when the block ends."""


@dataclass(frozen=True)
class Folder:
    """An index in a folder."""

    path: Path

    def parameters(self, wanted: Parameters | None) -> Parameters | None:
        return MapIndex.open(self.path, wanted).parameters if holds_index(self.path) else None

    def writer(self, parameters: Parameters) -> AbstractContextManager[Writer]:
        return open_index(self.path, parameters).writer()


def index_sources(
    request: IndexRequest, progress: SourceProgress | None = None, target: Target | None = None
) -> Report:
    """Describes every map of every source; each dataset replaces the one of the same name, all in one commit.

    A source that cannot be read is left out, and what the index held of it stays. Documents are written as
    they are made, so memory does not grow with the number of maps.

    Args:
        request: what, and how.
        progress: called with (source, stage, done, total).
        target: where the maps go, if not into an index in the request's folder.

    Raises:
        M2TError: if the request cannot be met; nothing is written then.
    """
    tell = progress or (lambda what, stage, done, of: None)
    names = dataset_names(request.sources, "indexed", request.options.name)
    into = target or Folder(request.index)
    parameters = parameters_for(request, into)
    report = Report()
    with ExitStack() as commit:
        writer: Writer | None = None
        for path, name in zip(request.sources, names, strict=True):
            begin = perf_counter()
            try:
                options = replace(request.options, name=name)
                source = open_source(path, options, partial(tell, name, "reading"))
                described = source.describe(parameters, request.jobs, partial(tell, name))
            except SourceError as error:
                report.failed.append(str(error))
                continue
            # The index is made, and locked, not before there is something to put into it.
            writer = writer or commit.enter_context(into.writer(parameters))
            writer.replace(name, described.documents, described.drive)
            scans, _ = described.drive
            report.indexed.append(Indexed(name, scans, perf_counter() - begin, source.warnings))
        tell("index", "writing", 0, 1)
    tell("index", "writing", 1, 1)
    return report


def parameters_for(request: IndexRequest, target: Target) -> Parameters:
    """Of the index if there is one, which must be those asked for, if any are."""
    wanted = parameters_of(request.profile) if request.profile is not None else None
    return target.parameters(wanted) or wanted or PROFILES["default"]
