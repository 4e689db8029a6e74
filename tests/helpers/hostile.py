"""Indexes as a stranger may send them: each attack turns a sound index into one that must be refused."""

import json
import os
import pickle
import resource
import signal
import socket
import struct
from collections.abc import Callable
from contextlib import suppress
from hashlib import blake2b
from pathlib import Path
from typing import Any

import children
import numpy as np
from states import contents, copied, maps
from whoosh.index import TOC

from m2t_text.errors import MapIndexError
from m2t_text.index.codec import MapSegment
from m2t_text.index.column import COUNTS, HEADER
from m2t_text.index.integrity.check import repair_index
from m2t_text.index.map_index import MapIndex
from m2t_text.index.storage.directory import MapStorage, fingerprint
from m2t_text.index.writing.toc import (
    DIGEST,
    FORMAT_VERSION,
    FORMER_SEAL,
    LENGTH,
    SEAL,
    contents_name,
    copy_name,
    entries_of,
    generation,
    latest,
    sealed,
)

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
def a_call_in_an_index_of_the_former_format(path: Path, canary: Path) -> None:
    data = pickle.dumps(Runs(canary)) + FORMER_SEAL
    put(path, data + blake2b(data, digest_size=DIGEST).digest())


@attack
def a_call_in_place_of_the_json(path: Path, canary: Path) -> None:
    forge(path, lambda own: pickle.dumps(Runs(canary), 0).decode())


# --- Names that lead elsewhere or command the terminal


@attack
def a_segment_in_another_folder(path: Path, canary: Path) -> None:
    with_segment(path, lambda one: vars(one).update(segid="/../../../etc/passwd"))


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
def json_of_an_exabyte(path: Path, canary: Path) -> None:
    data = table(path).read_bytes()[: -LENGTH - DIGEST] + (1 << 60).to_bytes(LENGTH)
    put(path, data + blake2b(data, digest_size=DIGEST).digest())


@attack
def a_number_of_a_million_digits(path: Path, canary: Path) -> None:
    forge(path, lambda own: own.replace('"generation": ', '"generation": ' + "1" * 1_000_000))


@attack
def millions_of_empty_containers(path: Path, canary: Path) -> None:
    forge(path, lambda own: f'{{"format": {FORMAT_VERSION}, "drives": [' + "{}," * 5_000_000 + "{}]}")


@attack
def json_that_is_no_object(path: Path, canary: Path) -> None:
    forge(path, lambda own: "[1, 2]")


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
    forge(path, lambda own: own.replace('"segments": [', f'"segments": [{json.dumps(entry_of(path))}, '))


@attack
def a_negative_size(path: Path, canary: Path) -> None:
    with_segment(path, lambda one: vars(one).update(size=-1))


@attack
def a_part_beyond_the_end_of_a_segment(path: Path, canary: Path) -> None:
    with_segment(path, lambda one: one.parts.update(text=(one.parts["text"][0], 1 << 50)))


@attack
def a_part_before_the_beginning_of_a_segment(path: Path, canary: Path) -> None:
    with_segment(path, lambda one: one.parts.update(text=(-(1 << 20), 100)))


@attack
def a_segment_that_is_shorter_than_its_parts(path: Path, canary: Path) -> None:
    rewrite(path, lambda data: data[:100])


@attack
def a_column_that_is_missing(path: Path, canary: Path) -> None:
    reassemble(path, {"record": lambda data: None})


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
def free_squares_that_are_too_small(path: Path, canary: Path) -> None:
    """Their sides are kept as words are: 3 cells."""
    reassemble(
        path, {"text": lambda data: of_squares(data, lambda part: rerun(part, lambda runs: runs % 64 + 192))}
    )


@attack
def free_squares_that_are_not_there(path: Path, canary: Path) -> None:
    reassemble(path, {"text": lambda data: of_squares(data, lambda part: reheaded(part, keypoints=1 << 40))})


@attack
def free_squares_of_other_maps(path: Path, canary: Path) -> None:
    reassemble(path, {"text": lambda data: of_squares(data, lambda part: recounted(part, KEYPOINTS, 1))})


