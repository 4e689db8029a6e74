"""Which matches become loops: what the trajectory allows, what waits, what is refused, and when it is known."""

import numpy as np
import pytest

from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.loops.gate import Gate, Loop
from m2t_text.loops.lookup import Candidate
from m2t_text.loops.uncertainty import Drift, PoseWithCovariance
from m2t_text.util.geometry import between, compose
from m2t_text.util.types import Floats

STRAIGHT = np.column_stack([np.arange(0.0, 301.0), np.zeros((301, 2))])
# Out and back on one line, a scan a metre: at scan k the robot is where it was at scan 600 - k.
DRIVE = np.concatenate([STRAIGHT, compose([300.0, 0.0, np.pi], STRAIGHT[1:])])
ALIGNMENT = np.diag([0.1, 0.1, 0.02]) ** 2


def document(dataset: str, scan: int) -> Document:
    """A map whose run of 5 m has this scan in its middle."""
    run, nothing = (scan - 2, scan + 3), np.zeros(3)
    return Document(dataset, *run, np.array(run, float), nothing, nothing, np.zeros(2), 0, Text.of([], [], []))


def match(
    scan: int, place: int, off: Floats | None = None, dataset: str = "drive", truth: Floats = DRIVE
) -> Loop:
    """A match of the drive's scan with a place, right but for ``off`` (3,)."""
    pose = compose(between(truth[place], DRIVE[scan]), np.zeros(3) if off is None else off)
    candidate = Candidate(
        document("drive", scan), document(dataset, place), 0.8, PoseWithCovariance(pose, ALIGNMENT)
    )
    return Loop(scan, dataset, place, PoseWithCovariance(pose, ALIGNMENT), candidate, scan + 3)


@pytest.fixture
def gate() -> Gate:
    return Gate("drive", {"drive": Drift(DRIVE), "other": Drift(STRAIGHT)})


def scans(loops: list[Loop]) -> list[int]:
    return [loop.scan for loop in loops]


def test_what_the_trajectory_allows_is_a_loop_at_once(gate: Gate):
    gate.offer(match(305, 295))
    assert [(loop.scan, loop.place, loop.known) for loop in gate.loops] == [(305, 295, 308)]


@pytest.mark.parametrize("off", [[1.0, 0.0, 0.0], [0.0, -1.5, 0.0], [0.0, 0.0, 0.2], [0.0, 0.0, np.pi]])
def test_what_the_trajectory_contradicts_is_refused(gate: Gate, off: list[float]):
    gate.offer(match(305, 295, np.array(off)))
    assert (gate.loops, gate.waiting, scans(gate.refused)) == ([], [], [305])


def test_after_a_long_way_a_match_waits_for_another_run_that_agrees(gate: Gate):
    gate.offer(match(500, 100))
    gate.offer(match(504, 96))  # whose run overlaps
    assert (gate.loops, scans(gate.waiting)) == ([], [500, 504])
    gate.offer(match(506, 94))
    assert (scans(gate.loops), gate.waiting) == ([500, 504, 506], [])
    assert {loop.known for loop in gate.loops} == {509}


def test_matches_that_disagree_do_not_confirm_each_other(gate: Gate):
    gate.offer(match(500, 100, np.array([0.0, 6.0, 0.0])))
    gate.offer(match(506, 94))
    assert (gate.loops, scans(gate.waiting)) == ([], [500, 506])
    gate.offer(match(512, 88))  # agrees with the second; then both contradict the first
    assert (scans(gate.loops), scans(gate.refused)) == ([506, 512], [500])


def test_a_known_loop_refuses_what_the_long_way_would_allow(gate: Gate):
    wrong = match(512, 88, np.array([0.0, 3.0, 0.0]))
    unsure = Gate("drive", {"drive": Drift(DRIVE)})
    unsure.offer(wrong)
    assert scans(unsure.waiting) == [512]
    for one in (match(500, 100), match(506, 94), wrong):
        gate.offer(one)
    assert (scans(gate.loops), scans(gate.refused)) == ([500, 506], [512])


def test_another_dataset_is_trusted_once_five_runs_agree(gate: Gate):
    shifted = compose([3.0, 4.0, 1.0], STRAIGHT)  # wherever the other drive began
    run_after_run = [50, 54, 56, 62, 68, 74]  # those of 50 and 54, and of 54 and 56, overlap
    for scan in run_after_run[:-1]:
        gate.offer(match(scan, scan - 30, dataset="other", truth=shifted))
    assert (gate.loops, scans(gate.waiting)) == ([], run_after_run[:-1])
    gate.offer(match(74, 44, dataset="other", truth=shifted))
    assert (scans(gate.loops), gate.waiting) == (run_after_run, [])
    gate.offer(match(80, 50, np.array([0.0, 0.0, 1.0]), "other", shifted))
    gate.offer(match(81, 51, dataset="other", truth=shifted))
    assert (scans(gate.refused), scans(gate.loops)) == ([80], [*run_after_run, 81])


def test_one_wrong_way_among_tight_ones_refuses_nothing(gate: Gate) -> None:
    """A wrong loop that is the nearest one, among right ones that are nearly as near."""
    for scan in range(305, 326, 3):
        gate.offer(match(scan, 600 - scan))
    know(gate, match(326, 274, np.array([0.0, 0.0, 0.3])))
    gate.offer(match(329, 271))
    assert scans(gate.loops)[-1] == 329


def test_what_was_refused_is_looked_at_again_once_loops_near_it_are_known(gate: Gate) -> None:
    know(gate, match(330, 270, np.array([0.0, 0.0, 0.3])))  # a wrong one
    gate.offer(match(333, 267))
    assert scans(gate.refused) == [333]
    for scan in (336, 338, 340):
        know(gate, match(scan, 600 - scan))
    gate.offer(match(341, 259))
    assert (scans(gate.loops)[-2:], gate.refused) == ([341, 333], [])
    assert gate.loops[-1].known == 344


def know(gate: Gate, loop: Loop) -> None:
    """Makes a match a loop, right or wrong."""
    gate.loops.append(loop)
    gate._of[loop.dataset].append(loop)


def test_a_drive_of_which_nothing_is_known_needs_five_runs() -> None:
    gate = Gate("drive", {"drive": Drift(DRIVE, [301])})
    run_after_run = [400, 406, 412, 418, 424]
    for scan in run_after_run[:-1]:
        gate.offer(match(scan, 600 - scan))
    assert (gate.loops, scans(gate.waiting)) == ([], run_after_run[:-1])
    gate.offer(match(424, 176))
    assert scans(gate.loops) == run_after_run
