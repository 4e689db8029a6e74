"""How well the relative places of key scans are known: by the surest way of constraints between them."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from m2t_text.slam.key_scans import KeyScans
from m2t_text.slam.optimisation import Constraints
from m2t_text.util.types import Floats

WEAK = np.diag([1e-2, 1e-2, 1e-1])  # information that is taken for granted, as a matrix may be singular
LEAST = 1e-8  # m²; zero would be no edge
CHUNK = 512  # rows of distances at once


def step_variances(keys: KeyScans, steps: Constraints) -> Floats:
    """(K - 1,) m²: how uncertain the way to the next key scan is where all its constraints are loosest."""
    information = np.tile(WEAK, (max(len(keys) - 1, 0), 1, 1))
    consecutive = steps.pairs[:, 1] == steps.pairs[:, 0] + 1
    np.add.at(information, steps.pairs[consecutive, 0], steps.information[consecutive])
    return _loosest(information)


def reached(keys: KeyScans, steps: Floats, known: Constraints, limit: float) -> Iterator[NDArray[np.bool_]]:
    """For each key scan, which ones (K,) have a place known to ``limit`` metres (one standard deviation).

    Args:
        steps: (K - 1,) m², as `step_variances` has them.
        known: constraints that are shorter ways, as far as they hold a place in all directions.
    """
    count = len(keys)
    same = np.flatnonzero(np.diff(keys.drives) == 0)
    a = np.concatenate([same, known.pairs[:, 0]])
    b = np.concatenate([same + 1, known.pairs[:, 1]])
    variances = np.concatenate([steps[same], _loosest(known.information + WEAK)])
    shortest: dict[tuple[int, int], float] = {}
    for i, j, variance in zip(a.tolist(), b.tolist(), variances.tolist(), strict=True):
        shortest[i, j] = min(max(variance, LEAST), shortest.get((i, j), np.inf))
    rows, columns = np.array(list(shortest), dtype=np.int64).reshape(-1, 2).T
    graph = coo_array((np.array(list(shortest.values())), (rows, columns)), shape=(count, count)).tocsr()
    for begin in range(0, count, CHUNK):
        chunk = np.arange(begin, min(begin + CHUNK, count))
        yield from np.isfinite(dijkstra(graph, directed=False, indices=chunk, limit=limit**2))


def _loosest(information: Floats) -> Floats:
    """(E,) m²: the variance of the place in its loosest direction."""
    if not len(information):
        return np.zeros(0)
    covariance = np.linalg.inv(information)[:, :2, :2]
    return np.asarray(np.linalg.eigvalsh(covariance)[:, -1])
