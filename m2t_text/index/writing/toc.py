"""The table of contents of an index: as Whoosh writes it, sealed with a checksum, and read as data alone."""

import math
import re
from collections.abc import Iterable
from hashlib import blake2b
from io import BytesIO
from pathlib import Path
from struct import error as struct_error
from typing import Any

from whoosh.filedb.filestore import RamStorage
from whoosh.filedb.structfile import StructFile
from whoosh.index import TOC

from m2t_text.config import check_parameters, from_json
from m2t_text.errors import DamageError, MapIndexError, SourceError
from m2t_text.index.codec import MapCodec, MapSegment
from m2t_text.index.schema import FORMAT_VERSION, schema
from m2t_text.index.storage.directory import MapStorage
from m2t_text.index.storage.safe_pickle import Made, load
from m2t_text.util.names import checked_name

INDEX = "MAIN"  # what Whoosh calls an index, and begins the names of its files with
CONTENTS = re.compile(rf"_{INDEX}_(0|[1-9][0-9]{{0,8}})\.toc")
SEAL = b"m2t-text seal "  # ends the file, and the checksum of all before it follows
DIGEST = 16
LIMIT = 16 << 20  # bytes of a table of contents at most
SEGMENT = re.compile(r"[0-9a-z]{16}")
CHECKSUM = re.compile(r"[0-9a-f]{32}")

SCHEMA_CLASSES = frozenset(
    {
        "__builtin__ float",
        "__builtin__ long",
        "m2t_text.index.column ArrayColumn",
        "m2t_text.index.column KeypointColumn",
        "m2t_text.index.column NameColumn",
        "m2t_text.index.schema NumberField",
        "m2t_text.index.schema PlainField",
        "m2t_text.index.schema RecordField",
        "m2t_text.index.schema TextField",
        "whoosh.analysis.tokenizers IDTokenizer",
        "whoosh.fields ID",
        "whoosh.fields Schema",
        "whoosh.formats Existence",
    }
)
SEGMENT_CLASSES = frozenset({"m2t_text.index.codec MapCodec", "m2t_text.index.codec MapSegment"})
MALFORMED = (ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError, struct_error)


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
    """The table of contents in a file, every part of it made anew from plain data."""
    with storage.open_plain(name) as file:
        data = file.read(LIMIT + 1)
    if len(data) > LIMIT:
        raise DamageError(f"{name} is too long")
    try:
        return _parsed(data, storage.path)
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
    (name,) = memory.list()
    data = bytes(memory.files[name]) + SEAL
    data += blake2b(data, digest_size=DIGEST).digest()
    if len(data) > LIMIT:
        raise MapIndexError("the index has too many deleted maps to keep account of; optimize it")
    storage.put(copy_name(contents.generation), data)
    storage.put(name, data)


def _parsed(data: bytes, folder: Path) -> TOC:
    end = len(data) - len(SEAL) - DIGEST
    sealed = data[max(end, 0) : -DIGEST] == SEAL
    if sealed and blake2b(data[:-DIGEST], digest_size=DIGEST).digest() != data[-DIGEST:]:
        raise DamageError("the checksum of its table of contents is wrong")
    stream = StructFile(BytesIO(data[:end] if sealed else data))
    for _ in range(3):  # sizes of numbers
        stream.read_varint()
    stream.read_int()  # order of bytes
    stream.read_int()  # Whoosh's version of the format
    for _ in range(3):  # Whoosh's version
        stream.read_varint()
    description, _ = load(stream.read_string(), SCHEMA_CLASSES)
    text = _state(_state(description)["_fields"].get("text"), "TextField")
    if text["version"] != FORMAT_VERSION:
        raise MapIndexError(
            f"the index in {folder} has format {int(text['version'])}, this program reads {FORMAT_VERSION}; "
            "index the logs again into another folder"
        )
    if not sealed:
        raise DamageError("its table of contents was cut off")
    number, _ = stream.read_int(), stream.read_int()
    segments, _ = load(stream.read(), SEGMENT_CLASSES)
    return TOC(_schema(text), _segments(segments), number)


def _state(made: Any, name: str = "") -> dict[str, Any]:
    """The attributes of what would be an object of a class that ends in this name."""
    if not (isinstance(made, Made) and made.name.endswith(name) and isinstance(made.state, dict)):
        raise DamageError("it is not one of maps")
    return made.state


def _schema(text: dict[str, Any]) -> Any:
    """The schema, with the parameters and the datasets' drives of the one that is described."""
    try:
        made = schema(check_parameters(from_json(text["stored_parameters"])))
    except (*MALFORMED, RecursionError) as error:
        raise DamageError("its parameters cannot be right") from error
    for name, (scans, metres) in text["drives"].items():
        if not (_count(scans) and type(metres) is float and math.isfinite(metres)):
            raise DamageError("the length of a drive cannot be right")
        made["text"].drives[checked_name(name)] = (scans, metres)
    return made


def _segments(made: list[Any]) -> list[MapSegment]:
    segments = [_segment(_state(one, " MapSegment")) for one in made]
    if len({segment.segid for segment in segments}) < len(segments):
        raise DamageError("it names a segment twice")
    return segments


def _segment(state: dict[str, Any]) -> MapSegment:
    """A segment; what names its file, and numbers that decide on memory, are checked."""
    number, maps, deleted = state["segid"], state["_doccount"], state["_deleted"] or set()
    size, digest = state["size"], state["digest"]
    named = SEGMENT.fullmatch(number) and CHECKSUM.fullmatch(digest) and state["indexname"] == INDEX
    counted = _count(maps) and _count(size) and maps <= size
    if not (named and counted and all(0 <= one < maps for one in deleted)):
        raise DamageError("the name or the size of a segment cannot be right")
    segment = MapSegment(MapCodec(), INDEX, doccount=maps, segid=number, deleted=set(deleted) or None)
    segment.size, segment.digest, segment.compound = size, digest, True
    segment.maps = {checked_name(name): maps for name, maps in state["maps"].items() if _count(maps)}
    segment._fieldlengths = {}
    return segment


def _count(value: Any) -> bool:
    return type(value) is int and 0 <= value < 2**62


def files_of(contents: TOC) -> Iterable[str]:
    """The names of the files of a state: its table of contents and copy, and its segments."""
    number = contents.generation
    return (contents_name(number), copy_name(number), *(one.filename for one in contents.segments))
