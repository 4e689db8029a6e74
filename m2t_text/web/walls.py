"""Walls and floor of a building: as a sample of a dataset's maps saw them, or from a saved map's image."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.document import Document
from m2t_text.index.map_index import MapIndex
from m2t_text.index.results import Overview
from m2t_text.saved_maps.grid import FREE, OCCUPIED, Grid
from m2t_text.util.geometry import compose, transform
from m2t_text.util.types import Floats
from m2t_text.web.packing import Bytes, pack

SAMPLE_SPACING = 2.0  # m of travel from one map of the sample to the next
MAX_SAMPLE = 600  # maps of a dataset in the sample, evenly chosen
MAX_CELLS = 200_000  # drawn of a dataset; where there are more, cells of twice the size are drawn
MAX_SPAN = 1 << 16  # cells from one end of a building to the other, at most
MAX_SEEN = 255  # maps that saw one cell, at most
FLOOR_FACTOR = 2  # cells; the floor is drawn in coarser ones

Columns = dict[str, NDArray[Any]]
Drawn = tuple[dict[str, Any], Columns]  # a header, and what it describes


def walls_of(index: MapIndex, overview: Overview, part: slice) -> Bytes:
    """What one dataset saw; see `drawn`."""
    chosen = overview.numbers[part][sample(overview.records["travel"][part, 0])]
    header, columns = drawn(list(index.numbered(chosen.tolist())), index.parameters.mapping.cell)
    return pack(header, columns)


def walls_of_image(grid: Grid) -> Bytes:
    """The cells of a saved map, in its frame; see `drawn`."""
    return pack(*drawn_image(grid))


def walls_and_places(documents: Sequence[Document], cell: float, image: Drawn | None = None) -> Bytes:
    """What maps that are not in an index saw, and where they begin: columns ``place_x``, ``place_y``,
    ``place_theta``, ``travel`` and ``first_scan``. A saved map's image is shown instead of what they saw."""
    header, seen = image or drawn(documents[::2], cell)
    columns = dict(seen)
    poses = np.array([document.pose for document in documents], dtype=np.float32).reshape(-1, 3)
    columns |= {
        "place_x": poses[:, 0].copy(),
        "place_y": poses[:, 1].copy(),
        "place_theta": poses[:, 2].copy(),
        "travel": np.array([document.travel[0] for document in documents], dtype=np.float32),
        "first_scan": np.array([document.first_scan for document in documents], dtype=np.uint32),
    }
    return pack(header | {"maps": len(documents)}, columns)


def drawn(documents: Sequence[Document], cell: float) -> Drawn:
    """Occupied cells and free ones, counted from an ``origin`` (metres, in the frame of the dataset).

    Columns are ``x``, ``y`` and ``seen``, how many maps have each occupied cell, which is of the size ``cell``
    (metres); and ``floor_x`` and ``floor_y`` of free cells of the size ``floor_cell``.
    """
    walls = [placed(document, document.text.positions() * cell) for document in documents]
    floors = [placed(document, _floor(document) * cell) for document in documents]
    return _in_cells(walls, floors, cell)


def drawn_image(grid: Grid) -> Drawn:
    """The same of the cells of a saved map. All its walls are as sure as walls can be."""
    header, columns = _in_cells([grid.centres(OCCUPIED)], [grid.centres(FREE)], grid.resolution)
    columns["seen"][:] = MAX_SEEN
    return header, columns


def _in_cells(walls: Sequence[Floats], floors: Sequence[Floats], cell: float) -> Drawn:
    """From points (N, 2) of each map on walls and floors, metres in the frame of the dataset."""
    points = np.concatenate([np.zeros((0, 2)), *walls, *floors])
    origin = np.floor(points.min(axis=0) / cell) * cell if len(points) else np.zeros(2)
    cells, seen, side = gathered([one - origin for one in walls], cell)
    free, _, free_side = gathered([one - origin for one in floors], FLOOR_FACTOR * cell)
    header = {"cell": side, "floor_cell": free_side, "origin": origin.tolist(), "maps": len(walls)}
    return header, {
        "x": cells[:, 0].astype(np.uint16),
        "y": cells[:, 1].astype(np.uint16),
        "seen": np.minimum(seen, MAX_SEEN).astype(np.uint8),
        "floor_x": free[:, 0].astype(np.uint16),
        "floor_y": free[:, 1].astype(np.uint16),
    }


def sample(travel: Floats) -> NDArray[np.int64]:
    """Which of the maps of a dataset are drawn, given the metres of travel (M,) at which they begin."""
    steps = np.floor(travel / SAMPLE_SPACING)
    first = np.unique(steps, return_index=True)[1] if np.ptp(travel) > 0 else np.arange(len(travel))
    if len(first) <= MAX_SAMPLE:
        return first
    return first[np.linspace(0, len(first) - 1, MAX_SAMPLE).astype(np.int64)]


def placed(document: Document, points: Floats) -> Floats:
    """Points (N, 2) of a map, metres in the frame of its viewpoint, in the frame of its dataset."""
    return transform(compose(document.pose, document.viewpoint), points)


def _floor(document: Document) -> Floats:
    """(N, 2) middles of free cells of a map, every second in x and in y, in units of cells."""
    grid = document.text.free.grid
    cells = np.argwhere(grid.cells[::FLOOR_FACTOR, ::FLOOR_FACTOR]) * FLOOR_FACTOR
    return cells + np.array([grid.x + 0.5, grid.y + 0.5])


def gathered(maps: Sequence[Floats], cell: float) -> tuple[NDArray[np.int64], NDArray[np.int64], float]:
    """The cells (N, 2) that hold points of any map, none of them below 0; how many maps have points in each
    (N,); and the side of a cell, a multiple of ``cell`` at which they are not too many."""
    span = max((float(points.max()) for points in maps if len(points)), default=0.0)
    while True:
        if span / cell < MAX_SPAN - 1:
            each = [np.unique(_numbers(points, cell)) for points in maps]
            everything = np.concatenate([np.zeros(0, dtype=np.int64), *each])
            numbers, seen = np.unique(everything, return_counts=True)
            if len(numbers) <= MAX_CELLS:
                return np.stack(np.divmod(numbers, MAX_SPAN), axis=1), seen, cell
        cell *= 2


def _numbers(points: Floats, cell: float) -> NDArray[np.int64]:
    """(N,) one number for the cell of each point."""
    cells = np.floor(points / cell + 1e-9).astype(np.int64)
    numbers: NDArray[np.int64] = cells[:, 0] * MAX_SPAN + cells[:, 1]
    return numbers
