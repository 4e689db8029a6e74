"""The text: tokens and arrays are two forms of one thing, and a broken text says where it is broken."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from m2t_text.description.text import POSES, Text, parse
from m2t_text.errors import TextError

WORDS = st.tuples(st.sampled_from(POSES), st.sampled_from(POSES), st.integers(0, 1023))


def of(rows) -> Text:
    return Text.of(*np.array(rows, dtype=np.int64).reshape(-1, 3).T)


def test_a_text_is_its_tokens_in_the_order_of_words():
    text = of([[12, -3, 517], [0, 5, 4], [-1, 5, 4], [0, 5, 4]])
    assert str(text) == "x-1_y5_a4 x0_y5_a4 x0_y5_a4 x12_y-3_a517"
    assert len(text) == 4 and text.words == 2


@given(st.lists(WORDS, max_size=30))
def test_text_and_arrays_are_the_same_thing(rows):
    text = of(rows)
    again = parse(str(text))
    assert str(again) == str(text)
    assert all(np.array_equal(getattr(again, name), getattr(text, name)) for name in ("wx", "wy", "wa"))


@given(st.text(max_size=60))
def test_any_string_is_a_text_or_a_text_error(string):
    try:
        text = parse(string)
    except TextError:
        return
    assert str(text).split() == sorted(str(text).split(), key=str(text).split().index)
    assert len(text) == len(string.split())


@pytest.mark.parametrize(
    "broken",
    [
        "x1_y2",
        "x1_y2_a1024",
        "x1_y2_a-1",
        "x1.5_y2_a3",
        "x40000_y0_a1",
        "X1_Y2_A3",
        "x1_y2_a3,",
        "x٣_y2_a3",
        "x" * 99,
    ],
)
def test_a_broken_token_is_named_with_its_position(broken):
    with pytest.raises(TextError, match=r"token 3 is 'x"[:-2]) as error:
        parse(f"x0_y0_a0 x1_y1_a1 {broken} also_broken")
    assert "\n" not in str(error.value) and len(str(error.value)) < 300


@pytest.mark.parametrize("rows", [[[32768, 0, 0]], [[0, -32769, 0]], [[0, 0, 1024]], [[0, 0, -1]]])
def test_words_out_of_range_are_refused(rows):
    with pytest.raises(TextError):
        of(rows)


def test_a_quarter_turn_by_hand():
    # The cell ahead (0...0.1, 0...0.1) of the viewpoint turns to the one on its left (-0.1...0, 0...0.1).
    assert str(of([[0, 0, 7], [9, -1, 7]]).turned(1)) == "x-1_y0_a7 x0_y9_a7"


@given(st.lists(WORDS, max_size=20), st.integers(-9, 9))
def test_four_quarters_are_a_whole_turn(rows, quarters):
    text = of(rows)
    assert str(text.turned(quarters).turned(4 - quarters)) == str(text)


@given(arrays(np.int64, (12, 3), elements=st.integers(0, 99)), st.integers(0, 3))
def test_moving_by_a_quarter_is_turning(rows, quarter):
    text = of(rows)
    assert str(text.moved([0.0, 0.0, quarter * np.pi / 2], 0.1)) == str(text.turned(quarter))


def test_moving_by_whole_cells_is_exact():
    assert str(of([[3, -4, 9]]).moved([0.2, -0.5, 0.0], 0.1)) == "x5_y-9_a9"
