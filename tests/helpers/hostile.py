"""Indexes as a stranger may send them: each attack turns a sound index into one that must be refused."""

import os
import pickle
import resource
import signal
import socket
import struct
from collections.abc import Callable
from contextlib import suppress
from hashlib import blake2b
from io import BytesIO
from pathlib import Path
from typing import Any

import children
import numpy as np
from states import contents, copied, maps
from whoosh.fields import ID, TEXT, Schema
from whoosh.filedb.structfile import StructFile
from whoosh.index import TOC

from m2t_text.errors import MapIndexError
from m2t_text.index.codec import MapSegment
from m2t_text.index.column import COUNTS, HEADER
from m2t_text.index.integrity.check import repair_index
from m2t_text.index.map_index import MapIndex
from m2t_text.index.storage.directory import MapStorage, fingerprint
from m2t_text.index.storage.segment_file import SegmentFile
from m2t_text.index.writing.toc import DIGEST, SEAL, contents_name, copy_name, generation, latest, write

Attack = Callable[[Path, Path], None]  # of an index's folder; the second path must stay as it is
ATTACKS: dict[str, Attack] = {}

MEMORY = 1 << 30  # bytes that a reader may take beside what it has
SECONDS = 20  # that it may take
KEYPOINTS, RUNS, WIDE = range(3)  # rows of the numbers in a column of keypoints


def attack(function: Attack) -> Attack:
    ATTACKS[function.__name__] = function
    return function


def suffer(index: MapIndex, path: Path, canary: Path, function: Attack) -> str | None:
    """Reads, searches and writes an attacked copy, in a process with bounds: what is said, if it is refused.

    Then it must survive a repair, too.
    """
    copied(index, path)
    function(path, canary)
    before = canary.read_bytes() if canary.exists() else None

    def work() -> str | None:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        limit = pages * resource.getpagesize() + MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        signal.alarm(SECONDS)
        try:
            attacked = MapIndex.open(path)
            attacked.search(maps(3, "a")[0].text, top=0)
            attacked.datasets()
            contents(attacked)
            with attacked.writer() as writer:
                writer.remove("b")
                writer.optimize = True
        except MapIndexError as error:
            with suppress(MapIndexError):
                repair_index(path, 1.0)
            return str(error)
        return None

    told = children.call(work)
    assert (canary.read_bytes() if canary.exists() else None) == before
    return None if told is None else str(told)


# --- Pickles that would run code


class Runs:
    """Pickled as a call that makes a file."""

    def __init__(self, canary: Path) -> None:
        self.canary = canary

    def __reduce__(self) -> Any:
        return os.system, (f"touch {self.canary}",)


@attack
def a_call_in_the_schema(path: Path, canary: Path) -> None:
    forge(path, schema=pickle.dumps(Runs(canary), 2))


@attack
def a_call_in_the_list_of_segments(path: Path, canary: Path) -> None:
    forge(path, segments=pickle.dumps([Runs(canary)], -1))


@attack
def a_call_in_the_oldest_protocol(path: Path, canary: Path) -> None:
    forge(path, schema=pickle.dumps(Runs(canary), 0))


@attack
def a_call_by_the_operation_inst(path: Path, canary: Path) -> None:
    forge(path, segments=f"(S'touch {canary}'\nios\nsystem\n.".encode())


@attack
def a_call_by_the_operation_obj(path: Path, canary: Path) -> None:
    forge(path, segments=b"(cos\nsystem\n" + text(f"touch {canary}") + b"o.")


@attack
def a_call_of_eval(path: Path, canary: Path) -> None:
    code = text(f"open({str(canary)!r}, 'w')")
    forge(path, segments=b"\x80\x04" + text("builtins") + text("eval") + b"\x93" + code + b"\x85R.")


@attack
def a_call_of_a_class_that_is_allowed(path: Path, canary: Path) -> None:
    forge(path, segments=b"\x80\x02cm2t_text.index.codec\nMapSegment\nK\x01K\x02\x86R.")


@attack
def attributes_of_a_class_that_is_allowed(path: Path, canary: Path) -> None:
    name = b"cm2t_text.index.codec\nMapSegment\n"
    forge(path, segments=b"\x80\x02" + name + b"N}" + text("is_sound") + b"Ns\x86b.")


@attack
def a_way_through_the_attributes_of_a_class(path: Path, canary: Path) -> None:
    forge(
        path,
        segments=b"\x80\x04" + text("m2t_text.index.codec") + text("MapSegment.count.__globals__") + b"\x93.",
    )


