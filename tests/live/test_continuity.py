"""A robot that is carried elsewhere sees other walls, and the drive begins anew there as far as it can tell."""

from dataclasses import replace

import numpy as np
import pytest

from m2t_text.config import PROFILES
from m2t_text.live.continuity import Continuity, goes_on
from m2t_text.live.survey import SPACING, LiveSurvey
from m2t_text.logs.log import Log
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.mapping.local_map import LocalMap, local_maps, run_starts
from m2t_text.mapping.trajectory import survey
from m2t_text.util.geometry import compose, inverse

DEFAULT = PROFILES["default"]
CUT = 70  # scans before the robot is carried elsewhere


@pytest.fixture(scope="module")
def ordinary() -> Log:
    return replace(simulate(Simulation(seed=4, length=24.0, travel=34.0, beams=90)), ground_truth=None)


@pytest.fixture(scope="module")
def glued(ordinary: Log) -> Log:
    """A drive that goes on elsewhere, though its odometry goes on as if nothing had happened."""
    before, after = ordinary.scans[:CUT], ordinary.scans[-60:]
    frame = compose(before[-1].odometry, inverse(after[0].odometry))
    moved = (replace(scan, odometry=compose(frame, scan.odometry)) for scan in after)
    return replace(ordinary, scans=(*before, *moved))


def test_an_ordinary_drive_is_one_piece(ordinary: Log) -> None:
    live = LiveSurvey(DEFAULT, ordinary.laser_pose)
    for scan in ordinary.scans:
        live.add(scan)
    assert live.continuity.carried == 0.0


def test_it_is_noticed_at_once(glued: Log) -> None:
    """What was seen before is looked up no more; what is left behind is that of the batch all the same."""
    whole = survey(glued, DEFAULT.mapping)
    live, left, at = LiveSurvey(DEFAULT, glued.laser_pose), list[LocalMap](), 0.0
    for k, scan in enumerate(glued.scans):
        assert np.array_equal(live.add(scan), whole.trajectory[k])
        left += live.new_runs()
        if k < CUT:
            assert live.continuity.carried == 0.0
            continue
        at = live.travel if k == CUT else at
        assert live.continuity.carried == at and live.driven == live.travel - at
        run = live.last_run(2.0)
        assert run is None if live.driven < 2.0 else run is not None and run.first_scan >= CUT
    assert live.last_run() is not None
    starts = run_starts(whole, DEFAULT.mapping.run_length, SPACING)
    maps = list(local_maps(whole, DEFAULT.mapping, starts))
    assert [one.first_scan for one in left] == starts.tolist()
    assert all(np.array_equal(a.points, b.points) for a, b in zip(left, maps, strict=True))
    assert any(one.first_scan < CUT <= one.last_scan for one in left)


def test_without_wheels_it_is_noticed_too(glued: Log) -> None:
    live = LiveSurvey(DEFAULT, glued.laser_pose, without_wheels=True)
    for scan in glued.scans[: CUT + 1]:
        assert live.continuity.carried == 0.0
        live.add(replace(scan, odometry=np.zeros(3)))
    assert live.continuity.carried == live.travel > 0.0


def test_a_reset_forgets_it(glued: Log) -> None:
    live = LiveSurvey(DEFAULT, glued.laser_pose)
    for scan in glued.scans[: CUT + 1]:
        live.add(scan)
    live.reset()
    assert live.continuity == Continuity() and live.driven == 0.0


def test_too_little_says_nothing(ordinary: Log) -> None:
    live = LiveSurvey(DEFAULT, ordinary.laser_pose)
    for scan in ordinary.scans[:60]:
        live.add(scan)
    before, newest = live.last_run(), live.last_run(0.2)
    assert before is not None and newest is not None
    assert goes_on(before, newest, DEFAULT)
    turned = replace(newest, pose=compose(newest.pose, [0.0, 0.0, 0.5]))
    assert not goes_on(before, turned, DEFAULT)
    assert newest.free is not None
    nothing = replace(
        turned, points=turned.points[:0], free=replace(newest.free, cells=newest.free.cells & False)
    )
    assert goes_on(before, nothing, DEFAULT)
