"""The folder of an index: making it, opening it, and telling it from anything else."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from whoosh.index import TOC

from m2t_text.config import Parameters, check_parameters
from m2t_text.errors import DamageError, MapIndexError
from m2t_text.index.schema import schema
from m2t_text.index.storage.directory import MapStorage, flush
from m2t_text.index.writing.lock import OURS, locked, sweep
from m2t_text.index.writing.segment_writer import SafeIndex
from m2t_text.index.writing.toc import contents_name, generation, write


def create_whoosh(folder: Path, parameters: Parameters, seconds: float) -> None:
    """A new Whoosh index in a folder that is made, is empty, or was left half made.

    Raises:
        MapIndexError: if the folder holds an index or anything else, or cannot be written.
    """
    try:
        check_parameters(parameters)
    except (ValueError, TypeError) as error:
        raise MapIndexError(f"no index can be made with these parameters: {error}") from error
    storage = MapStorage(folder)
    try:
        _make(folder)
        _refuse_index(folder)
        check_new(folder)
        with locked(folder, seconds):
            _refuse_index(folder)  # of another process, made since
            sweep(storage)
            write(storage, TOC(schema(parameters), [], 0))
    except OSError as error:
        raise MapIndexError(f"cannot make an index in {folder}: {error.strerror or error}") from error


def check_new(folder: Path) -> None:
    """Raises MapIndexError if a folder holds anything but what a killed writer may have left."""
    foreign = [name for name in names(folder) if not OURS.fullmatch(name) or name.endswith(".seg")]
    if foreign:
        raise MapIndexError(f"{folder} holds other files, as {foreign[0]!r}; choose a folder of its own")


def _refuse_index(folder: Path) -> None:
    if holds_index(folder):
        raise MapIndexError(f"{folder} already holds an index; open it, or choose another folder")


def holds_index(folder: Path) -> bool:
    """Whether there is an index in a folder."""
    return generation(MapStorage(folder)) >= 0


def open_whoosh(folder: Path) -> tuple[SafeIndex, Parameters]:
    """The Whoosh index in a folder, and the parameters that it was made with.

    Raises:
        MapIndexError: if there is none, or it is of another kind or version, or damaged.
    """
    if not holds_index(folder):
        raise no_index(folder)
    with damage_errors(folder):
        whoosh = SafeIndex(MapStorage(folder))
        return whoosh, whoosh.schema["text"].parameters


def revision(folder: Path) -> str | None:
    """A different string for each commit to the index in a folder; None if there is no index."""
    number = generation(MapStorage(folder))
    try:
        return f"{number}-{(folder / contents_name(number)).stat().st_mtime_ns:x}"
    except OSError:  # none was made, or a later commit has replaced it
        return None if number < 0 else f"{number}-"


def no_index(folder: Path) -> MapIndexError:
    """What to tell who names a folder without an index."""
    if any(name.startswith("manifest-") for name in names(folder)):
        return MapIndexError(f"the index in {folder} has shards, which this cannot read; see docs/cluster.md")
    return MapIndexError(f"no index in {folder}; make one with `m2t-text index`")


def is_empty(whoosh: SafeIndex) -> bool:
    """Whether an index holds no map, so that its parameters bind nobody."""
    return not whoosh._segments()


@contextmanager
def damage_errors(folder: Path) -> Iterator[None]:
    """Says of what goes wrong in the block that the index cannot be read, and what to do."""
    try:
        yield
    except (DamageError, OSError, MemoryError) as error:
        reason = getattr(error, "strerror", None) or str(error) or "it does not fit into memory"
        raise MapIndexError(
            f"the index in {folder} cannot be read ({reason}); `m2t-text check --index {folder}` says more"
        ) from error


def names(folder: Path) -> list[str]:
    """The names of a folder's files, sorted."""
    return MapStorage(folder).list()


def _make(folder: Path) -> None:
    """Makes a folder and those above it, on disk when this returns."""
    if not folder.is_dir():
        _make(folder.absolute().parent)
        with suppress(FileExistsError):  # another process is as quick
            folder.mkdir()
        with suppress(PermissionError):  # it may be entered but not read
            flush(folder.absolute().parent)