@attack
def a_registered_extension(path: Path, canary: Path) -> None:
    forge(path, segments=b"\x80\x02\x82\x01.")


@attack
def a_persistent_object(path: Path, canary: Path) -> None:
    forge(path, segments=b"\x80\x02Pobject\n.")


@attack
def a_class_that_is_not_ours(path: Path, canary: Path) -> None:
    forge(path, schema=pickle.dumps(Schema(text=TEXT()), 2))


@attack
def a_call_in_a_segment(path: Path, canary: Path) -> None:
    reassemble(path, directory=pickle.dumps(Runs(canary), -1))


# --- Names that lead elsewhere or command the terminal


@attack
def a_segment_in_another_folder(path: Path, canary: Path) -> None:
    with_segment(path, lambda one: vars(one).update(segid="/../../../etc/passwd"))


@attack
def a_segment_of_another_index(path: Path, canary: Path) -> None:
    with_segment(path, lambda one: vars(one).update(indexname="../MAIN"))


@attack
def a_segment_with_a_name_of_commands(path: Path, canary: Path) -> None:
    with_segment(path, lambda one: vars(one).update(segid="\x1b[2Jaaaaaaaaaaaa"))


@attack
def a_linked_segment(path: Path, canary: Path) -> None:
    (file,) = path.glob("*.seg")
    file.rename(path.parent / "elsewhere.seg")
    file.symlink_to(path.parent / "elsewhere.seg")


@attack
def a_linked_table_of_contents(path: Path, canary: Path) -> None:
    file = table(path)
    file.unlink()
    file.symlink_to("/etc/passwd")


@attack
def a_linked_lock(path: Path, canary: Path) -> None:
    (path / "MAIN_WRITELOCK").unlink()
    (path / "MAIN_WRITELOCK").symlink_to(canary)


@attack
def a_dataset_in_another_folder(path: Path, canary: Path) -> None:
    with_drives(path, {"../../outside": (1, 1.0)})


@attack
def a_dataset_with_a_name_of_commands(path: Path, canary: Path) -> None:
    with_drives(path, {"\x1b]0;pwned\x07": (1, 1.0)})


@attack
def a_segments_dataset_with_a_name_of_commands(path: Path, canary: Path) -> None:
    with_segment(path, lambda one: vars(one).update(maps={"\x9b31m": 1}))


@attack
def maps_of_a_dataset_with_a_name_of_commands(path: Path, canary: Path) -> None:
    reassemble(path, {"dataset": lambda data: data.replace(b'"a"', b'"\\u001b[2J"')})


@attack
def maps_of_a_dataset_with_a_name_that_turns_the_text_around(path: Path, canary: Path) -> None:
    reassemble(path, {"dataset": lambda data: data.replace(b'"a"', '"\u202e"'.encode())})


@attack
def maps_of_two_datasets_of_one_name(path: Path, canary: Path) -> None:
    reassemble(path, {"dataset": lambda data: data.replace(b'"a"', b'"b"')})


@attack
def maps_of_a_dataset_without_a_name(path: Path, canary: Path) -> None:
    reassemble(path, {"dataset": lambda data: data.replace(b'"a"', b"0")})


@attack
def maps_of_a_dataset_beyond_the_last(path: Path, canary: Path) -> None:
    reassemble(path, {"dataset": lambda data: struct.pack("<i", 2) + data[4:]})


@attack
def maps_of_a_dataset_before_the_first(path: Path, canary: Path) -> None:
    reassemble(path, {"dataset": lambda data: struct.pack("<i", -1) + data[4:]})


@attack
def names_that_nest_without_end(path: Path, canary: Path) -> None:
    reassemble(path, {"dataset": lambda data: data.replace(b'"a"', b"[" * 200_000)})


@attack
def maps_of_a_dataset_that_is_not_listed(path: Path, canary: Path) -> None:
    with_drives(path, {})


@attack
def a_profile_with_a_name_of_commands(path: Path, canary: Path) -> None:
    with_parameters(path, '"profile": "default"', '"profile": "\\u001b[2J"')


# --- Files that never end, and claims of more than there is


@attack
def a_pipe_for_a_table_of_contents(path: Path, canary: Path) -> None:
    file = table(path)
    file.unlink()
    os.mkfifo(file)


@attack
def a_pipe_for_a_segment(path: Path, canary: Path) -> None:
    (file,) = path.glob("*.seg")
    file.unlink()
    os.mkfifo(file)


