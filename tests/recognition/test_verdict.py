"""The verdict, its probability and its reason, on fits and rivals that are made up."""

from dataclasses import replace

import numpy as np
import pytest

from m2t_text.description.document import Document
from m2t_text.description.text import Text
from m2t_text.index.results import Hit
from m2t_text.recognition.fit import Fit
from m2t_text.recognition.found import Found, strongest
from m2t_text.recognition.verdict import SURE, Assessment, Rival, assess
from m2t_text.recognition.verification import Alignment

GOOD = Fit(keypoints=900, seen=800, inliers=760, conflicts=2, free_known=True, grip=0.3, patch=3)
POOR = replace(GOOD, inliers=300, conflicts=250, patch=40)


def rival(fit: Fit, kind: str = "elsewhere", away: float = 12.0) -> Rival:
    return Rival(kind, "log/000020", away, np.pi, 0.0, GOOD.evidence - fit.evidence)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("fit", "other", "verdict", "code"),
    [
        (GOOD, None, "match", "fits"),
        (GOOD, rival(POOR), "match", "fits"),
        (GOOD, rival(GOOD), "ambiguous", "elsewhere"),
        (GOOD, rival(GOOD, "turned"), "ambiguous", "turned"),
        (GOOD, rival(GOOD, "slides"), "ambiguous", "slides"),
        (replace(GOOD, inliers=200), None, "none", "misfit"),
        (replace(GOOD, seen=80, inliers=65, conflicts=0), None, "ambiguous", "little"),
        (replace(GOOD, inliers=500, conflicts=290), None, "none", "conflict"),
        (replace(GOOD, inliers=700, patch=90), None, "none", "misfit"),
        (POOR, rival(POOR), "none", "conflict"),
    ],
)
def test_the_verdict(fit: Fit, other: Rival | None, verdict: str, code: str) -> None:
    found = assess(fit, other)
    assert (found.verdict, found.reason.code) == (verdict, code)
    assert (found.probability >= SURE) == (verdict == "match")
    assert found.reason.rival == (other.map_id if other and code == other.kind else None)


def test_more_against_an_answer_makes_it_less_likely() -> None:
    def sure(fit: Fit, other: Rival | None = None) -> float:
        probability = assess(fit, other).probability
        assert probability is not None
        return probability

    assert sure(GOOD) > sure(replace(GOOD, conflicts=20)) > sure(replace(GOOD, conflicts=40))
    assert sure(GOOD) > sure(replace(GOOD, inliers=700)) > sure(replace(GOOD, inliers=600))
    assert sure(GOOD) > sure(replace(GOOD, patch=10)) > sure(replace(GOOD, patch=30))
    assert sure(GOOD) > sure(replace(GOOD, keypoints=1500))
    assert sure(GOOD) >= sure(GOOD, rival(POOR)) > sure(GOOD, rival(GOOD))


def test_what_the_way_says_counts_in_the_lead() -> None:
    here, there = found(0, GOOD), found(20, replace(GOOD, inliers=600), place=(30.0, 0.0, 0.0))
    assert here.alignment is not None and there.alignment is not None
    assert judged(there, best=here).verdict == "match"
    against = replace(here, alignment=replace(here.alignment, support=-6.0))
    assert judged(there, best=against).reason.code == "elsewhere"


def test_where_it_is_not_known_what_is_free_conflicts_say_nothing() -> None:
    blind = replace(GOOD, free_known=False)
    assert assess(blind, None).probability == assess(replace(blind, conflicts=90), None).probability


def found(number: int, fit: Fit, place=(0.0, 0.0, 0.0), pose=(0.0, 0.0, 0.0), dataset: str = "log") -> Found:
    travel, empty = np.array([number, number + 5.0]), Text.of([], [], [])
    one = Document(dataset, number, number + 9, travel, np.array(place), np.zeros(3), np.zeros(2), 9, empty)
    return Found(Hit(one, 0.9, 9, np.zeros(3)), None, Alignment(np.array(pose), fit, 0.9))


def judged(*others: Found, best: Found | None = None) -> Assessment:
    first = best or found(0, GOOD)
    assert first.alignment is not None
    return assess(first.alignment.fit, strongest(first, others))


@pytest.mark.parametrize(
    ("other", "code"),
    [
        (found(20, GOOD, place=(30.0, 0.0, 0.0)), "elsewhere"),
        (found(20, POOR, place=(30.0, 0.0, 0.0)), "fits"),
        (found(100, GOOD, place=(1.0, 0.0, 0.0)), "fits"),  # the same place, as far as drift can tell
        (found(0, GOOD, dataset="another"), "elsewhere"),
        (found(1, GOOD, pose=(0.0, 0.0, np.pi)), "turned"),
        (found(0, GOOD, pose=(1.5, 0.0, 0.0)), "slides"),
    ],
)
def test_which_hits_are_rivals(other: Found, code: str) -> None:
    assert judged(other).reason.code == code


def test_other_alignments_of_the_best_hit_are_rivals() -> None:
    turned = Alignment(np.array([0.0, 0.0, np.pi]), GOOD, 0.9)
    assert judged(best=replace(found(0, GOOD), others=(turned,))).reason.code == "turned"
    assert judged(best=replace(found(0, GOOD), others=(replace(turned, fit=POOR),))).verdict == "match"


def test_the_strongest_rival_is_named() -> None:
    near, far = found(20, replace(GOOD, inliers=758), (9.0, 0, 0)), found(40, GOOD, (0, 30.0, 0))
    reason = judged(near, far).reason
    assert reason.rival == "log/000040" and "30.0 m away" in reason.text
