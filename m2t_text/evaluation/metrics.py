"""The figures of the evaluation, as functions of arrays (paper, V-C). Shares and ranks lie in 0...1."""

import numpy as np
from numpy.typing import NDArray

from m2t_text.util.geometry import wrap
from m2t_text.util.types import Floats

Booleans = NDArray[np.bool_]


def normalised_ranks(scores: Floats, relevant: Booleans, irrelevant: Booleans) -> Floats:
    """(R,) of each relevant map its rank among all irrelevant ones, by their number plus one.

    Rank 1 is the best, and an equal score counts half. The scores and both masks are (N,).
    """
    others = np.sort(scores[irrelevant])
    own = scores[relevant]
    below, not_above = (np.searchsorted(others, own, side) for side in ("left", "right"))
    better, equal = len(others) - not_above, not_above - below
    return (1 + better + equal / 2) / (len(others) + 1)


def best(scores: Floats, allowed: Booleans) -> int | None:
    """Which of the allowed maps has the best score, the first of equals; None if all are 0, as in a search."""
    candidates = np.flatnonzero(allowed & (scores > 0))
    return int(candidates[scores[candidates].argmax()]) if len(candidates) else None


def recall(distances: Floats, limit: float) -> float:
    """Share of the queries whose best map lies within ``limit`` metres; distances (Q,), ``inf`` if none."""
    return float(np.mean(distances <= limit))


def verdicts(distances: Floats, match: Booleans, limit: float) -> tuple[float | None, float]:
    """Precision and recall of the verdict ``match`` (Q,); a precision of no verdict at all is None."""
    right = match & (distances <= limit)
    precision = float(right.sum() / match.sum()) if match.any() else None
    return precision, float(right.mean())


def pose_error(estimate: Floats, truth: Floats) -> tuple[float, float]:
    """Metres and radians (not negative) between two poses (3,) in one frame."""
    return float(np.hypot(*(estimate - truth)[:2])), float(np.abs(wrap(estimate[2] - truth[2])))


def median(values: Floats) -> float | None:
    """The median; None if there are no values."""
    return float(np.median(values)) if len(values) else None
