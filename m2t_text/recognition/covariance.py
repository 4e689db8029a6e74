"""How sure the pose of an alignment is: the covariance of a point-to-line fit, and of the pose it leads to."""

import numpy as np
from numpy.typing import NDArray

from m2t_text.description.document import Document
from m2t_text.recognition.raster import INLIER, Shape
from m2t_text.recognition.verification import Alignment
from m2t_text.util.geometry import between, compose, inverse, transform
from m2t_text.util.types import Floats

# Errors of alignments on the five logs of the Radish repository:
REMAINDER = np.array([0.03, 0.03, 0.01])  # m, m, rad; of the best ones, as drift bends the runs themselves
LEAST_NOISE = 0.01  # m
KNOWN_ANYWAY = np.array([1e-2, 1e-2, 1e-1])  # 1/m², 1/m², 1/rad²; information that is taken for granted
CORRELATION = 25.0  # neighbouring keypoints err together: so many count as one
SAMPLED = 1000  # keypoints of the query at most: more say no more
PAIRS = 1 << 20  # of keypoints compared at once
STILL = np.zeros(3)


def fit_covariance(query: Shape, found: Shape, pose: Floats) -> Floats:
    """(3, 3) covariance of the ``pose`` (3,) of the query in the found map's frame, in the query's frame.

    That of a point-to-line fit by least squares: large along a wall if little stands across it.
    """
    back = inverse(pose)
    walls = transform(back, found.points)
    across = transform(np.array([0.0, 0.0, back[2]]), found.normals)
    every = -(-len(query.points) // SAMPLED) or 1
    partner = _nearest(query.points[::every], walls)
    points, partner = query.points[::every][partner >= 0], partner[partner >= 0]
    lever = across[partner, 1] * points[:, 0] - across[partner, 0] * points[:, 1]
    slopes = np.column_stack([across[partner], lever])
    misfit = ((points - walls[partner]) * across[partner]).sum(axis=1)
    held = max(int(slopes.any(axis=1).sum()), 1)
    variance = max(float((misfit**2).sum()) / held, LEAST_NOISE**2) * CORRELATION
    fit: Floats = np.linalg.inv(every * slopes.T @ slopes / variance + np.diag(KNOWN_ANYWAY))
    return np.diag(REMAINDER**2) + fit


def _nearest(points: Floats, walls: Floats) -> NDArray[np.int64]:
    """(N,) for each point (N, 2) the nearest of the walls (M, 2), -1 where none lies within INLIER.

    Compared one with all: SciPy's tree would take a tenth of a command to load.
    """
    nearest = np.full(len(points), -1)
    step = max(1, PAIRS // max(len(walls), 1))
    for begin in range(0, len(points) if len(walls) else 0, step):
        part = points[begin : begin + step]
        distance = (part[:, :1] - walls[:, 0]) ** 2 + (part[:, 1:] - walls[:, 1]) ** 2
        best = distance.argmin(axis=1)
        near = distance[np.arange(len(part)), best] <= INLIER**2
        nearest[begin : begin + step][near] = best[near]
    return nearest


def dataset_covariance(
    query: Document, found: Document, alignment: Alignment, cell: float, motion: Floats = STILL
) -> Floats:
    """(3, 3) covariance of the robot's pose in the frame of the found map's dataset, in its axes.

    It is that of the query's first scan, or where ``motion`` (3,) leads from there. The found map counts as
    known exactly.
    """
    loose = fit_covariance(Shape.of(query.text, cell), Shape.of(found.text, cell), alignment.pose)
    viewpoint = compose(compose(found.pose, found.viewpoint), alignment.pose)
    return carried(loose, viewpoint, between(query.viewpoint, motion))


def carried(covariance: Floats, pose: Floats, further: Floats) -> Floats:
    """(3, 3) covariance of ``compose(pose, further)`` in the axes of the frame in which the pose (3,) is given,
    from that of the pose in its own frame."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array([[c, -s], [s, c]])
    slopes = np.eye(3)
    slopes[:2, :2] = turn
    slopes[:2, 2] = turn @ [-further[1], further[0]]
    moved: Floats = slopes @ covariance @ slopes.T
    return (moved + moved.T) / 2  # symmetric to the last bit
