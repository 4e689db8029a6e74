"""What is uploaded, read in a process of its own, whose time and memory are bounded.

It has nothing of the server but a pipe, into which it writes one JSON document a message. What it reads may be
anything, and nothing else is opened for it.
"""

import json
import os
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.description.text import parse
from m2t_text.errors import M2TError, MapFileError
from m2t_text.logs.log import Log
from m2t_text.mapping.free_space import Beams
from m2t_text.mapping.local_map import Survey, local_maps, run_starts
from m2t_text.mapping.trajectory import hits, refined_poses
from m2t_text.pipeline import describe
from m2t_text.saved_maps.header import read_header
from m2t_text.sources.indexing import Request, index_sources
from m2t_text.sources.opening import LogSource, SourceOptions, open_source
from m2t_text.util.names import SAVED_MAPS
from m2t_text.util.workers import follow_parent

MEMORY = 3 << 30  # bytes of address space beside what a process has when it begins
SECONDS = 600  # of the processor
WRITTEN = 1 << 30  # bytes of one file that it may write: unpacked bags, an index
SPACING = 1.0  # m of travel from one place of a drive to the next
PATIENCE = 0.4  # s from one look at how far a drive has come to the next
NUMBERS = ("travel", "pose", "viewpoint", "centre_of_gravity")


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


class Sender:
    """Writes messages into the pipe, and progress not more often than anybody looks."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._told = 0.0

    def send(self, **message: Any) -> None:
        self._pipe.send_bytes(json.dumps(message, allow_nan=False).encode())

    def progress(self, stage: str, done: int, total: int) -> None:
        if done >= total or monotonic() - self._told > 0.1:
            self._told = monotonic()
            self.send(progress=[stage, int(done), int(total)])


def work(job: Job, pipe: Connection) -> None:
    """The whole life of the process."""
    follow_parent()
    _bound()
    os.chdir(job.path.parent)
    tempfile.tempdir = str(job.path.parent)
    sender = Sender(pipe)
    try:
        (_add if job.index else _describe)(job, sender)
        sender.send(end=True)
    except M2TError as error:
        sender.send(error=_without(str(error), job.path.parent))
    except MemoryError:
        sender.send(error=f"{job.path.name} takes more than {MEMORY >> 30} GB of memory to read")
    except (BrokenPipeError, ConnectionError):
        pass  # nobody listens any more


def _bound() -> None:
    try:
        import resource  # not on every system
    except ImportError:
        return
    pages = int(Path("/proc/self/statm").read_text().split()[0]) if Path("/proc/self/statm").exists() else 0
    limit = pages * resource.getpagesize() + MEMORY
    for kind, most in (
        (resource.RLIMIT_AS, limit),
        (resource.RLIMIT_CPU, SECONDS),
        (resource.RLIMIT_FSIZE, WRITTEN),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(kind, (most, most))


def _without(message: str, folder: Path) -> str:
    """A message that names files as the one who uploaded them does."""
    return message.replace(f"{folder}/", "")


def check_image(path: Path) -> Path:
    """The image of a saved map, which must lie beside its YAML file. Raises MapFileError if it does not."""
    image = read_header(path).image
    beside = path.parent / image.name
    if image != beside:
        raise MapFileError(
            f"{path.name} names the image {image.name!r} in another folder; name one that is uploaded with it"
        )
    return beside


def _describe(job: Job, sender: Sender) -> None:
    if job.path.suffix.lower() in SAVED_MAPS:
        check_image(job.path)
    source = open_source(
        job.path, SourceOptions(job.name), lambda done, of: sender.progress("reading", done, of)
    )
    sender.send(warnings=list(source.warnings))
    if isinstance(source, LogSource):
        documents: Iterable[Document] = places_of(source.log, job.parameters, sender)
    else:
        documents = source.describe(job.parameters, 1, sender.progress).documents
    for document in documents:
        sender.send(map=to_json(document))


def _add(job: Job, sender: Sender) -> None:
    assert job.index is not None
    options = SourceOptions(job.name)
    report = index_sources(
        Request([job.path], job.index, options=options),
        lambda what, stage, done, of: sender.progress(stage, done, of),
    )
    for line in report.failed:
        raise M2TError(line)


def places_of(log: Log, parameters: Parameters, sender: Sender | None = None) -> Iterator[Document]:
    """The places of a drive, SPACING apart, each as soon as the scans of its map are matched.

    They are those of `describe_survey`: what is known of a run does not change when the drive goes on.
    """
    mapping = parameters.mapping
    points, starts = hits(log, mapping.range_limit)
    beams = Beams.of(log, mapping.range_limit)
    poses: list[Any] = []
    last, looked, first = -1, monotonic(), True
    for pose in refined_poses(log):
        poses.append(pose)
        done = len(poses)
        if sender:
            sender.progress("scans", done, len(log.scans))
        if done < len(log.scans) and monotonic() - looked < PATIENCE:
            continue
        cuts = log.cuts[log.cuts < done]
        survey = Survey(points, starts[: done + 1], np.array(poses), cuts, beams)
        begun = run_starts(survey, mapping.run_length, SPACING)
        for local_map in local_maps(survey, mapping, begun[begun > last]):
            yield describe(local_map, log.name, parameters)
            last, first = local_map.first_scan, False
        looked = monotonic()
    if first:
        least = f"the {mapping.run_length:g} m of one map"
        raise M2TError(f"{log.name}: the robot travels less than {least}; record a longer log")


def to_json(document: Document) -> dict[str, Any]:
    """A document as it goes through the pipe."""
    return {
        "dataset": document.dataset,
        "first_scan": document.first_scan,
        "last_scan": document.last_scan,
        "points": document.points,
        "text": str(document.text),
        **{name: getattr(document, name).tolist() for name in NUMBERS},
    }


def from_message(message: dict[str, Any]) -> Document:
    """The document that `to_json` wrote."""
    arrays = {name: np.array(message[name], dtype=float) for name in NUMBERS}
    return Document(
        dataset=str(message["dataset"]),
        first_scan=int(message["first_scan"]),
        last_scan=int(message["last_scan"]),
        points=int(message["points"]),
        text=parse(message["text"]),
        **arrays,
    )
