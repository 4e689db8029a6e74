"""Pose graph optimisation: Gauss-Newton on sparse normal equations, with a robust loss for what may be wrong.

Grisetti et al., "A tutorial on graph-based SLAM" (2010); the loss is Cauchy's, by iterative reweighting, and
SciPy's sparse direct solver does the solving.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from m2t_text.util.geometry import compose, inverse, wrap
from m2t_text.util.types import Floats, Ints

ITERATIONS = 50  # at most
CONVERGED = (1e-5, 1e-6)  # m and rad; no pose moves by more in the last iteration
DAMPING = (1e-9, 1e6)  # share of the diagonal added to it: from the start, and where nothing is tried any more
LOSS_SCALE = 3.0  # standard deviations at which Cauchy's loss halves a constraint's weight
GRADUAL = (1000.0, 100.0, 30.0, 10.0, LOSS_SCALE)  # the same, one after the other, from a start that is far off


@dataclass(frozen=True)
class Constraints:
    """Relative poses between vertices.

    Attributes:
        pairs: (E, 2) the vertices ``start`` and ``end``.
        poses: (E, 3) of ``end`` as seen from ``start``, metres and radians.
        information: (E, 3, 3) inverse covariances, in the frame of ``end`` as in g2o.
        robust: (E,) whether the constraint may be wrong, so that the loss caps its pull.
    """

    pairs: Ints
    poses: Floats
    information: Floats
    robust: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.pairs)

    def chosen(self, mask: NDArray[np.bool_] | Sequence[int]) -> "Constraints":
        """Those of a mask or of indices."""
        mask = np.asarray(mask, dtype=np.int64 if not len(mask) else None)
        return Constraints(self.pairs[mask], self.poses[mask], self.information[mask], self.robust[mask])

    def between(self, vertices: NDArray[np.bool_]) -> "Constraints":
        """Those of which both ends are among some of the vertices (V,), which are numbered anew."""
        inside = self.chosen(vertices[self.pairs[:, 0]] & vertices[self.pairs[:, 1]])
        return replace(inside, pairs=(np.cumsum(vertices) - 1)[inside.pairs])

    def joined(self, other: "Constraints") -> "Constraints":
        """These and the other ones."""
        return Constraints(
            np.concatenate([self.pairs, other.pairs]),
            np.concatenate([self.poses, other.poses]),
            np.concatenate([self.information, other.information]),
            np.concatenate([self.robust, other.robust]),
        )

    def errors(self, vertices: Floats) -> Floats:
        """(E, 3) by which the vertices (V, 3) miss each constraint: the end's pose in the frame measured."""
        start, end = vertices[self.pairs[:, 0]], vertices[self.pairs[:, 1]]
        return compose(inverse(self.poses), compose(inverse(start), end))

    def squared_distances(self, vertices: Floats) -> Floats:
        """(E,) squared Mahalanobis distances of the errors."""
        errors = self.errors(vertices)
        return np.einsum("ei,eij,ej->e", errors, self.information, errors)


def optimise_gradually(vertices: Floats, constraints: Constraints) -> Floats:
    """The same as `optimise`, from a start so bad that constraints which are right look wrong.

    First none is taken for wrong, then fewer and fewer are kept (Yang et al., "Graduated non-convexity for
    robust spatial perception", IEEE Robotics and Automation Letters 5, 2020).
    """
    for scale in GRADUAL:
        vertices = optimise(vertices, constraints, scale=scale)
    return vertices


def optimise(vertices: Floats, constraints: Constraints, fixed: int = 0, scale: float = LOSS_SCALE) -> Floats:
    """The vertices (V, 3) that fit the constraints best, one of them held where it is.

    Vertices that no constraint ties to the fixed one, directly or through others, stay where they are, up to
    their own constraints. Levenberg's damping lets a step through only if it lowers the cost.
    """
    if not len(constraints):
        return vertices
    system = _System(len(vertices), constraints, fixed, scale)
    poses, damping = vertices, DAMPING[0]
    cost = _cost(constraints, poses, scale)
    for _ in range(ITERATIONS):
        hessian, gradient = system.linearised(poses)
        step = None
        while damping <= DAMPING[1]:
            step = system.solved(hessian, gradient, damping).reshape(-1, 3)
            moved = poses + step
            moved[:, 2] = wrap(moved[:, 2])
            lower = _cost(constraints, moved, scale)
            if lower <= cost:
                break
            step, damping = None, max(damping, 1e-6) * 10
        if step is None:
            break
        poses, cost, damping = moved, lower, max(damping / 10, DAMPING[0])
        if np.abs(step[:, :2]).max() < CONVERGED[0] and np.abs(step[:, 2]).max() < CONVERGED[1]:
            break
    return poses


