"""Which maps of a drive lead to a query, and how the robot moved from each of them to it."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from m2t_text.description.document import Document, map_id_of
from m2t_text.description.text import Text
from m2t_text.index.searchable import Searchable
from m2t_text.util.geometry import between, compose
from m2t_text.util.types import Floats

OVERLAP_STEP = 0.5  # of a run's length, from the begin of one map to that of the next: they overlap by half


@dataclass(frozen=True)
class Earlier:
    """An earlier map of a query's drive.

    Attributes:
        text: its text.
        behind: metres of travel from its middle to the query's.
        motion: (3,) the query's frame, at its viewpoint, as seen from the earlier map's.
    """

    text: Text
    behind: float
    motion: Floats


def earlier_maps(documents: Iterable[Document], query: Document) -> tuple[Earlier, ...]:
    """Earlier maps of the drive of a query, all of them with poses in one frame."""
    here = compose(query.pose, query.viewpoint)
    return tuple(
        Earlier(one.text, query.middle - one.middle, between(compose(one.pose, one.viewpoint), here))
        for one in documents
    )


def distances(metres: float, run_length: float) -> list[float]:
    """Travel from the begin of each earlier map to that of the query, metres, the last map first.

    Args:
        metres: length of the part of the drive that counts, up to the end of the query's run.
        run_length: of a map, metres; without it, no other maps are taken.
    """
    step = run_length * OVERLAP_STEP
    count = int(max(metres - run_length, 0.0) / step + 1e-9) if step else 0
    return [k * step for k in range(1, count + 1)]


def indexed_before(index: Searchable, query: Document, metres: float) -> tuple[Earlier, ...]:
    """The maps of an index that lead to a query, which is a map of one of its drives."""
    scans, begins = index.runs(query.dataset)
    begin = float(query.travel[0])
    wanted = [begin - distance for distance in distances(metres, index.parameters.mapping.run_length)]
    places = [int(np.searchsorted(begins, at, side="right")) - 1 for at in wanted]
    chosen = [k for k in dict.fromkeys(places) if k >= 0 and begins[k] < begin]
    return earlier_maps([index.document(map_id_of(query.dataset, int(scans[k]))) for k in chosen], query)
