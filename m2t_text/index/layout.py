"""Whether the columns of a segment are laid out so that no reader, compiled ones least, can leave them."""

import numpy as np
from numpy.typing import NDArray

from m2t_text.errors import DamageError
from m2t_text.index.column import COUNTS, HEADER, RUN

RECORDS = np.dtype([("scans", "<i8", 2), ("numbers", "<f8", 10), ("points", "<i8")])  # see `schema.RECORD`


def check_records(column: memoryview) -> None:
    """Raises DamageError unless the records' numbers are finite and their counts not negative."""
    if len(column) % RECORDS.itemsize:
        raise DamageError("the records of the maps are damaged")
    records = np.frombuffer(column, RECORDS)
    counted = (records["scans"] >= 0).all() and (records["points"] >= 0).all()
    if not (counted and np.isfinite(records["numbers"]).all()):
        raise DamageError("the records of the maps are damaged")


def check_keypoints(column: memoryview) -> None:
    """Checks a `KeypointColumn` whose sections are known to fill it.

    Raises:
        DamageError: unless the documents share out each section, and each one's words ascend and are as many
            as its keypoints.
    """
    head = np.frombuffer(column, HEADER, 1)[0]
    counts = np.frombuffer(column, COUNTS, int(head["maps"]), HEADER.itemsize)
    runs = np.frombuffer(column, "<u2", int(head["runs"]), HEADER.itemsize + counts.nbytes)
    shared = all(counts[name].sum(dtype=np.int64) == head[name] for name in COUNTS.names or ())
    wide = (counts["wide"] == 0) | (counts["wide"] == counts["keypoints"])
    if not (shared and wide.all() and _fits(runs, counts)):
        raise DamageError("the keypoints of the maps are damaged")


def _fits(runs: NDArray[np.uint16], counts: NDArray[np.void]) -> bool:
    """Whether the runs of each document are as long as it has keypoints, and ascend."""
    bounds = np.append(0, np.cumsum(counts["runs"], dtype=np.int64))
    ends = np.append(0, np.cumsum(runs % RUN + np.int64(1)))
    falls = np.flatnonzero(np.diff(runs // RUN, prepend=np.uint16(0)).view(np.int16) < 0)
    return bool((np.diff(ends[bounds]) == counts["keypoints"]).all() and np.isin(falls, bounds).all())
