"""Pictures: that they are made for whatever there is to draw, and what they claim."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from m2t_text.config import PROFILES
from m2t_text.description.document import Document
from m2t_text.description.free_squares import FreeSquares
from m2t_text.description.text import Text
from m2t_text.errors import M2TError
from m2t_text.index.results import Hit
from m2t_text.plotting import canvas, pictures
from m2t_text.plotting.canvas import correspondences
from m2t_text.recognition.found import Found

PARAMETERS = PROFILES["paper"]
PNG, EMPTY = b"\x89PNG", Text.of([], [], [])
SQUARE = Text.of([0, 10, 10, 0], [0, 0, 20, 20], [5, 5, 700, 1023])


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of fewer dots, which take less time to draw."""
    savefig = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda *what, **how: savefig(*what, **how | {"dpi": 30}))


def document(dataset: str = "fr101", text: Text = SQUARE) -> Document:
    return Document(
        dataset=dataset,
        first_scan=12,
        last_scan=15,
        travel=np.array([3.0, 6.0]),
        pose=np.zeros(3),
        viewpoint=np.array([1.0, 2.0, 0.5]),
        centre_of_gravity=np.array([1.2, 2.1]),
        points=len(text),
        text=text,
    )


def hits(count: int, dataset: str = "fr101", text: Text = SQUARE) -> list[tuple[Hit, Text]]:
    turns = [np.array([0.0, 0.0, k % 4 * np.pi / 2]) for k in range(count)]
    return [(Found(Hit(document(dataset, text), 0.5 / (k + 1), 4, turns[k])), text) for k in range(count)]


@pytest.mark.parametrize("count", [0, 9])
def test_any_number_of_hits_is_drawn(tmp_path: Path, count: int) -> None:
    pictures.plot_match(SQUARE, "query", hits(count), PARAMETERS, tmp_path / "match.png")
    assert (tmp_path / "match.png").read_bytes().startswith(PNG)


@pytest.mark.parametrize("text", [EMPTY, Text.of([3], [4], [5]), Text.of([-32767, 32767], [0, 0], [1, 2])])
def test_any_text_is_drawn(tmp_path: Path, text: Text) -> None:
    pictures.plot_match(text, "query", hits(1, text=text), PARAMETERS, tmp_path / "match.png")
    pictures.plot_document(text, document(text=text), 0.1, tmp_path / "map.png")
    assert all((tmp_path / name).stat().st_size > 1000 for name in ("match.png", "map.png"))


@pytest.mark.parametrize("ending", ["png", "PNG", "pdf", "svg"])
def test_a_picture_of_each_kind(tmp_path: Path, ending: str) -> None:
    pictures.plot_document(SQUARE, document(), 0.1, tmp_path / f"map.{ending}")
    assert [file.name for file in tmp_path.iterdir()] == [f"map.{ending}"]


def test_any_name_is_drawn_as_it_is(tmp_path: Path) -> None:
    names = ["$x^{2}$", "a_b%c", "日本", "n" * 200]
    found = [hit for name in names for hit in hits(1, name)]
    pictures.plot_match(SQUARE, names[0], found, PARAMETERS, tmp_path / "match.png")
    assert (tmp_path / "match.png").exists()
    pictures.plot_document(SQUARE, document("".join(names[:3])), 0.1, tmp_path / "map.png")
    assert (tmp_path / "map.png").exists()


def test_a_long_name_keeps_its_number() -> None:
    assert pictures.short("a" * 90 + "/000123").endswith("aaaaaa/000123")
    assert len(pictures.short("a" * 90 + "/000123")) == pictures.TITLE
    assert pictures.short("fr101/000123") == "fr101/000123"


def test_the_same_picture_twice_is_the_same_file(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        pictures.plot_match(SQUARE, "query", hits(1), PARAMETERS, tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize("count", [0, 3])
def test_an_overview_with_and_without_places(tmp_path: Path, count: int) -> None:
    ways = np.array([[0.0, 0.0], [4.0, 1.0], [8.0, 0.0]])
    visits = [pictures.Visit(way, way + 0.5, k > 0, k < 2) for k, way in enumerate(ways[:count])]
    pictures.plot_overview(ways + 1.0, ways, ways + 0.1, visits, tmp_path / "overview.png")
    assert (tmp_path / "overview.png").read_bytes().startswith(PNG)


def test_wrong_answers_are_red_and_withheld_ones_grey() -> None:
    here = np.zeros(2)
    colours = [
        pictures.Visit(here, here, right, answered).colour
        for right, answered in [(True, True), (False, True), (True, False), (False, False)]
    ]
    assert colours == [canvas.QUERY, canvas.MATCHED, canvas.WITHHELD, canvas.WITHHELD]


def test_words_that_are_near_have_colours_that_differ() -> None:
    """Of the 1024 words a text has a few dozen, most of them low: by value they would all be blue."""
    axes = Figure().subplots()
    words = [3, 5, 5, 6, 48, 1023]
    assert canvas.draw_words(axes, Text.of(range(6), [0] * 6, words), 0.1).tolist() == [3, 5, 6, 48, 1023]
    (drawn,) = axes.collections
    drawn.update_scalarmappable()
    colours = drawn.get_facecolors()[:, :3]
    assert np.array_equal(colours[1], colours[2])
    apart = np.abs(colours[:, None] - colours[None]).sum(axis=2)
    assert apart[np.not_equal.outer(words, words)].min() > 0.3


def test_the_bar_names_the_words(tmp_path: Path) -> None:
    pictures.plot_document(SQUARE, None, 0.1, tmp_path / "map.svg")
    assert all(f"<!-- {word} -->" in (tmp_path / "map.svg").read_text() for word in (5, 700, 1023))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("map.jpeg", "name a file that ends in .png, .pdf, .svg"),
        ("map", "name a file that ends in"),
        ("missing/map.png", "there is no folder"),
    ],
)
def test_a_wrong_file_is_told_before_the_work(tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(M2TError, match=message):
        pictures.check_picture(tmp_path / name)


def test_a_picture_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "map.png").mkdir()
    with pytest.raises(M2TError, match="cannot write"):
        pictures.plot_document(SQUARE, None, 0.1, tmp_path / "map.png")
    assert [file.name for file in tmp_path.iterdir()] == ["map.png"]


