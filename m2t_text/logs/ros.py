"""ROS bags of both versions through the package rosbags: their topics, and their messages decoded.

Messages are decoded by the standard definitions of their types, not by those that a bag brings along, which
would be compiled and run.
"""

import os
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from io import BufferedReader
from pathlib import Path
from typing import IO, Any

from m2t_text.errors import LogError, PartError, clean
from m2t_text.logs.lines import PROGRESS_STEP, Damage
from m2t_text.util.files import is_folder, opened, shown
from m2t_text.util.types import Progress

LASER = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
TRANSFORMS_TEXT = "geometry_msgs/TransformStamped[] transforms"  # the only one that rosbags lacks for ROS 1
OLDER = {"tf/msg/tfMessage": TRANSFORMS}  # the same under its name in early ROS 1
MENDED = {".bag": "mend it with `rosbag reindex`, or ", ".mcap": "mend it with `mcap recover`, or "}


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
class Bag:
    """An open bag; ``topics`` gives the type of each topic that has messages."""

    topics: dict[str, str]
    _reader: Any
    _counts: dict[str, int]  # of messages, by topic
    _decode: Callable[[bytes, str], Any]

    def messages(
        self, topics: Collection[str], damage: Damage, progress: Progress | None = None
    ) -> Iterator[Message]:
        """All messages of some topics. Those that cannot be decoded are added to ``damage``."""
        connections = [one for one in self._reader.connections if one.topic in topics]
        total = sum(self._counts[topic] for topic in topics)
        number = 0
        try:
            for number, (connection, time, raw) in enumerate(self._raw(connections), start=1):
                if connection.topic not in topics:  # of several connections with one number
                    damage.add("message that two topics claim", number)
                    continue
                kind = self.topics[connection.topic]
                try:
                    with _library():
                        message = Message(connection.topic, kind, number, time / 1e9, self._decode(raw, kind))
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

    def _raw(self, connections: list[Any]) -> Iterator[tuple[Any, int, bytes]]:
        with _library():
            messages = iter(self._reader.messages(connections))
        while True:
            with _library():
                message = next(messages, None)
            if message is None:
                return
            yield message


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """A bag, open for reading: a .bag, .db3 or .mcap file, or a folder with a metadata.yaml.

    Raises LogError with one line if it cannot be opened, or if the package rosbags is missing.
    """
    try:
        from rosbags import rosbag1, rosbag2
    except ImportError as error:
        raise LogError(
            f"{shown(path)} is a ROS bag, which takes one more package: pip install 'm2t-text[ros]'"
        ) from error
    with opened(path / "metadata.yaml" if is_folder(path) else path, LogError):
        pass  # what is wrong with the file as such is told as for any other
    first = path.suffix.lower() == ".bag" and not is_folder(path)
    with ExitStack() as stack:
        try:
            with _library():
                reader: Any = stack.enter_context((rosbag1 if first else rosbag2).Reader(_BagPath(path)))
                counts: dict[str, int] = Counter()
                kinds: dict[str, str] = {}
                for one in reader.connections:
                    counts[one.topic] += int(one.msgcount)
                    kinds[one.topic] = str(OLDER.get(one.msgtype, one.msgtype))
        except PartError as error:
            mend = MENDED.get(path.suffix.lower(), "")
            text = f"{shown(path)} is no sound bag ({error}): {mend}record or fetch it again"
            raise LogError(clean(text)) from error
        held = {topic: kind for topic, kind in kinds.items() if counts[topic] > 0 and isinstance(topic, str)}
        yield Bag(held, reader, counts, _decoder(first))


@cache
def _decoder(first: bool) -> Callable[[bytes, str], Any]:
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
