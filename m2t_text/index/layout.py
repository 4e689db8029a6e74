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


def check_keypoints(column: memoryview, documents: int) -> None:
    """Checks a `KeypointColumn` of so many documents.

    Raises:
        DamageError: unless its sections fill it, the documents share out each of them, and the words of each
            document ascend and are as many as its keypoints.
    """
    if not (_filled(column, documents) and _shared_out(column)):
        raise DamageError("the keypoints of the maps are damaged")


def _filled(column: memoryview, documents: int) -> bool:
    if len(column) < HEADER.itemsize:
        return False
    maps, runs, keypoints, wide = np.frombuffer(column, HEADER, 1)[0].tolist()
    size = HEADER.itemsize + maps * COUNTS.itemsize + 2 * (runs + keypoints + wide)
    return bool(maps == documents and size == len(column))


def _shared_out(column: memoryview) -> bool:
    head = np.frombuffer(column, HEADER, 1)[0]
    counts = np.frombuffer(column, COUNTS, int(head["maps"]), HEADER.itemsize)
    runs = np.frombuffer(column, "<u2", int(head["runs"]), HEADER.itemsize + counts.nbytes)
    shared = all(counts[name].sum(dtype=np.int64) == head[name] for name in COUNTS.names or ())
    wide = (counts["wide"] == 0) | (counts["wide"] == counts["keypoints"])
    return bool(shared and wide.all() and _fits(runs, counts))


def _fits(runs: NDArray[np.uint16], counts: NDArray[np.void]) -> bool:
    """Whether the runs of each document are as long as it has keypoints, and ascend."""
    bounds = np.append(0, np.cumsum(counts["runs"], dtype=np.int64))
    ends = np.append(0, np.cumsum(runs % RUN + np.int64(1)))
    falls = np.flatnonzero(np.diff(runs // RUN, prepend=np.uint16(0)).view(np.int16) < 0)
    return bool((np.diff(ends[bounds]) == counts["keypoints"]).all() and np.isin(falls, bounds).all())
