"""Which drives lie in one frame: those that constraints join, directly or by way of others."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from m2t_text.slam.key_scans import KeyScans
from m2t_text.slam.optimisation import Constraints
from m2t_text.util.types import Ints


def frames(keys: KeyScans, constraints: Constraints) -> Ints:
    """(D,) the number of the frame that each drive lies in."""
    count, ends = int(keys.drives[-1]) + 1, keys.drives[constraints.pairs]
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    _, frame = connected_components(graph, directed=False)
    return np.asarray(frame, dtype=np.int64)
