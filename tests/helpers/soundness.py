"""What must hold of all that is read, from whatever file."""

import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from m2t_text.errors import LogError
from m2t_text.logs import read_log


def assert_sound_or_refused(path: Path) -> None:
    """A log with at least two scans and numbers that can be reckoned with, or one line that can be printed."""
    try:
        log = read_log(path)
    except LogError as error:
        assert str(error).isprintable()
        return
    assert len(log.scans) >= 2
    assert np.isfinite(log.odometry).all() and np.isfinite(log.laser_pose).all()
    assert log.ground_truth is None or np.isfinite(log.ground_truth).all()
    assert all(warning.isprintable() for warning in log.warnings)
    for scan in log.scans:
        assert scan.ranges.shape == scan.angles.shape
        assert (scan.ranges > 0).all() and np.isfinite(scan.angles).all()


@contextmanager
def at_most(memory: float) -> Iterator[None]:
    """So many bytes are allocated at the most at any time, by all that tells Python so."""
    tracemalloc.start()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < memory
