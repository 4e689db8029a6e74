"""The optimiser: against hand-computed graphs, GTSAM and finite differences; and one wrong loop put in."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gtsam_oracle import optimise_g2o

from m2t_text.loops.detection import LoopDetection
from m2t_text.loops.export import to_g2o, write
from m2t_text.loops.graph import pose_graph
from m2t_text.slam.correction import constraints_of
from m2t_text.slam.optimisation import Constraints, _slopes, optimise, optimise_gradually, robust_weights
from m2t_text.util.geometry import between, compose


def constraints(pairs: list[tuple[int, int]], poses: np.ndarray, robust: bool = False) -> Constraints:
    count = len(pairs)
    return Constraints(
        np.array(pairs, dtype=np.int64),
        np.asarray(poses, dtype=float),
        np.broadcast_to(np.eye(3) * 100.0, (count, 3, 3)),
        np.full(count, robust),
    )


def circle(count: int) -> np.ndarray:
    """Poses that drive once round a circle of 10 m, back to where they began."""
    angle = np.linspace(0, 2 * np.pi, count + 1)
    return np.column_stack([10 * np.sin(angle), 10 - 10 * np.cos(angle), angle])


def test_two_measurements_of_one_step_meet_in_the_middle():
    both = constraints([(0, 1), (0, 1)], np.array([[1.0, 0.0, 0.0], [2.0, 1.0, 0.2]]))
    found = optimise(np.zeros((2, 3)), both)
    assert found == pytest.approx(np.array([[0, 0, 0], [1.5, 0.5, 0.1]]), abs=1e-4)


def test_consistent_constraints_are_met_from_a_bad_start():
    truth = circle(40)
    pairs = [(k, k + 1) for k in range(40)] + [(0, 40), (10, 30)]
    measured = constraints(pairs, [between(truth[i], truth[j]) for i, j in pairs])
    start = compose(truth, np.random.default_rng(0).normal(0, 0.2, truth.shape) * [1, 1, 0.3])
    start[0] = truth[0]
    found = optimise(start, measured)
    assert np.abs(between(truth, found)).max() < 1e-5


def test_slopes_are_derivatives():
    rng = np.random.default_rng(1)
    vertices, measured = rng.normal(0, 1, (4, 3)), constraints([(0, 1), (3, 2)], rng.normal(0, 1, (2, 3)))
    slopes, step = _slopes(measured, vertices), 1e-6
    for row, pair in enumerate(measured.pairs):
        for side in range(2):
            for axis in range(3):
                moved = vertices.copy()
                moved[pair[side], axis] += step
                numeric = (measured.errors(moved)[row] - measured.errors(vertices)[row]) / step
                assert slopes[row, :, 3 * side + axis] == pytest.approx(numeric, abs=1e-5)


def test_gtsam_finds_the_same_poses(detection: LoopDetection, tmp_path: Path):
    graph = pose_graph(detection)
    write(tmp_path / "graph.g2o", to_g2o(graph))
    found = optimise(graph.vertices, constraints_of([*graph.steps, *graph.loops], robust=False))
    assert np.abs(found - graph.vertices).max() > 0.05
    assert np.abs(between(optimise_g2o(tmp_path / "graph.g2o"), found)).max() < 1e-3


def test_one_wrong_loop_is_overruled_only_where_constraints_are_robust():
    truth = circle(60)
    steps = [(k, k + 1) for k in range(60)]
    loops = [(k, 60 - k) for k in range(3)] + [(0, 58), (2, 59)]
    right = [between(truth[i], truth[j]) for i, j in steps + loops]
    wrong = compose(between(truth[5], truth[35]), [4.0, -3.0, 1.0])
    certain = replace(constraints(steps, right[:60]), information=np.tile(np.eye(3) * 1e4, (60, 1, 1)))
    worst = {}
    for robust in (False, True):
        unsure = constraints([*loops, (5, 35)], [*right[60:], wrong], robust)
        found = optimise(truth, certain.joined(unsure))
        worst[robust] = np.hypot(*(found - truth).T[:2]).max()
        weights = robust_weights(unsure, found)
    assert worst[False] > 1.0 and worst[True] < 0.15
    assert weights[:-1].min() > 0.9 and weights[-1] < 0.05


def test_right_loops_that_look_wrong_at_first_win_gradually():
    """A drive slipped by 3 m at one step, so that all its loops contradict the rest."""
    truth = np.column_stack([np.r_[0:20.0, 20.0:0:-1], np.repeat([0.0, 1.0], 20), np.zeros(40)])
    steps = [(k, k + 1) for k in range(39)]
    loops = [(39 - k, k) for k in range(12)]
    measured = [between(truth[i], truth[j]) for i, j in steps]
    slipped = [step + np.array([3.0, 0.0, 0.0]) if k == 25 else step for k, step in enumerate(measured)]
    start = np.concatenate([truth[:26], truth[26:] + np.array([3.0, 0.0, 0.0])])
    tied = [between(truth[i], truth[j]) for i, j in loops]
    stiff = replace(constraints(steps, slipped, robust=True), information=np.tile(np.eye(3) * 1e4, (39, 1, 1)))
    firm = replace(constraints(loops, tied, robust=True), information=np.tile(np.eye(3) * 1e3, (12, 1, 1)))
    graph = stiff.joined(firm)
    at_once, gradually = (
        robust_weights(graph, found(start, graph)) for found in (optimise, optimise_gradually)
    )
    assert at_once[39:].mean() < 0.1
    assert gradually[39:].min() > 0.6


def test_what_nothing_ties_stays_where_it_is():
    start = np.array([[0.0, 0, 0], [1, 0, 0], [5, 5, 1], [6, 5, 1]])
    tied = constraints([(0, 1)], np.array([[2.0, 0, 0]]))
    found = optimise(start, tied)
    assert found == pytest.approx(np.array([[0, 0, 0], [2, 0, 0], [5, 5, 1], [6, 5, 1]]), abs=1e-4)
    assert (optimise(start, tied.chosen(np.zeros(1, dtype=bool))) == start).all()


def test_information_that_says_nothing_of_a_direction_is_no_singular_matrix():
    """A corridor: two poses that only agree across it."""
    across = Constraints(
        np.array([[0, 1]]), np.zeros((1, 3)), np.diag([0.0, 100.0, 100.0])[None], np.zeros(1, dtype=bool)
    )
    found = optimise(np.array([[0.0, 0, 0], [3.0, 1.0, 0.1]]), across)
    assert np.isfinite(found).all() and abs(found[1, 1]) < 1e-3 and abs(found[1, 2]) < 1e-3