@attack
def no_free_squares_at_all(path: Path, canary: Path) -> None:
    reassemble(path, {"text": lambda data: of_squares(data, lambda part: b"")})


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
    forge(path, lambda own: own.replace(f'"format": {FORMAT_VERSION}', '"format": 999'))


@attack
def no_seal(path: Path, canary: Path) -> None:
    table(path).write_bytes(table(path).read_bytes()[: -len(SEAL) - LENGTH - DIGEST])


# --- Tools


def table(path: Path) -> Path:
    """The latest table of contents."""
    return path / contents_name(generation(MapStorage(path)))


def put(path: Path, data: bytes) -> None:
    """Writes a table of contents, and its copy."""
    number = generation(MapStorage(path))
    for name in (contents_name(number), copy_name(number)):
        (path / name).write_bytes(data)


def forge(path: Path, change: Callable[[str], str] = str, whooshs: bytes = b"") -> None:
    """Changes the JSON of the table of contents, and what lies there for Whoosh, sealed as it should be."""
    own = json.dumps(entries_of(latest(MapStorage(path))), sort_keys=True)
    put(path, sealed(whooshs, change(own).encode()))


def with_segment(path: Path, change: Callable[[MapSegment], Any]) -> None:
    """Changes what the table of contents says of the only segment."""
    toc: TOC = latest(MapStorage(path))
    (segment,) = toc.segments
    change(segment)
    put(path, sealed(b"", json.dumps(entries_of(toc)).encode()))


def entry_of(path: Path) -> Any:
    """What the table of contents says of the only segment."""
    (entry,) = entries_of(latest(MapStorage(path)))["segments"]
    return entry


def with_drives(path: Path, drives: dict[str, tuple[int, float]]) -> None:
    """Changes the datasets of the table of contents."""
    toc = latest(MapStorage(path))
    toc.schema["text"].drives = drives
    put(path, sealed(b"", json.dumps(entries_of(toc)).encode()))


def with_parameters(path: Path, before: str, after: str) -> None:
    """Changes the parameters of the table of contents."""

    def changed(own: str) -> str:
        assert before in own
        return own.replace(before, after)

    forge(path, changed)


def rewrite(
    path: Path, change: Callable[[bytes], bytes], parts: dict[str, tuple[int, int]] | None = None
) -> None:
    """Changes the bytes of the only segment, and its checksum with them."""
    (file,) = path.glob("*.seg")
    data = change(file.read_bytes())
    file.write_bytes(data)
    with file.open("rb") as opened:
        digest = fingerprint(opened)

    def tell(one: MapSegment) -> None:
        one.size, one.digest = len(data), digest
        one.parts = one.parts if parts is None else parts

    with_segment(path, tell)


def reassemble(path: Path, changes: dict[str, Callable[[bytes], bytes | None]] | None = None) -> None:
    """Changes columns of the only segment, or leaves them out."""
    data, parts = b"", {}
    for column, part in unpacked(path).items():
        changed = (changes or {}).get(column, lambda part: part)(part)
        if changed is not None:
            parts[column] = (len(data), len(changed))
            data += changed
    rewrite(path, lambda _: data, parts)


def unpacked(path: Path) -> dict[str, bytes]:
    """The columns of the only segment."""
    (segment,) = latest(MapStorage(path)).segments
    data = (path / segment.filename).read_bytes()
    return {name: data[begin : begin + length] for name, (begin, length) in segment.parts.items()}


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
    """A column of texts of the same numbers, but with random bytes for their words, sides and cells."""
    rng, made = np.random.default_rng(seed), b""
    while data:  # keypoints, then squares
        head = np.frombuffer(data, HEADER, 1)[0]
        begin = HEADER.itemsize + counts_of(data).nbytes
        size = 2 * int(head["keypoints"] + head["runs"] + head["wide"])
        made += data[:begin] + rng.bytes(size)
        data = data[begin + size :]
    return made


def of_squares(data: bytes, change: Callable[[bytes], bytes]) -> bytes:
    """A column of texts with another part of free squares."""
    head = np.frombuffer(data, HEADER, 1)[0]
    begin = HEADER.itemsize + counts_of(data).nbytes + 2 * int(head["keypoints"] + head["runs"] + head["wide"])
    return data[:begin] + change(data[begin:])


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
