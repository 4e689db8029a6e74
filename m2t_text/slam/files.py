"""The folder of a map: for Nav2, for optimisers, for evaluators, and to look at."""

import json
from pathlib import Path

import numpy as np

from m2t_text.loops.export import to_g2o, tum_lines, write
from m2t_text.loops.graph import Edge, PoseGraph
from m2t_text.loops.uncertainty import PoseWithCovariance
from m2t_text.saved_maps.writing import write_map
from m2t_text.slam.mapping import MapOfLogs
from m2t_text.slam.plots import plot_map


def write_map_folder(made: MapOfLogs, folder: Path) -> list[Path]:
    """Writes all files of a map into a folder that exists; returns their paths.

    ``map.yaml`` and ``map.pgm`` as ROS reads them, ``trajectory.tum`` (for several logs one each,
    ``trajectory-NAME.tum``), ``graph.g2o``, ``map.png`` and ``summary.json``. Raises M2TError if one cannot be
    written.
    """
    write_map(made.grid, folder / "map.yaml")
    written = [folder / "map.yaml", folder / "map.pgm"]
    for log, poses in zip(made.logs, made.trajectories(), strict=True):
        path = folder / ("trajectory.tum" if len(made.logs) == 1 else f"trajectory-{log.name}.tum")
        write(path, tum_lines(log, poses))
        written.append(path)
    write(folder / "graph.g2o", to_g2o(corrected_graph(made)))
    plot_map(made, folder / "map.png")
    write(folder / "summary.json", json.dumps(made.to_json(), indent=2) + "\n")
    return [*written, folder / "graph.g2o", folder / "map.png", folder / "summary.json"]


def corrected_graph(made: MapOfLogs) -> PoseGraph:
    """All scans at their corrected poses, steps between them, and the constraints between key scans."""
    detection, correction = made.detection, made.correction
    count = len(correction.trajectory)
    scans = np.arange(count - 1)
    drives = np.array([scan.drive for scan in detection.log.scans])
    same = scans[drives[:-1] == drives[1:]]
    motions = detection.drifts[detection.log.name].relative(same, same + 1)
    steps = [
        Edge(int(scan), int(scan) + 1, PoseWithCovariance(motions.pose[k], motions.covariance[k]))
        for k, scan in enumerate(same)
    ]
    constraints = correction.constraints.chosen(correction.kinds != "step")
    covariances = np.linalg.inv(constraints.information)
    loops = [
        Edge(int(start), int(end), PoseWithCovariance(pose, covariance))
        for (start, end), pose, covariance in zip(
            correction.keys.numbers[constraints.pairs], constraints.poses, covariances, strict=True
        )
    ]
    return PoseGraph(correction.trajectory, count, [], steps, loops)
