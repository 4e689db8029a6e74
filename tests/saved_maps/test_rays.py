"""Rays through a grid: by hand, and against ones that go in tiny steps."""

import math
from itertools import product

import numpy as np
import pytest
from drawings import drawn
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numba import njit
from numpy.typing import NDArray

from m2t_text.saved_maps import rays
from m2t_text.saved_maps.grid import FREE, OCCUPIED, UNKNOWN, States
from m2t_text.saved_maps.rays import Beams, nearest_open, passed_free, seen

CORRIDOR = drawn(
    "########",
    "#.. ...#",
    "########",
)
STEP = 1e-3  # cells; of the slow ray


@njit
def cast(states, x, y, angle, reach, veil):
    return rays.cast(states, x, y, angle, reach, veil)


@njit
def add_along(sums, stamps, stamp, begin, end, value):
    rays.add_along(sums, stamps, stamp, begin, end, value)


def slow_cells(x: float, y: float, angle: float, reach: float) -> list[tuple[int, int, float]]:
    """(column, row, cells gone) at tiny steps along a ray."""
    gone = np.arange(0.0, reach, STEP)
    places = np.column_stack([x + gone * math.cos(angle), y + gone * math.sin(angle)])
    return [(i, j, g) for (i, j), g in zip(np.floor(places).astype(int).tolist(), gone.tolist(), strict=True)]


def slow_cast(states: States, x: float, y: float, angle: float, reach: float, veil: float) -> float:
    rows, columns = states.shape
    dark, hit = 0.0, []
    for i, j, gone in slow_cells(x, y, angle, reach + 2.0):
        inside = 0 <= i < columns and 0 <= j < rows
        if hit and (not inside or (i, j) != hit[0][:2]):
            break
        if not inside:
            return math.inf
        if states[j, i] == OCCUPIED:
            hit.append((i, j, gone))
        dark += STEP * (states[j, i] == UNKNOWN)
        if dark > veil:
            return math.inf
    middle = (hit[0][2] + hit[-1][2]) / 2 if hit else math.inf
    return middle if middle <= reach else math.inf


def test_a_ray_ends_in_the_middle_of_the_first_wall() -> None:
    assert cast(CORRIDOR, 1.5, 1.5, math.pi, 9.0, 0.0) == pytest.approx(1.0)
    assert cast(CORRIDOR, 1.5, 1.5, math.pi / 2, 9.0, 0.0) == pytest.approx(1.0)
    assert cast(CORRIDOR, 4.5, 1.5, 0.0, 9.0, 0.0) == pytest.approx(3.0)
    # Rising by 1 in 5: it meets the upper wall at x = 3.75, and leaves that cell of it at x = 4.
    assert cast(CORRIDOR, 1.25, 1.5, math.atan2(1, 5), 9.0, 1.0) == pytest.approx(2.625 * math.hypot(1, 0.2))


def test_a_ray_has_an_end() -> None:
    assert cast(CORRIDOR, 4.5, 1.5, 0.0, 2.9, 0.0) == math.inf
    assert cast(CORRIDOR, 4.5, 1.5, 0.0, 3.1, 0.0) == pytest.approx(3.0)
    assert cast(np.full((3, 3), FREE, dtype=np.int8), 1.5, 1.5, 0.3, 9.0, 0.0) == math.inf


def test_a_ray_passes_a_veil_of_unknown_space_and_no_more() -> None:
    assert cast(CORRIDOR, 1.5, 1.5, 0.0, 9.0, 0.9) == math.inf
    assert cast(CORRIDOR, 1.5, 1.5, 0.0, 9.0, 1.1) == pytest.approx(6.0)


def some_grid(seed: int) -> States:
    kinds = np.array([FREE, OCCUPIED, UNKNOWN], dtype=np.int8)
    return np.random.default_rng(seed).choice(kinds, (7, 9), p=[0.7, 0.15, 0.15])


GRIDS = st.integers(0, 2**32 - 1).map(some_grid)


@example(some_grid(146760), 3.0, 3.0, 4.0, 1.0).via("a ray that begins in a corner")
@settings(max_examples=30, deadline=None)
@given(GRIDS, st.floats(0.1, 8.9), st.floats(0.1, 6.9), st.floats(-4.0, 4.0), st.floats(0.5, 9.0))
def test_a_ray_goes_where_one_of_tiny_steps_goes(
    states: States, x: float, y: float, angle: float, reach: float
) -> None:
    veil = 0.77
    slow = slow_cast(states, x, y, angle, reach, veil)
    near = [
        cast(states, x + dx, y + dy, angle + turn, reach + more, veil)
        for dx, dy, turn, more in product((-1e-4, 0, 1e-4), (-1e-4, 0, 1e-4), (-2e-3, 0, 2e-3), (0, -5e-3))
    ]
    # A ray that grazes a corner, or begins or ends in one, may go either way; a neighbour goes as the slow one.
    assert any(fast == slow == math.inf or abs(fast - slow) < 0.03 for fast in near)


