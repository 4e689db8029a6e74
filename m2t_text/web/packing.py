"""Arrays for the page: a header in JSON, and columns of numbers as they lie in memory."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from m2t_text.index.results import Overview

Bytes = bytes
ALIGNED = 8  # bytes to a multiple of which header and columns are filled up


def pack(header: dict[str, Any], columns: Mapping[str, NDArray[Any]]) -> Bytes:
    """The header's length (uint32), the header with each column's name, type and length, and the columns.

    All numbers are little-endian. The header and each column begin at a multiple of ALIGNED bytes.
    """
    described = [
        {"name": name, "type": array.dtype.str.lstrip("<|"), "length": len(array)}
        for name, array in columns.items()
    ]
    text = json.dumps(header | {"columns": described}, allow_nan=False).encode()
    text += b" " * (-(len(text) + 4) % ALIGNED)
    parts = [np.uint32(len(text)).tobytes(), text]
    for array in columns.values():
        data = array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes()
        parts += [data, bytes(-len(data) % ALIGNED)]
    return b"".join(parts)


def pack_places(overview: Overview) -> Bytes:
    """Where every map begins: columns ``x``, ``y``, ``theta`` (metres, radians, in the frame of its dataset),
    ``travel`` (metres at its begin), ``first_scan``. The maps of one dataset follow each other."""
    records = overview.records
    begins = np.searchsorted(overview.codes, np.arange(len(overview.names) + 1)).tolist()
    datasets = []
    for name, begin, end in zip(overview.names, begins, begins[1:], strict=False):
        part = records[begin:end]
        low, high = part["pose"][:, :2].min(axis=0), part["pose"][:, :2].max(axis=0)
        driven = bool((part["travel"][:, 1] > part["travel"][:, 0]).any())
        box = [round(value, 3) for value in (*low.tolist(), *high.tolist())]
        datasets.append({"name": name, "begin": begin, "end": end, "driven": driven, "box": box})
    pose = records["pose"].astype(np.float32)
    columns: dict[str, NDArray[Any]] = {
        "x": np.ascontiguousarray(pose[:, 0]),
        "y": np.ascontiguousarray(pose[:, 1]),
        "theta": np.ascontiguousarray(pose[:, 2]),
        "travel": records["travel"][:, 0].astype(np.float32),
        "first_scan": records["first_scan"].astype(np.uint32),
    }
    return pack({"maps": len(overview), "datasets": datasets}, columns)
