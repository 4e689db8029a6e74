"""ROS bags of both versions through the package rosbags: their topics, and their messages decoded.

Messages are decoded by the standard definitions of their types, not by those that a bag brings along, which
would be compiled and run.
"""

import math
import os
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from io import BufferedReader
from itertools import pairwise
from pathlib import Path
from typing import IO, Any

from m2t_text.errors import LogError, PartError, clean
from m2t_text.logs.lines import PROGRESS_STEP, Damage
from m2t_text.logs.unpacking import unpacked_file
from m2t_text.util.files import is_file, is_folder, opened, shown
from m2t_text.util.names import alike, bag_ending, bag_files
from m2t_text.util.types import Progress

LASER = "sensor_msgs/msg/LaserScan"
ECHOES = "sensor_msgs/msg/MultiEchoLaserScan"
POINTS = "sensor_msgs/msg/PointCloud2"
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
TRANSFORMS_TEXT = "geometry_msgs/TransformStamped[] transforms"  # the only one that rosbags lacks for ROS 1
OLDER = {"tf/msg/tfMessage": TRANSFORMS}  # the same under its name in early ROS 1
MENDED = {
    ".bag": "mend it with `rosbag reindex`, or ",
    ".mcap": "mend it with `mcap recover`, or ",
    "folder": "mend it with `ros2 bag reindex`, or ",
}
OVERLAP, PAUSE = 2.0, 60.0  # s between two parts of one recording, at the most
METADATA_LIMIT = 1 << 20  # bytes of a metadata.yaml that are looked at


class _BoundedFile(BufferedReader):
    """A file of which no more is read, and no more memory taken, than it holds, whatever it claims."""

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > 0:
            size = min(size, max(0, os.fstat(self.fileno()).st_size - self.tell()))
        return super().read(size)


class _BagPath(type(Path())):  # type: ignore[misc] # Path itself has subclasses from Python 3.12 on only
    """A path, and all below it, whose files are bounded."""

    def open(self, mode: str = "r", *arguments: Any, **named: Any) -> IO[Any]:
        if mode == "rb":
            return _BoundedFile(super().open(mode, buffering=0))
        file: IO[Any] = super().open(mode, *arguments, **named)
        return file


@dataclass(frozen=True)
class Message:
    """One message: its topic and type, its number in the bag, when it was recorded (s), and what it holds."""

    topic: str
    kind: str
    number: int
    recorded: float
    body: Any


@dataclass(frozen=True)
class Part:
    """An open file or folder of a bag: its reader, what decodes it, begin and end (s)."""

    reader: Any
    decode: Callable[[bytes, str], Any]
    begin: float
    end: float


@dataclass(frozen=True)
class Bag:
    """An open bag; ``topics`` gives the type of each topic with messages, ``parts`` are in order of time."""

    topics: dict[str, str]
    counts: dict[str, int]  # of messages, by topic
    parts: tuple[Part, ...]
    warnings: tuple[str, ...] = ()

    def messages(
        self, topics: Collection[str], damage: Damage, progress: Progress | None = None
    ) -> Iterator[Message]:
        """All messages of some topics. Those that cannot be decoded are added to ``damage``."""
        total = sum(self.counts[topic] for topic in topics)
        number = 0
        for part in self.parts:
            connections = [one for one in part.reader.connections if one.topic in topics]
            if not connections:  # the reader would give all that there is
                continue
            try:
                for connection, time, raw in _raw(part, connections):
                    number += 1
                    if connection.topic not in topics:  # of several connections with one number
                        damage.add("message that two topics claim", number)
                        continue
                    kind = self.topics[connection.topic]
                    try:
                        with _library():
                            body = part.decode(raw, kind)
                            message = Message(connection.topic, kind, number, time / 1e9, body)
                    except PartError:
                        damage.add(f"{connection.topic}, no message of its type", number)
                        continue
                    yield message
                    if progress and number % PROGRESS_STEP == 0:
                        progress(min(number, total), total)
            except PartError as error:
                damage.add(f"the bag is damaged ({error}), the rest was not read", number + 1)
        if progress:
            progress(total, total)