def test_a_run_sees_from_all_its_places_and_ends_at_the_wall() -> None:
    allowed = CORRIDOR == FREE
    beams = Beams(np.array([0.0, math.pi / 2]), 9.0, 2.0)
    points, scans = seen(CORRIDOR, allowed, np.array([4.5, 1.5, 0.0]), beams, 9, 1.0)
    assert scans == 3
    assert points == pytest.approx(
        np.array([[7.5, 1.5], [4.5, 2.5], [7.5, 1.5], [5.5, 2.5], [7.5, 1.5], [6.5, 2.5]])
    )
    assert (
        seen(CORRIDOR, allowed, np.array([1.5, 1.5, 0.0]), beams, 9, 1.0)[1] == 2
    )  # the unknown is not allowed


@settings(max_examples=30, deadline=None)
@given(GRIDS, st.integers(1, 5))
def test_each_square_gets_its_allowed_cell_nearest_to_the_middle(states: States, side: int) -> None:
    allowed = states == FREE
    expected = []
    for low in range(0, allowed.shape[0], side):
        for left in range(0, allowed.shape[1], side):
            j, i = np.nonzero(allowed[low : low + side, left : left + side])
            if len(i):
                away = np.hypot(i + 0.5 - side / 2, j + 0.5 - side / 2)
                best = int(np.argmin(away.round(9)))
                expected.append((left + i[best] + 0.5, low + j[best] + 0.5))
    assert nearest_open(allowed, side).tolist() == [list(place) for place in expected]


@settings(max_examples=25, deadline=None)
@given(st.floats(0.1, 8.9), st.floats(0.1, 6.9), st.floats(-2.0, 11.0), st.floats(-2.0, 9.0))
def test_beams_pass_the_cells_before_their_last(x: float, y: float, to_x: float, to_y: float) -> None:
    assume(min(abs(to_x - round(to_x)), abs(to_y - round(to_y))) > 1e-9)  # by rounding, in either cell
    passed: NDArray[np.float32] = np.zeros((7, 9), dtype=np.float32)
    stamps: NDArray[np.int32] = np.zeros((7, 9), dtype=np.int32)
    for _ in range(2):  # the second time, all cells bear the stamp
        add_along(passed, stamps, 1, np.array([x, y]), np.array([to_x, to_y]), 1.0)
    assert ((stamps == 1) == (passed == 1)).all()
    length = math.hypot(to_x - x, to_y - y)
    cells = slow_cells(x, y, math.atan2(to_y - y, to_x - x), length)
    last = (math.floor(to_x), math.floor(to_y))
    slow = {(j, i) for i, j, _ in cells if (i, j) != last and 0 <= i < 9 and 0 <= j < 7}
    fast = set(zip(*(axis.tolist() for axis in np.nonzero(passed)), strict=True))
    assert passed.max(initial=0) <= 1
    assert slow <= fast  # and what the tiny steps jump over are corners:
    for j, i in fast - slow:
        assert (
            min(
                math.hypot(a - x - g * (to_x - x), b - y - g * (to_y - y))
                for a in (i, i + 1)
                for b in (j, j + 1)
                for g in np.linspace(0, 1, 2001)
            )
            < 0.02
        )


def test_beams_pass_free_cells_up_to_what_they_meet() -> None:
    ahead = Beams(np.array([0.0]), 9.0, 2.0)
    cells, column, row = passed_free(CORRIDOR, np.array([[1.5, 1.5]]), ahead)
    found = {(i + column, j + row) for i, j in np.argwhere(cells).tolist()}
    assert found == {(1, 1), (2, 1), (4, 1), (5, 1), (6, 1)}  # the one in the middle is unknown
    short = Beams(np.array([0.0, math.pi]), 9.0, 0.5)
    cells, column, row = passed_free(CORRIDOR, np.array([[2.5, 1.5], [1.5, 1.5]]), short)
    assert {(i + column, j + row) for i, j in np.argwhere(cells).tolist()} == {(1, 1), (2, 1)}


@given(st.floats(0.1, 7.9), st.floats(0.1, 7.9), st.floats(-4, 4), st.integers(0, 2**32))
@settings(max_examples=60)
def test_passed_cells_are_those_of_tiny_steps(x: float, y: float, angle: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    states = rng.choice(np.array([FREE] * 8 + [OCCUPIED, UNKNOWN], dtype=np.int8), (8, 8))
    cells, column, row = passed_free(states, np.array([[x, y]]), Beams(np.array([angle]), 6.0, 9.0))
    found = {(i + column, j + row) for i, j in np.argwhere(cells).tolist()}
    slow = set()
    for i, j, _ in slow_cells(x, y, angle, 6.0):
        if not (0 <= i < 8 and 0 <= j < 8) or states[j, i] == OCCUPIED:
            break
        slow |= {(i, j)} if states[j, i] == FREE else set()
    assert slow <= found and len(found - slow) <= 2  # tiny steps may miss the corner of a cell
    assert all(states[j, i] == FREE for i, j in found)
