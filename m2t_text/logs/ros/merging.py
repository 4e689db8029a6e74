"""Scans of several lasers of one robot as those of one."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from m2t_text.logs.log import Scan
from m2t_text.util.geometry import between, compose, transform
from m2t_text.util.types import Floats

PARTNER = 0.6  # of the time between two scans within which one of the other laser belongs to it


def merged(scans: Sequence[Scan], laser: Floats, others: Sequence[Scan], other_laser: Floats) -> list[Scan]:
    """The scans with what another laser saw nearest in time on the same drive, as if seen from the first one.

    ``laser`` and ``other_laser`` (3,) are the poses of both on the robot, whose motion between two scans is
    that of its odometry. A scan without a partner stays as it is.
    """
    if not others or len(scans) < 2:
        return list(scans)
    times = np.array([scan.timestamp for scan in others])
    order = np.argsort(times, kind="stable")
    gap = PARTNER * float(np.median(np.abs(np.diff([scan.timestamp for scan in scans]))))
    result = []
    for scan in scans:
        place = int(np.searchsorted(times[order], scan.timestamp))
        near = [order[k] for k in (place - 1, place) if 0 <= k < len(order)]
        partner = others[min(near, key=lambda k: abs(times[k] - scan.timestamp))]
        fits = partner.drive == scan.drive and abs(partner.timestamp - scan.timestamp) <= gap
        result.append(_joined(scan, laser, partner, other_laser) if fits else scan)
    return result


def _joined(scan: Scan, laser: Floats, partner: Scan, other_laser: Floats) -> Scan:
    seen_from = compose(between(scan.odometry, partner.odometry), other_laser)
    place = between(laser, seen_from)
    hit = np.isfinite(partner.ranges)
    ranges, angles = partner.ranges[hit], partner.angles[hit]
    points = transform(place, np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=1))
    ranges = np.concatenate([scan.ranges, np.hypot(points[:, 0], points[:, 1])])
    angles = np.concatenate([scan.angles, np.arctan2(points[:, 1], points[:, 0])])
    order = np.argsort(angles, kind="stable")
    return replace(scan, ranges=ranges[order], angles=angles[order])
