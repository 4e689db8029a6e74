"""How well a map's occupied cells agree with those of the map that the same scans show at their true poses."""

from dataclasses import asdict, dataclass

import numpy as np
from scipy.spatial import KDTree

from m2t_text.logs.log import Log
from m2t_text.mapping.local_map import Survey
from m2t_text.saved_maps.grid import OCCUPIED
from m2t_text.saved_maps.occupancy_mapping import build_map
from m2t_text.util.types import Floats

CELL = 0.1  # m
ROUNDING = 1e-6  # m


@dataclass(frozen=True)
class CellAgreement:
    """Shares of occupied cells of CELL metres.

    Attributes:
        precision, recall: of the map's cells that are the true map's, too, and of those that are the map's.
        near_precision, near_recall: the same, a cell beside, above or below counting as well: walls along a
            border between cells fall to either side of it.
    """

    precision: float
    recall: float
    near_precision: float
    near_recall: float

    def to_json(self) -> dict[str, float]:
        """Shares by name."""
        return asdict(self)


def cell_agreement(log: Log, survey: Survey, poses: Floats, truth: Floats) -> CellAgreement:
    """Of the map at ``poses`` (S, 3) with that at ``truth`` (S, 3), both in one frame, from the same scans."""
    scans = np.flatnonzero(survey.moved)
    drawn, true = (build_map(log, at, scans, CELL).centres(OCCUPIED) for at in (poses, truth))
    precision, near_precision = _covered(drawn, true)
    recall, near_recall = _covered(true, drawn)
    return CellAgreement(precision, recall, near_precision, near_recall)


def _covered(cells: Floats, others: Floats) -> tuple[float, float]:
    """The share of cells (N, 2) that are among others (M, 2), and of those that have one of them near."""
    if not len(cells) or not len(others):
        return 0.0, 0.0
    away, _ = KDTree(others).query(cells)
    away = np.asarray(away)
    return float((away < ROUNDING).mean()), float((away < CELL + ROUNDING).mean())