def robust_weights(constraints: Constraints, vertices: Floats, scale: float = LOSS_SCALE) -> Floats:
    """(E,) the share of its weight that each constraint keeps: Cauchy's where it is robust, 1 elsewhere."""
    squared = constraints.squared_distances(vertices) / scale**2
    return np.where(constraints.robust, 1 / (1 + squared), 1.0)


def _cost(constraints: Constraints, vertices: Floats, scale: float) -> float:
    squared = constraints.squared_distances(vertices)
    capped = scale**2 * np.log1p(squared / scale**2)
    return float(np.where(constraints.robust, capped, squared).sum())


class _System:
    """The normal equations; where their entries lie is found once."""

    def __init__(self, count: int, constraints: Constraints, fixed: int, scale: float) -> None:
        self._constraints = constraints
        self._scale = scale
        self._size = 3 * count
        self._fixed = fixed
        local = np.arange(3)
        places = (3 * constraints.pairs[:, :, None] + local).reshape(-1, 6)  # (E, 6) rows of each constraint
        rows = np.repeat(places, 6, axis=1).ravel()
        columns = np.tile(places, (1, 6)).ravel()
        diagonal = np.arange(self._size)
        keys = np.concatenate([columns * self._size + rows, diagonal * (self._size + 1)])
        cells, self._slot = np.unique(keys, return_inverse=True)
        self._rows = (cells % self._size).astype(np.int32)
        counts = np.bincount(cells // self._size, minlength=self._size)
        self._starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        self._diagonal = self._slot[-self._size :]
        self._places = places

    def linearised(self, vertices: Floats) -> tuple[Floats, Floats]:
        """The entries of the Hessian, and the gradient."""
        constraints = self._constraints
        errors = constraints.errors(vertices)
        slopes = _slopes(constraints, vertices)
        weights = robust_weights(constraints, vertices, self._scale)[:, None, None] * constraints.information
        weighted = np.swapaxes(slopes, 1, 2) @ weights
        blocks = (weighted @ slopes).reshape(-1)
        pull = (weighted @ errors[:, :, None])[:, :, 0]
        entries: Floats = np.bincount(self._slot[: len(blocks)], blocks, len(self._rows)).astype(float)
        gradient: Floats = np.bincount(self._places.ravel(), pull.ravel(), self._size).astype(float)
        return entries, gradient

    def solved(self, hessian: Floats, gradient: Floats, damping: float) -> Floats:
        """The step that the damped equations ask for; zeros for the fixed vertex."""
        entries = hessian.copy()
        held = self._diagonal[3 * self._fixed : 3 * self._fixed + 3]
        entries[self._diagonal] *= 1 + damping
        entries[self._diagonal] += 1e-9  # a vertex without constraints
        entries[held] += 1e15
        matrix = csc_array((entries, self._rows, self._starts), shape=(self._size, self._size))
        factors = splu(
            matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        step: Floats = -factors.solve(gradient)
        return step


def _slopes(constraints: Constraints, vertices: Floats) -> Floats:
    """(E, 3, 6) derivatives of the errors by the start's and the end's x, y, theta."""
    start, end = vertices[constraints.pairs[:, 0]], vertices[constraints.pairs[:, 1]]
    angle = start[:, 2] + constraints.poses[:, 2]
    c, s = np.cos(angle), np.sin(angle)
    dx, dy = end[:, 0] - start[:, 0], end[:, 1] - start[:, 1]
    slopes = np.zeros((len(constraints), 3, 6))
    slopes[:, 0, 0], slopes[:, 0, 1] = -c, -s
    slopes[:, 1, 0], slopes[:, 1, 1] = s, -c
    slopes[:, 0, 2] = -s * dx + c * dy
    slopes[:, 1, 2] = -c * dx - s * dy
    slopes[:, 0, 3], slopes[:, 0, 4] = c, s
    slopes[:, 1, 3], slopes[:, 1, 4] = -s, c
    slopes[:, 2, 2], slopes[:, 2, 5] = -1.0, 1.0
    return slopes
