"""The evaluation's pictures: sorted ranks, places on the map, pairs of maps (paper, Figs. 3 to 7)."""

from collections.abc import Sequence
from math import ceil
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

from m2t_text.evaluation.examples import Pair
from m2t_text.evaluation.judging import column
from m2t_text.evaluation.run import EvaluatedLog, Evaluation
from m2t_text.plotting.canvas import (
    FIRST,
    HIT,
    INK,
    MATCHED,
    PALE,
    QUERY,
    draw_match,
    draw_overlap,
    draw_viewpoint,
    draw_walls,
    entitle,
    make_metric,
    mark,
    metres,
    walls_of,
)
from m2t_text.plotting.pictures import save, short

ANYWHERE = 1 << 14  # cells; no keypoint lies farther from another: a bag of words
RANK = ListedColormap(colormaps["turbo"](np.linspace(0.12, 0.92, 256)))  # its ends are both dark
METHODS = (("bow", "BoW", FIRST, ANYWHERE), ("m2t", "M2T", MATCHED, None))


def plot_all(evaluation: Evaluation, folder: Path) -> list[Path]:
    """Draws everything into a folder that exists; returns the files."""
    figures = {"anr.png": ranks_figure(evaluation.datasets)}
    for one in evaluation.datasets:
        figures[f"{one.log.name}-map.png"] = map_figure(one)
        figures[f"{one.log.name}-pairs.png"] = pairs_figure(one.pairs)
    for name, figure in figures.items():
        save(figure, folder / name)
    return [folder / name for name in figures]


def ranks_figure(datasets: Sequence[EvaluatedLog]) -> Figure:
    """Of each dataset the queries' normalised ranks in ascending order, by method (paper, Fig. 6)."""
    columns = min(3, len(datasets))
    rows = ceil(len(datasets) / columns)
    figure = Figure((max(4.2, 3.5 * columns), 2.9 * rows + 0.6), layout="compressed", facecolor="white")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for one, evaluated in zip(axes, datasets, strict=False):
        means = []
        for method, name, colour, _ in METHODS:
            ranks = 100 * np.sort(column(evaluated.judgements, "normalised_rank", method))
            one.plot(np.arange(1, len(ranks) + 1), ranks, color=colour, lw=2.0)
            means.append(f"{name} {ranks.mean():.1f} %")
        one.set(xlim=(1, max(2, len(ranks))), ylim=(0, 100), xlabel="query, sorted")
        one.set_ylabel("normalised rank (%)" if one is axes[0] else "")
        entitle(one, short(evaluated.log.name), "mean: " + ", ".join(means))
        _make_plain(one)
    for one in axes[len(datasets) :]:
        one.remove()
    marks = [mark(colour, name, "-") for _, name, colour, _ in METHODS]
    figure.legend(handles=marks, loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    return figure


def map_figure(evaluated: EvaluatedLog) -> Figure:
    """The walls and the drive by the ground truth, and each query in the colour of its rank (paper, Fig. 3)."""
    assert evaluated.log.ground_truth is not None
    walls, way = walls_of(evaluated.log, evaluated.log.ground_truth), evaluated.log.ground_truth[:, :2]
    low, high = np.vstack([walls, way]).min(axis=0) - 1.0, np.vstack([walls, way]).max(axis=0) + 1.0
    aspect = float(np.clip((high - low)[1] / (high - low)[0], 0.3, 2.0))
    width = 8.0 / max(1.0, aspect)
    figure = Figure((width + 1.4, width * aspect + 1.0), layout="compressed", facecolor="white")
    axes = figure.subplots()
    draw_walls(axes, walls)
    axes.plot(*way.T, color=FIRST, lw=0.8, alpha=0.6)
    ranks = 100 * column(evaluated.judgements, "normalised_rank", "m2t")
    places = evaluated.truth.places[[judgement.query for judgement in evaluated.judgements]]
    order = np.argsort(ranks)  # the worst on top: they are what one looks for
    colours = Normalize(0, 50)
    x, y = places[order].T
    axes.scatter(x, y, c=ranks[order], cmap=RANK, norm=colours, s=20, lw=0.4, edgecolors="white", zorder=4)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    entitle(
        axes, short(evaluated.log.name, 60), f"{len(ranks)} queries, mean normalised rank {ranks.mean():.1f} %"
    )
    make_metric(axes)
    figure.colorbar(
        ScalarMappable(colours, RANK),
        ax=axes,
        extend="max",
        shrink=0.7,
        label="normalised rank, M2T (%); 50 is chance",
    )
    return figure


def pairs_figure(pairs: Sequence[Pair]) -> Figure:
    """A pair a row: keypoints with the same word, anywhere and where they belong (paper, Figs. 4, 5, 7)."""
    texts = [(text, pair.cell) for pair in pairs for text in (pair.query_text, pair.found_text)]
    points = np.concatenate([metres(text, cell) for text, cell in texts])
    low, high = points.min(axis=0) - 0.6, points.max(axis=0) + 0.6
    aspect = float(np.clip((high - low)[1] / (high - low)[0], 0.4, 1.6))
    size = (9.0, len(pairs) * (4.1 * aspect + 0.7) + 0.7)
    figure = Figure(size, layout="compressed", facecolor="white")
    axes = figure.subplots(len(pairs), len(METHODS), squeeze=False, sharex=True, sharey=True)
    for row, pair in zip(axes, pairs, strict=True):
        for one, (method, name, _, reach) in zip(row, METHODS, strict=True):
            window = reach or pair.tolerance
            if window > 1:
                matched = draw_match(one, pair.query_text, pair.found_text, window, pair.cell)
            else:  # where matches must meet, no line would be seen
                matched = draw_overlap(one, pair.query_text, pair.found_text, pair.cell)
            draw_viewpoint(one, pair.alignment, QUERY)
            draw_viewpoint(one, np.zeros(3), HIT)
            kind = "the same place" if pair.relevant else "another place"
            entitle(
                one,
                f"{name}, {kind}",
                f"{_number(pair.query)} and {_number(pair.found)}: {matched} of {len(pair.query_text)} "
                f"keypoints matched, score {pair.scores[method]:.3g}",
            )
            one.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
            make_metric(one)
    marks = [mark(QUERY, "query"), mark(HIT, "map of the index"), mark(MATCHED, "same word", "-")]
    if any(pair.tolerance <= 1 for pair in pairs):
        marks.append(mark(MATCHED, "both, at the agreed offset"))
    figure.legend(handles=marks, loc="outside lower center", ncols=len(marks), frameon=False, fontsize=9)
    return figure


def _number(map_id: str) -> str:
    return map_id.rpartition("/")[2]


def _make_plain(axes: Axes) -> None:
    """A pale frame and grid, as the pictures in metres have."""
    axes.grid(color=PALE, lw=0.5)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, colors=INK)
    axes.spines[:].set_color(PALE)
