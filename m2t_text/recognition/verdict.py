"""How sure an answer is: a probability, the verdict that follows from it, and the reason in words.

The odds that an answer is right are how well it stands by itself, between 0 and 1, times how much better it
stands than any other answer. By itself it stands by how much of both maps the other one saw, by the shares of
that which fit and which conflict, and by the largest patch that one map has and the other lacks. Two answers
that fit alike have at most half a chance each, however well they fit.

The few coefficients are the same for all maps. `make calibrate` fits them, and `docs/verdict.md` says how right
they are on logs that took no part in the fit.
"""

from dataclasses import dataclass, replace
from math import degrees, exp, log
from typing import Literal

from m2t_text.recognition.fit import Fit

Verdict = Literal["match", "ambiguous", "none"]
Code = Literal["fits", "elsewhere", "turned", "slides", "conflict", "misfit", "little", "nothing", "unverified"]

SURE = 0.9  # probability from which an answer is a `match`; of those in logs left out, 99.7 % were right
FURTHEST = 9.0  # of the evidence by which the best rival may be behind; more says no more
LEAST_ODDS = -500.0  # on a logarithmic scale; less is no number any more


@dataclass(frozen=True)
class Coefficients:
    """What the figures of a fit add to the logarithm of the odds that two maps show one place."""

    overlap: float  # the share of both maps' keypoints that lie where the other one saw
    inliers: float  # the share of those that fit
    conflicts: float  # the share of those that conflict
    patch: float  # the keypoints in the largest patch of misfits
    constant: float
    lead: float  # the evidence by which the best rival is behind, which counts beside all of these


# Within 3 % of what `make calibrate` prints.
WITH_FREE = Coefficients(5.91, 7.27, -20.21, -0.06, -12.47, 0.76)
WITHOUT_FREE = Coefficients(8.68, 7.29, 0.0, 0.0, -15.68, 0.87)  # where a text does not tell what is free
HOPELESS = -4.0  # odds by itself, on a logarithmic scale, below which nothing fits however much was seen


@dataclass(frozen=True)
class Rival:
    """Another answer: the query elsewhere, or turned, or shifted.

    Attributes:
        kind: another place, the same place turned, or the same and merely shifted.
        map_id: the map that the query lies on.
        away: metres from the answer; infinite on another dataset.
        turn: radians, from the answer.
        direction: radians, in which the viewpoint is shifted, in the frame of the answer's map.
        lead: evidence by which it is behind the answer; negative where more speaks for it.
    """

    kind: Literal["elsewhere", "turned", "slides"]
    map_id: str
    away: float
    turn: float
    direction: float
    lead: float


@dataclass(frozen=True)
class Reason:
    """Why the verdict is what it is: one of a closed list of codes, a line in words, and the rival's map."""

    code: Code
    text: str
    rival: str | None = None


@dataclass(frozen=True)
class Assessment:
    """The verdict on an answer; its probability is None where nothing was verified."""

    verdict: Verdict
    probability: float | None
    reason: Reason


UNVERIFIED = Assessment("ambiguous", None, Reason("unverified", "the best hit was not verified"))
NOTHING = Assessment("none", None, Reason("nothing", "no map shares a keypoint with the query"))


def assess(fit: Fit, rival: Rival | None) -> Assessment:
    """The verdict on an answer of this ``fit``, whose best ``rival`` may be None."""
    sure = probability(fit, rival)
    terms = _terms(fit)
    if fit.free_known:  # else all is thought to be seen that lies in reach
        terms["little"] = _ordinary(fit)["little"]
    if _odds(terms, fit) < HOPELESS:
        return Assessment("none", sure, _weakest(fit))
    if sure >= SURE:
        text = f"{fit.seen_inliers:.0%} of what both maps saw fits, and nothing else fits as well"
        return Assessment("match", sure, Reason("fits", text))
    by_itself = probability(fit, None) >= SURE
    return Assessment("ambiguous", sure, _rivalled(rival) if rival and by_itself else _weakest(fit))


def probability(fit: Fit, rival: Rival | None) -> float:
    """That the pose of an answer is right."""
    own = log(_logistic(_odds(_terms(fit), fit)))
    return _logistic(own + _coefficients(fit).lead * lead(rival))


def lead(rival: Rival | None) -> float:
    """How far the evidence for the best rival is behind, at most FURTHEST."""
    return FURTHEST if rival is None else min(rival.lead, FURTHEST)


def _coefficients(fit: Fit) -> Coefficients:
    return WITH_FREE if fit.free_known else WITHOUT_FREE


def _terms(fit: Fit) -> dict[str, float]:
    """What each figure of a fit adds to the odds, by the code of the reason if it lacks."""
    by = _coefficients(fit)
    return {
        "little": by.overlap * fit.seen / max(fit.keypoints, 1),
        "misfit": by.inliers * fit.seen_inliers,
        "conflict": by.conflicts * fit.seen_conflicts,
        "patch": by.patch * fit.patch,
    }


def _odds(terms: dict[str, float], fit: Fit) -> float:
    return sum(terms.values()) + _coefficients(fit).constant


def _logistic(odds: float) -> float:
    return 1.0 / (1.0 + exp(-max(odds, LEAST_ODDS)))


def _ordinary(fit: Fit) -> dict[str, float]:
    """The terms of an ordinary right answer, beside which it shows what an answer lacks."""
    return _terms(replace(fit, keypoints=700, seen=600, inliers=540, conflicts=5, patch=4))


def _weakest(fit: Fit) -> Reason:
    """The figure of a fit by which an answer loses most beside an ordinary one."""
    terms, ordinary = _terms(fit), _ordinary(fit)
    lacking = max(terms, key=lambda name: ordinary[name] - terms[name])
    if lacking == "conflict":
        share = fit.conflicts / max(fit.keypoints, 1)
        return Reason("conflict", f"{share:.1%} of the keypoints lie where the other map was seen to be free")
    if lacking == "little" and fit.free_known:
        share = fit.seen / max(fit.keypoints, 1)
        return Reason("little", f"each map saw only {share:.0%} of what the other shows: too little to be sure")
    if lacking == "patch":
        return Reason(
            "misfit", f"a patch of {fit.patch} keypoints, as of a wall, fits nothing that the other map shows"
        )
    return Reason("misfit", f"only {fit.seen_inliers:.0%} of what both maps saw fits")


def _rivalled(rival: Rival) -> Reason:
    if rival.kind == "turned":
        text = f"turned by {abs(degrees(rival.turn)):.0f}° it fits about as well, on {rival.map_id}"
        return Reason("turned", text, rival.map_id)
    if rival.kind == "slides":
        along = degrees(rival.direction) % 180
        text = f"it may slide by {rival.away:.1f} m along {along:.0f}° and fits about as well there"
        return Reason("slides", text, rival.map_id)
    where = "in another dataset" if rival.away == float("inf") else f"{rival.away:.1f} m away"
    return Reason("elsewhere", f"{rival.map_id}, {where}, fits about as well", rival.map_id)
