"""Free squares: what they cover is free, in any frame, and few of them cover most of it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from m2t_text.description.free_cells import MIN_NEW_CELLS, FreeSpace, covering, free_squares
from m2t_text.description.free_squares import CELL_RANGE, MAX_SIDE, MIN_SIDE, NO_SQUARES, CellGrid, FreeSquares
from m2t_text.description.text import Text, parse
from m2t_text.errors import TextError
from m2t_text.util.geometry import inverse, transform

SQUARE = st.tuples(st.integers(-60, 60), st.integers(-60, 60), st.integers(MIN_SIDE, 40))
SQUARES = st.lists(SQUARE, max_size=12).map(lambda rows: FreeSquares.of(*np.array(rows).reshape(-1, 3).T))
GRIDS = arrays(
    np.bool_, st.tuples(st.integers(0, 40), st.integers(0, 40)), elements=st.just(True), fill=st.booleans()
)
NOTHING = np.empty((0, 2), dtype=np.int64)


def cells_of(squares: FreeSquares) -> set[tuple[int, int]]:
    """By the definition, square by square."""
    return {
        (int(x) + i, int(y) + j)
        for x, y, side in zip(squares.wx, squares.wy, squares.size, strict=True)
        for i in range(side)
        for j in range(side)
    }


def marked(grid: CellGrid) -> set[tuple[int, int]]:
    return {(int(i) + grid.x, int(j) + grid.y) for i, j in np.argwhere(grid.cells)}


def with_holes(seed: int, shape: tuple[int, int], holes: int) -> CellGrid:
    rng = np.random.default_rng(seed)
    cells = np.ones(shape, dtype=np.bool_)
    cells[rng.integers(0, shape[0], holes), rng.integers(0, shape[1], holes)] = False
    return CellGrid(-7, 3, cells)


def test_free_tokens_stand_after_the_keypoints_the_smallest_first():
    text = parse("x8_y-4_f6 x12_y3_a517 x9_y-9_f4 x-3_y0_f4 x0_y5_a4")
    assert str(text) == "x0_y5_a4 x12_y3_a517 x-3_y0_f4 x9_y-9_f4 x8_y-4_f6"
    assert len(text) == 2 and len(text.free) == 3
    assert text.free.size.tolist() == [4, 4, 6]


def test_a_keypoint_in_a_free_square_is_refused_and_one_beside_it_is_not():
    for x, y in ((8, -4), (11, -1)):  # its corners
        with pytest.raises(TextError, match=f"x{x}_y{y}_a7 lies in a free square"):
            parse(f"x8_y-4_f4 x{x}_y{y}_a7")
    for x, y in ((7, -4), (12, -1), (8, -5), (11, 0)):
        assert len(parse(f"x8_y-4_f4 x{x}_y{y}_a7").free) == 1


@pytest.mark.parametrize(
    "token",
    [
        "x0_y0_f3",
        "x0_y0_f1024",
        "x2045_y0_f4",
        "x0_y-2049_f4",
        "x0_y0_f-4",
        "x0_y0_f4.5",
        "x0_y0_F4",
        "x0_y0_f",
    ],
)
def test_squares_out_of_range_are_refused(token):
    with pytest.raises(TextError, match="token 2 is "):
        parse(f"x1_y2_a3 {token}")


@pytest.mark.parametrize(
    "square",
    [(0, 0, 3), (0, 0, MAX_SIDE + 1), (CELL_RANGE.stop - 4, 0, 5), (0, CELL_RANGE[0] - 1, 9), (40_000, 0, 4)],
)
def test_no_such_squares_are_made(square):
    with pytest.raises(TextError, match="free square"):
        FreeSquares.of(*square)


@settings(max_examples=40)
@given(SQUARES)
def test_squares_cover_what_they_say(squares):
    covered = cells_of(squares)
    assert marked(squares.grid) == covered
    places = np.mgrid[-62:105:3, -62:105:3].reshape(2, -1).T + 0.4
    assert [tuple(np.floor(p).astype(int)) in covered for p in places] == squares.covers(places).tolist()


@given(SQUARES)
def test_squares_are_their_tokens(squares):
    again = parse(str(squares)).free
    assert str(again) == str(squares) and again.valid
    assert all(np.array_equal(a, b) for a, b in zip(vars(again).values(), vars(squares).values(), strict=False))


@settings(max_examples=40)
@given(SQUARES, st.integers(-5, 8))
def test_turned_squares_cover_the_turned_cells(squares, quarters):
    turned = cells_of(squares)
    for _ in range(quarters % 4):
        turned = {(-y - 1, x) for x, y in turned}
    assert cells_of(squares.turned(quarters)) == turned


@settings(max_examples=30)
@given(GRIDS, st.integers(-30, 30), st.integers(-30, 30))
def test_squares_lie_within_what_is_free(cells, x, y):
    free = CellGrid(x, y, cells)
    squares = covering(free)
    assert cells_of(squares) <= marked(free) and squares.valid


@pytest.mark.parametrize("seed", range(6))
def test_few_squares_cover_nearly_all_that_squares_can(seed):
    free = with_holes(seed, (70, 50), 25)
    squares = covering(free)
    corners = [(i, j) for i in range(67) for j in range(47) if free.cells[i : i + 4, j : j + 4].all()]
    possible = {(i + a - 7, j + b + 3) for i, j in corners for a in range(4) for b in range(4)}
    covered = cells_of(squares)
    assert covered <= possible and len(covered) > 0.9 * len(possible)
    assert (
        len(squares) < len(possible) / 20
    )  # nor is any in vain: each adds MIN_NEW_CELLS cells to those taken before it
    assert len(squares) * MIN_NEW_CELLS <= len(covered)


def test_a_free_square_is_covered_by_itself():
    cells = np.zeros((20, 30), dtype=np.bool_)
    cells[5:14, 10:19] = True
    assert str(covering(CellGrid(100, -50, cells))) == "x105_y-40_f9"
    assert str(covering(CellGrid(0, 0, cells[:, :13]))) == ""  # three cells wide


def test_what_is_too_far_away_is_left_out():
    free = CellGrid(CELL_RANGE.stop - 10, CELL_RANGE[0] - 3, np.ones((30, 30), dtype=np.bool_))
    assert max(x for x, _ in cells_of(covering(free))) == CELL_RANGE[-1]
    assert min(y for _, y in cells_of(covering(free))) == CELL_RANGE[0]
    assert not len(covering(CellGrid(5000, 0, np.ones((30, 30), dtype=np.bool_))))


def test_cells_near_what_is_occupied_are_not_free():
    free = FreeSpace(np.ones((60, 60), dtype=np.bool_), np.array([-3.0, -3.0, 0.0]), 0.1)
    squares = free_squares(free, np.array([[0, 0]]), 0.1)
    near = np.array([[0, 2], [2, 0], [-2, 0], [0, -2], [1, 1], [0, 0]])  # within 0.2 m, by their middles
    assert not squares.covers(near + 0.5).any()
    assert squares.covers(np.array([[0, 3], [3, 0], [-3, 0], [0, -3], [2, 2]]) + 0.5).mean() > 0.7


def test_cells_beside_what_no_beam_passed_are_not_free_unless_that_was_hit():
    """A lane one metre wide, passed throughout, with a wall along the middle of one side."""
    lane = FreeSpace(np.zeros((60, 20), dtype=np.bool_), np.zeros(3), 0.1)
    lane.cells[:, 5:15] = True
    wall = np.array([[i, 17] for i in range(20, 40)])
    squares = free_squares(lane, wall, 0.1)
    assert squares.covers([[30.5, 14.5]]).all()  # up to the last cell passed, two cells from the wall
    assert not squares.covers([[30.5, 5.5], [5.5, 14.5], [0.5, 10.5], [59.5, 10.5]]).any()
    assert squares.covers([[30.5, 6.5], [5.5, 13.5], [1.5, 10.5], [58.5, 10.5]]).all()


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (1.3, -0.4, 0.3), (-2.0, 5.0, -2.5), (0.05, 0.0, np.pi / 2)])
def test_what_is_free_is_found_again_in_another_frame(pose):
    """A hall of 8 by 6 m about the origin of its own frame, whose grid is finer than the cells of squares."""
    hall = FreeSpace(np.ones((160, 120), dtype=np.bool_), np.array([-4.0, -3.0, 0.0]), 0.05)
    squares = free_squares(hall.seen_from(inverse(np.array(pose))), NOTHING, 0.1)
    places = (np.argwhere(squares.grid.cells) + [squares.grid.x, squares.grid.y] + 0.5) * 0.1
    own = np.abs(transform(inverse(np.array(pose)), places))
    assert (own[:, 0] <= 4.0 + 1e-9).all() and (own[:, 1] <= 3.0 + 1e-9).all()
    assert len(places) * 0.01 > 0.93 * 7.8 * 5.8  # not where no beam passed the cell beside


def test_nothing_seen_is_nothing_free():
    nowhere = FreeSpace(np.zeros((9, 9), dtype=np.bool_), np.zeros(3), 0.1)
    assert not len(free_squares(nowhere, NOTHING, 0.1)) and not len(NO_SQUARES.grid.cells)
    assert not NO_SQUARES.covers([[0.5, 0.5]]).any()
    assert str(Text.of([1], [2], [3])) == "x1_y2_a3"


@given(st.lists(SQUARE, max_size=8), st.floats(-3, 3), st.floats(-3, 3), st.floats(-4, 4))
def test_a_moved_text_does_not_contradict_itself(rows, x, y, theta):
    free = FreeSquares.of(*np.array(rows).reshape(-1, 3).T)
    beside = [
        (i, j) for i, j in np.random.default_rng(0).integers(-90, 90, (40, 2)) if not free.covers([(i, j)])
    ]
    text = Text.of(*np.array(beside).reshape(-1, 2).T, np.zeros(len(beside)), free)
    moved = text.moved([x, y, theta], 0.1)
    assert not moved.contradicts_itself
    back = transform(inverse([x, y, theta]), (np.argwhere(moved.free.grid.cells) + 0.5) * 0.1)
    offset = transform(inverse([0, 0, theta]), [[moved.free.grid.x * 0.1, moved.free.grid.y * 0.1]])
    assert free.covers((back + offset) / 0.1).all()
