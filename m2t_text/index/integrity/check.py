"""Whether an index is what was written, file by file and map by map; and its repair."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from m2t_text.errors import DamageError, MapIndexError
from m2t_text.index.codec import MapSegment
from m2t_text.index.integrity.salvage import maps_of
from m2t_text.index.storage.directory import MapStorage
from m2t_text.index.writing.folder import no_index
from m2t_text.index.writing.lock import leftovers, locked
from m2t_text.index.writing.map_writer import disk_errors, open_writer
from m2t_text.index.writing.toc import TOC, contents_name, copy_name, files_of, generation, read
from m2t_text.util.types import Progress


@dataclass(frozen=True)
class FileCheck:
    """One file of an index, and what is wrong with it, if anything is."""

    name: str
    bytes: int
    problem: str | None = None


@dataclass(frozen=True)
class DatasetCheck:
    """One dataset: the number of maps that are whole, and of those that are lost."""

    name: str
    maps: int
    lost: int


@dataclass(frozen=True)
class Check:
    """What was found in an index.

    Attributes:
        files: all that the latest state consists of: the table of contents, its copy, and the segments.
        datasets: by name; none if the table of contents cannot be read.
        leftovers: files that a killed writer left; the next one removes them, and they harm nobody.
    """

    path: Path
    files: tuple[FileCheck, ...]
    datasets: tuple[DatasetCheck, ...]
    leftovers: tuple[str, ...]

    @property
    def sound(self) -> bool:
        return all(file.problem is None for file in self.files)

    @property
    def legible(self) -> bool:
        """Whether the table of contents or its copy can be read."""
        return any(file.problem is None for file in self.files[:2])


def check_index(folder: Path, progress: Progress | None = None) -> Check:
    """Verifies every byte and every map of the latest state of an index.

    Raises:
        MapIndexError: if there is no index, or one of another version.
    """
    storage = MapStorage(folder)
    number = generation(storage)
    if number < 0:
        raise no_index(folder)
    tables = [_check_table(storage, name) for name in (contents_name(number), copy_name(number))]
    contents = next((contents for contents, _ in tables if contents is not None), None)
    files = [file for _, file in tables]
    if contents is None:
        return Check(folder, tuple(files), (), ())
    drives = contents.schema["text"].drives
    whole, lost = Counter[str](), Counter[str]()
    tell = _counted(progress, sum(segment.doc_count() for segment in contents.segments))
    for segment in contents.segments:
        file, found = _check_segment(storage, segment, set(drives), tell)
        files.append(file)
        whole += found
        lost += Counter(segment.maps) - found
    names = sorted(whole | lost)
    datasets = tuple(DatasetCheck(name, whole[name], lost[name]) for name in names)
    return Check(folder, tuple(files), datasets, tuple(leftovers(storage, files_of(contents))))


def repair_index(folder: Path, seconds: float, progress: Progress | None = None) -> list[str]:
    """Rebuilds what can be rebuilt of an index and removes the rest; reports each step.

    Args:
        seconds: to wait for another writer.

    Raises:
        MapIndexError: if nothing is known of the maps, or the disk refuses.
    """
    storage = MapStorage(folder)
    if generation(storage) < 0:
        raise no_index(folder)
    with disk_errors(folder), locked(folder, seconds):
        done = _repair_tables(storage)
    contents = read(storage, contents_name(generation(storage)))
    if check_index(folder, progress).sound:
        return done
    with open_writer(folder, contents.schema["text"].parameters, seconds) as writer:
        drives = set(contents.schema["text"].drives)
        for segment in list(contents.segments):
            file, _ = _check_segment(storage, segment, drives, lambda: None)
            if file.problem is not None:
                found = [each.document for each in maps_of(storage, segment) if each.document is not None]
                writer.rebuild(segment, found)
                done.append(f"rebuilt {len(found):,} of {segment.doc_count():,} maps of {segment.filename}")
                done += _told_of(segment, Counter(document.dataset for document in found))
    return done


def _check_table(storage: MapStorage, name: str) -> tuple[TOC | None, FileCheck]:
    """A table of contents, if it can be read."""
    try:
        contents = read(storage, name)
    except FileNotFoundError:
        return None, FileCheck(name, 0, "is missing")
    except (DamageError, OSError) as error:
        return None, FileCheck(name, storage.file_length(name), str(error))
    return contents, FileCheck(name, storage.file_length(name))


def _check_segment(
    storage: MapStorage, segment: MapSegment, known: set[str], tell: Callable[[], None]
) -> tuple[FileCheck, Counter[str]]:
    """A segment, and the number of whole maps of each dataset in it."""
    name, found, exact = segment.filename, Counter[str](), True
    if not storage.file_exists(name):
        return FileCheck(name, 0, "is missing"), found
    for one in maps_of(storage, segment):
        tell()
        exact &= one.exact
        if one.document is not None:
            found[one.document.dataset] += 1
    try:
        sound = segment.is_sound(storage)
    except (DamageError, OSError):
        sound = False
    problem = None
    if not sound:
        problem = "differs from what was written"
    elif not exact or found != Counter(segment.maps) or not found.keys() <= known:
        problem = "contradicts itself"
    return FileCheck(name, storage.file_length(name), problem), found


def _repair_tables(storage: MapStorage) -> list[str]:
    """Writes the table of contents anew from its copy, or the copy from it."""
    number = generation(storage)
    names = (contents_name(number), copy_name(number))
    sound = [name for name in names if _check_table(storage, name)[1].problem is None]
    if not sound:
        raise MapIndexError(
            f"the table of contents of {storage.path} is damaged, and so is its copy: nothing is known of "
            "its maps; index the logs again into another folder"
        )
    done = []
    for name in names:
        if name not in sound:
            with storage.open_plain(sound[0]) as file:
                data = file.read()
            storage.put(name, data)
            done.append(f"wrote {name} anew from {sound[0]}")
    return done


def _told_of(segment: MapSegment, found: Counter[str]) -> list[str]:
    """The message about maps that could not be rebuilt."""
    lost = Counter(segment.maps) - found
    return [
        f"removed {count:,} of {segment.maps[name]:,} maps of {name}; index its log again to have them back"
        for name, count in sorted(lost.items())
    ]


def _counted(progress: Progress | None, of: int) -> Callable[[], None]:
    """Tells of one more map at each call."""
    done = 0

    def tell() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, of)

    return tell
