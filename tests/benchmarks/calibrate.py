"""Fits the coefficients of evidence and of the verdict's probability: `make calibrate LOGS="a.log b.log.gz"`.

Logs with corrected poses and simulated buildings are looked up (`lookups.py`), which takes minutes and is kept
in a folder; then the coefficients are fitted (`fitting.py`) in seconds. Each building is judged by coefficients
that were fitted on all others, and then by those in force. What is fitted on all is printed beside those; for
the five logs of the Radish repository with corrected poses they lie within 3 % of each other.

`RAW=CORRECTED` names a log without corrected poses, and one that holds some of its scans and has them.
"""

import argparse
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple, fields
from itertools import pairwise
from pathlib import Path

import numpy as np
from calibration_sources import all_lookups, all_sequences
from fitting import Answers, answers, fitted_agreement, fitted_evidence, fitted_verdict, odds
from lookups import IN_MAP, KINDS, NEVER, VISITED, Lookups
from scipy.special import expit

from m2t_text.recognition import fit, verdict
from m2t_text.recognition.verdict import SURE, Coefficients
from m2t_text.util.types import Floats

EVIDENCE_IN_FORCE = (fit.SEEN, fit.INLIERS, fit.CONFLICTS, fit.DISTANCE)
SIMULATED = 0.5  # weight of a simulated building beside a log
BINS = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.95, 0.98, 0.995, 1.0)


def weight_of(one: Lookups) -> float:
    return SIMULATED if one.name.startswith("simulated") else 1.0


def held_out(found: Sequence[Lookups], free: bool) -> Iterator[tuple[Lookups, Answers, Floats]]:
    """Each source's answers, and their odds by coefficients that saw no source of its building."""
    for building in sorted({one.building for one in found}):
        others = [one for one in found if one.building != building]
        evidence = fitted_evidence(others)
        by = fitted_verdict([answers(one, evidence, free, weight_of(one)) for one in others])
        for one in found:
            if one.building == building:
                judged = answers(one, evidence, free)
                yield one, judged, odds(by, judged)


def shares(judged: Sequence[tuple[Answers, Floats]]) -> str:
    """Of a source: how many first answers are right, `match` right and found, and wrong ones of each kind."""
    kind, right = (np.concatenate([getattr(one, name) for one, _ in judged]) for name in ("kind", "right"))
    match = np.concatenate([value for _, value in judged]) >= np.log(SURE / (1 - SURE))
    visited = kind == VISITED
    count = (match & right & visited).sum()
    precision = 100 * count / max((match & ((kind == VISITED) | (kind == NEVER))).sum(), 1)
    wrong = [f"{(match & ~right & (kind == k)).sum()}/{(kind == k).sum()}" for k in range(len(KINDS))]
    found, first = (100 * n / max(visited.sum(), 1) for n in (count, (right & visited).sum()))
    runs = kind == IN_MAP
    told = (
        f"  {100 * (match & right & runs).sum() / runs.sum():.1f} % found in a saved map" if runs.any() else ""
    )
    return f"{first:6.1f} {precision:6.1f} {found:6.1f}  " + " ".join(f"{text:>8}" for text in wrong) + told


def by_those_in_force(found: Sequence[Lookups], free: bool) -> Iterator[tuple[Lookups, Answers, Floats]]:
    """Each source's answers, and their odds by the coefficients in force."""
    for one in found:
        judged = answers(one, np.array(EVIDENCE_IN_FORCE), free)
        yield one, judged, odds(verdict.WITH_FREE if free else verdict.WITHOUT_FREE, judged)


def print_judged(title: str, found: Iterable[tuple[Lookups, Answers, Floats]], free: bool) -> None:
    print(f"\nJudged by coefficients {title}, {'with' if free else 'without'} free squares")
    print(f"{'':24} {'first':>6} {'match':>6} {'found':>6}  wrong `match` of {', '.join(KINDS)}")
    judged: dict[str, list[tuple[Answers, Floats]]] = {}
    for one, answered, value in found:
        judged.setdefault(one.name, []).append((answered, value))
    for name, some in judged.items():
        print(f"{name:24} {shares(some)}")
    right = np.concatenate([one.right for some in judged.values() for one, _ in some])
    chance = expit(np.concatenate([value for some in judged.values() for _, value in some]))
    print("\nprobability    answers  right, %")
    for low, high in pairwise(BINS):
        inside = (chance >= low) & ((chance < high) | (high == 1.0))
        if inside.any():
            print(f"{low:5.3f}–{high:5.3f} {inside.sum():10}    {100 * right[inside].mean():6.1f}")


def print_coefficients(found: Sequence[Lookups], free: bool) -> None:
    """Those fitted on all sources beside those in force."""
    evidence = fitted_evidence(found)
    fitted = fitted_verdict([answers(one, evidence, free, weight_of(one)) for one in found])
    in_force = verdict.WITH_FREE if free else verdict.WITHOUT_FREE
    print(f"\nProbability, {'with' if free else 'without'} free squares")
    print_table([field.name for field in fields(Coefficients)], astuple(fitted), astuple(in_force))


def print_agreement(sequences: Sequence[Lookups]) -> None:
    """A coefficient for what earlier maps of a drive say beyond the lead; none is in force."""
    answered = [answers(one, np.array(EVIDENCE_IN_FORCE), True) for one in sequences]
    print("\nThe way that led there, with free squares")
    print_table(["agreed"], [fitted_agreement(answered, verdict.WITH_FREE)], [0.0])


def print_table(names: Sequence[str], fitted: Sequence[float], in_force: Sequence[float]) -> None:
    print(" " * 9 + " ".join(f"{name:>10}" for name in names))
    for title, values in (("fitted", fitted), ("in force", in_force)):
        print(f"{title:9}" + " ".join(f"{value:10.2f}" for value in values))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", help="logs with corrected poses, or RAW=CORRECTED")
    parser.add_argument("--simulated", type=int, default=4, help="number of simulated buildings")
    parser.add_argument(
        "--queries", type=int, default=300, help="visited places looked up in each log, at most"
    )
    parser.add_argument(
        "--keep", type=Path, default=Path("indexes/calibration"), help="what is kept of lookups"
    )
    options = parser.parse_args()
    if len(options.logs) + options.simulated < 2:
        parser.error("each building is judged by the others: name two logs or more, or have some simulated")
    found = list(all_lookups(options.logs, options.simulated, options.queries, options.keep))
    for free in (True, False):
        print_judged("of other buildings", held_out(found, free), free)
        print_judged("in force", by_those_in_force(found, free), free)
    print("\nEvidence")
    print_table(
        ("ln seen", "inliers", "conflicts", "distance"), fitted_evidence(found).tolist(), EVIDENCE_IN_FORCE
    )
    print_coefficients(found, free=True)
    print_coefficients(found, free=False)
    if options.logs:
        print_agreement(list(all_sequences(options.logs, options.queries, options.keep)))


if __name__ == "__main__":
    main()
