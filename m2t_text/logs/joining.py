"""Several logs as one, whose drives nothing ties together yet."""

from collections.abc import Sequence
from dataclasses import replace

from m2t_text.logs.log import Log
from m2t_text.util.geometry import compose, inverse


def joined(logs: Sequence[Log], name: str) -> Log:
    """The logs one after the other, each a drive or more of its own; the laser sits where the first one has it.

    Where a log's laser sits elsewhere, its robot's frame is moved so that the laser sits there.
    """
    if len(logs) == 1:
        return replace(logs[0], name=name)
    scans, drives = [], 0
    laser = logs[0].laser_pose
    for log in logs:
        offset = compose(log.laser_pose, inverse(laser))
        for scan in log.scans:
            odometry = scan.odometry if not offset.any() else compose(scan.odometry, offset)
            scans.append(replace(scan, odometry=odometry, drive=drives + scan.drive))
        drives = scans[-1].drive + 1
    warnings = tuple(f"{log.name}: {warning}" for log in logs for warning in log.warnings)
    return Log(name, tuple(scans), laser, None, warnings, all(log.has_odometry for log in logs))
