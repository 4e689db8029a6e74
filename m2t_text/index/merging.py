"""Several indexes: those that lie side by side in one folder, and all of them as one."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from m2t_text.description.document import Document
from m2t_text.errors import MapIndexError, listed
from m2t_text.index.map_index import MapIndex, open_index
from m2t_text.index.results import DatasetSummary, IndexInfo
from m2t_text.index.writing.folder import holds_index
from m2t_text.util.types import SourceProgress


@dataclass(frozen=True)
class Unreadable:
    """An index that cannot be opened, and why."""

    path: Path
    reason: str


def indexes_in(folder: str | Path) -> list[IndexInfo | Unreadable]:
    """What each index right in a folder holds, ordered by name; none if there is no such folder.

    Examples:
        >>> import m2t_text as m2t
        >>> [(info.path.name, info.parameters.profile) for info in m2t.indexes_in("indexes")]
        [('default', 'default')]
    """
    within = Path(folder)
    if not within.is_dir():
        return []
    return [_info(path) for path in sorted(within.iterdir()) if holds_index(path)]


def _info(path: Path) -> IndexInfo | Unreadable:
    try:
        return MapIndex.open(path).info()
    except MapIndexError as error:
        return Unreadable(path, str(error))


@dataclass(frozen=True)
class Merged:
    """A dataset that was copied, and the index that it came from."""

    dataset: DatasetSummary
    source: Path


def merge(
    sources: Sequence[str | Path],
    into: str | Path,
    replace: bool = False,
    progress: SourceProgress | None = None,
) -> list[Merged]:
    """Copies all datasets of the sources into one index, in one commit. The sources stay as they are.

    Args:
        sources: folders of indexes, all with the same parameters.
        into: the folder of an index with these parameters; it is made if there is none.
        replace: where several hold a dataset of one name, take that of the last source. Without it this is an
            error, as one of them would be lost.
        progress: called with (dataset, stage, maps done, total).

    Raises:
        MapIndexError: if the request cannot be met; nothing is written then.

    Examples:
        >>> import m2t_text as m2t
        >>> [merged.dataset.name for merged in m2t.merge(["indexes/default"], "indexes/all")]
        ['drive']
    """
    folders = [Path(source) for source in sources]
    _check_distinct(folders, Path(into))
    opened = [MapIndex.open(folder).pinned() for folder in folders]
    for index in opened[1:]:
        _check_same(index, opened[0])
    found = [(dataset, index) for index in opened for dataset in index.datasets()]
    if not replace:
        _check_unique([dataset.name for dataset, _ in found], "the indexes to merge")
    last = {dataset.name: (dataset, index) for dataset, index in found}
    tell = progress or (lambda what, stage, done, of: None)
    target = open_index(into, opened[0].parameters)
    if not replace and holds_index(target.path):
        _check_unique([*last, *_names(target)], f"{into} and those to merge")
    with target.writer() as writer:
        if not replace:  # another process may have added one; from here on none can
            _check_unique([*last, *_names(target)], f"{into} and those to merge")
        for name, (dataset, index) in last.items():
            writer.replace(name, _copied(index, dataset, tell), (dataset.scans, dataset.travel))
    return [Merged(dataset, index.path) for dataset, index in last.values()]


def _names(index: MapIndex) -> list[str]:
    return [dataset.name for dataset in index.datasets()]


def _check_distinct(sources: Sequence[Path], into: Path) -> None:
    if not sources:
        raise MapIndexError("no index to merge; name at least one")
    real = [source.resolve() for source in sources]
    if into.resolve() in real:
        raise MapIndexError(f"{into} is the index to merge into; name only those that are to be copied into it")
    twice = next((source for source, count in Counter(real).items() if count > 1), None)
    if twice is not None:
        raise MapIndexError(f"{twice} is named twice; name each index once")


def _check_same(index: MapIndex, first: MapIndex) -> None:
    """Texts of other parameters cannot be compared."""
    if index.parameters != first.parameters:
        raise MapIndexError(
            f"{index.path} (profile {index.parameters.profile!r}) and {first.path} (profile "
            f"{first.parameters.profile!r}) were made with other parameters; use one profile for all"
        )


def _check_unique(names: Sequence[str], holders: str) -> None:
    twice = sorted(repr(name) for name, count in Counter(names).items() if count > 1)
    if twice:
        raise MapIndexError(
            f"{holders} hold datasets of the same name: {listed(twice)}; with --replace the last is taken"
        )


def _copied(index: MapIndex, dataset: DatasetSummary, tell: SourceProgress) -> Iterator[Document]:
    for done, document in enumerate(index.documents(dataset.name), start=1):
        yield document
        tell(dataset.name, "copying maps", done, dataset.maps)
