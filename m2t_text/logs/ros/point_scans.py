"""Clouds of points as scans: those of a 2D laser as they are, those of a 3D laser cut to a band of heights."""

from typing import Any

import numpy as np

from m2t_text.errors import PartError
from m2t_text.util.geometry import inverse, transform
from m2t_text.util.types import Floats

BAND = (0.3, 1.5)  # m above the ground: walls and furniture, but neither floor nor ceiling
FLAT = 0.2  # m; points that differ by less in height are of a 2D laser
BEAMS = 720  # of a scan that is cut from a cloud; each tells of the nearest point
MIDDLES: Floats = np.linspace(-np.pi, np.pi, 2 * BEAMS + 1)[1::2]  # rad; of the beams
NEAREST = 0.05  # m; nearer points are beams that did not return, which many drivers put at the origin
FARTHEST = 1000.0  # m
KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}  # sensor_msgs/PointField
# The ground is a plane through the lowest points of cells near the robot:
CELL, REACH = 1.0, 20.0  # m
LOW = 20  # percentile of the cells' lowest points about which it is looked for
ROUNDS = (0.5, 0.3, 0.2, 0.15, 0.15)  # m; distances within which points count, narrower from fit to fit
STEEP = np.tan(np.radians(15.0))  # slope in the robot's frame that no robot drives on
FEWEST = 8  # cells that make a plane


def cloud_points(body: Any) -> Floats:
    """The points (N, 3) of a PointCloud2 that are finite and not at its origin, in its own frame.

    Raises PartError if it holds none.
    """
    fields = {field.name.lower(): field for field in body.fields}
    try:
        codes = [KINDS[fields[axis].datatype] for axis in "xyz"]
        offsets = [int(fields[axis].offset) for axis in "xyz"]
    except KeyError as error:
        raise PartError("without fields x, y and z of numbers") from error
    order, step, data = ">" if body.is_bigendian else "<", int(body.point_step), body.data
    width, height, row = int(body.width), int(body.height), int(body.row_step)
    ends = [offset + np.dtype(code).itemsize for offset, code in zip(offsets, codes, strict=True)]
    if not (
        width > 0 and height > 0 and max(ends) <= step and width * step <= row and row * height <= len(data)
    ):
        raise PartError("whose data are shorter than the points that it claims")
    kind = np.dtype({"names": list("xyz"), "formats": [order + code for code in codes], "offsets": offsets,
                     "itemsize": step})  # fmt: skip
    rows = np.frombuffer(bytes(data[: row * height]), np.uint8).reshape(height, row)[:, : width * step]
    records = np.frombuffer(rows.tobytes(), kind)
    with np.errstate(invalid="ignore"):
        points = np.column_stack([records[axis].astype(np.float64) for axis in "xyz"])
    with np.errstate(over="ignore", invalid="ignore"):
        distances = np.sqrt((points**2).sum(axis=1))
    return points[(distances > NEAREST) & (distances < FARTHEST)]  # false for NaN, too


def scan_of(points: Floats, mount: Floats, height: tuple[float, float] | None) -> tuple[Floats, Floats]:
    """Ranges and angles (B,) about the laser, in the plane of the robot, of points (N, 3) in the laser's frame.

    ``mount`` (4, 4) is the laser's pose on the robot. Points of a 3D laser are cut to ``height``, metres in the
    robot's frame, or else to a band above the ground. Raises PartError if no point is left.
    """
    placed = points @ mount[:3, :3].T + mount[:3, 3]
    flat = len(points) < 2 or np.ptp(points[:, 2]) < FLAT
    if not flat or height is not None:
        heights = placed[:, 2] if height is not None else above_ground(placed)
        low, high = height or BAND
        placed = placed[(heights >= low) & (heights <= high)]
    if len(placed) < 2:
        raise PartError("without two points in the band of heights; --height names another")
    laser = np.array([mount[0, 3], mount[1, 3], np.arctan2(mount[1, 0], mount[0, 0])])
    seen = transform(inverse(laser), placed[:, :2])
    ranges: Floats = np.hypot(seen[:, 0], seen[:, 1])
    angles: Floats = np.arctan2(seen[:, 1], seen[:, 0])
    if flat:
        order = np.argsort(angles, kind="stable")
        return ranges[order], angles[order]
    beams = np.floor((angles + np.pi) / (2 * np.pi) * BEAMS).astype(np.int64) % BEAMS
    nearest: Floats = np.full(BEAMS, np.inf)
    np.minimum.at(nearest, beams, ranges)
    return nearest, MIDDLES


def is_cut(angles: Floats) -> bool:
    """Whether a scan with these angles was cut from the cloud of a 3D laser."""
    return len(angles) == BEAMS and angles[0] == MIDDLES[0]


def above_ground(points: Floats) -> Floats:
    """(N,) the heights of points (N, 3), robot's frame, above the ground that they show."""
    a, b, c = ground(points)
    return (points[:, 2] - a * points[:, 0] - b * points[:, 1] - c) / np.sqrt(1 + a * a + b * b)


def ground(points: Floats) -> tuple[float, float, float]:
    """a, b, c of the ground z = a x + b y + c; level at the lowest points where they show no plane."""
    near = points[np.hypot(points[:, 0], points[:, 1]) < REACH]
    near = near if len(near) else points
    level = float(np.percentile(near[:, 2], 1))
    lowest = _lowest(near)
    plane = np.array([0.0, 0.0, float(np.percentile(lowest[:, 2], LOW))])
    for reach in ROUNDS:
        away = lowest[:, 2] - lowest[:, :2] @ plane[:2] - plane[2]
        close = lowest[np.abs(away) < reach]
        if len(close) < FEWEST:
            return 0.0, 0.0, level
        system = np.column_stack([close[:, :2], np.ones(len(close))])
        plane, _, rank, _ = np.linalg.lstsq(system, close[:, 2], rcond=None)
        if rank < 3 or np.hypot(*plane[:2]) > STEEP:
            return 0.0, 0.0, level
    return float(plane[0]), float(plane[1]), float(plane[2])


def _lowest(points: Floats) -> Floats:
    """The lowest point of every cell, (M, 3)."""
    cells = np.floor(points[:, :2] / CELL).astype(np.int64)
    order = np.lexsort((points[:, 2], cells[:, 1], cells[:, 0]))
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (np.diff(cells[order], axis=0) != 0).any(axis=1)
    return points[order][first]