def test_correspondences_by_hand() -> None:
    query = Text.of([0, 0, 50], [0, 5, 0], [7, 8, 7])
    found = Text.of([3, 11, 0], [10, 0, 6], [7, 7, 9])
    # (0, 0, 7) has (3, 10, 7) in its window of 10 and not (11, 0, 7); the others have no partner.
    assert correspondences(query, found, 10).tolist() == [[0, 0]]
    assert correspondences(query, found, 9).tolist() == []
    assert correspondences(EMPTY, found, 10).shape == correspondences(query, EMPTY, 10).shape == (0, 2)


words = st.lists(st.tuples(st.integers(-20, 20), st.integers(-20, 20), st.integers(0, 3)), max_size=30)


@settings(max_examples=50, deadline=None)
@given(words, words, st.integers(0, 12))
def test_correspondences_are_the_nearest_of_those_in_the_window(
    first: list[tuple[int, int, int]], second: list[tuple[int, int, int]], window: int
) -> None:
    query, found = (Text.of(*np.array(w, dtype=np.int64).reshape(-1, 3).T) for w in (first, second))
    partners = dict(correspondences(query, found, window).tolist())
    for i in range(len(query)):
        apart = np.maximum(abs(found.wx - query.wx[i]), abs(found.wy - query.wy[i])).astype(float)
        apart[found.wa != query.wa[i]] = np.inf
        nearest = apart.min(initial=np.inf)
        assert (i in partners) == (nearest <= window)
        assert i not in partners or apart[partners[i]] == nearest


@pytest.mark.parametrize("cell", [0.1, 0.2])
def test_a_query_is_laid_on_a_hit_in_the_cells_of_its_index(tmp_path: Path, cell: float) -> None:
    """The offset of a hit is in metres: drawn with cells of another size, the query would miss it."""
    laid = np.array([20 * cell, 0.0, 0.0])
    query = SQUARE.moved(-laid, cell)
    axes = Figure().subplots()
    assert canvas.draw_overlap(axes, query.moved(laid, cell), SQUARE, cell) == len(SQUARE)
    shown = np.concatenate([line.get_xydata() for line in axes.lines])
    assert shown.max() == pytest.approx(20.5 * cell)  # the middle of the farthest cell

    drawn: list[Text] = []
    parameters = replace(PARAMETERS, mapping=replace(PARAMETERS.mapping, cell=cell))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "draw_match", lambda axes, text, found, window, cell: drawn.append(text))
        found = Found(Hit(document(), 0.5, 4, laid))
        pictures.plot_match(query, "query", [(found, SQUARE)], parameters, tmp_path / "match.png")
    assert str(drawn[0]) == str(SQUARE)


def test_free_squares_are_drawn_where_they_lie() -> None:
    text = Text.of([0], [0], [5], FreeSquares.of([10, -20], [-4, 6], [6, 4]))
    corners = canvas.free_corners(text, 0.5)
    assert corners[1].tolist() == [
        [5.0, -2.0],
        [8.0, -2.0],
        [8.0, 1.0],
        [5.0, 1.0],
    ]  # the larger
    axes = Figure().subplots()
    canvas.draw_free(axes, text, 0.5)
    (drawn,) = axes.collections
    assert [path.vertices[:4].tolist() for path in drawn.get_paths()] == corners.tolist()


@pytest.mark.parametrize("free", [FreeSquares.of([], [], []), FreeSquares.of([20, -2000], [4, 5], [9, 1000])])
def test_a_text_is_drawn_with_what_is_free_in_it(tmp_path: Path, free: FreeSquares) -> None:
    text = replace(SQUARE, free=free)
    pictures.plot_document(text, document(text=text), 0.1, tmp_path / "map.png")
    pictures.plot_match(text, "query", hits(1, text=text), PARAMETERS, tmp_path / "match.png")
    assert all((tmp_path / name).stat().st_size > 1000 for name in ("match.png", "map.png"))