@attack
def a_socket_for_a_segment(path: Path, canary: Path) -> None:
    (file,) = path.glob("*.seg")
    file.unlink()
    with socket.socket(socket.AF_UNIX) as server:
        here = Path.cwd()
        os.chdir(path)  # the names of sockets are short
        server.bind(file.name)
        os.chdir(here)


@attack
def a_folder_for_a_segment(path: Path, canary: Path) -> None:
    (file,) = path.glob("*.seg")
    file.unlink()
    file.mkdir()


@attack
def a_table_of_contents_of_a_terabyte(path: Path, canary: Path) -> None:
    os.truncate(table(path), 1 << 40)


@attack
def a_string_of_an_exabyte(path: Path, canary: Path) -> None:
    forge(path, segments=b"\x80\x04\x8d" + struct.pack("<Q", 1 << 60) + b"abc.")


@attack
def bytes_of_an_exabyte(path: Path, canary: Path) -> None:
    forge(path, segments=b"\x80\x05\x96" + struct.pack("<Q", 1 << 60) + b"abc.")


@attack
def a_schema_of_an_exabyte(path: Path, canary: Path) -> None:
    forge(path, claim=1 << 60)


@attack
def a_memo_of_many_gigabytes(path: Path, canary: Path) -> None:
    forge(path, segments=b"\x80\x02]r" + struct.pack("<I", 0x7FFFFFFF) + b".")


@attack
def a_key_that_takes_for_ever_to_hash(path: Path, canary: Path) -> None:
    forge(path, segments=b"\x80\x02})" + b"2\x86" * 64 + b"Ns.")


@attack
def a_key_that_takes_for_ever_to_hash_without_copies(path: Path, canary: Path) -> None:
    forge(path, segments=b"\x80\x02})" + b"q\x00h\x00\x86" * 64 + b"Ns.")


@attack
def millions_of_empty_containers(path: Path, canary: Path) -> None:
    forge(path, segments=b"\x80\x02]" + b"(" + b"}" * 10_000_000 + b"e.")


@attack
def more_maps_than_there_are(path: Path, canary: Path) -> None:
    with_segment(path, lambda one: one.set_doc_count(10**15))


@attack
def a_few_more_maps_than_there_are(path: Path, canary: Path) -> None:
    with_segment(path, lambda one: one.set_doc_count(one.doc_count_all() + 3))


@attack
def deleted_maps_that_are_not_there(path: Path, canary: Path) -> None:
    with_segment(path, lambda one: vars(one).update(_deleted={10**12}))


@attack
def a_segment_twice(path: Path, canary: Path) -> None:
    segments = latest(MapStorage(path)).segments
    forge(path, segments=pickle.dumps(segments * 2, -1))


@attack
def a_negative_size(path: Path, canary: Path) -> None:
    with_segment(path, lambda one: vars(one).update(size=-1))


@attack
def a_part_beyond_the_end_of_a_segment(path: Path, canary: Path) -> None:
    redirect(path, "text", lambda part: part.update(length=1 << 50))


@attack
def a_part_before_the_beginning_of_a_segment(path: Path, canary: Path) -> None:
    redirect(path, "text", lambda part: part.update(offset=-(1 << 20)))


@attack
def a_column_that_is_missing(path: Path, canary: Path) -> None:
    reassemble(path, {"record": lambda data: None})


@attack
def a_directory_beyond_the_end_of_a_segment(path: Path, canary: Path) -> None:
    rewrite(path, lambda data: struct.pack("!q", 1 << 40) + data[8:])


@attack
def a_directory_that_is_the_whole_segment(path: Path, canary: Path) -> None:
    rewrite(path, lambda data: struct.pack("!qi", 12, 0x7FFFFFFF) + data[12:])


@attack
def more_keypoints_than_there_are(path: Path, canary: Path) -> None:
    reassemble(path, {"text": lambda data: reheaded(data, keypoints=1 << 40)})


@attack
def keypoints_of_one_map_that_are_anothers(path: Path, canary: Path) -> None:
    reassemble(path, {"text": lambda data: recounted(data, KEYPOINTS, 5)})


@attack
def runs_of_one_map_that_are_anothers(path: Path, canary: Path) -> None:
    reassemble(path, {"text": lambda data: recounted(data, RUNS, 3)})


@attack
def a_text_with_many_runs_and_few_keypoints(path: Path, canary: Path) -> None:
    def lengthen(data: bytes) -> bytes:
        counts = np.zeros_like(counts_of(data))
        counts[RUNS, 0] = 1 << 24  # of 64 keypoints each, if one believes them
        head = np.array([(counts.shape[1], 0, 1 << 24, 0)], HEADER)
        return head.tobytes() + counts.tobytes() + b"\xff" * (2 << 24)

    reassemble(path, {"text": lengthen})


