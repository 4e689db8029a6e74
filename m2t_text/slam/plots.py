"""The picture of a map: what is occupied and free, the corrected drives, and the loops found by text."""

from pathlib import Path

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from m2t_text.plotting.canvas import FIRST, INK, LATER, MATCHED, PALE, entitle, make_metric, mark
from m2t_text.plotting.pictures import save, short
from m2t_text.saved_maps.grid import FREE, OCCUPIED
from m2t_text.slam.mapping import MapOfLogs

INCHES = 10.0  # longer side of the map
SHADES = {"free": 1.0, "unknown": 0.88, "occupied": 0.1}
MARGIN = 1.0  # m about what was seen


def plot_map(made: MapOfLogs, path: Path) -> None:
    """Draws a map with its drives; raises M2TError if the picture cannot be written."""
    grid = made.grid
    shades = np.full(grid.states.shape, SHADES["unknown"])
    shades[grid.states == FREE] = SHADES["free"]
    shades[grid.states == OCCUPIED] = SHADES["occupied"]
    low = grid.origin[:2]
    high = low + np.array(grid.states.shape[::-1]) * grid.resolution
    aspect = float(np.clip((high - low)[1] / (high - low)[0], 0.3, 2.0))
    width = INCHES / max(1.0, aspect)
    figure = Figure((width, width * aspect + 1.2), layout="compressed", facecolor="white")
    axes = figure.subplots()
    axes.imshow(
        shades,
        cmap="gray",
        vmin=0,
        vmax=1,
        origin="lower",
        extent=(low[0], high[0], low[1], high[1]),
        interpolation="antialiased",
    )
    shown = [name not in made.left_out for name in (log.name for log in made.logs)]
    for k, poses in enumerate(made.trajectories()):
        if shown[k]:
            axes.plot(*poses[:, :2].T, color=(FIRST, LATER)[k % 2], lw=0.8)
    correction = made.correction
    loops = correction.constraints.chosen(correction.kinds == "loop")
    ends = correction.trajectory[correction.keys.numbers[loops.pairs], :2]
    axes.add_collection(LineCollection(list(ends), colors=MATCHED, lw=0.7, alpha=0.6, zorder=4))
    axes.plot(*made.correction.trajectory[0, :2], "o", ms=7, color=INK, mec="white", zorder=6)
    travel = f"{made.detection.survey.way[-1]:,.0f} m of travel"
    entitle(axes, short(made.detection.log.name, 60), f"{travel}, {len(loops):,} loops found by text")
    make_metric(axes)
    axes.grid(color=PALE, lw=0.3)
    marks = [mark(INK, "begin"), mark(FIRST, "corrected trajectory", "-"), mark(MATCHED, "loop", "-")]
    figure.legend(handles=marks, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    save(figure, path)
