"""How the coefficients of a pose's evidence and of the verdict's probability are fitted; arrays alone, no maps.

Evidence puts the alignments of a query in order: a conditional logit, how likely the right ones are among all.
The probability is a logistic function of how an answer fits and of its lead over its rivals. More of a figure
never counts against what it should speak for: signs are given. Both are held back a little (RIDGE), and a share
of NOISE of the labels may be wrong, as that of a map that scan matching bent, so that few answers do not rule.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from lookups import FIT, IN_MAP, VISITED, Lookups
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit

from m2t_text.recognition.found import SAME_DIRECTION, SAME_PLACE
from m2t_text.recognition.verdict import FURTHEST, Coefficients
from m2t_text.util.geometry import wrap
from m2t_text.util.types import Floats

KEYPOINTS, SEEN, INLIERS, CONFLICTS, GRIP, DISTANCE, PATCH = range(len(FIT))
RIDGE = 0.003  # for the mean square of coefficients, of figures whose standard deviation is one
NOISE = 0.004
WEIGHTS = (1.0, 0.5, 0.5, 0.5, 0.5, 0.25)  # of the kinds of queries
FEWEST = 40  # queries of a kind that count in full
DOUBT = 0.2  # added to the chance of the right alignments, so that queries with hopeless ones do not rule
UNLIKELY = 1e-12


@dataclass(frozen=True)
class Answers:
    """The best alignment of each query of a source.

    Attributes:
        kind: (Q,) of the queries.
        right: (Q,) whether its pose is.
        lead: (Q,) evidence by which the best rival is behind, at most FURTHEST.
        figures: (Q, 4) shares of overlap, inliers and conflicts, and keypoints in the largest patch of misfits;
            where it is not known what is free, (Q, 2), the first two.
        support: (Q,) of earlier maps of the drive.
        weight: (Q,) in the fit.
    """

    kind: NDArray[np.int64]
    right: NDArray[np.bool_]
    lead: Floats
    figures: Floats
    support: Floats
    weight: Floats


def evidence_figures(fit: Floats) -> Floats:
    """(A, 4) what `Fit.evidence` adds up, of alignments whose figures FIT are given (A, 7)."""
    seen = np.maximum(fit[:, SEEN], 1)
    shares = fit[:, [INLIERS, CONFLICTS]] / seen[:, None]
    return np.column_stack([np.log1p(fit[:, SEEN]), shares, fit[:, DISTANCE]])


def own_figures(fit: Floats, free: bool) -> Floats:
    """(A, 4) or (A, 2) what the verdict adds up, see `Answers`."""
    seen = np.maximum(fit[:, SEEN], 1)
    overlap = fit[:, SEEN] / np.maximum(fit[:, KEYPOINTS], 1)
    if not free:
        return np.column_stack([overlap, fit[:, INLIERS] / seen])
    return np.column_stack([overlap, fit[:, INLIERS] / seen, fit[:, CONFLICTS] / seen, fit[:, PATCH]])


def answers(source: Lookups, evidence: Floats, free: bool, weight: float = 1.0) -> Answers:
    """The answers to a source's queries where ``evidence`` (4,) puts the alignments in order."""
    fit = source.fit if free else source.blind
    value = evidence_figures(fit) @ evidence + source.support
    best, lead = [], []
    for rows in _by_query(source):
        k = rows[np.where(source.extra[rows], -np.inf, value[rows]).argmax()]
        others = rows[_differ(source.place, k, rows)]
        best.append(k)
        lead.append(min(value[k] - value[others].max(initial=-np.inf), FURTHEST))
    each = np.bincount(source.kind, minlength=len(WEIGHTS))
    weights = np.array(WEIGHTS)[source.kind] / np.maximum(each, FEWEST)[source.kind]
    figures = own_figures(fit[best], free)
    return Answers(
        source.kind, source.right[best], np.array(lead), figures, source.support[best], weight * weights
    )


def _by_query(source: Lookups) -> list[NDArray[np.int64]]:
    """The rows of each query's alignments."""
    return np.split(np.arange(len(source.query)), np.searchsorted(source.query, np.arange(1, len(source.kind))))


