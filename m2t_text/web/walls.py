"""The walls of a building, as a sample of a dataset's maps saw them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.document import Document
from m2t_text.index.map_index import MapIndex
from m2t_text.index.results import Overview
from m2t_text.util.geometry import compose, transform
from m2t_text.util.types import Floats
from m2t_text.web.packing import Bytes, pack

EVERY = 2.0  # m of travel from one map of the sample to the next
MOST = 600  # maps of a dataset in the sample, evenly chosen
CELLS = 200_000  # drawn of a dataset; where there are more, cells of twice the size are drawn
SPAN = 1 << 16  # cells from one end of a building to the other, at most
SEEN = 255  # maps that saw one cell, at most


def walls_of(index: MapIndex, overview: Overview, part: slice) -> Bytes:
    """The occupied cells of one dataset: columns ``x`` and ``y`` from the ``origin`` on, in cells of the size
    ``cell`` (metres), and ``seen``, how many maps of the sample have each."""
    chosen = overview.numbers[part][sample(overview.records["travel"][part, 0])]
    cell = index.parameters.mapping.cell
    points = [placed(document, cell) for document in index.numbered(chosen.tolist())]
    origin, cells, seen, cell = gathered(points, cell)
    columns: dict[str, NDArray[Any]] = {
        "x": cells[:, 0].astype(np.uint16),
        "y": cells[:, 1].astype(np.uint16),
        "seen": np.minimum(seen, SEEN).astype(np.uint8),
    }
    return pack({"cell": cell, "origin": origin.tolist(), "maps": len(points)}, columns)


def drawn(documents: Sequence[Document], cell: float) -> Bytes:
    """The same of maps that are not in an index, and where they begin: columns ``place_x``, ``place_y``,
    ``place_theta``, ``travel`` and ``first_scan``."""
    documents = list(documents)  # more may come meanwhile
    origin, cells, seen, side = gathered([placed(document, cell) for document in documents[::2]], cell)
    poses = np.array([document.pose for document in documents], dtype=np.float32).reshape(-1, 3)
    columns: dict[str, NDArray[Any]] = {
        "x": cells[:, 0].astype(np.uint16),
        "y": cells[:, 1].astype(np.uint16),
        "seen": np.minimum(seen, SEEN).astype(np.uint8),
        "place_x": poses[:, 0].copy(),
        "place_y": poses[:, 1].copy(),
        "place_theta": poses[:, 2].copy(),
        "travel": np.array([document.travel[0] for document in documents], dtype=np.float32),
        "first_scan": np.array([document.first_scan for document in documents], dtype=np.uint32),
    }
    return pack({"cell": side, "origin": origin.tolist(), "maps": len(documents)}, columns)


def sample(travel: Floats) -> NDArray[np.int64]:
    """Which of the maps of a dataset are drawn, given the metres of travel (M,) at which they begin."""
    steps = np.floor(travel / EVERY)
    first = np.unique(steps, return_index=True)[1] if np.ptp(travel) > 0 else np.arange(len(travel))
    if len(first) <= MOST:
        return first
    return first[np.linspace(0, len(first) - 1, MOST).astype(np.int64)]


def placed(document: Document, cell: float) -> Floats:
    """(N, 2) a map's keypoints in the frame of its dataset, metres."""
    return transform(compose(document.pose, document.viewpoint), document.text.positions() * cell)


def gathered(maps: list[Floats], cell: float) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64], float]:
    """The cells (N, 2) that hold points of any map, counted from an origin (2,) in metres; how many maps have
    points in each (N,); and the side of a cell, a multiple of ``cell`` at which they are not too many."""
    if not sum(map(len, maps)):
        return np.zeros(2), np.zeros((0, 2), dtype=np.int64), np.zeros(0, dtype=np.int64), cell
    everything = np.concatenate(maps)
    origin = np.floor(everything.min(axis=0) / cell) * cell
    span = float((everything.max(axis=0) - origin).max())
    while True:
        if span / cell < SPAN - 1:
            each = [np.unique(_numbers(points - origin, cell)) for points in maps]
            numbers, seen = np.unique(np.concatenate(each), return_counts=True)
            if len(numbers) <= CELLS:
                return origin, np.stack(np.divmod(numbers, SPAN), axis=1), seen, cell
        cell *= 2


def _numbers(points: Floats, cell: float) -> NDArray[np.int64]:
    """(N,) one number for the cell of each point."""
    cells = np.floor(points / cell + 1e-9).astype(np.int64)
    numbers: NDArray[np.int64] = cells[:, 0] * SPAN + cells[:, 1]
    return numbers
