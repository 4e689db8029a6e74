"""Other poses at which one map lies on another: a place that looks the same when it is turned or shifted.

Both maps are drawn as grids, one of them in many directions, and Fourier's transform counts at once for every
shift how many of their points meet. The best are aligned as hits are.
"""

from collections.abc import Sequence
from itertools import count, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from m2t_text.recognition.raster import EXTENT, Raster
from m2t_text.recognition.verification import Alignment, aligned_from
from m2t_text.util.geometry import compose, transform, wrap
from m2t_text.util.types import Floats

DIRECTIONS = 24  # directions tried; those of triangles, squares, hexagons and octagons are among them
GRID = 0.3  # m; points less than one or two cells apart meet
REFINED = 3  # poses that are aligned, those where most points meet
SAME_POSE = (1.0, np.radians(10.0))  # m and rad; nearer than both, a pose is the same one


def other_poses(query: Raster, found: Raster, pose: Floats) -> list[Alignment]:
    """The query on the found map elsewhere than at the ``pose`` (3,), those first where most points meet.

    What has fewer than one point in reach has no rivals. The agreement of an alignment is the share of the
    query's points that met.
    """
    placed, fixed = _in_reach(transform(pose, query.points)), _in_reach(found.points)
    if not len(placed) or not len(fixed):
        return []
    centre = placed.mean(axis=0)
    angles = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
    turns = compose(np.column_stack([np.tile(centre, (DIRECTIONS, 1)), angles]), np.append(-centre, 0.0))
    met = _overlap(fixed, [_in_reach(transform(turn, placed)) for turn in turns])
    offsets = np.fft.fftfreq(met.shape[1], 1 / met.shape[1]) * GRID
    near = np.abs(offsets) <= SAME_POSE[0]
    met[0, near[:, None] & near[None, :]] = 0  # the pose itself
    best = met.reshape(DIRECTIONS, -1).argmax(axis=1)
    most = met.reshape(DIRECTIONS, -1)[np.arange(DIRECTIONS), best]
    aligned = []
    for k in np.argsort(-most, kind="stable")[:REFINED]:
        shift = offsets[list(np.unravel_index(best[k], met.shape[1:]))]
        start = compose(np.append(shift, 0.0), compose(turns[k], pose))
        aligned.append(aligned_from(query, found, start, float(most[k]) / len(placed)))
    return [one for one in aligned if _apart(one.pose, pose)]


def _in_reach(points: Floats) -> Floats:
    return points[(np.abs(points) < EXTENT).all(axis=1)]


def _apart(a: Floats, b: Floats) -> bool:
    return bool(np.hypot(*(a - b)[:2]) > SAME_POSE[0] or abs(wrap(a[2] - b[2])) > SAME_POSE[1])


def _overlap(fixed: Floats, moved: Sequence[Floats]) -> NDArray[np.float32]:
    """(T, n, n) how many occupied cells of each of T point sets meet those of the fixed one, by the shift in
    x and in y, in cells; negative shifts come last."""
    everything = np.concatenate([fixed, *moved])
    low = everything.min(axis=0)
    cells = int(np.ptp(everything, axis=0).max() / GRID) + 3
    size = _quick_size(2 * cells)
    images = np.zeros((len(moved) + 1, size, size), dtype=np.float32)
    for image, points in zip(images, [fixed, *moved], strict=True):
        x, y = ((points - low) / GRID).astype(np.int64).T + 1
        image[x, y] = 1
    x, y = images[0].nonzero()
    for dx, dy in product((-1, 0, 1), repeat=2):
        images[0, x + dx, y + dy] = 1
    transformed = np.fft.rfft2(images)
    overlaps: NDArray[Any] = np.fft.irfft2(transformed[0] * transformed[1:].conj(), s=(size, size))
    return overlaps


def _quick_size(least: int) -> int:
    """The next size that Fourier's transform is quick for: with no prime factors but 2, 3 and 5."""
    return next(size for size in count(least) if pow(30, size, size) == 0)
