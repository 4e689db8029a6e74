"""A relevant and an irrelevant pair of maps, to look at (paper, Figs. 4, 5, 7)."""

from dataclasses import dataclass

import numpy as np

from m2t_text.description.text import Text
from m2t_text.evaluation.judging import METHODS, Judgement
from m2t_text.evaluation.protocol import RIGHT_DISTANCE, GroundTruth
from m2t_text.index.map_index import MapIndex
from m2t_text.util.types import Floats


@dataclass(frozen=True)
class Pair:
    """Two maps and how well they fit.

    Attributes:
        query, found: their ids.
        query_text: laid over the other as the score with the pose words has it.
        found_text: as it is.
        alignment: (3,) pose of the query's viewpoint in the other's frame there, metres and radians.
        tolerance: cells by which matched keypoints may differ there.
        cell: metres, the step of both texts' pose words.
        scores: by method.
        relevant: whether both show the same place.
    """

    query: str
    found: str
    query_text: Text
    found_text: Text
    alignment: Floats
    tolerance: int
    cell: float
    scores: dict[str, float]
    relevant: bool


def examples(index: MapIndex, truth: GroundTruth, judgements: list[Judgement]) -> list[Pair]:
    """An ordinary query, the one whose normalised rank is the median, with its best relevant map and the best
    one of another place, which is missing where there is none."""
    ranks = np.array([judgement.normalised_rank["m2t"] for judgement in judgements])
    query = judgements[int(np.argsort(ranks, kind="stable")[(len(ranks) - 1) // 2])].query
    document = index.document(index.ids[query])
    scores = {method: index.scores(document.text, method) for method in METHODS}
    relevant, irrelevant = truth.relevance(query)
    elsewhere = irrelevant & (truth.distances(query) > RIGHT_DISTANCE)
    matching, cell = index.parameters.matching, index.parameters.mapping.cell
    pairs = []
    for mask in (relevant, elsewhere):
        if not mask.any():
            continue
        place = int(np.where(mask, scores["m2t"].score, -np.inf).argmax())
        found = index.document(index.ids[place])
        alignment = scores["m2t"].alignment[place] * [cell, cell, 1.0]
        laid = document.text.moved(alignment, cell)
        fits: dict[str, float] = {method: float(scores[method].score[place]) for method in METHODS}
        texts = (laid, found.text, alignment, matching.tolerance, cell)
        pairs.append(Pair(document.map_id, found.map_id, *texts, fits, mask is relevant))
    return pairs