def _raw(part: Part, connections: list[Any]) -> Iterator[tuple[Any, int, bytes]]:
    with _library():
        messages = iter(part.reader.messages(connections))
    while True:
        with _library():
            message = next(messages, None)
        if message is None:
            return
        yield message


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """A bag, open for reading: a .bag, .db3 or .mcap file, compressed or not, or the folder of one.

    A folder without a metadata.yaml holds the parts of one recording: their names differ in numbers alone.
    Raises LogError with one line if it cannot be opened, or if the package rosbags is missing.
    """
    with ExitStack() as stack:
        files, warnings = _files(path) if is_folder(path) else ([path], [])
        parts = sorted((stack.enter_context(_part(file)) for file in files), key=lambda part: part.begin)
        _check_sequence(path, parts)
        counts: dict[str, int] = Counter()
        kinds: dict[str, str] = {}
        with _sound(path):
            for part in parts:
                for one in part.reader.connections:
                    counts[one.topic] += int(one.msgcount)
                    kinds[one.topic] = str(OLDER.get(one.msgtype, one.msgtype))
        held = {topic: kind for topic, kind in kinds.items() if counts[topic] > 0 and isinstance(topic, str)}
        yield Bag(held, counts, tuple(parts), tuple(warnings))


def _files(folder: Path) -> tuple[list[Path], list[str]]:
    """What is read of a folder: itself if it says what it holds, else all parts of one recording."""
    files = bag_files(folder)
    if is_file(folder / "metadata.yaml"):
        listed = _listed_files(folder)
        missing = [name for name in listed if not is_file(folder / name)]
        if not missing or not files:
            return [folder], []
        left = f"{len(missing)} of {len(listed)} files that its metadata.yaml names are missing: "
        return files, [f"{left}read as they lie; `ros2 bag reindex {folder.name}` mends it"]
    if not all(alike(files[0], file) for file in files):
        raise LogError(
            f"{shown(folder)} holds {len(files)} bags of different names and no metadata.yaml: name one, or "
            f"make one bag of all with `ros2 bag reindex {clean(str(folder))}`"
        )
    several = f"{len(files)} files without a metadata.yaml are read as the parts of one recording"
    return files, [several] if len(files) > 1 else []


def _check_sequence(path: Path, parts: list[Part]) -> None:
    """Raises LogError if parts do not follow each other as those of one recording."""
    for one, following in pairwise(part for part in parts if part.begin < math.inf):
        gap = following.begin - one.end
        if not -OVERLAP <= gap <= PAUSE:
            what = f"{gap:,.0f} s after each other" if gap > 0 else f"{-gap:,.0f} s at the same time"
            raise LogError(
                f"{shown(path)} holds bags that were recorded {what}, so they are no parts of one recording: "
                "name the files in it one by one"
            )


def _listed_files(folder: Path) -> list[str]:
    """The names of the files that a metadata.yaml lists; none if it cannot be read."""
    text = (folder / "metadata.yaml").read_bytes()[:METADATA_LIMIT].decode("utf-8", errors="replace")
    listed = re.search(r"relative_file_paths:\s*\n((?:\s*-[^\n]*\n?)+)", text)
    return (
        []
        if listed is None
        else [Path(one.strip(" -'\"\r")).name for one in listed[1].splitlines() if one.strip()]
    )


@contextmanager
def _part(path: Path) -> Iterator[Part]:
    """One file or folder, open."""
    try:
        from rosbags import rosbag1, rosbag2
    except ImportError as error:
        raise LogError(
            f"{shown(path)} is a ROS bag, which takes the package rosbags: pip install rosbags"
        ) from error
    with opened(path / "metadata.yaml" if is_folder(path) else path, LogError):
        pass  # a file that is broken as such is reported as any other
    with ExitStack() as stack:
        try:
            plain = path if is_folder(path) else stack.enter_context(unpacked_file(path))
        except PartError as error:
            raise LogError(clean(f"{shown(path)}: {error}")) from error
        first = bag_ending(path) == ".bag" and not is_folder(path)
        with _sound(path):
            reader: Any = stack.enter_context((rosbag1 if first else rosbag2).Reader(_BagPath(plain)))
            held = bool(reader.message_count)
            span = (reader.start_time / 1e9, reader.end_time / 1e9) if held else (math.inf, math.inf)
        yield Part(reader, decoder(first), *span)


@contextmanager
def _sound(path: Path) -> Iterator[None]:
    """What the package says of a file that is no sound bag, as an error with the way to mend it."""
    try:
        with _library():
            yield
    except PartError as error:
        mend = MENDED.get("folder" if is_folder(path) else bag_ending(path), "")
        text = f"{shown(path)} is no sound bag ({error}): {mend}record or fetch it again"
        raise LogError(clean(text)) from error


@cache
def decoder(first: bool) -> Callable[[bytes, str], Any]:
    """Decodes messages of ROS 1 or 2, given their type."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.LATEST)
    if first:
        store.register(get_types_from_msg(TRANSFORMS_TEXT, TRANSFORMS))
    return store.deserialize_ros1 if first else store.deserialize_cdr


@contextmanager
def _library() -> Iterator[None]:
    """Whatever rosbags raises inside, as one line."""
    try:
        yield
    except Exception as error:
        raise PartError(" ".join(str(error).split()) or type(error).__name__) from error
