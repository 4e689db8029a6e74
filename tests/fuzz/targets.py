"""What is fuzzed: all that reads what others have made. A target takes any bytes, and raises M2TError alone."""

import bz2
import gzip
import lzma
import os
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from hashlib import blake2b
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / "helpers"), str(TESTS / "clouds")]

import map_files  # noqa: E402
import numpy as np  # noqa: E402
from backports import zstd  # noqa: E402
from bags import ECHOES, LASER, LEVEL, ODOMETRY, TRANSFORMS, Messages, Sent, small_bags  # noqa: E402
from bags import POINTS as POINT_CLOUD  # noqa: E402
from states import built, contents, maps  # noqa: E402
from test_clouds import POINTS, WRITERS  # noqa: E402

from m2t_text.config import PROFILES  # noqa: E402
from m2t_text.description.text import parse  # noqa: E402
from m2t_text.errors import LogError, M2TError, PartError, clean  # noqa: E402
from m2t_text.index.integrity.check import check_index  # noqa: E402
from m2t_text.index.map_index import MapIndex  # noqa: E402
from m2t_text.index.writing.toc import DIGEST, LENGTH, SEAL  # noqa: E402
from m2t_text.logs import LogOptions  # noqa: E402
from m2t_text.logs.ros.bag import assembled  # noqa: E402
from m2t_text.logs.ros.messages import Bag, Part, decoder  # noqa: E402
from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen  # noqa: E402
from m2t_text.recognition.finding import find  # noqa: E402
from m2t_text.recognition.queries import Context, resolve  # noqa: E402
from m2t_text.sources.opening import LogSource, Source, open_source  # noqa: E402

PARAMETERS = PROFILES["default"]
TOPICS = (
    ("/scan", LASER),
    ("/echoes", ECHOES),
    ("/points", POINT_CLOUD),
    ("/odom", ODOMETRY),
    ("/tf", TRANSFORMS),
)
MESSAGES = 100  # that are decoded of one input
PART = b"\n---PART---\n"  # between a metadata.yaml and a part
STATE = {"a": 5, "b": 11}  # of the index that is searched, and damaged
MAPS = 2  # of a source that are described

Seeds = dict[str, bytes]


@dataclass(frozen=True)
class Target:
    """One reader.

    Attributes:
        seeds: sound inputs to start from, for that folder.
        run: reads one input, in a folder that it may litter.
    """

    seeds: Callable[[Path], Seeds]
    run: Callable[[bytes, Path], None]


def tried(target: Target, content: bytes, folder: Path) -> str | None:
    """The one line that refuses the content, or None if it was read. Anything else raises."""
    try:
        target.run(content, folder)
    except M2TError as error:
        assert str(error).isprintable(), f"not printable: {str(error)!r}"
        return str(error)
    return None


# --- Sources


def source_read(content: bytes, folder: Path, ending: str) -> None:
    path = folder / f"fuzzed{ending}"
    path.write_bytes(content)
    described(open_source(path))


def described(source: Source) -> None:
    """Describes the first maps of a source as `index` does."""
    assert all(warning.isprintable() for warning in source.warnings)
    documents = source.describe(PARAMETERS, 1, lambda stage, done, of: None).documents
    for document, _ in zip(documents, range(MAPS), strict=False):
        assert str(parse(str(document.text))) == str(document.text)


def logs(folder: Path) -> Seeds:
    """A drive that is just long enough for a map, with few beams and without a way back."""
    path = folder / "drive.log"
    write_carmen(simulate(Simulation(length=24.0, travel=6.0, beams=12)), path)
    drive = path.read_bytes()
    head = b"PARAM robot_frontlaser_offset 0.1\nPARAM robot_front_laser_max 20\n"
    poses = b"0 0 0 0.1 0 0 0 0 0 0 0 1"
    laser = b"ROBOTLASER1 0 -1.57 3.14 0.785 30 0.1 0 5 1 2 3 4 5 0 " + poses + b" host 1\n"
    raw = b"RAWLASER1 0 -1.57 6.3 0.785 4 0.1 0 9 4 4 4 4 4 4 4 nan -1 0 %d h 1\nODOM %d 0 0 0 0 0 %d h 1\n"
    old = b"FLASER 3 1,5 2,5 4,0 %d 0 0\nRLASER 3 1 2 1.#QNAN %d 0 0 %d 0 0 7\nODOM %d 0 0\n"
    return {
        "drive": drive,
        "other": head + laser * 2 + b"ODOM 1 0 0 0 0 0 2 host 2\n",
        "raw": b"".join(raw % (k, k, k) for k in range(12)),
        "old": b"".join(old % (k, k, k, 9 * k) for k in range(12)),
    }


def gzipped(folder: Path) -> Seeds:
    return {name: gzip.compress(content, mtime=0) for name, content in logs(folder).items()}


