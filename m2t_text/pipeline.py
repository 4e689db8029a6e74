"""From a log to documents: the paper's method in one place (IV-A, IV-B, IV-C)."""

from collections.abc import Callable, Iterable, Iterator, Sized
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from m2t_text.config import DescriptionParameters, Parameters
from m2t_text.description.document import Document
from m2t_text.description.free_cells import FreeSpace, free_squares
from m2t_text.description.free_squares import NO_SQUARES
from m2t_text.description.polestar import polestar_words
from m2t_text.description.text import Text
from m2t_text.description.viewpoint import plan_viewpoint
from m2t_text.logs.log import Log
from m2t_text.mapping.local_map import LocalMap, Survey, local_maps, run_starts
from m2t_text.mapping.parts import Matching, Part, parts_of
from m2t_text.mapping.single_run import BEFORE, local_map_at
from m2t_text.mapping.trajectory import survey, travel_of
from m2t_text.util.geometry import inverse, transform
from m2t_text.util.types import StageProgress
from m2t_text.util.workers import mapped

Chunk = TypeVar("Chunk", bound=Sized)


def describe(local_map: LocalMap, dataset: str, parameters: Parameters) -> Document:
    """A local map as a document.

    The occupied cells are cut anew along the walls, in the frame of the planned viewpoint: each is one
    keypoint, its pose word is its cell, its appearance word what lies around it.
    """
    chosen = parameters.description
    # Viewpoint planning (IV-B)
    viewpoint, centre = plan_viewpoint(local_map.points, local_map.trajectory, chosen.viewpoint == "trajectory")
    # Holistic view descriptor (IV-C)
    free = local_map.free.seen_from(viewpoint) if local_map.free is not None and chosen.free_space else None
    text = view_text(transform(inverse(viewpoint), local_map.points), chosen, parameters.mapping.cell, free)
    return Document(
        dataset=dataset,
        first_scan=local_map.first_scan,
        last_scan=local_map.last_scan,
        travel=local_map.travel,
        pose=local_map.pose,
        viewpoint=viewpoint,
        centre_of_gravity=centre,
        points=len(local_map.points),
        text=text,
    )


def view_text(
    points: NDArray[np.float64], parameters: DescriptionParameters, cell: float, free: FreeSpace | None = None
) -> Text:
    """The text of points (N, 2), and of what is free, both given in the frame of the viewpoint.

    It has one token for each occupied cell, and one for each free square.
    """
    cells = _cells_of(points, cell)
    middles = np.asarray((cells + 0.5) * cell, dtype=np.float64)
    words = polestar_words(middles, np.array(parameters.radii))
    squares = NO_SQUARES if free is None else free_squares(free, cells, cell)
    return replace(Text.of(cells[:, 0], cells[:, 1], words), free=squares)


def _cells_of(points: NDArray[np.float64], cell: float) -> NDArray[np.int64]:
    """(M, 2) the different cells in which the points (N, 2) lie, by (x, y)."""
    x, y = np.floor(points.T / cell).astype(np.int64)
    order = np.lexsort((y, x))
    x, y = x[order], y[order]
    first = np.ones(len(x), dtype=np.bool_)
    first[1:] = (x[1:] != x[:-1]) | (y[1:] != y[:-1])
    return np.column_stack([x[first], y[first]])


def describe_log(
    log: Log, parameters: Parameters, jobs: int = 1, progress: StageProgress | None = None
) -> Iterator[Document]:
    """The documents of all local maps of a log, in the order of their first scans; see `describe_survey`.

    Examples:
        >>> import m2t_text as m2t
        >>> log = m2t.read_log("drive.log")
        >>> documents = list(m2t.describe_log(log, m2t.PROFILES["default"]))
        >>> documents[0].map_id, len(documents[0].text) == documents[0].text.wx.size
        ('drive/000000', True)
    """
    tell = progress or _silent
    matching = Matching(log, parameters.mapping, progress=partial(tell, "scans"))
    yield from describe_matching(matching, log.name, parameters, jobs, tell)


