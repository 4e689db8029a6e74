"""The maps that a session's drive leaves behind: they become the drive's past, and show its loops."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from m2t_text.config import Parameters
from m2t_text.index.map_index import MapIndex
from m2t_text.index.writing.folder import holds_index
from m2t_text.live.localizer import Localizer
from m2t_text.loops.export import loop_fields
from m2t_text.loops.gate import Loop
from m2t_text.loops.growing import GrowingDataset
from m2t_text.loops.online import OnlineLoops
from m2t_text.mapping.local_map import LocalMap
from m2t_text.pipeline import describe
from m2t_text.util.types import Floats


@dataclass(frozen=True)
class Left:
    """What a scan leaves behind.

    Attributes:
        name: of the robot.
        scan: its number; 0 for the first one of all, or after a reset.
        pose: (3,) of the robot.
        travel: metres up to it.
        begins: whether a drive begins with it of which it is not known where.
        runs: the local maps that it completed.
    """

    name: str
    scan: int
    pose: Floats
    travel: float
    begins: bool
    runs: tuple[LocalMap, ...]


class LiveLoops:
    """Describes what a drive leaves behind, keeps it in an index, and finds the loops of the drive.

    Without an index the drive has one of its own, which is removed at the end: its loops are those that the
    whole log has. To an index that is given the drive is added as a dataset, durably; its loops lead to other
    datasets, too.
    """

    def __init__(
        self,
        parameters: Parameters,
        index: MapIndex | None = None,
        find: bool = True,
        localizer: Localizer | None = None,
        keep_per_place: int | None = None,
    ) -> None:
        """
        Args:
            parameters: of the index, if there is one.
            index: that the drive is added to.
            find: whether loops are looked for.
            localizer: looks places up in the same index; it is kept from finding the drive itself.
            keep_per_place: see `GrowingDataset`.
        """
        self._parameters = parameters
        self._index = index
        self._find = find
        self._localizer = localizer
        self._keep = keep_per_place
        self._folder: TemporaryDirectory[str] | None = None
        self._past: GrowingDataset | None = None

    def take(self, left: Left) -> Iterator[dict[str, Any]]:
        """The loops that are known with a scan, as they are told."""
        if left.scan == 0 or self._past is None:
            self._begin(left.name)
        assert self._past is not None
        self._online.move(left.pose, left.travel, [left.scan] if left.begins and left.scan else [])
        for run in left.runs:
            document = describe(run, self._past.name, self._parameters)
            if self._find:
                yield from map(_told, self._online.add(document))
            else:
                self._past.add(document)

    def _begin(self, name: str) -> None:
        self.end()
        index = self._index
        if index is None:
            self._folder = TemporaryDirectory(prefix="m2t-text-")
            index = MapIndex.create(Path(self._folder.name) / "past", self._parameters)
        else:
            name = _free(name, [held.name for held in index.datasets()] if holds_index(index.path) else ())
            if self._localizer is not None:
                self._localizer.without = name
        self._past = GrowingDataset(index, name, self._keep)
        self._online = OnlineLoops(name, index, self._past)

    def end(self) -> None:
        """Commits what waits; what was kept for the drive alone is removed."""
        if self._past is not None and self._folder is None:
            self._past.commit()
        self._past = None
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None


def _free(name: str, held: Iterable[str]) -> str:
    """The name, or the first of ``name-2``, ``name-3``, ... that no dataset has."""
    taken = set(held)
    names = (name if number == 1 else f"{name}-{number}" for number in count(1))
    return next(one for one in names if one not in taken)


def _told(loop: Loop) -> dict[str, Any]:
    """A loop as an answer; ``from`` is a scan of the drive, or None where the place is another dataset's."""
    own = loop.dataset == loop.candidate.query.dataset
    return {"type": "loop", "from": loop.place if own else None, "to": loop.scan, **loop_fields(loop)}
