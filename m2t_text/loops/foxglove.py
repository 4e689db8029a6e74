"""Loops as messages that Foxglove shows: one file with map, trajectory, loops and refusals as time goes on.

The messages are Foxglove's own schemas as JSON, so that nothing of ROS is needed to show them.
"""

import base64
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from m2t_text import __version__
from m2t_text.errors import M2TError
from m2t_text.logs.log import Log
from m2t_text.loops.detection import LoopDetection
from m2t_text.loops.gate import Loop
from m2t_text.loops.graph import PoseGraph
from m2t_text.plotting.canvas import walls_of
from m2t_text.util.files import written_whole
from m2t_text.util.types import Floats

FRAME, ROBOT = "map", "base_link"
PACE = 0.1  # s between two scans of a log whose times do not ascend
LOOP, REFUSED, WAITING = (0.1, 0.7, 0.2), (0.9, 0.2, 0.1), (0.9, 0.7, 0.1)  # colours
NUMBER, TEXT = {"type": "number"}, {"type": "string"}
TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
ANY, LIST = {"type": "object"}, {"type": "array", "items": {"type": "object"}}
SCHEMAS: dict[str, dict[str, Any]] = {
    "foxglove.PointCloud": {
        "timestamp": TIME,
        "frame_id": TEXT,
        "pose": ANY,
        "point_stride": {"type": "integer"},
        "fields": LIST,
        "data": {"type": "string", "contentEncoding": "base64"},
    },
    "foxglove.PosesInFrame": {"timestamp": TIME, "frame_id": TEXT, "poses": LIST},
    "foxglove.FrameTransform": {
        "timestamp": TIME,
        "parent_frame_id": TEXT,
        "child_frame_id": TEXT,
        "translation": ANY,
        "rotation": ANY,
    },
    "foxglove.SceneUpdate": {"deletions": LIST, "entities": LIST},
}
TOPICS = {
    "/map": "foxglove.PointCloud",
    "/trajectory": "foxglove.PosesInFrame",
    "/tf": "foxglove.FrameTransform",
    "/loops": "foxglove.SceneUpdate",
    "/refused": "foxglove.SceneUpdate",
    "/waiting": "foxglove.SceneUpdate",
}


@dataclass(frozen=True)
class _Message:
    topic: str
    time: int  # ns
    body: dict[str, Any]


def check_mcap() -> None:
    """Raises M2TError where the package that writes MCAP files is missing."""
    try:
        import mcap.writer  # noqa: F401
    except ImportError as error:
        raise M2TError("--mcap takes one more package: pip install 'm2t-text[mcap]'") from error


def write_mcap(detection: LoopDetection, graph: PoseGraph, path: Path) -> None:
    """Writes the file whole or not at all.

    Raises:
        M2TError: if it cannot be written, or the package `mcap` is missing.
    """
    check_mcap()
    from mcap.writer import Writer

    try:
        with written_whole(path) as temporary, temporary.open("wb") as stream:
            writer = Writer(stream)
            writer.start(library=f"m2t-text {__version__}")
            channels = {}
            for topic, name in TOPICS.items():
                schema = json.dumps({"type": "object", "properties": SCHEMAS[name]}).encode()
                number = writer.register_schema(name, "jsonschema", schema)
                channels[topic] = writer.register_channel(topic, "json", number)
            for message in messages(detection, graph):
                body = json.dumps(message.body, allow_nan=False).encode()
                writer.add_message(channels[message.topic], message.time, body, message.time)
            writer.finish()
    except OSError as error:
        raise M2TError(f"cannot write {str(path)!r}: {error.strerror or error}") from error