def describe_matching(
    matching: Matching,
    dataset: str,
    parameters: Parameters,
    jobs: int = 1,
    progress: StageProgress | None = None,
) -> Iterator[Document]:
    """The documents of all local maps of a log, described while later scans are matched (IV-A).

    All scans are matched by the time that the first document is given.
    """
    return describe_all(partial(_cut, parameters), matching.parts(), dataset, parameters, jobs, progress)


def describe_survey(
    whole: Survey,
    dataset: str,
    parameters: Parameters,
    jobs: int = 1,
    progress: StageProgress | None = None,
    spacing: float = 0.0,
) -> Iterator[Document]:
    """The documents of all local maps of a survey, in the order of their first scans.

    The same for any number of ``jobs`` (processes). ``progress`` is called with (stage, done, total). Maps that
    begin less than ``spacing`` metres of travel after the one before are left out.
    """
    run_length = parameters.mapping.run_length
    parts = parts_of(whole, run_starts(whole, run_length, spacing), run_length)
    return describe_all(partial(_cut, parameters), parts, dataset, parameters, jobs, progress)


def _cut(parameters: Parameters, part: Part) -> Iterator[LocalMap]:
    return part.local_maps(parameters.mapping)


def describe_all(
    maps: Callable[[Chunk], Iterable[LocalMap]],
    chunks: Iterable[Chunk],
    dataset: str,
    parameters: Parameters,
    jobs: int = 1,
    progress: StageProgress | None = None,
) -> Iterator[Document]:
    """The documents of all local maps that ``maps`` makes of each chunk, as many as its length, in their order.

    The same for any number of ``jobs`` (processes), to which both go. ``progress`` is called with (stage, done,
    total).
    """
    tell, done, total = progress or _silent, 0, 0

    def counted() -> Iterator[Chunk]:
        nonlocal total
        for chunk in chunks:
            total += len(chunk)
            yield chunk

    for documents in mapped(partial(_describer, maps, dataset, parameters), counted(), jobs):
        yield from documents
        done += len(documents)
        tell("maps", done, total)


def describe_at(log: Log, scan: int, parameters: Parameters) -> Document:
    """The document of the local map that begins at one scan of a log; only the scans around it are matched.

    The text is nearly that of `describe_log`. Travel and pose begin where wheel odometry puts the scan.

    Examples:
        >>> import m2t_text as m2t
        >>> document = m2t.describe_at(m2t.read_log("drive.log"), 40, m2t.PROFILES["default"])
        >>> document.map_id, document.text.wx.dtype, document.viewpoint.shape
        ('drive/000040', dtype('int16'), (3,))
    """
    return describe(local_map_at(log, scan, parameters.mapping), log.name, parameters)


def describe_before(
    log: Log, scan: int, distances: list[float], parameters: Parameters
) -> tuple[list[Document], Document]:
    """The documents of the local maps that begin some ``distances`` of travel before a scan, and its own.

    Those that the drive does not have are left out. Only that part of the log is matched; poses and travel are
    those of that part.
    """
    way = travel_of(log)
    first = max((int(cut) for cut in log.cuts if cut <= scan), default=0)
    begin = max(int(np.searchsorted(way, way[scan] - max(distances, default=0.0) - BEFORE)), first)
    end = int(np.searchsorted(way, way[scan] + 2 * parameters.mapping.run_length)) + 1
    window = replace(log, scans=log.scans[begin:end], ground_truth=None)
    whole = survey(window, parameters.mapping)
    here = scan - begin
    wanted = [whole.way[here] - distance for distance in distances]
    starts = [int(np.searchsorted(whole.way, at, side="right")) - 1 for at in wanted if at >= 0.0]
    chosen = np.array([*dict.fromkeys(start for start in starts if start != here), here])
    *before, own = [
        describe(one, log.name, parameters) for one in local_maps(whole, parameters.mapping, chosen)
    ]
    return before, own


def _silent(stage: str, done: int, of: int) -> None:
    """StageProgress that nobody watches."""


def _describer(
    maps: Callable[[Chunk], Iterable[LocalMap]], dataset: str, parameters: Parameters
) -> Callable[[Chunk], list[Document]]:
    """What describes a chunk."""
    return lambda chunk: [describe(one, dataset, parameters) for one in maps(chunk)]