def packed(folder: Path) -> Seeds:
    """One log in all kinds of compression, which the first bytes tell."""
    drive = logs(folder)["drive"]
    return {"bzip2": bz2.compress(drive), "xz": lzma.compress(drive), "zstd": zstd.compress(drive)}


def part_read(content: bytes, folder: Path) -> None:
    """A part of a recording, beside a sound one and a metadata.yaml that names others; the content is both."""
    recording = folder / "recording"
    if not recording.exists():
        recording.mkdir()
        ros = Messages(2)
        static = ros.transforms(0.0, ("base_link", "laser", (0.1, 0, 0.2), LEVEL))
        with TemporaryDirectory(dir=folder) as made:
            (file,) = ros.write(Path(made) / "a.mcap", [Sent(0.0, "/tf_static", static)]).glob("*.mcap")
            (recording / "part_0.mcap").write_bytes(file.read_bytes())
    metadata, _, part = content.partition(PART)
    (recording / "metadata.yaml").write_bytes(metadata or b" ")
    (recording / "part_1.mcap").write_bytes(part or b" ")
    described(open_source(recording))


def parts(folder: Path) -> Seeds:
    listed = b"rosbag2_bagfile_information:\n  relative_file_paths:\n    - part_0.mcap\n    - gone.mcap\n"
    return {"parts": listed + PART + bags(folder, ".mcap")["bag"]}


def messages_read(content: bytes, folder: Path) -> None:
    """Messages of a robot as they lie in a bag, each after its topic's number and its length."""
    sent, at = [], 0
    while at + 5 <= len(content) and len(sent) < MESSAGES:
        length = int.from_bytes(content[at + 1 : at + 5], "little") % (1 << 16)
        sent.append((TOPICS[content[at] % len(TOPICS)], float(len(sent)), content[at + 5 : at + 5 + length]))
        at += 5 + length
    topics = {topic: kind for topic, kind in TOPICS if any(one[0][0] == topic for one in sent)}
    connections = {topic: SimpleNamespace(topic=topic) for topic in topics}
    raw = [(connections[topic], round(time * 1e9), data) for (topic, _), time, data in sent]
    reader = SimpleNamespace(
        connections=list(connections.values()),
        messages=lambda chosen: iter([one for one in raw if one[0] in chosen]),
    )
    bag = Bag(topics, Counter(one[0].topic for one in raw), (Part(reader, decoder(False), 0.0, 1.0),))
    problem = ""
    for scan in ("/scan", "/echoes", "/points", "/scan /points"):
        try:
            log = assembled("fuzzed", bag, LogOptions(scan=tuple(scan.split())), None)
        except PartError as error:
            problem = str(error)
            continue
        described(LogSource(log))
        return
    raise LogError(clean(problem))


def messages(folder: Path) -> Seeds:
    """A drive with a laser scan, echoes and a cloud a second, whose frames tf tells."""
    ros, numbers = Messages(2), {topic: number for number, (topic, _) in enumerate(TOPICS)}
    content = b""
    for k in range(10):
        time, angles = 1.0 + k, np.linspace(-3, 3, 30)
        points = np.column_stack([3 * np.cos(angles), 3 * np.sin(angles), np.linspace(0, 1, 30)])
        told = {
            "/tf": ros.transforms(
                time, ("odom", "base", (0.8 * k, 0, 0), LEVEL), ("base", "laser", (0.1, 0, 0.2), LEVEL)
            ),
            "/odom": ros.odometry(time, (0.8 * k, 0, 0), "base"),
            "/scan": ros.scan(time, [1.0, 2.0, np.inf, 3.0], (-1.0, 0.5)),
            "/echoes": ros.echoes(time, [[1.0, 2.0], [], [2.5], [3.0]], (-1.0, 0.5)),
            "/points": ros.points(time, points),
        }
        for topic, message in told.items():
            data = bytes(ros.store.serialize_cdr(message, dict(TOPICS)[topic]))
            content += bytes([numbers[topic]]) + len(data).to_bytes(4, "little") + data
    return {"drive": content}


def bags(folder: Path, ending: str) -> Seeds:
    with TemporaryDirectory(dir=folder) as made:
        return {"bag": small_bags(Path(made))[ending]}


def clouds(folder: Path, ending: str) -> Seeds:
    return {name: write(POINTS) for name, write in WRITERS.items() if name.endswith(ending)}


def header_read(content: bytes, folder: Path) -> None:
    """The YAML file of a saved map, beside a sound image."""
    source = map_files.read(content, map_files.drawn("PPM", "L"), folder)
    if source is not None:
        described(source)


def image_read(content: bytes, folder: Path) -> None:
    """The image of a saved map, beside a sound YAML file. A PNG gets checksums that fit."""
    image = map_files.sealed(content) if content.startswith(b"\x89PNG") else content
    source = map_files.read(map_files.HEADER.encode(), image, folder)
    if source is not None:
        described(source)


# --- Texts, and what is typed