def messages(detection: LoopDetection, graph: PoseGraph) -> "Iterator[_Message]":
    """All messages in the order of time. A loop appears with the scan at which it is known."""
    times = _times(detection.log)
    poses = graph.vertices[: graph.scans]
    yield _Message("/map", times[0], _cloud(times[0], walls_of(detection.log, poses)))
    yield _Message("/trajectory", times[0], _path(times[0], poses))
    links = [
        ("/loops", loop.known, loop, (edge.start, edge.end), LOOP)
        for loop, edge in zip(detection.loops, graph.loops, strict=True)
    ]
    for topic, loops, colour in (
        ("/refused", detection.refused, REFUSED),
        ("/waiting", detection.waiting, WAITING),
    ):
        links += [(topic, loop.known, loop, _ends(detection, loop), colour) for loop in loops]
    links.sort(key=lambda link: link[1])
    shown = 0
    for scan, time in enumerate(times):
        yield _Message("/tf", time, _transform(time, poses[scan]))
        while shown < len(links) and links[shown][1] <= scan:
            topic, _, loop, ends, colour = links[shown]
            yield _Message(topic, time, _scene(time, shown, loop, graph.vertices[list(ends)], colour))
            shown += 1


def _ends(detection: LoopDetection, loop: Loop) -> tuple[int, int]:
    """The scans that a loop joins; of one to another dataset, which is laid nowhere, its own scan twice."""
    return (loop.place if loop.dataset == detection.log.name else loop.scan, loop.scan)


def _times(log: Log) -> list[int]:
    times = np.array([scan.timestamp for scan in log.scans])
    if not (np.diff(times) > 0).all() or times[0] < 0:
        times = np.arange(len(times)) * PACE
    return [round(time * 1e9) for time in times.tolist()]


def _stamp(time: int) -> dict[str, int]:
    return {"sec": time // 10**9, "nsec": time % 10**9}


def _placed(pose: Sequence[float]) -> dict[str, Any]:
    x, y, theta = (float(value) for value in pose)
    return {
        "position": {"x": x, "y": y, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": float(np.sin(theta / 2)), "w": float(np.cos(theta / 2))},
    }


def _cloud(time: int, points: Floats) -> dict[str, Any]:
    data = np.column_stack([points, np.zeros(len(points))]).astype("<f4").tobytes()
    fields = [{"name": name, "offset": 4 * k, "type": 7} for k, name in enumerate("xyz")]  # 7: 32 bit floats
    return {
        "timestamp": _stamp(time),
        "frame_id": FRAME,
        "pose": _placed([0.0, 0.0, 0.0]),
        "point_stride": 12,
        "fields": fields,
        "data": base64.b64encode(data).decode("ascii"),
    }


def _path(time: int, poses: Floats) -> dict[str, Any]:
    return {"timestamp": _stamp(time), "frame_id": FRAME, "poses": [_placed(pose) for pose in poses]}


def _transform(time: int, pose: Floats) -> dict[str, Any]:
    placed = _placed(pose.tolist())
    return {
        "timestamp": _stamp(time),
        "parent_frame_id": FRAME,
        "child_frame_id": ROBOT,
        "translation": placed["position"],
        "rotation": placed["orientation"],
    }


def _scene(
    time: int, number: int, loop: Loop, ends: Floats, colour: tuple[float, float, float]
) -> dict[str, Any]:
    red, green, blue = colour
    line = {
        "type": 0,  # a strip of lines
        "pose": _placed([0.0, 0.0, 0.0]),
        "thickness": 0.1,
        "scale_invariant": False,
        "points": [{"x": float(x), "y": float(y), "z": 0.1} for x, y, _ in ends],
        "color": {"r": red, "g": green, "b": blue, "a": 1.0},
        "colors": [],
        "indices": [],
    }
    told = {
        "query": loop.candidate.query.map_id,
        "found": loop.candidate.found.map_id,
        "inlier ratio": f"{loop.candidate.inlier_ratio:.3f}",
    }
    entity = {
        "timestamp": _stamp(time),
        "frame_id": FRAME,
        "id": str(number),
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": False,
        "metadata": [{"key": key, "value": value} for key, value in told.items()],
        "lines": [line],
    }
    return {"deletions": [], "entities": [entity]}
