"""Whether a drive goes on where it was: what a robot sees now must fit what it saw just before.

A robot that is carried elsewhere sees other walls at once, though its wheels do not tell, and scan matching
fits next to nothing of them. Nor does it where a door opens on much that was not seen before; but there, what
was seen is not contradicted: no walls stand where it was free, and none are missing.
"""

from dataclasses import dataclass

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.mapping.local_map import LocalMap
from m2t_text.pipeline import describe
from m2t_text.recognition.fit import Fit
from m2t_text.recognition.raster import Raster
from m2t_text.util.geometry import between, compose
from m2t_text.util.types import Floats

DOUBTFUL = 0.6  # share of a scan's points that fit the scans before it, below which it is looked at closely
LEAST_SEEN = 40  # keypoints, of both maps, from which one contradicts another,
FITS, CONFLICTS = 0.5, 5.0  # below this share of inliers, less so many times that of conflicts


@dataclass(frozen=True)
class Continuity:
    """Over which of its last metres a drive is one piece.

    Attributes:
        carried: metres of travel at which the robot was last carried elsewhere: what it saw before is no part
            of what surrounds it now.
        doubtful: metres of travel at the last scan that hardly fitted those before it: across it, it is not
            sure where the drive led.
    """

    carried: float = 0.0
    doubtful: float = 0.0


def goes_on(before: LocalMap, newest: LocalMap, parameters: Parameters) -> bool:
    """Whether what was seen last may have been seen where the drive leads."""
    there, here = (describe(one, "live", parameters) for one in (before, newest))
    return may_show(here, between(there.pose, here.pose), there, parameters.mapping.cell)


def may_show(document: Document, pose: Floats, there: Document, cell: float) -> bool:
    """Whether two maps may show one place: too little of it may. The ``pose`` (3,) is that of the one's run as
    seen from the begin of the other's."""
    placed = between(there.viewpoint, compose(pose, document.viewpoint))
    fit = Fit.of(Raster.of(document.text, cell), placed, Raster.of(there.text, cell))
    return fit.seen < LEAST_SEEN or fit.seen_inliers - CONFLICTS * fit.seen_conflicts >= FITS