@attack
def keypoints_of_which_few_are_wide(path: Path, canary: Path) -> None:
    def widen(data: bytes) -> bytes:
        counts = counts_of(data)
        counts[WIDE, 0] += 1
        return recounted_as(reheaded(data, wide=int(counts[WIDE].sum())), counts) + bytes(2)

    reassemble(path, {"text": widen})


@attack
def runs_longer_than_the_text(path: Path, canary: Path) -> None:
    reassemble(path, {"text": lambda data: rerun(data, lambda runs: runs | 63)})


@attack
def words_that_do_not_ascend(path: Path, canary: Path) -> None:
    reassemble(path, {"text": lambda data: rerun(data, lambda runs: runs ^ (np.arange(len(runs)) % 2 << 15))})


@attack
def a_record_that_is_no_number(path: Path, canary: Path) -> None:
    reassemble(path, {"record": lambda data: data[:16] + struct.pack("<d", float("nan")) + data[24:]})


@attack
def a_record_with_a_negative_scan(path: Path, canary: Path) -> None:
    reassemble(path, {"record": lambda data: struct.pack("<q", -5) + data[8:]})


@attack
def a_window_of_a_hundred_kilometres(path: Path, canary: Path) -> None:
    with_parameters(path, '"window": 10', '"window": 1000000')


@attack
def a_thousand_directions(path: Path, canary: Path) -> None:
    with_parameters(path, '"directions": 3', '"directions": 1000')


@attack
def a_hundred_turns(path: Path, canary: Path) -> None:
    with_parameters(path, '"turns": [0, 1, 2, 3]', f'"turns": {[0] * 100}')


@attack
def no_cells(path: Path, canary: Path) -> None:
    with_parameters(path, '"cell": 0.1', '"cell": 0.0')


@attack
def parameters_that_are_none(path: Path, canary: Path) -> None:
    with_parameters(path, '"cell": 0.1', '"cell": "0.1"')


@attack
def parameters_that_nest_without_end(path: Path, canary: Path) -> None:
    with_parameters(path, '"cell": 0.1', '"cell": ' + "[" * 200_000)


@attack
def another_version(path: Path, canary: Path) -> None:
    toc = latest(MapStorage(path))
    toc.schema["text"].version = 999
    write(MapStorage(path), toc)


@attack
def no_seal(path: Path, canary: Path) -> None:
    table(path).write_bytes(table(path).read_bytes()[: -len(SEAL) - DIGEST])


@attack
def a_schema_without_texts(path: Path, canary: Path) -> None:
    forge(path, schema=pickle.dumps(Schema(map_id=ID()), 2))


# --- Tools


def table(path: Path) -> Path:
    """The latest table of contents."""
    return path / contents_name(generation(MapStorage(path)))


def text(string: str) -> bytes:
    """The operation that loads a string."""
    return b"X" + struct.pack("<I", len(string.encode())) + string.encode()


def forge(
    path: Path, schema: bytes | None = None, segments: bytes | None = None, claim: int | None = None
) -> None:
    """Writes a table of contents, sealed as it should be, of these pickles; the copy is the same."""
    toc = latest(MapStorage(path))
    stream = StructFile(BytesIO())
    schema = pickle.dumps(toc.schema, 2) if schema is None else schema
    for size in (4, 8, 4):
        stream.write_varint(size)
    stream.write_int(-12345)
    stream.write_int(-111)
    for part in (2, 7, 5):
        stream.write_varint(part)
    stream.write_varint(len(schema) if claim is None else claim)
    stream.write(schema)
    stream.write_int(toc.generation)
    stream.write_int(0)
    stream.write(pickle.dumps(toc.segments, -1) if segments is None else segments)
    data = stream.file.getvalue() + SEAL
    data += blake2b(data, digest_size=DIGEST).digest()
    for name in (contents_name(toc.generation), copy_name(toc.generation)):
        (path / name).write_bytes(data)


def with_segment(path: Path, change: Callable[[MapSegment], Any]) -> None:
    """Changes what the table of contents says of the only segment."""
    toc: TOC = latest(MapStorage(path))
    (segment,) = toc.segments
    change(segment)
    forge(path, segments=pickle.dumps(toc.segments, -1))


def with_drives(path: Path, drives: dict[str, tuple[int, float]]) -> None:
    """Changes the datasets of the table of contents."""
    toc = latest(MapStorage(path))
    toc.schema["text"].drives = drives
    forge(path, schema=pickle.dumps(toc.schema, 2))