def _differ(place: Floats, best: int, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(R,) which alignments are other answers than the best one: `found.difference`, on arrays."""
    apart = place[rows] - place[best]
    gap, away, turn = np.abs(apart[:, 1]), np.hypot(apart[:, 2], apart[:, 3]), np.abs(wrap(apart[:, 4]))
    base, slope, most = SAME_DIRECTION
    near = (away <= SAME_PLACE[0] + SAME_PLACE[1] * gap) & (turn <= np.minimum(base + slope * gap, most))
    return ~near | (apart[:, 0] != 0)


def fitted_evidence(sources: Sequence[Lookups]) -> Floats:
    """(4,) coefficients under which the right alignments of places that were visited are most likely."""
    figures, right, weights = [], [], []
    for source in sources:
        known = np.isin(source.kind, (VISITED, IN_MAP))
        for number, rows in enumerate(_by_query(source)):
            hits = rows[~source.extra[rows]]
            if known[number] and source.right[hits].any() and not source.right[hits].all():
                figures.append(evidence_figures(source.fit[hits]))
                right.append(source.right[hits])
                weights.append(1.0 / known.sum())
    table, ends = np.concatenate(figures), np.cumsum([len(rows) for rows in figures])
    begins, weight, sign = np.append(0, ends[:-1]), np.array(weights) / sum(weights), np.array([1, 1, -1, -1])
    among, scale = np.concatenate(right), table.std(axis=0)

    def loss(scaled: Floats) -> float:
        value = table @ (sign * scaled / scale)
        chance = np.exp(
            value - np.repeat(np.maximum.reduceat(value, begins), np.diff(np.append(begins, len(value))))
        )
        share = np.add.reduceat(chance * among, begins) / np.add.reduceat(chance, begins)
        return float(-(weight * np.log(share + DOUBT)).sum() + RIDGE / 10 * (scaled**2).mean())

    return sign * _least(loss, np.ones(4), [(0.0, None)] * 4) / scale


def fitted_verdict(sources: Sequence[Answers]) -> Coefficients:
    """The coefficients that make the answers of all sources most likely right or wrong, as they are."""
    figures = np.concatenate([one.figures for one in sources])
    lead, right, weight = (
        np.concatenate([getattr(one, name) for one in sources]) for name in ("lead", "right", "weight")
    )
    weight = weight / weight.sum()
    mean, scale = figures.mean(axis=0), figures.std(axis=0) + UNLIKELY
    sign = np.array([1, 1, -1, -1])[: figures.shape[1]]
    standard = (figures - mean) / scale * sign

    def loss(scaled: Floats) -> float:
        value = scaled[0] * lead - np.logaddexp(0, -(scaled[1] + standard @ scaled[2:]))
        chance = expit(np.where(right, value, -value))
        likely = np.log((1 - 2 * NOISE) * chance + NOISE)
        return float(-(weight * likely).sum() + RIDGE * (scaled[2:] ** 2).mean())

    start = np.array([1.0, 2.0, *np.ones(len(sign))])
    scaled = _least(loss, start, [(0.0, None), (None, None), *[(0.0, None)] * len(sign)])
    own = sign * scaled[2:] / scale
    constant = float(scaled[1] - own @ mean)
    return Coefficients(*map(float, [*own, 0.0, 0.0][:4]), constant, float(scaled[0]))


def _least(
    loss: Callable[[Floats], float], start: Floats, bounds: list[tuple[float | None, float | None]]
) -> Floats:
    return np.asarray(minimize(loss, start, method="L-BFGS-B", bounds=bounds, options={"maxiter": 1000}).x)


def fitted_agreement(sources: Sequence[Answers], by: Coefficients) -> float:
    """The coefficient of the support of earlier maps, beside others that are known."""
    value, support = (
        np.concatenate(rows) for rows in zip(*[(odds(by, one), one.support) for one in sources], strict=True)
    )
    right, weight = (np.concatenate([getattr(one, name) for one in sources]) for name in ("right", "weight"))

    def loss(scaled: Floats) -> float:
        total = value + scaled[0] * support
        chance = expit(np.where(right, total, -total))
        return float(-(weight * np.log((1 - 2 * NOISE) * chance + NOISE)).sum())

    return float(_least(loss, np.ones(1), [(0.0, None)])[0])


def odds(by: Coefficients, one: Answers) -> Floats:
    """(Q,) of the answers being right by themselves, on a logarithmic scale, as in `verdict.probability`."""
    own = one.figures @ np.array([by.overlap, by.inliers, by.conflicts, by.patch])[: one.figures.shape[1]]
    return by.lead * one.lead - np.logaddexp(0, -(own + by.constant))
