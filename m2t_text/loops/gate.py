"""Which matches become loops: those that the trajectory and all other loops allow.

The verdict on a match compares places; this compares times. A match says where the query lies as seen from an
earlier pose, and so does the trajectory between both, directly or by way of a loop that is known already. The
tightest of such ways say most (Bosse's Dijkstra projection, "An Atlas framework for scalable mapping", ICRA
2003), and one that contradicts most of these is refused, in the spirit of pairwise consistency (Mangelson et
al., "Pairwise consistent measurement set maximization", ICRA 2018), but at once and in the order of the drive,
so that nothing looks ahead. Once loops near it become known, a match that was refused is looked at again.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from m2t_text.loops.lookup import Candidate
from m2t_text.loops.uncertainty import Drift, PoseWithCovariance
from m2t_text.util.types import Ints

GATE = 16.27  # squared Mahalanobis distance that a right match exceeds once in a thousand: 3 degrees of freedom
LOOSE = 2.0  # m; standard deviation of a predicted place from which the prediction alone confirms no match:
OWN_RUNS, OTHER_RUNS = 2, 5  # that share no scan must agree then, on the drive's past and on another dataset,
UNKNOWN = 100.0  # m; or on a past of which no more is known than this
TIGHT, VOTES = 2.0, 9  # ways so many times as loose as the tightest say as much; of so many at most, most count
AGAIN = 30.0  # m of travel from a refused match to a new loop, on both sides, from which it is looked at again


@dataclass(frozen=True, eq=False)
class Loop:
    """A pose of the drive as seen from an earlier one, or from one of another dataset.

    Attributes:
        scan: of the drive.
        dataset: that the place belongs to.
        place: index into that dataset's trajectory; a scan, where it is the drive's own.
        pose: of the scan as seen from the place.
        candidate: what was found.
        known: the scan at which the loop is known: its query's last, or that of the match that confirmed it.
    """

    scan: int
    dataset: str
    place: int
    pose: PoseWithCovariance
    candidate: Candidate
    known: int


class Gate:
    """Takes matches in the order of the drive, and says which are loops from then on.

    Attributes:
        loops: those that are sure, in the order in which they became so.
        waiting: those that nothing contradicts, but nothing confirms yet.
        refused: those that something contradicts.
    """

    def __init__(self, drive: str, drifts: dict[str, Drift]) -> None:
        """``drifts`` holds the trajectory of the drive and those of all other datasets."""
        self.loops: list[Loop] = []
        self.waiting: list[Loop] = []
        self.refused: list[Loop] = []
        self._drive = drive
        self._drifts = drifts
        self._of: defaultdict[str, list[Loop]] = defaultdict(list)

    def offer(self, loop: Loop) -> None:
        """Judges a match, and those that waited for it."""
        self.waiting.append(loop)
        before = len(self.loops)
        while any(self._settles(one, loop.known) for one in tuple(self.waiting)):
            again = [one for one in self.refused if self._near(one, self.loops[before:])]
            self.refused = [one for one in self.refused if one not in again]
            self.waiting += again
            before = len(self.loops)

    def _near(self, one: Loop, loops: Sequence[Loop]) -> bool:
        """Whether a match lies near any of the loops, in travel on both sides."""
        ours, theirs = self._drifts[self._drive].way, self._drifts[one.dataset].way
        return any(
            loop.dataset == one.dataset
            and abs(ours[loop.scan] - ours[one.scan]) <= AGAIN
            and abs(theirs[loop.place] - theirs[one.place]) <= AGAIN
            for loop in loops
        )

    def _settles(self, one: Loop, scan: int) -> bool:
        """Whether one that waits becomes a loop at a scan, perhaps with others: more may follow then."""
        ways = self._ways(one)
        if self._contradicts(ways, one):
            self.waiting.remove(one)
            self.refused.append(one)
            return False
        together = [one] if (ways.reach <= LOOSE).any() else self._agreeing(one)
        for loop in together:
            self.waiting.remove(loop)
            sure = replace(loop, known=scan)
            self.loops.append(sure)
            self._of[loop.dataset].append(sure)
        return bool(together)

    def _contradicts(self, ways: PoseWithCovariance, one: Loop) -> bool:
        """Whether most of the tightest ways (W, 3) lead elsewhere than a match says."""
        if not len(ways.pose):
            return False
        order = np.argsort(ways.reach, kind="stable")[:VOTES]
        order = order[ways.reach[order] <= TIGHT * ways.reach[order[0]]]
        tight = PoseWithCovariance(ways.pose[order], ways.covariance[order])
        return bool((tight.distance(one.pose) > GATE).mean() >= 0.5)

    def _agreeing(self, one: Loop) -> list[Loop]:
        """This one and those that wait and confirm it and each other, if they are of enough runs."""
        group = [one]
        waiting = [
            other for other in reversed(self.waiting) if other is not one and other.dataset == one.dataset
        ]
        for other, confirmed in zip(waiting, self._confirms(one, waiting), strict=True):
            if confirmed and self._confirmed(other, group[1:]):
                group.append(other)
        drift = self._drifts[self._drive]
        known = one.dataset == self._drive and drift.relative(one.place, one.scan).reach < UNKNOWN
        enough = OWN_RUNS if known else OTHER_RUNS
        return [loop for loop in self.waiting if loop in group] if _runs(group) >= enough else []

    def _confirms(self, one: Loop, others: Sequence[Loop]) -> NDArray[np.bool_]:
        """(L,) whether a match confirms each of the others."""
        ends, poses = _stacked(others)
        ways = self._by_way_of([one] * len(others), one.dataset, ends)
        return (ways.distance(poses) <= GATE) & (ways.reach <= LOOSE)

    def _confirmed(self, loop: Loop, others: Sequence[Loop]) -> bool:
        ways = self._by_way_of(others, loop.dataset, np.array([[loop.place, loop.scan]]))
        return bool((ways.distance(loop.pose) <= GATE).all() and (ways.reach <= LOOSE).all())

    def _ways(self, loop: Loop) -> PoseWithCovariance:
        """(W, 3) where a loop's scan lies as seen from its place, by the trajectory and by other loops."""
        ends = np.array([[loop.place, loop.scan]])
        ways = self._by_way_of(self._of[loop.dataset], loop.dataset, ends)
        if loop.dataset != self._drive:
            return ways
        direct = self._drifts[self._drive].relative(loop.place, np.array([loop.scan]))
        return PoseWithCovariance(
            np.concatenate([direct.pose, ways.pose]), np.concatenate([direct.covariance, ways.covariance])
        )

    def _by_way_of(self, others: Sequence[Loop], dataset: str, ends: Ints) -> PoseWithCovariance:
        """(W, 3) where scans lie as seen from places, by the places and scans of others.

        The places and scans are ``ends`` (W or 1, 2).
        """
        theirs, poses = _stacked(others)
        there = self._drifts[dataset].relative(ends[:, 0], theirs[:, 0])
        back = self._drifts[self._drive].relative(theirs[:, 1], ends[:, 1])
        return there.compose(poses).compose(back)


def _stacked(loops: Sequence[Loop]) -> tuple[Ints, PoseWithCovariance]:
    """Places and scans (L, 2), and poses (L, 3) with covariances."""
    ends = np.array([(loop.place, loop.scan) for loop in loops], dtype=np.int64).reshape(-1, 2)
    poses = np.array([loop.pose.pose for loop in loops]).reshape(-1, 3)
    covariances = np.array([loop.pose.covariance for loop in loops]).reshape(-1, 3, 3)
    return ends, PoseWithCovariance(poses, covariances)


def _runs(loops: Sequence[Loop]) -> int:
    """How many of the loops' queries, at most, share no scan with each other."""
    count, end = 0, -1
    for query in sorted((loop.candidate.query for loop in loops), key=lambda query: query.last_scan):
        if query.first_scan > end:
            count, end = count + 1, query.last_scan
    return count