@cache
def searched(folder: Path) -> MapIndex:
    """A small index beside the folder of the inputs, made once; its own files stay as they are.

    It is pinned: that nobody commits to it need not be looked up for every input.
    """
    return built(folder.with_name("searched"), STATE).pinned()


def typed(content: bytes) -> str:
    """As the shell hands bytes over, without the zeros that it cannot."""
    return os.fsdecode(content.replace(b"\0", b""))


def text_found(content: bytes, folder: Path) -> None:
    """A text from a file, looked up with verification."""
    path = folder / "fuzzed.txt"
    path.write_bytes(content)
    index = searched(folder)
    query = resolve(str(path), Context(index.parameters, index))
    assert str(parse(str(query.text))) == str(query.text)
    find(index, query)


def filtered(content: bytes, folder: Path) -> None:
    """A filter in the query language, of a search."""
    index = searched(folder)
    index.search(maps(5, "a")[-1].text, filter=typed(content))


def named(content: bytes, folder: Path) -> None:
    """Whatever is typed for a query, in a folder with a log and a text."""
    index = searched(folder)
    for name, seed in {**logs_here(folder), "a.txt": b"x0_y0_a1"}.items():
        if not (folder / name).exists():
            (folder / name).write_bytes(seed)
    os.chdir(folder)
    find(index, resolve(typed(content), Context(index.parameters, index)))


@cache
def logs_here(folder: Path) -> Seeds:
    return {"drive.log": logs(folder)["drive"]}


def texts(folder: Path) -> Seeds:
    free = b"x0_y-3_a5 x7_y7_a5 x-40_y2_f12 x8_y-4_f4"
    return {"map": str(maps(5, "a")[-1].text).encode(), "broken": b"x0_y-3_a5 x1_y1_a1024", "free": free}


def filters(folder: Path) -> Seeds:
    strings = (
        "dataset:a AND travel:[10 TO 20]",
        "NOT (dataset:b OR map_id:a/00*)",
        "x0_y0_a5~^2 OR travel:[3 TO]",
        "x1*_a5 OR [x1 TO x2] x0_y0_a5~3",
        "x0_y0_a5^2 'a b' travel:>3",
    )
    return {str(number): string.encode() for number, string in enumerate(strings)}


def names(folder: Path) -> Seeds:
    strings = "a/000001", "b/000009", "drive.log@0.5", "drive.log#3", "a.txt", "drive.log", "nothing.pcd"
    return {str(number): string.encode() for number, string in enumerate(strings)}


# --- Indexes


def files(folder: Path) -> list[Path]:
    return [file for file in sorted(searched(folder).path.iterdir()) if file.stat().st_size]


def index_files(folder: Path) -> Seeds:
    """The number of a file of the index, and what it holds."""
    return {f.name: bytes([number]) + f.read_bytes() for number, f in enumerate(files(folder))}


def index_read(content: bytes, folder: Path) -> None:
    """Other contents in one file of an index: everything is read, looked up and checked.

    A table of contents gets a seal that fits, or nothing behind the seal would ever be read.
    """
    path = searched(folder).path
    all_files = files(folder)
    file = all_files[(content[0] if content else 0) % len(all_files)]
    before, damaged = file.read_bytes(), content[1:]
    if SEAL in damaged:
        end = damaged.rindex(SEAL)
        begin = max(damaged.rfind(b'{"drives"', 0, end), 0)
        sealed = damaged[:end] + SEAL + (end - begin).to_bytes(LENGTH)
        damaged = sealed + blake2b(sealed, digest_size=DIGEST).digest()
    file.write_bytes(damaged or b"\0")
    try:
        with suppress(M2TError):
            check_index(path)
        index = MapIndex.open(path)
        index.search(maps(3, "a")[0].text, top=0)
        index.search(maps(3, "a")[0].text, filter="dataset:a", method="bow")
        index.info()
        contents(index)
    finally:
        file.write_bytes(before)


TARGETS = {
    "carmen": Target(logs, partial(source_read, ending=".log")),
    "carmen-gzip": Target(gzipped, partial(source_read, ending=".log.gz")),
    "carmen-packed": Target(packed, partial(source_read, ending=".log.zst")),
    "messages": Target(messages, messages_read),
    "parts": Target(parts, part_read),
    **{
        name: Target(partial(bags, ending=f".{name}"), partial(source_read, ending=f".{name}"))
        for name in ("bag", "db3", "mcap")
    },
    **{
        name: Target(partial(clouds, ending=f".{name}"), partial(source_read, ending=f".{name}"))
        for name in ("pcd", "ply", "npy", "xyz", "pts", "csv")
    },
    "yaml": Target(map_files.headers, header_read),
    **{
        name: Target(partial(map_files.images, format=format), image_read)
        for name, format in (("pgm", "PPM"), ("png", "PNG"), ("bmp", "BMP"), ("jpeg", "JPEG"))
    },
    "text": Target(texts, text_found),
    "filter": Target(filters, filtered),
    "name": Target(names, named),
    "index": Target(index_files, index_read),
}
