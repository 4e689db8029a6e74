"""What pictures are made of: functions that fill axes, in the frame of a map's viewpoint, in metres."""

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import ListedColormap
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from scipy.spatial import KDTree

from m2t_text.description.text import Text
from m2t_text.logs.log import Log
from m2t_text.mapping.scan_cloud import scan_points
from m2t_text.util.geometry import transform
from m2t_text.util.types import Floats

QUERY, HIT, MATCHED = "#1a9641", "#2b6cb0", "#d7301f"
FIRST, LATER = "#7a8ba0", "#e08214"
INK, PALE, WITHHELD = "#222222", "#d5d9de", "#9aa1ab"
FREE, FREE_EDGE = "#e6f2ea", "#a9cdb6"
ARROW = 1.2  # m; length of the arrow that shows a viewing direction
WALL_RANGE, WALL_CELL = 10.0, 0.1  # m; which hits are drawn, and how far apart


def draw_keypoints(axes: Axes, text: Text, colour: str, cell: float) -> None:
    """A text's keypoints as dots; ``cell`` is the step of its pose words, metres, here and below."""
    axes.plot(*metres(text, cell).T, ".", ms=3.5, color=colour, mec="none")


def draw_words(axes: Axes, text: Text, cell: float) -> NDArray[np.int64]:
    """A text's keypoints as dots with a colour for each appearance word in it; returns these words, ascending.

    A text has a few dozen of the 1024 words, so colours follow a word's rank in the text: see `word_colours`.
    """
    words, ranks = np.unique(text.wa, return_inverse=True)
    x, y = metres(text, cell).T
    axes.scatter(x, y, c=ranks, cmap=word_colours(len(words)), vmin=-0.5, vmax=len(words) - 0.5, s=12, lw=0)
    return words.astype(np.int64)


def word_colours(count: int) -> ListedColormap:
    """As many colours as words, as far apart as there is room between blue and red."""
    return ListedColormap(colormaps["turbo"](np.linspace(0.06, 0.94, max(1, count))))


def draw_free(axes: Axes, text: Text, cell: float, edges: bool = False) -> None:
    """A text's free squares as pale areas below all else, with the edges of each square or without."""
    style = {"ec": FREE_EDGE, "lw": 0.4} if edges else {"ec": "none"}
    axes.add_collection(PolyCollection(list(free_corners(text, cell)), fc=FREE, zorder=0.1, **style))


def free_corners(text: Text, cell: float) -> Floats:
    """(F, 4, 2) the corners of a text's free squares, metres."""
    x, y, side = (values * cell for values in (text.free.wx, text.free.wy, text.free.size))
    return np.stack([x, y, x + side, y, x + side, y + side, x, y + side], axis=1).reshape(-1, 4, 2)


def draw_match(axes: Axes, query: Text, found: Text, window: int, cell: float) -> int:
    """Both texts and their correspondences; returns how many of the query's keypoints have one."""
    pairs = correspondences(query, found, window)
    ends = np.stack([metres(query, cell)[pairs[:, 0]], metres(found, cell)[pairs[:, 1]]], axis=1)
    axes.add_collection(LineCollection(list(ends), colors=MATCHED, lw=0.6, alpha=0.65, zorder=1))
    draw_free(axes, found, cell)
    draw_keypoints(axes, found, HIT, cell)
    draw_keypoints(axes, query, QUERY, cell)
    return len(pairs)


def draw_overlap(axes: Axes, query: Text, found: Text, cell: float) -> int:
    """A query laid over a map: the query's keypoints that have one of the map in their cell or the next are
    matched; returns how many."""
    draw_free(axes, found, cell)
    draw_keypoints(axes, found, HIT, cell)
    draw_keypoints(axes, query, QUERY, cell)
    if not len(query) or not len(found):
        return 0
    distance, _ = KDTree(found.positions()).query(query.positions(), p=np.inf, distance_upper_bound=1.5)
    matched = metres(query, cell)[np.isfinite(distance)]
    axes.plot(*matched.T, ".", ms=4.5, color=MATCHED, mec="none")
    return len(matched)


def draw_viewpoint(axes: Axes, pose: Floats, colour: str) -> None:
    """A pose as a dot with an arrow."""
    x, y, theta = pose
    tip = (x + ARROW * np.cos(theta), y + ARROW * np.sin(theta))
    style = {"arrowstyle": "-|>", "color": colour, "lw": 2.2, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 13}
    axes.annotate("", tip, (x, y), arrowprops=style, zorder=5)
    axes.plot(x, y, "o", ms=7, color=colour, mec="white", mew=1.0, zorder=6)


def draw_walls(axes: Axes, points: Floats) -> None:
    """What the laser hit, (N, 2), as fine dots."""
    axes.plot(*points.T, ".", ms=2.2, color="#4b5563", mec="none", rasterized=True)


def walls_of(log: Log, poses: Floats) -> Floats:
    """(N, 2) what the laser hit, seen from the poses (S, 3) of the scans, metres; one hit in each cell."""
    hits = [
        _one_in_a_cell(transform(pose, scan_points(scan, log.laser_pose, WALL_RANGE)))
        for pose, scan in zip(poses, log.scans, strict=True)
    ]
    return _one_in_a_cell(np.concatenate(hits))


def _one_in_a_cell(points: Floats) -> Floats:
    return points[np.unique(np.floor(points / WALL_CELL), axis=0, return_index=True)[1]]


def correspondences(query: Text, found: Text, window: int) -> NDArray[np.int64]:
    """(K, 2) for each of the query's keypoints with a partner, both indices: the nearest one with the same word
    that differs by at most ``window`` cells in x and in y (paper, eqs. 2, 3)."""
    if not len(query) or not len(found):
        return np.empty((0, 2), dtype=np.int64)
    apart = window + 1.0  # words lie so far apart on a third axis that only equal ones are in reach
    spaces = [np.column_stack([text.wx, text.wy, text.wa * apart]) for text in (query, found)]
    distance, partner = KDTree(spaces[1]).query(spaces[0], p=np.inf, distance_upper_bound=window + 0.5)
    pairs = np.column_stack([np.arange(len(query)), partner])
    return pairs[np.isfinite(distance)]


def metres(text: Text, cell: float) -> Floats:
    """(N, 2) a text's keypoints in the frame of the viewpoint."""
    return text.positions() * cell


def entitle(axes: Axes, title: str, subtitle: str) -> None:
    """A title on the left, and a smaller line below it."""
    axes.set_title(f"{title}\n", fontsize=10, color=INK, loc="left", parse_math=False, pad=4)
    axes.annotate(subtitle, (0, 1), (0, 5), xycoords="axes fraction", textcoords="offset points", fontsize=9)


def make_metric(axes: Axes) -> None:
    """Both axes in metres, to one scale, over a pale grid."""
    axes.set_aspect("equal")
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.label_outer()
    axes.grid(color=PALE, lw=0.5)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, colors=INK)
    axes.spines[:].set_color(PALE)


def mark(colour: str, label: str, line: str = "", marker: str = "o") -> Line2D:
    """An entry of a legend."""
    return Line2D(
        [],
        [],
        color=colour,
        ls=line,
        marker="" if line else marker,
        ms=6,
        mew=2 if marker == "+" else 0,
        label=label,
    )
