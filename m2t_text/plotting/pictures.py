"""Every picture that a command writes."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.errors import M2TError
from m2t_text.plotting.canvas import (
    ARROW,
    FIRST,
    FREE_EDGE,
    HIT,
    INK,
    LATER,
    MATCHED,
    PALE,
    QUERY,
    WITHHELD,
    draw_free,
    draw_keypoints,
    draw_match,
    draw_overlap,
    draw_viewpoint,
    draw_walls,
    draw_words,
    entitle,
    free_corners,
    make_metric,
    mark,
    metres,
    word_colours,
)
from m2t_text.recognition.found import Found
from m2t_text.util.files import written_whole
from m2t_text.util.geometry import inverse, transform
from m2t_text.util.types import Floats

ENDINGS = (".png", ".pdf", ".svg")
PANELS = 5  # hits in one picture
NAMED = 16  # words named beside a picture
TITLE = 34  # characters of a map id in a title


@dataclass(frozen=True)
class Visit:
    """A place that was looked up: (2,) where the query and its best hit lie, whether that is right, and whether
    it was given as the answer (the verdict ``match``) or withheld."""

    query: Floats
    hit: Floats
    right: bool
    answered: bool

    @property
    def colour(self) -> str:
        if not self.answered:
            return WITHHELD
        return QUERY if self.right else MATCHED


def check_picture(path: Path) -> None:
    """Raises M2TError if no picture can be written there; told before the work, not after it."""
    if path.suffix.lower() not in ENDINGS:
        raise M2TError(f"cannot draw {str(path)!r}: name a file that ends in {', '.join(ENDINGS)}")
    if not path.parent.is_dir():
        raise M2TError(f"cannot draw {str(path)!r}: there is no folder {str(path.parent)!r}; make it first")


def plot_match(
    query: Text,
    title: str,
    found: Sequence[tuple[Found, Text]],
    parameters: Parameters,
    path: Path,
    reason: str = "",
) -> None:
    """A query, and each of its best hits (with its text) with the query laid over it.

    The ``parameters`` are those with which the texts were made; the ``reason`` for the verdict is a line above.
    """
    cell, window = parameters.mapping.cell, parameters.matching.tolerance
    shown = found[:PANELS]
    laid = [query.moved(result.laid, cell) for result, _ in shown]
    columns = min(3, len(shown) + 1)
    rows = ceil((len(shown) + 1) / columns)
    box = _box(np.concatenate([metres(text, cell) for text in (query, *laid, *(text for _, text in shown))]))
    figure = Figure(
        (4.0 * columns, rows * (3.6 * _aspect(box) + 0.7) + 0.8), layout="compressed", facecolor="white"
    )
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    draw_free(axes[0], query, cell)
    draw_keypoints(axes[0], query, QUERY, cell)
    draw_viewpoint(axes[0], np.zeros(3), QUERY)
    entitle(axes[0], f"query  {short(title)}", f"{len(query)} keypoints")
    for place, (one, (result, text)) in enumerate(zip(axes[1:], shown, strict=False)):
        if window > 1:
            draw_match(one, laid[place], text, window, cell)
        else:
            draw_overlap(one, laid[place], text, cell)
        draw_viewpoint(one, result.laid, QUERY)
        draw_viewpoint(one, np.zeros(3), HIT)
        entitle(one, f"{place + 1}.  {short(result.hit.map_id)}", _fit(result))
    for one in axes[: len(shown) + 1]:
        one.set(xlim=box[:, 0], ylim=box[:, 1])
        make_metric(one)
    for one in axes[len(shown) + 1 :]:
        one.remove()
    marks = [
        mark(QUERY, "query"),
        mark(HIT, "map of the index"),
        mark(MATCHED, "same word within the window", "-") if window > 1 else mark(MATCHED, "both"),
    ]
    if reason:
        figure.suptitle(reason, fontsize=10, color=INK)
    if any(len(text.free) for text in (query, *(text for _, text in shown))):
        marks.append(mark(FREE_EDGE, "seen to be free", "", "s"))
    figure.legend(handles=marks, loc="outside lower center", ncols=len(marks), frameon=False, fontsize=9)
    save(figure, path)


def _fit(result: Found) -> str:
    degrees = round(np.degrees(result.laid[2])) % 360
    fit = f"score {result.hit.score:.4g}, {result.hit.matched} matched"
    if result.inlier_ratio is not None:
        fit = f"score {result.hit.score:.4g}, {result.inlier_ratio:.0%} inliers"
    if result.conflict_ratio is not None:
        fit += f", {result.conflict_ratio:.0%} conflicts"
    return f"{fit}, query turned by {degrees}°" if degrees else fit


def plot_document(text: Text, document: Document | None, cell: float, path: Path) -> None:
    """A text: keypoints by appearance word, and of the map that it describes, if there is one, its poses."""
    places = [metres(text, cell), free_corners(text, cell).reshape(-1, 2)]
    if document is not None:
        to_view = inverse(document.viewpoint)
        centre = transform(to_view, document.centre_of_gravity[None])
        places += [centre, to_view[None, :2]]
    box = _box(np.concatenate(places))
    width, height = (6.0 / _aspect(box), 6.0) if _aspect(box) > 1 else (6.0, 6.0 * _aspect(box))
    figure = Figure((width + 1.8, height + 1.2), layout="compressed", facecolor="white")
    axes = figure.subplots()
    draw_free(axes, text, cell, edges=True)
    words = draw_words(axes, text, cell)
    marks = [mark(INK, "viewpoint and direction")]
    if len(text.free):
        marks.append(mark(FREE_EDGE, "free squares", "", "s"))
    if document is not None:
        draw_viewpoint(axes, to_view, LATER)
        axes.plot(*centre[0], "+", ms=13, mew=2, color=MATCHED, zorder=7)
        marks += [mark(LATER, "robot at the first scan"), mark(MATCHED, "centre of gravity", "", "+")]
    draw_viewpoint(axes, np.zeros(3), INK)
    axes.set(xlim=box[:, 0], ylim=box[:, 1])
    title = short(document.map_id, 60) if document else "text"
    free = f", {len(text.free)} free squares" if len(text.free) else ""
    entitle(axes, title, f"{len(text)} keypoints, {text.words} different words{free}")
    make_metric(axes)
    if len(words):
        _explain_words(figure, axes, words)
    figure.legend(handles=marks, loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    save(figure, path)


def _explain_words(figure: Figure, axes: Axes, words: NDArray[np.int64]) -> None:
    """A bar with a field for each word of a text, of which as many are named as can be read."""
    colours = ScalarMappable(Normalize(-0.5, len(words) - 0.5), word_colours(len(words)))
    named = np.unique(np.linspace(0, len(words) - 1, min(len(words), NAMED)).round().astype(int))
    bar = figure.colorbar(colours, ax=axes, label="appearance word $w_a$", shrink=0.7, ticks=named)
    bar.ax.set_yticklabels([str(word) for word in words[named]], fontsize=8)
    bar.ax.minorticks_off()
    bar.outline.set_edgecolor(PALE)


def plot_overview(walls: Floats, first: Floats, later: Floats, visits: Sequence[Visit], path: Path) -> None:
    """A building (N, 2) with two drives (S, 2), and the places that were looked up on the later one."""
    box = _box(np.vstack([walls, first, later]))
    figure = Figure(
        (10.0, float(np.clip(9.0 * _aspect(box), 3.0, 12.0)) + 1.8), layout="compressed", facecolor="white"
    )
    axes = figure.subplots()
    draw_walls(axes, walls)
    axes.plot(*first.T, color=FIRST, lw=5, alpha=0.45, solid_capstyle="round")
    axes.plot(*later.T, color=LATER, lw=1.5)
    drawn = sorted(visits, key=lambda visit: (visit.answered, not visit.right))  # wrong answers on top
    colours = [visit.colour for visit in drawn]
    links = np.array([(visit.query, visit.hit) for visit in drawn]).reshape(-1, 2, 2)
    widths = [1.4 if visit.answered else 0.7 for visit in drawn]
    axes.add_collection(LineCollection(list(links), colors=colours, lw=widths, alpha=0.8, zorder=4))
    axes.scatter(links[:, 0, 0], links[:, 0, 1], c=colours, s=28, zorder=5, edgecolors="white", lw=0.6)
    answered = [visit.right for visit in visits if visit.answered]
    axes.set(xlim=box[:, 0], ylim=box[:, 1])
    entitle(
        axes,
        "Places of the later visit, found again by their texts",
        f"{len(visits)} places: {sum(answered)} of {len(answered)} answers right, "
        f"{len(visits) - len(answered)} withheld",
    )
    make_metric(axes)
    marks = [
        mark(FIRST, "first visit, indexed", "-"),
        mark(LATER, "later visit", "-"),
        mark(QUERY, "place, linked with its best hit: right"),
        mark(MATCHED, "wrong"),
        mark(WITHHELD, "withheld: no `match`"),
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    save(figure, path)


def save(figure: Figure, path: Path) -> None:
    """Write a figure; the file appears whole or not at all."""
    check_picture(path)
    FigureCanvasAgg(figure)
    ending = path.suffix.lower()
    metadata: dict[str, None] = {"Software": None} if ending == ".png" else {}
    try:
        with written_whole(path) as temporary, warnings.catch_warnings():
            # A name may hold letters that the font lacks.
            warnings.filterwarnings("ignore", message="Glyph", category=UserWarning)
            figure.savefig(temporary, dpi=110, metadata=metadata, bbox_inches="tight", pad_inches=0.12)
    except OSError as error:
        raise M2TError(f"cannot write {str(path)!r}: {error.strerror or error}") from error


def short(name: str, length: int = TITLE) -> str:
    """A name cut in its middle, its end kept: that is where the scan number stands."""
    return name if len(name) <= length else name[: length - 15] + "…" + name[-14:]


def _box(points: Floats) -> Floats:
    """(2, 2) least and greatest x and y, with a margin and room for the arrow at the origin."""
    low, high = points.min(axis=0, initial=-ARROW), points.max(axis=0, initial=ARROW)
    return np.array([low - 0.4, high + 0.4])


def _aspect(box: Floats) -> float:
    """Height by width, within what a page holds."""
    width, height = box[1] - box[0]
    return float(np.clip(height / width, 0.3, 2.0))
