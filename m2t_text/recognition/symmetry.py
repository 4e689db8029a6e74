"""Other poses at which one map lies on another: a place that looks the same when it is turned or shifted.

Both maps are drawn on a grid, one of them in many directions, and for every shift is counted how many of their
points meet. The best are aligned as hits are.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from m2t_text.recognition.raster import EXTENT, Raster
from m2t_text.recognition.verification import Alignment, aligned
from m2t_text.util.compiling import kernel
from m2t_text.util.geometry import compose, transform, wrap
from m2t_text.util.types import Floats
from m2t_text.util.workers import together

DIRECTIONS = 24  # directions tried; those of triangles, squares, hexagons and octagons are among them
GRID = 0.3  # m; points less than one or two cells apart meet
REFINED = 3  # poses that are aligned, those where most points meet
SAME_POSE = (1.0, np.radians(10.0))  # m and rad; nearer than both, a pose is the same one
SAME_CELLS = int(SAME_POSE[0] / GRID)
U = np.uint64


def other_poses(query: Raster, found: Raster, pose: Floats) -> list[Alignment]:
    """The query on the found map elsewhere than at the ``pose`` (3,), those first where most points meet.

    What has fewer than one point in reach has no rivals. The agreement of an alignment is the share of the
    query's points that met.
    """
    placed, fixed = (points[_in_reach(points)] for points in (transform(pose, query.points), found.points))
    if not len(placed) or not len(fixed):
        return []
    centre = placed.mean(axis=0)
    angles = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
    turns = compose(np.column_stack([np.tile(centre, (DIRECTIONS, 1)), angles]), np.append(-centre, 0.0))
    most, shifts = meetings(fixed, np.array([transform(turn, placed) for turn in turns]))
    chosen = np.argsort(-most, kind="stable")[:REFINED]
    starts = compose(np.insert(shifts[chosen], 2, 0.0, axis=1), compose(turns[chosen], pose))
    others = aligned(query, found, starts, most[chosen] / len(placed))
    return [one for one in others if _apart(one.pose, pose)]


def _in_reach(points: Floats) -> NDArray[np.bool_]:
    """(...) which points (..., 2) lie near enough to the viewpoint to be laid on anything."""
    return np.asarray((np.abs(points) < EXTENT).all(axis=-1))


def _apart(a: Floats, b: Floats) -> bool:
    return bool(np.hypot(*(a - b)[:2]) > SAME_POSE[0] or abs(wrap(a[2] - b[2])) > SAME_POSE[1])


def meetings(fixed: Floats, moved: Floats) -> tuple[NDArray[np.int64], Floats]:
    """(T,) the most occupied cells of each of T point sets (T, N, 2) that meet those of the fixed one (M, 2)
    under any shift, and (T, 2) that shift in x and in y, metres. The first set is not left where it is."""
    image, corner = _image(_cells(fixed))
    cells = _cells(moved)
    inside = _in_reach(moved)
    last = cells[inside].max(axis=0)
    back = last - cells  # a shift by so much more takes a point as far as that in the last cell
    span = back[inside].max(axis=0) + 1
    middle = last - corner  # the place of no shift

    def meeting(number: int) -> tuple[int, NDArray[np.int64]]:
        taken, met = np.zeros(span, dtype=np.bool_), np.zeros(image.shape + span, dtype=np.uint16)
        taken[tuple(back[number, inside[number]].T)] = True
        x, y = taken.nonzero()
        _add_moved(image, x, y, met)
        if number == 0:
            met[_about(middle)] = 0
        best = np.unravel_index(met.argmax(), met.shape)
        return int(met[best]), np.array(best) - middle

    most, shifts = zip(*together(meeting, range(len(moved))), strict=True)
    return np.array(most), np.array(shifts) * GRID


def _about(place: NDArray[np.int64]) -> tuple[slice, ...]:
    """The shifts that leave a pose the same, where that of none has this place."""
    return tuple(slice(max(at - SAME_CELLS, 0), max(at + SAME_CELLS + 1, 0)) for at in place.tolist())


def _cells(points: Floats) -> NDArray[np.int64]:
    return np.floor(points / GRID).astype(np.int64)


def _image(cells: NDArray[np.int64]) -> tuple[NDArray[np.uint16], NDArray[np.int64]]:
    """1 in the cells (M, 2), and in those beside them; and the cell of the image's corner."""
    corner = cells.min(axis=0) - 1
    x, y = (cells - corner).T
    image = np.zeros((x.max() + 2, y.max() + 2), dtype=np.uint16)
    for dx, dy in product((-1, 0, 1), repeat=2):
        image[x + dx, y + dy] = 1
    return image, corner


@kernel
def _add_moved(
    image: NDArray[np.uint16], x: NDArray[np.int64], y: NDArray[np.int64], met: NDArray[np.uint16]
) -> None:
    """Adds the image, moved by each of some (x, y), to ``met``."""
    for k in range(len(x)):
        for i in range(U(image.shape[0])):
            row, from_y = met[U(x[k]) + i], U(y[k])
            for j in range(U(image.shape[1])):
                row[from_y + j] += image[i, j]
