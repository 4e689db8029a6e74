"""A pose graph for others: g2o, TUM and JSON."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from m2t_text.errors import M2TError
from m2t_text.logs.log import Log
from m2t_text.loops.detection import LoopDetection
from m2t_text.loops.gate import Loop
from m2t_text.loops.graph import Edge, PoseGraph
from m2t_text.util.files import written_whole
from m2t_text.util.types import Floats


def to_g2o(graph: PoseGraph) -> str:
    """The graph as ``VERTEX_SE2`` and ``EDGE_SE2`` lines: vertices, steps, loops. No vertex is fixed."""
    lines = [f"VERTEX_SE2 {number} {_row(pose)}" for number, pose in enumerate(graph.vertices)]
    lines += [_edge(edge) for edge in (*graph.steps, *graph.loops)]
    return "\n".join(lines) + "\n"


def _edge(edge: Edge) -> str:
    upper = edge.information[np.triu_indices(3)]
    return f"EDGE_SE2 {edge.start} {edge.end} {_row(edge.pose.pose)} {_row(upper)}"


def to_tum(detection: LoopDetection) -> str:
    """The trajectory before any loop; see `tum_lines`."""
    return tum_lines(detection.log, detection.survey.trajectory)


def tum_lines(log: Log, poses: Floats) -> str:
    """A trajectory (S, 3) of a log's scans, a line a scan: ``timestamp x y z qx qy qz qw``.

    Where the log's times do not ascend from scan to scan, the timestamps are the scans' numbers.
    """
    times = np.array([scan.timestamp for scan in log.scans])
    if not (np.diff(times) > 0).all():
        times = np.arange(len(times), dtype=float)
    return "".join(f"{line}\n" for line in _tum(times, poses))


def _tum(times: np.ndarray, poses: np.ndarray) -> Iterator[str]:
    for time, (x, y, theta) in zip(times, poses, strict=True):
        yield f"{time:.6f} {_row([x, y, 0.0, 0.0, 0.0, np.sin(theta / 2), np.cos(theta / 2)])}"


def to_json(detection: LoopDetection, graph: PoseGraph) -> dict[str, Any]:
    """The document of ``loops --json``."""
    return {
        "dataset": detection.log.name,
        "index": None if detection.index is None else str(detection.index),
        "scans": graph.scans,
        "travel": float(detection.survey.way[-1]),
        "queries": detection.queries,
        "matches": detection.matches,
        "refused": len(detection.refused),
        "waiting": len(detection.waiting),
        "loops": [_loop(loop, edge) for loop, edge in zip(detection.loops, graph.loops, strict=True)],
        "maps": [{"vertex": graph.scans + k, "map_id": map_id} for k, map_id in enumerate(graph.maps)],
    }


def _loop(loop: Loop, edge: Edge) -> dict[str, Any]:
    return {"from": edge.start, "to": edge.end, **loop_fields(loop)}


def loop_fields(loop: Loop) -> dict[str, Any]:
    """What is told of a loop, but for the vertices that it joins."""
    return {
        "pose": loop.pose.pose.tolist(),
        "information": loop.pose.information.tolist(),
        "query": loop.candidate.query.map_id,
        "map_id": loop.candidate.found.map_id,
        "inlier_ratio": loop.candidate.inlier_ratio,
        "known": loop.known,
    }


def write(path: Path, text: str) -> None:
    """Writes a file whole or not at all. Raises M2TError if it cannot be written."""
    try:
        with written_whole(path) as temporary:
            temporary.write_text(text, encoding="ascii")
    except OSError as error:
        raise M2TError(f"cannot write {str(path)!r}: {error.strerror or error}") from error


def _row(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values)
