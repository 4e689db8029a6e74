"""What is uploaded, read in a process of its own, whose time and memory are bounded.

``python -m m2t_text.web.uploads.parsing`` gets a job as a line of JSON on its standard input, and writes a JSON
document a line to its standard output. It has nothing else of the server, and ends when its standard input
does. What it reads may be anything, and nothing else is opened for it.
"""

import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from threading import Thread
from time import monotonic
from typing import Any

from m2t_text.config import PROFILES, Parameters, from_dict
from m2t_text.description.document import Document
from m2t_text.errors import M2TError, MapFileError
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.saved_maps.header import read_header
from m2t_text.sources.indexing import IndexRequest, index_sources
from m2t_text.sources.opening import LogSource, SourceOptions, open_source
from m2t_text.sources.saved_map import SavedMap
from m2t_text.util.names import is_saved_map
from m2t_text.util.types import StageProgress
from m2t_text.web.uploads.drives import described_places, image_to_json, to_json
from m2t_text.web.walls import drawn_image

MEMORY = 3 << 30  # bytes of address space beside what a process has when it begins
SECONDS = 600  # of the processor
WRITTEN = 1 << 30  # bytes of one file that it may write: unpacked bags, an index

Send = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class Job:
    """What a process is to do with a file.

    Attributes:
        path: of the file, alone in its folder but for what belongs to it.
        name: of the dataset.
        parameters: how its maps are described.
        index: folder of the index to put it into; None to describe its maps alone.
    """

    path: Path
    name: str
    parameters: Parameters
    index: Path | None = None

    def to_json(self) -> str:
        index = str(self.index) if self.index else None
        fields = {
            "path": str(self.path),
            "name": self.name,
            "parameters": asdict(self.parameters),
            "index": index,
        }
        return json.dumps(fields)

    @classmethod
    def from_json(cls, line: str) -> "Job":
        fields = json.loads(line)
        index = Path(fields["index"]) if fields["index"] else None
        return cls(Path(fields["path"]), fields["name"], from_dict(fields["parameters"]), index)


def main() -> None:
    """The whole life of the process."""
    _warm()
    line = sys.stdin.readline()
    if not line:
        return
    Thread(target=_end_with_server, daemon=True).start()
    out = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # whatever else is printed is no message

    def send(message: dict[str, Any]) -> None:
        out.write(json.dumps(message, allow_nan=False) + "\n")
        out.flush()

    with suppress(BrokenPipeError):  # nobody listens any more
        work(Job.from_json(line), send)


def _warm() -> None:
    """Loads all compiled code that a drive needs, while there is nothing else to do."""
    with suppress(M2TError):
        drive = simulate(Simulation(length=24.0, travel=6.5, beams=24))
        for _ in described_places(drive, PROFILES["default"]):
            pass


def _end_with_server() -> None:
    sys.stdin.read()
    os._exit(1)


def work(job: Job, send: Send) -> None:
    """Does a job, and sends what comes of it: progress, warnings, maps, and an error or the end."""
    _bound()
    os.chdir(job.path.parent)
    tempfile.tempdir = str(job.path.parent)
    try:
        (_add if job.index else _describe)(job, send)
        send({"end": True})
    except M2TError as error:
        send({"error": _without(str(error), job.path.parent)})
    except MemoryError:
        send({"error": f"{job.path.name} takes more than {MEMORY >> 30} GB of memory to read"})


def _bound() -> None:
    try:
        import resource  # not on every system
    except ImportError:
        return
    pages = int(Path("/proc/self/statm").read_text().split()[0]) if Path("/proc/self/statm").exists() else 0
    limit = pages * resource.getpagesize() + MEMORY
    used = int(sum(resource.getrusage(resource.RUSAGE_SELF)[:2]))
    for kind, most in (
        (resource.RLIMIT_AS, limit),
        (resource.RLIMIT_CPU, used + SECONDS),
        (resource.RLIMIT_FSIZE, WRITTEN),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(kind, (most, most))


def _without(message: str, folder: Path) -> str:
    """A message that names files as the one who uploaded them does."""
    return message.replace(f"{folder}/", "")


def _progress(send: Send) -> StageProgress:
    """Sends how far a stage has come, but not more often than anybody looks."""
    told = 0.0

    def progress(stage: str, done: int, total: int) -> None:
        nonlocal told
        if done >= total or monotonic() - told > 0.1:
            told = monotonic()
            send({"progress": [stage, int(done), int(total)]})

    return progress


def check_image(path: Path) -> Path:
    """The image of a saved map, which must lie beside its YAML file. Raises MapFileError if it does not."""
    image = read_header(path).image
    beside = path.parent / image.name
    if image != beside:
        raise MapFileError(
            f"{path.name} names the image {image.name!r} in another folder; name one that is uploaded with it"
        )
    return beside


def _describe(job: Job, send: Send) -> None:
    if is_saved_map(job.path):
        check_image(job.path)
    progress = _progress(send)
    source = open_source(job.path, SourceOptions(job.name), partial(progress, "reading"))
    send({"warnings": list(source.warnings)})
    if isinstance(source, LogSource):
        documents: Iterable[Document] = described_places(source.log, job.parameters, partial(progress, "scans"))
    else:
        if isinstance(source, SavedMap):
            send({"image": image_to_json(drawn_image(source.grid))})
        documents = source.describe(job.parameters, 1, progress).documents
    for document in documents:
        send({"map": to_json(document)})


def _add(job: Job, send: Send) -> None:
    assert job.index is not None
    request = IndexRequest([job.path], job.index, options=SourceOptions(job.name))
    progress = _progress(send)
    report = index_sources(request, lambda what, stage, done, of: progress(stage, done, of))
    for line in report.failed:
        raise M2TError(line)


if __name__ == "__main__":
    main()
