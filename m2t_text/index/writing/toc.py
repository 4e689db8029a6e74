"""The table of contents of an index: sealed JSON, which alone is read here.

The file begins with the pickles that Whoosh itself would write, so that plain Whoosh can open a sound index.
They are written and never read: unpickling runs what a file asks for.
"""

import json
import math
import re
from collections.abc import Iterable
from dataclasses import asdict
from hashlib import blake2b
from pathlib import Path
from typing import Any

from whoosh.filedb.filestore import RamStorage
from whoosh.index import TOC

from m2t_text.config import check_parameters, from_dict
from m2t_text.errors import DamageError, MapIndexError, SourceError
from m2t_text.index.codec import MapCodec, MapSegment
from m2t_text.index.schema import schema, schema_columns
from m2t_text.index.storage.directory import MapStorage
from m2t_text.util.names import checked_name

FORMAT_VERSION = 5
INDEX = "MAIN"  # what Whoosh calls an index, and begins the names of its files with
CONTENTS = re.compile(rf"_{INDEX}_(0|[1-9][0-9]{{0,8}})\.toc")
SEAL = b"m2t-text json "  # follows the JSON; its length and the checksum of all before end the file
FORMER_SEAL = b"m2t-text seal "  # of formats up to 3, before a checksum
LENGTH, DIGEST = 8, 16  # bytes of both
LIMIT = 16 << 20  # bytes of a table of contents at most
MAPS = 2**62  # in an index, fewer
SEGMENT = re.compile(r"[0-9a-z]{16}")
CHECKSUM = re.compile(r"[0-9a-f]{32}")
MALFORMED = (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError)


def generation(storage: MapStorage) -> int:
    """The number of the latest commit; -1 if there is no index."""
    matches = (CONTENTS.fullmatch(name) for name in storage.list())
    return max((int(match[1]) for match in matches if match), default=-1)


def contents_name(number: int) -> str:
    """The file of the table of contents of a commit."""
    return f"_{INDEX}_{number}.toc"


def copy_name(number: int) -> str:
    """The file of its copy, which no reader looks for, but `check` does."""
    return f"_{INDEX}_{number}.copy.toc"


def latest(storage: MapStorage) -> TOC:
    """The table of contents of the latest commit.

    Raises:
        FileNotFoundError: if there is none.
        DamageError: if it is damaged, or claims what an index of ours cannot.
    """
    number = generation(storage)
    while True:
        try:
            return read(storage, contents_name(number))
        except FileNotFoundError:
            before, number = number, generation(storage)
            if number <= before:  # else another process has just replaced it
                raise


def read(storage: MapStorage, name: str) -> TOC:
    """The table of contents in a file.

    Raises:
        MapIndexError: if it is of another version.
        DamageError: if it is damaged, or claims what an index of ours cannot.
    """
    with storage.open_plain(name) as file:
        data = file.read(LIMIT + 1)
    if len(data) > LIMIT:
        raise DamageError(f"{name} is too long")
    try:
        entries = json.loads(unsealed(data, storage.path))
        if entries["format"] != FORMAT_VERSION:
            raise _other_format(storage.path, int(entries["format"]))
        return _contents(entries)
    except SourceError as error:
        raise DamageError(f"{name}: {error}") from error
    except MALFORMED as error:
        raise DamageError(f"{name} is malformed") from error


def write(storage: MapStorage, contents: TOC) -> None:
    """Makes a state of the index the latest, in one step; it survives a loss of power when this returns.

    Raises:
        OSError: if the disk refuses; nothing has changed then.
    """
    memory = RamStorage()
    contents.write(memory, INDEX)
    (whooshs,) = memory.files.values()
    data = sealed(bytes(whooshs), json.dumps(entries_of(contents), sort_keys=True).encode())
    if len(data) > LIMIT:
        raise MapIndexError("the index has too many deleted maps to keep account of; optimize it")
    for name in (copy_name(contents.generation), contents_name(contents.generation)):
        storage.put(name, data)


