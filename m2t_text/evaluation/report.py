"""The figures of an evaluation, as ``evaluate --json`` has them: percentages are 0...100, angles radians."""

import re
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from m2t_text.evaluation.judging import METHODS, Judgement, column
from m2t_text.evaluation.metrics import median, recall, verdicts
from m2t_text.evaluation.protocol import LIMITS, RIGHT_DISTANCE
from m2t_text.evaluation.run import EvaluatedLog, Evaluation
from m2t_text.util.types import Floats

# ANR of BoW and M2T in percent (paper, Table I), by what the name of the log begins with.
PUBLISHED = {
    r"abuilding": (29.3, 7.0),
    r"albert": (35.0, 26.6),
    r"(freiburg-|fr)079": (24.0, 17.1),
    r"(freiburg-|fr)101": (32.6, 16.7),
    r"kwing1": (18.7, 3.6),
    r"run1": (41.7, 15.2),
}


def published(dataset: str) -> dict[str, float] | None:
    """The paper's ANR by method, if the dataset is one of its six."""
    for name, figures in PUBLISHED.items():
        if re.match(rf"{name}(?!\d)", dataset, re.IGNORECASE):
            return dict(zip(METHODS, figures, strict=True))
    return None


def report(evaluation: Evaluation) -> dict[str, Any]:
    """The document of ``evaluate --json``."""
    datasets = [_dataset(one) for one in evaluation.datasets]
    return {
        "profile": evaluation.parameters.profile,
        "parameters": asdict(evaluation.parameters),
        "datasets": datasets,
        "mean": mean([dataset["methods"] for dataset in datasets]),
    }


def _dataset(one: EvaluatedLog) -> dict[str, Any]:
    return {
        "dataset": one.log.name,
        "scans": len(one.log.scans),
        "travel": one.travel,
        "maps": len(one.truth),
        "queries": len(one.judgements),
        "pairs": sum(judgement.relevant for judgement in one.judgements),
        "methods": methods(one.judgements, one.unvisited, one.elsewhere),
        "published_anr": published(one.log.name),
    }


def methods(
    judgements: list[Judgement], unvisited: tuple[int, int] = (0, 0), elsewhere: tuple[int, int] = (0, 0)
) -> dict[str, Any]:
    """The figures of each method over all queries of a dataset; None where nothing defines one.

    ``unvisited`` and ``elsewhere`` count the maps that were looked up where their place is not, and those among
    them that got a `match`.
    """
    figures: dict[str, Any] = {
        method: {
            "anr": 100 * float(column(judgements, "normalised_rank", method).mean()),
            "recall_at_1": _recalls(column(judgements, "distance", method)),
        }
        for method in METHODS
    }
    distances = column(judgements, "distance", "verified")
    match = np.array([judgement.verdict == "match" for judgement in judgements])
    precision, found = verdicts(distances, match, RIGHT_DISTANCE)
    right = np.array([judgement.right for judgement in judgements])
    all_matches = int(match.sum()) + unvisited[1]
    errors = np.array([j.error for j in judgements if j.error is not None]).reshape(-1, 2)
    figures["verified"] = {
        "recall_at_1": _recalls(distances),
        "translation_error_median": median(errors[:, 0]),
        "rotation_error_median": median(errors[:, 1]),
        "verdict_precision": None if precision is None else 100 * precision,
        "verdict_recall": 100 * found,
        "pose_recall": 100 * float(right.mean()),
        "match_precision": 100 * float((right & match).sum()) / all_matches if all_matches else None,
        "match_recall": 100 * float((right & match).mean()),
        "unvisited": unvisited[0],
        "unvisited_matches": unvisited[1],
        "elsewhere": elsewhere[0],
        "elsewhere_matches": elsewhere[1],
    }
    return figures


def _recalls(distances: Floats) -> dict[str, float]:
    return {f"{limit:g}": 100 * recall(distances, limit) for limit in LIMITS}


def mean(figures: Sequence[Any]) -> Any:
    """The mean of nested figures, one by one, over those that are not None; None if all are."""
    if isinstance(figures[0], dict):
        return {key: mean([figure[key] for figure in figures]) for key in figures[0]}
    known = [figure for figure in figures if figure is not None]
    return float(np.mean(known)) if known else None
