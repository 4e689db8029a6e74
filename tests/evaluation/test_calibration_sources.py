"""The ground truth of raw logs, which the verdict's coefficients are fitted on."""

from dataclasses import replace

import numpy as np
import pytest
from calibration_sources import with_truth_of

from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.util.geometry import between


def test_a_raw_log_takes_its_truth_from_one_that_holds_some_of_its_scans() -> None:
    """Also where the robot turns, and from the first such scan on to the last."""
    whole = simulate(Simulation(length=24.0, travel=8.0, step=0.1, beams=90))
    assert whole.ground_truth is not None
    kept = range(10, len(whole.scans), 12)
    some = replace(whole, scans=[whole.scans[k] for k in kept], ground_truth=whole.ground_truth[list(kept)])
    found = with_truth_of(replace(whole, ground_truth=None), some)
    assert found.ground_truth is not None and len(found.scans) == len(found.ground_truth) == kept[-1] - 10 + 1
    error = between(whole.ground_truth[10 : kept[-1] + 1], found.ground_truth)
    assert error[::12] == pytest.approx(0.0, abs=1e-9)
    assert np.hypot(error[:, 0], error[:, 1]).max() < 0.05 and np.abs(error[:, 2]).max() < np.radians(1.0)
