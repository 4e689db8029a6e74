"""The picture of a drive as its odometry and scan matching have it, and of the loops that it closes."""

from pathlib import Path

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from m2t_text.loops.detection import LoopDetection
from m2t_text.loops.graph import PoseGraph
from m2t_text.plotting.canvas import FIRST, HIT, INK, MATCHED, draw_walls, entitle, make_metric, mark, walls_of
from m2t_text.plotting.pictures import save, short


def plot_detection(detection: LoopDetection, graph: PoseGraph, path: Path) -> None:
    """Walls, drive and loops. A loop is a line between two poses from which one place was seen."""
    poses = graph.vertices[:, :2]
    drive, maps = np.split(poses, [graph.scans])
    walls = walls_of(detection.log, graph.vertices[: graph.scans])
    links = [poses[[edge.start, edge.end]] for edge in graph.loops]
    everything = np.vstack([walls, poses])
    low, high = everything.min(axis=0) - 1.0, everything.max(axis=0) + 1.0
    aspect = float(np.clip((high - low)[1] / (high - low)[0], 0.3, 2.0))
    width = 9.0 / max(1.0, aspect)
    figure = Figure((width, width * aspect + 1.4), layout="compressed", facecolor="white")
    axes = figure.subplots()
    draw_walls(axes, walls)
    axes.plot(*drive.T, color=FIRST, lw=1.0)
    axes.plot(*maps.T, "o", ms=4, color=HIT, mec="none", zorder=5)
    axes.add_collection(LineCollection(links, colors=MATCHED, lw=1.2, zorder=4))
    axes.plot(*poses[[edge.end for edge in graph.loops]].T, ".", ms=5, color=MATCHED, zorder=5)
    axes.plot(*drive[0], "o", ms=8, color=INK, mec="white", zorder=6)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    entitle(
        axes, short(detection.log.name, 60), f"{detection.survey.way[-1]:.0f} m of travel, {len(links)} loops"
    )
    make_metric(axes)
    marks = [mark(INK, "begin"), mark(FIRST, "odometry and scan matching", "-"), mark(MATCHED, "loop", "-")]
    marks += [mark(HIT, "map of another dataset")] if len(maps) else []
    figure.legend(handles=marks, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    save(figure, path)
