"""Relative pose and inliers of two maps, from their texts alone.

The words vote for an offset between the viewpoints, in each direction along the walls (as in ``agreement``).
From there the pose words, which are the maps' geometry, cell by cell, are aligned by point-to-line ICP.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.search.weighting import OffsetAgreement, agreed
from m2t_text.mapping.normals import cloud_normals
from m2t_text.mapping.registration import register, within
from m2t_text.util.geometry import compose, inverse, transform
from m2t_text.util.types import Floats
from m2t_text.util.workers import cores

INLIER = 0.15  # m; a keypoint is an inlier if the other map has one so near
NORMAL_REACH = 0.3  # m; about a keypoint, for the direction of its wall
LOOSENESS = np.array([0.5, 0.1])  # m and rad by which the vote may be off


@dataclass(frozen=True)
class Alignment:
    """How a query lies on a map.

    Attributes:
        pose: (3,) the query's frame in the map's frame (both at their viewpoints), metres and radians.
        inlier_ratio: share of the keypoints of both maps that have one of the other map within INLIER.
        agreement: share of keypoints that matched at the offset for which the words voted, before that.
        grip: 0...0.5, the share of the inliers' walls that hold the pose in its loosest direction: 0 between
            two parallel walls, along which the query may slide.
    """

    pose: Floats
    inlier_ratio: float
    agreement: float
    grip: float


@dataclass(frozen=True)
class Shape:
    """A text as geometry: ``points`` (N, 2) in metres and unit ``normals`` (N, 2) of their walls, or zeros."""

    points: Floats
    normals: Floats

    @classmethod
    def of(cls, text: Text, cell: float) -> "Shape":
        points = text.positions() * cell
        return cls(points, cloud_normals(points, NORMAL_REACH))


def align(query: Text, candidates: Sequence[Text], cell: float) -> list[Alignment]:
    """The query aligned with each of the candidates; ``cell`` is the pose words' step, metres.

    Examples:
        >>> import m2t_text as m2t
        >>> text = m2t.MapIndex.open("indexes/default").document("drive/000040").text
        >>> alignment = m2t.align(text.moved([0.5, 0.0, 0.0], 0.1), [text], 0.1)[0]
        >>> alignment.pose.round(2).tolist(), alignment.inlier_ratio
        ([-0.5, 0.0, 0.0], 1.0)
    """
    if not candidates or not len(query):
        return [Alignment(np.zeros(3), 0.0, 0.0, 0.0) for _ in candidates]
    starts = agreed(Texts.of(candidates), query, OffsetAgreement())
    shape = Shape.of(query, cell)

    def aligned(text: Text, start: Floats, agreement: float) -> Alignment:
        return refined(shape, Shape.of(text, cell), start * [cell, cell, 1.0], agreement)

    with ThreadPoolExecutor(cores(None)) as pool:  # compiled code lets the others run
        return list(pool.map(aligned, candidates, starts.alignment, starts.score.tolist()))


def refined(query: Shape, found: Shape, start: Floats, agreement: float) -> Alignment:
    """Point-to-line ICP of two shapes from a ``start`` pose (3,) of the query in the found map's frame.

    The ``agreement`` is what they had there.
    """
    if not len(query.points) or not len(found.points):
        return Alignment(start, 0.0, agreement, 0.0)
    back = inverse(start)
    turn = np.array([0.0, 0.0, back[2]])
    correction, _ = register(
        transform(back, found.points), transform(turn, found.normals), query.points, 0.0, 0.0, LOOSENESS
    )
    pose = compose(start, correction)
    here = within(transform(pose, query.points), found.points, INLIER)
    there = within(transform(inverse(pose), found.points), query.points, INLIER)
    inliers = int(here.sum() + there.sum())
    return Alignment(pose, inliers / (len(here) + len(there)), agreement, grip(query.normals[here]))


def grip(normals: Floats) -> float:
    """The least share of the unit normals (N, 2) along any direction: their spread's smaller eigenvalue."""
    if not len(normals):
        return 0.0
    return float(np.linalg.eigvalsh(normals.T @ normals / len(normals))[0])


def relative_pose(query: Document, found: Document, pose: Floats) -> Floats:
    """(3,) the query's first-scan robot frame in the found map's, given the alignment's ``pose`` (3,)."""
    return compose(compose(found.viewpoint, pose), inverse(query.viewpoint))