def sealed(whooshs: bytes, own: bytes) -> bytes:
    """The file of a table of contents: Whoosh's bytes, then our JSON and its checksum."""
    data = whooshs + own + SEAL + len(own).to_bytes(LENGTH)
    return data + blake2b(data, digest_size=DIGEST).digest()


def unsealed(data: bytes, folder: Path | str) -> bytes:
    """The JSON in a table of contents. Raises DamageError if it is not as it was written."""
    body, digest = data[:-DIGEST], data[-DIGEST:]
    if body.endswith(FORMER_SEAL):
        raise _other_format(folder, 3)
    end = len(body) - LENGTH - len(SEAL)
    if end < 0 or body[end:-LENGTH] != SEAL:
        raise DamageError("it is not one of maps, or its table of contents was cut off")
    if blake2b(body, digest_size=DIGEST).digest() != digest:
        raise DamageError("the checksum of its table of contents is wrong")
    return body[max(0, end - int.from_bytes(body[-LENGTH:])) : end]


def _other_format(folder: Path | str, found: int) -> MapIndexError:
    return MapIndexError(
        f"the index in {folder} has format {found}, this program reads {FORMAT_VERSION}; "
        "index the logs again into another folder"
    )


def entries_of(contents: TOC) -> dict[str, Any]:
    """All that is known of a state of the index, as JSON has it."""
    text = contents.schema["text"]
    return {
        "format": FORMAT_VERSION,
        "generation": contents.generation,
        "parameters": asdict(text.parameters),
        "drives": text.drives,
        "segments": [
            {
                "id": segment.segid,
                "size": segment.size,
                "digest": segment.digest,
                "documents": segment.doc_count_all(),
                "deleted": sorted(segment.deleted_docs()),
                "maps": segment.maps,
                "parts": segment.parts,
            }
            for segment in contents.segments
        ],
    }


def _contents(entries: dict[str, Any]) -> TOC:
    """The table of contents of which `entries_of` tells; every number that decides on memory is checked."""
    made = schema(check_parameters(from_dict(entries["parameters"])))
    for name, (scans, metres) in entries["drives"].items():
        if not (type(metres) is float and math.isfinite(metres)):
            raise DamageError("the length of a drive cannot be right")
        made["text"].drives[checked_name(name)] = (_count(scans), metres)
    segments = [_segment(entry) for entry in entries["segments"]]
    if len({segment.segid for segment in segments}) < len(segments):
        raise DamageError("it names a segment twice")
    return TOC(made, segments, _count(entries["generation"]))


def _segment(entry: dict[str, Any]) -> MapSegment:
    number, digest, size = entry["id"], entry["digest"], _count(entry["size"])
    maps, deleted = _count(entry["documents"], size + 1), entry["deleted"]
    if not (SEGMENT.fullmatch(number) and CHECKSUM.fullmatch(digest)):
        raise DamageError("the name of a segment cannot be right")
    gone = {_count(one, maps) for one in deleted}
    segment = MapSegment(MapCodec(), INDEX, doccount=maps, segid=number, deleted=gone or None)
    segment.size, segment.digest, segment.compound = size, digest, True
    segment.maps = {checked_name(name): _count(live, maps + 1) for name, live in entry["maps"].items()}
    for name in schema_columns():
        begin, length = entry["parts"][name]
        segment.parts[name] = (_count(begin, size + 1), _count(length, size - begin + 1))
    return segment


def _count(value: Any, end: int = MAPS) -> int:
    """The value, if it is one of 0...end - 1."""
    if type(value) is not int or not 0 <= value < end:
        raise DamageError("a number in it cannot be right")
    return value


def files_of(contents: TOC) -> Iterable[str]:
    """The names of the files of a state: its table of contents and copy, and its segments."""
    number = contents.generation
    return (contents_name(number), copy_name(number), *(one.filename for one in contents.segments))