def with_parameters(path: Path, before: str, after: str) -> None:
    """Changes the parameters of the table of contents."""
    toc = latest(MapStorage(path))
    field = toc.schema["text"]
    assert before in field.stored_parameters
    field.stored_parameters = field.stored_parameters.replace(before, after)
    forge(path, schema=pickle.dumps(toc.schema, 2))


def rewrite(path: Path, change: Callable[[bytes], bytes]) -> None:
    """Changes the bytes of the only segment, and its checksum with them."""
    (file,) = path.glob("*.seg")
    data = change(file.read_bytes())
    file.write_bytes(data)
    with file.open("rb") as opened:
        digest = fingerprint(opened)
    with_segment(path, lambda one: vars(one).update(size=len(data), digest=digest))


def reassemble(
    path: Path,
    parts: dict[str, Callable[[bytes], bytes | None]] | None = None,
    directory: bytes | None = None,
) -> None:
    """Changes columns of the only segment, or leaves them out, or puts another directory there."""
    data, listed = packed(path, parts or {})
    assemble(path, data, pickle.dumps(listed, -1) if directory is None else directory)


def redirect(path: Path, column: str, change: Callable[[dict[str, Any]], None]) -> None:
    """Changes what the directory of the only segment says of a column."""
    data, listed = packed(path, {})
    (name,) = (name for name in listed if name.split(".")[1] == column)
    change(listed[name])
    assemble(path, data, pickle.dumps(listed, -1))


def packed(path: Path, parts: dict[str, Callable[[bytes], bytes | None]]) -> tuple[bytes, dict[str, Any]]:
    """The columns of the only segment, changed, and their directory."""
    data, listed = b"", {}
    for name, part in unpacked(path).items():
        column = name.split(".")[1]
        changed = parts[column](part) if column in parts else part
        if changed is not None:
            listed[name] = {"offset": 12 + len(data), "length": len(changed), "modified": 0.0}
            data += changed
    return data, listed


def assemble(path: Path, data: bytes, directory: bytes) -> None:
    head = struct.pack("!qi", 12 + len(data), len(directory) + len(pickle.dumps({}, -1)))
    rewrite(path, lambda _: head + data + directory + pickle.dumps({}, -1))


def unpacked(path: Path) -> dict[str, bytes]:
    """The columns of the only segment."""
    (file,) = path.glob("*.seg")
    with file.open("rb") as opened:
        parts = SegmentFile(opened, file.name)
    return {name: parts.open_file(name).get(0, parts.file_length(name)) for name in parts.list()}


def reheaded(data: bytes, **numbers: int) -> bytes:
    """A column of keypoints that claims other numbers."""
    head = np.frombuffer(data, HEADER, 1).copy()
    for name, number in numbers.items():
        head[0][name] = number
    return head.tobytes() + data[HEADER.itemsize :]


def counts_of(data: bytes) -> Any:
    """(3, maps) numbers of keypoints, of runs and of wide keypoints."""
    maps = int(np.frombuffer(data, HEADER, 1)["maps"][0])
    return np.frombuffer(data, COUNTS, 3 * maps, HEADER.itemsize).reshape(3, maps).copy()


def scrambled(data: bytes, seed: int) -> bytes:
    """A column of keypoints of the same numbers, but with random bytes for their words and cells."""
    begin = HEADER.itemsize + counts_of(data).nbytes
    return data[:begin] + np.random.default_rng(seed).bytes(len(data) - begin)


def recounted_as(data: bytes, counts: Any) -> bytes:
    """A column of keypoints with other numbers of them."""
    return data[: HEADER.itemsize] + counts.tobytes() + data[HEADER.itemsize + counts.nbytes :]


def recounted(data: bytes, row: int, change: int) -> bytes:
    """A column of keypoints in which one document has more of something, and the next one less."""
    counts = counts_of(data)
    largest = int(np.argmax(counts[row]))
    counts[row, largest] -= change
    counts[row, largest - 1] += change
    return recounted_as(data, counts)


def rerun(data: bytes, change: Callable[[Any], Any]) -> bytes:
    """A column of keypoints with other runs of words."""
    head = np.frombuffer(data, HEADER, 1)[0]
    begin = HEADER.itemsize + counts_of(data).nbytes
    runs = np.frombuffer(data, "<u2", int(head["runs"]), begin)
    changed = np.asarray(change(runs)).astype("<u2").tobytes()
    return data[:begin] + changed + data[begin + len(changed) :]
