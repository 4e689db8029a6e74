"""The fit of the verdict's coefficients, on answers that are drawn with coefficients which are known."""

from dataclasses import replace

import numpy as np
import pytest
from fitting import Answers, answers, fitted_agreement, fitted_evidence, fitted_verdict, odds
from lookups import NEVER, OTHER_LOG, VISITED, Lookups
from scipy.special import expit

from m2t_text.recognition.fit import Fit
from m2t_text.recognition.verdict import FURTHEST, WITH_FREE, Coefficients, Rival, probability

TRUE = Coefficients(10.0, 8.0, -20.0, -0.1, -15.0, 1.2)


def drawn(count: int, seed: int = 0) -> Answers:
    rng = np.random.default_rng(seed)
    shares = rng.uniform((0.3, 0.4, 0.0, 0.0), (1.0, 1.0, 0.15, 40.0), (count, 4))
    lead = rng.uniform(0.0, FURTHEST, count)
    none = np.zeros(count)
    one = Answers(none.astype(int), none > 0, lead, shares, none, np.full(count, 1 / count))
    return replace(one, right=rng.random(count) < expit(odds(TRUE, one)))


def test_the_fit_finds_the_coefficients_that_answers_were_drawn_with() -> None:
    fitted = fitted_verdict([drawn(20000), drawn(20000, seed=1)])
    for name, value in vars(TRUE).items():
        assert getattr(fitted, name) == pytest.approx(value, rel=0.2), name


def test_its_probabilities_hold_for_answers_that_it_never_saw() -> None:
    fitted, fresh = fitted_verdict([drawn(4000)]), drawn(20000, seed=1)
    chance = expit(odds(fitted, fresh))
    for low in (0.0, 0.2, 0.4, 0.6, 0.8, 0.95):
        inside = (chance >= low) & (chance < low + 0.2)
        assert fresh.right[inside].mean() == pytest.approx(chance[inside].mean(), abs=0.06)


def test_no_figure_counts_against_what_it_speaks_for() -> None:
    one = drawn(2000)
    fitted = fitted_verdict([replace(one, right=~one.right)])
    assert fitted.overlap >= 0 and fitted.inliers >= 0 and fitted.conflicts <= 0 and fitted.patch <= 0


def test_without_free_squares_there_are_fewer_figures() -> None:
    one = drawn(5000)
    fitted = fitted_verdict([replace(one, figures=one.figures[:, :2])])
    assert fitted.conflicts == fitted.patch == 0.0 and fitted.inliers > 0


def test_the_odds_are_those_of_the_verdict() -> None:
    fit = Fit(keypoints=900, seen=800, inliers=720, conflicts=12, free_known=True, grip=0.3, patch=7)
    rival = Rival("elsewhere", "log/000020", 9.0, 0.0, 0.0, lead=2.5)
    figures = np.array([[800 / 900, 720 / 800, 12 / 800, 7.0]])
    one = Answers(np.zeros(1, int), np.ones(1, bool), np.array([2.5]), figures, np.zeros(1), np.ones(1))
    chance = expit(odds(WITH_FREE, one)[0])
    assert chance == pytest.approx(probability(fit, rival), rel=1e-12)


def test_the_weight_of_the_way_is_found() -> None:
    one = drawn(20000)
    support = -np.random.default_rng(2).exponential(2.0, len(one.lead))
    right = np.random.default_rng(3).random(len(support)) < expit(odds(TRUE, one) + 0.7 * support)
    assert fitted_agreement([replace(one, right=right, support=support)], TRUE) == pytest.approx(0.7, rel=0.1)
    untold = replace(one, support=support)  # it has nothing to do with what is right
    assert fitted_agreement([untold], TRUE) == pytest.approx(0.0, abs=0.02)


def looked_up(queries: int, each: int, evidence: np.ndarray, seed: int = 0) -> Lookups:
    """Alignments of which one of each query is right, the likelier the more evidence speaks for it."""
    rng = np.random.default_rng(seed)
    count = queries * each
    seen = rng.integers(100, 900, count).astype(float)
    inliers, conflicts = rng.uniform(0.6, 1.0, count), rng.uniform(0.0, 0.1, count)
    distance, none = rng.uniform(0.0, 0.08, count), np.zeros(count)
    figures = np.column_stack([np.log1p(seen), inliers, conflicts, distance])
    value = (figures @ evidence).reshape(queries, each) + rng.gumbel(size=(queries, each))
    right = (value == value.max(axis=1, keepdims=True)).ravel()
    fit = np.column_stack([seen + 100, seen, seen * inliers, seen * conflicts, none, distance, none])
    place = np.column_stack([none, none, np.arange(count) * 5.0, none, none])
    kind, query = np.full(queries, VISITED), np.repeat(np.arange(queries), each)
    return Lookups("drawn", "drawn", kind, query, none > 0, place, right, none, fit, fit)


def test_the_fit_finds_the_evidence_by_which_alignments_are_right() -> None:
    """Up to a factor: the verdict has one for the lead."""
    true = np.array([2.0, 15.0, -30.0, -20.0])
    found = fitted_evidence([looked_up(4000, 8, true)])
    assert found / np.abs(found).sum() == pytest.approx(true / np.abs(true).sum(), rel=0.15)


def test_queries_with_hopeless_alignments_do_not_rule() -> None:
    true = np.array([2.0, 15.0, -30.0, -20.0])
    odd = looked_up(400, 8, -3 * true, seed=1)  # weighs as much; its worst alignments are right
    found = fitted_evidence([looked_up(4000, 8, true), replace(odd, name="odd")])
    assert found / np.abs(found).sum() == pytest.approx(true / np.abs(true).sum(), rel=0.25)


def test_the_best_answer_and_its_lead_are_those_of_a_plain_search() -> None:
    evidence = np.array([3.0, 18.0, -40.0, -10.0])
    source = looked_up(30, 6, evidence)
    one = answers(source, evidence, free=True)
    value = (
        np.column_stack(
            [
                np.log1p(source.fit[:, 1]),
                source.fit[:, 2] / source.fit[:, 1],
                source.fit[:, 3] / source.fit[:, 1],
                source.fit[:, 5],
            ]
        )
        @ evidence
    )
    for k in range(30):
        own = np.sort(value[source.query == k])[::-1]  # all lie 5 m apart: each is a rival of each
        assert one.lead[k] == pytest.approx(min(own[0] - own[1], FURTHEST))
        assert one.right[k] == source.right[np.flatnonzero(value == own[0])[0]]


def test_kinds_of_queries_weigh_alike_however_many_there_are() -> None:
    source = looked_up(300, 2, np.ones(4))
    kind = np.where(np.arange(300) < 200, VISITED, np.where(np.arange(300) < 250, NEVER, OTHER_LOG))
    fields = vars(source) | {"kind": kind}
    weight = answers(Lookups(**fields), np.ones(4), free=True).weight
    assert weight[kind == VISITED].sum() == pytest.approx(1.0)
    assert weight[kind == NEVER].sum() == pytest.approx(weight[kind == OTHER_LOG].sum())
