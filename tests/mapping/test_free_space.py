"""What beams passed: by hand for single beams, and against the true walls of a simulated building."""

from dataclasses import replace

import numpy as np
import pytest

from m2t_text.config import PROFILES, MappingParameters
from m2t_text.logs.log import Log, Scan
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.mapping.free_space import Beams, FreeScans, longest_reading
from m2t_text.mapping.local_map import Survey, local_maps
from m2t_text.mapping.trajectory import hits
from m2t_text.pipeline import describe
from m2t_text.util.geometry import compose, transform

LONGEST = 40.0  # m


def log_of(*beams: list[tuple[float, float]], laser: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Log:
    """One scan for each list of beams, which are (degrees, metres)."""
    scans = [
        Scan(
            np.array([metres for _, metres in part]), np.radians([degrees for degrees, _ in part]), np.zeros(3)
        )
        for part in beams
    ]
    return Log("by-hand", tuple(scans), np.array(laser))


def passed(log: Log, poses: list[list[float]], cell: float = 0.1, limit: float = 8.0) -> set[tuple[int, int]]:
    """The cells that the beams of the scans pass, in the frame of the poses; an earlier reading was longer."""
    trajectory = np.array(poses)
    free = FreeScans(Beams.of(log, limit, LONGEST), trajectory, cell).together(np.arange(len(poses)))
    assert free.pose[2] == 0.0 and free.cell == cell
    middles = transform(compose(trajectory[0], free.pose), (np.argwhere(free.cells) + 0.5) * cell)
    return {(int(x), int(y)) for x, y in np.floor(middles / cell)}


def test_a_beam_passes_the_cells_before_what_it_hits():
    cells = passed(log_of([(0.0, 1.0)]), [[0.05, 0.05, 0.0]])
    assert cells == {(i, 0) for i in range(8)}  # up to 0.05 + 1.0 - 0.25 m, so in steps of 0.1 m up to 0.75


def test_the_laser_may_sit_and_look_elsewhere_than_the_robot():
    cells = passed(log_of([(0.0, 1.0)], laser=(0.2, 0.0, np.pi / 2)), [[0.05, 0.05, 0.0]])
    assert cells == {(2, j) for j in range(8)}


def test_a_run_passes_what_its_scans_pass():
    log = log_of([(0.0, 0.5)], [(90.0, 0.5)])
    cells = passed(log, [[0.05, 0.05, 0.0], [1.05, 0.05, 0.0]])
    assert cells == {(i, 0) for i in range(3)} | {(10, j) for j in range(3)}


@pytest.mark.parametrize("reading", [np.inf, LONGEST, 0.99 * LONGEST, 0.0, 0.2])
def test_beams_that_say_nothing(reading):
    """Of those that did not return, and those that are as long as any; the shortest ones pass nothing."""
    assert passed(log_of([(0.0, reading)]), [[0.05, 0.05, 0.0]]) <= {(0, 0)}
    if reading not in (0.2, 0.0):
        assert Beams.of(log_of([(0.0, reading)]), 8.0, LONGEST).lengths[0] == 0.0


def test_a_far_hit_leaves_all_free_up_to_the_range_limit():
    cells = passed(log_of([(0.0, 30.0)]), [[0.05, 0.05, 0.0]], limit=2.0)
    assert cells == {(i, 0) for i in range(21)}


def test_nothing_hides_between_beams_that_lie_close_and_both_pass():
    close = passed(log_of([(0.0, 6.0), (1.5, 6.0)]), [[0.05, 0.05, 0.0]])
    assert (50, 0) in close and (50, 1) in close  # 0.13 m apart there: each cell between them is passed
    between = passed(log_of([(0.0, 6.0), (2.0, 6.0)]), [[0.05, 0.05, 0.0]])
    assert {(48, 0), (48, 1), (48, 2)} <= between or {(48, 0), (48, 1)} <= between
    apart = passed(log_of([(0.0, 6.0), (10.0, 6.0)]), [[0.05, 0.05, 0.0]])
    assert (50, 4) not in apart and (50, 0) in apart
    shorter = passed(log_of([(0.0, 6.0), (1.5, np.inf)]), [[0.05, 0.05, 0.0]])
    assert shorter == {(i, 0) for i in range(58)}


def test_maps_share_what_single_scans_passed():
    log = simulate(Simulation(seed=2, length=24.0, travel=14.0))
    assert log.ground_truth is not None
    beams = Beams.of(log, 8.0)
    whole = FreeScans(beams, log.ground_truth, 0.1)
    for first in (0, 3, 10):
        run = np.arange(first, first + 12)
        one, again = whole.together(run), FreeScans(beams, log.ground_truth, 0.1).together(run)
        assert np.array_equal(one.cells, again.cells) and np.array_equal(one.pose, again.pose)


@pytest.mark.parametrize("seed", [3, 4])
def test_nothing_that_is_occupied_is_called_free(seed):
    """Walls of the simulated building, seen from true poses: an oracle that the method does not read."""
    log = simulate(Simulation(seed=seed, length=24.0, travel=20.0, people=0, range_noise=0.0))
    parameters = PROFILES["default"]
    assert log.ground_truth is not None
    points, starts = hits(log, 30.0)
    walls = np.concatenate(
        [transform(pose, points[starts[k] : starts[k + 1]]) for k, pose in enumerate(log.ground_truth)]
    )
    survey = Survey(*hits(log, 8.0), log.ground_truth, beams=Beams.of(log, 8.0))
    covered, wrong = 0, []
    for local_map in list(local_maps(survey, MappingParameters()))[::7]:
        document = describe(local_map, "simulated", parameters)
        view = compose(document.pose, document.viewpoint)
        seen = transform(np.array(view), np.zeros((1, 2)))  # the viewpoint, in the building's frame
        c, s = np.cos(view[2]), np.sin(view[2])
        there = (walls - seen) @ np.array([[c, -s], [s, c]]) / 0.1
        # Only a thin thing that is seen from its end alone, so that beams pass close by it, escapes notice.
        assert document.text.free.covers(there).mean() < 0.01
        wrong.append(document.text.free.covers(there).mean())
        assert len(document.text.free) > 10
        covered += int(document.text.free.grid.cells.sum())
    assert covered > 0 and np.mean(wrong) < 0.003


def test_the_longest_reading_is_that_of_any_beam_that_returned():
    (scan,) = log_of([(0.0, np.inf), (1.0, 3.0)]).scans
    assert longest_reading(scan) == 3.0
    assert longest_reading(Scan(np.full(2, np.inf), np.zeros(2), np.zeros(3))) == 0.0


def test_what_a_scan_saw_depends_on_no_later_one():
    log = log_of([(0.0, 5.0), (2.0, 4.0)], [(0.0, 4.95), (2.0, 4.0)], [(0.0, 6.0), (2.0, 4.0)], [(0.0, 4.95)])
    whole = Beams.of(log, 8.0)
    assert whole.lengths.tolist() == [0.0, 3.75, 0.0, 3.75, 0.0, 3.75, 4.7]
    assert np.array_equal(Beams.of(replace(log, scans=log.scans[:2]), 8.0).lengths, whole.lengths[:4])


def test_the_paper_knows_nothing_of_free_space():
    log = simulate(Simulation(seed=2, length=24.0, travel=8.0))
    survey = Survey(*hits(log, 8.0), log.odometry, beams=Beams.of(log, 8.0))
    (local_map,) = local_maps(survey, MappingParameters(), np.array([0]))
    assert len(describe(local_map, "a", PROFILES["default"]).text.free) > 0
    assert len(describe(local_map, "a", PROFILES["paper"]).text.free) == 0
