"""Sources: whatever can be indexed, as one kind of thing. The ending of a file tells how it is read."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from m2t_text.config import Parameters
from m2t_text.description.source import Described, Source
from m2t_text.errors import LogError, M2TError, SourceError
from m2t_text.logs import Log, LogOptions, read_log
from m2t_text.util.files import is_file, is_folder
from m2t_text.util.names import BAGS, CLOUDS, LOGS, PACKED, SAVED_MAPS, checked_name, dataset_name, is_bag
from m2t_text.util.types import Progress, StageProgress

if TYPE_CHECKING:
    from m2t_text.clouds import Cloud


@dataclass(frozen=True)
class SourceOptions:
    """How to read a source, where its file leaves that open.

    Attributes:
        name: of the dataset; None for that of the file.
        log: of a log; its band of heights is a point cloud's, too.
    """

    name: str | None = None
    log: LogOptions = field(default_factory=LogOptions)


@dataclass(frozen=True)
class LogSource:
    """A laser log: one map for every scan after which the robot travels far enough."""

    log: Log

    @property
    def name(self) -> str:
        return self.log.name

    @property
    def warnings(self) -> tuple[str, ...]:
        return self.log.warnings

    def describe(self, parameters: Parameters, jobs: int, tell: StageProgress) -> Described:
        from m2t_text.mapping.parts import Matching  # compiled code, slow to import
        from m2t_text.pipeline import describe_matching

        matching = Matching(self.log, parameters.mapping, progress=partial(tell, "scans"))
        documents = describe_matching(matching, self.name, parameters, jobs, tell)
        first = next(documents, None)
        if first is None:
            length = parameters.mapping.run_length
            raise LogError(
                f"{self.name}: the robot travels less than the {length:g} m of one map; record a longer log"
            )
        return Described(chain([first], documents), (len(self.log.scans), matching.travel))


@dataclass(frozen=True)
class CloudSource:
    """A point cloud: one map without a trajectory."""

    cloud: "Cloud"

    @property
    def name(self) -> str:
        return self.cloud.name

    @property
    def warnings(self) -> tuple[str, ...]:
        return self.cloud.warnings

    def describe(self, parameters: Parameters, jobs: int, tell: StageProgress) -> Described:
        from m2t_text.pipeline import describe  # compiled code, slow to import

        tell("maps", 0, 1)
        document = describe(self.cloud.local_map(parameters.mapping.cell), self.name, parameters)
        tell("maps", 1, 1)
        return Described(iter([document]), (0, 0.0))


def _open_log(path: Path, options: SourceOptions, progress: Progress | None) -> Source:
    return LogSource(read_log(path, options.name, progress, options.log))


def _open_cloud(path: Path, options: SourceOptions, progress: Progress | None) -> Source:
    from m2t_text.clouds import read_cloud  # compiled code, slow to import

    return CloudSource(read_cloud(path, options.name, options.log.height, progress))


def _open_saved_map(path: Path, options: SourceOptions, progress: Progress | None) -> Source:
    from m2t_text.sources.saved_map import SavedMap  # compiled code and Pillow, slow to import

    return SavedMap.read(path, options.name)


Reader = Callable[[Path, SourceOptions, Progress | None], Source]
READERS: Mapping[str, Reader] = {
    **dict.fromkeys((*LOGS, *BAGS, *PACKED), _open_log),
    **dict.fromkeys(CLOUDS, _open_cloud),
    **dict.fromkeys(SAVED_MAPS, _open_saved_map),
}


def open_source(
    path: str | Path, options: SourceOptions | None = None, progress: Progress | None = None
) -> Source:
    """Read a source by the reader of its ending; what has any other, and the folder of a bag, is a laser log.

    ``progress`` is called with (done, total). Raises SourceError with one line that says what is wrong, where,
    and what to do.

    Examples:
        >>> import m2t_text as m2t
        >>> m2t.open_source("drive.log", m2t.SourceOptions(name="monday")).name
        'monday'
    """
    file = Path(path)
    reader = _open_log if is_folder(file) else READERS.get(file.suffix.lower(), _open_log)
    return reader(file, options or SourceOptions(), progress)


def open_log(path: Path, options: SourceOptions | None = None, progress: Progress | None = None) -> Log:
    """Read a source that has scans. Raises SourceError as `open_source` does, or if it has none."""
    source = open_source(path, options, progress)
    if not isinstance(source, LogSource):
        raise SourceError(f"{str(path)!r} is a map without scans; name a laser log")
    return source.log


def is_source(path: Path) -> bool:
    """Whether there is a file, or the folder of a bag."""
    return is_file(path) or (is_folder(path) and is_bag(path))


def dataset_names(sources: Sequence[Path], done: str, name: str | None = None) -> list[str]:
    """The dataset of each source, told before the work: what is missing, and what would replace itself.

    Args:
        sources: all that one command was given.
        done: what would have been done with them.
        name: of the only source, where the user gives one.

    Raises:
        M2TError: naming the source, and saying that nothing was ``done``.
    """
    if name is not None and len(sources) > 1:
        raise M2TError("--name names one dataset, but there are several sources; name them one by one")
    for source in sources:
        if not is_source(source):
            wrong = "is a folder; name the files in it" if is_folder(source) else "does not exist"
            raise SourceError(f"{str(source)!r} {wrong}; nothing was {done}")
    names = [dataset_name(source) for source in sources] if name is None else [checked_name(name)]
    for one, count in Counter(names).items():
        if count > 1:
            raise M2TError(f"{count} sources would be the dataset {one!r}; take them one by one, or rename one")
    return names
