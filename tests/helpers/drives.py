"""Drives of which something is left out."""

from dataclasses import replace

import numpy as np

from m2t_text.logs import Log


def cut(log: Log, scans: int) -> Log:
    """The beginning of a log with ground truth."""
    assert log.ground_truth is not None
    return replace(log, scans=log.scans[:scans], ground_truth=log.ground_truth[:scans])


def without_odometry(log: Log) -> Log:
    """The log as if the robot had no wheels: it stands at every scan."""
    nowhere = np.zeros(3)
    scans = tuple(replace(scan, odometry=nowhere) for scan in log.scans)
    return replace(log, scans=scans, has_odometry=False)
