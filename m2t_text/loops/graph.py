"""The pose graph of a detection: what an optimiser needs to correct the trajectory."""

from dataclasses import dataclass

import numpy as np

from m2t_text.loops.detection import LoopDetection
from m2t_text.loops.uncertainty import PoseWithCovariance
from m2t_text.util.geometry import compose, inverse
from m2t_text.util.types import Floats


@dataclass(frozen=True)
class Edge:
    """The vertex ``end`` as seen from the vertex ``start``."""

    start: int
    end: int
    pose: PoseWithCovariance

    @property
    def information(self) -> Floats:
        """(3, 3) inverse covariance of x, y, theta, in the frame of ``end``."""
        return self.pose.information


@dataclass(frozen=True)
class PoseGraph:
    """Poses, and constraints between them.

    Attributes:
        vertices: (V, 3) poses before optimisation; the scans of the drive, then maps of other datasets.
        scans: number of vertices that are scans.
        maps: ids of the maps that the others are.
        steps: between consecutive scans, and between consecutive maps of one other dataset.
        loops: one for each of the detection's loops, in their order.
    """

    vertices: Floats
    scans: int
    maps: list[str]
    steps: list[Edge]
    loops: list[Edge]


def pose_graph(detection: LoopDetection) -> PoseGraph:
    """The graph of a drive and its loops. A map of another dataset is a vertex if a loop leads to it; each such
    dataset is laid where its first loop puts it."""
    ours = detection.drifts[detection.log.name]
    count = len(ours.trajectory)
    vertices, maps = [ours.trajectory], []
    scans = np.arange(count)
    steps = _chain(scans, ours.relative(scans[:-1], scans[1:]))
    number = {(detection.log.name, scan): scan for scan in range(count)}
    for name in sorted(detection.maps):
        theirs, found = detection.drifts[name], [loop for loop in detection.loops if loop.dataset == name]
        places = np.unique([loop.place for loop in found]).astype(np.int64)
        if not found:
            continue
        first = compose(ours.trajectory[found[0].scan], inverse(found[0].pose.pose))
        frame = compose(first, inverse(theirs.trajectory[found[0].place]))
        numbers = np.arange(len(number), len(number) + len(places))
        number |= {(name, int(place)): int(n) for place, n in zip(places, numbers, strict=True)}
        vertices.append(compose(frame, theirs.trajectory[places]))
        maps += [detection.maps[name][place] for place in places]
        steps += _chain(numbers, theirs.relative(places[:-1], places[1:]))
    loops = [Edge(number[loop.dataset, loop.place], loop.scan, loop.pose) for loop in detection.loops]
    return PoseGraph(np.concatenate(vertices), count, maps, steps, loops)


def _chain(numbers: np.ndarray, motions: PoseWithCovariance) -> list[Edge]:
    """Edges between consecutive vertices."""
    return [
        Edge(int(numbers[k]), int(numbers[k + 1]), PoseWithCovariance(motions.pose[k], motions.covariance[k]))
        for k in range(len(numbers) - 1)
    ]
