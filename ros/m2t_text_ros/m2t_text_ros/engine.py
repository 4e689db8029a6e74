"""The node's own state, free of ROS: one lock, a session that takes messages, and a localizer that answers."""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock
from typing import Any

import numpy as np

from m2t_text import PROFILES, Localizer, MapIndex, Place, Simulation, simulate
from m2t_text.index.writing.folder import holds_index
from m2t_text.live.looping import Left, LiveLoops
from m2t_text.live.messages import Odometry, Swept
from m2t_text.live.session import Session
from m2t_text.mapping.local_map import LocalMap
from m2t_text.pipeline import describe
from m2t_text.sources.saved_map import SavedMap
from m2t_text.util.compiled import Group
from m2t_text.warming import warm
from m2t_text_ros.conversion import Floats


@dataclass(frozen=True)
class Located:
    """An answer, and the keypoints (N, 2) of what the robot saw and of the map in which it was found, where the
    answer places them, metres in the map's frame."""

    place: Place
    seen: Floats
    shown: Floats


class Engine:
    """Scans and odometry come in one thread, requests in another; neither waits for the other's work."""

    def __init__(
        self,
        laser_pose: Floats,
        index: MapIndex | None,
        loops: bool = False,
        append: bool = False,
        keep_per_place: int | None = None,
    ) -> None:
        """``loops``, ``append`` and ``keep_per_place`` are those of `LiveLoops`."""
        self._lock = Lock()  # the only one: of the session
        self._laser_pose = laser_pose
        self._left: deque[Left] = deque()  # from the thread of the scans to that of the requests
        self._behind = loops or append
        self._grown = (index if append else None, loops, keep_per_place)
        self._folder: TemporaryDirectory[str] | None = None
        self._drive = 0
        self.warnings = 0
        self.last_warning = ""
        self._use(index)

    def _use(self, index: MapIndex | None) -> None:
        self.index = index
        self._localizer = None if index is None else Localizer(index)
        parameters = PROFILES["default"] if index is None else index.parameters
        grown, loops, keep = self._grown
        localizer = None if grown is None else self._localizer
        self._loops = LiveLoops(parameters, grown, loops, localizer, keep)
        left = self._keep if self._behind else None
        with self._lock:
            self._session = Session(parameters, poses=False, laser_pose=self._laser_pose, left=left)

    def _keep(self, left: Left) -> tuple[()]:
        self._left.append(left)
        return ()

    def loops(self) -> Iterator[dict[str, Any]]:
        """The loops that are known by now and were not before. One call at a time, not beside `locate`."""
        while self._left:
            yield from self._loops.take(self._left.popleft())

    def close(self) -> None:
        """Commits what waits, and removes what lies on disk for the drive alone."""
        for _ in self.loops():
            pass  # nobody hears of them any more, but their maps are kept
        self._loops.end()
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    def take(self, message: Swept | Odometry) -> None:
        """A scan or odometry. Raises LogError if it is none."""
        with self._lock:
            self._note(self._session.take(message))

    def _note(self, answers: Iterable[dict[str, Any]]) -> None:
        for answer in answers:
            self.warnings += 1
            self.last_warning = answer["text"]

    @property
    def maps(self) -> int:
        """How many maps the robot is looked for in."""
        return len(self.index) if self.index is not None and holds_index(self.index.path) else 0

    @property
    def travel(self) -> float:
        """Metres since the first scan."""
        return float(self._session.survey.travel)

    @property
    def scans(self) -> int:
        return self._session.survey.scans

    def replace_map(self, saved: SavedMap) -> None:
        """Localises in another map from now on. Raises MapFileError if nothing is to be seen in it."""
        folder = TemporaryDirectory(prefix="m2t-text-")
        index = MapIndex.create(Path(folder.name) / "index", PROFILES["default"])
        index.add(saved)
        old, self._folder = self._folder, folder
        if self.index is None:
            self.index, self._localizer = index, Localizer(index)
        else:
            self._localizer, self.index = Localizer(index), index
        if old is not None:
            old.cleanup()

    def forget(self) -> None:
        """What earlier answers say of where the robot is."""
        if self._localizer is not None:
            self._localizer.reset()

    def locate(self) -> Located | None:
        """Where the robot is; None if nothing is known of that yet. One call at a time."""
        localizer, index = self._localizer, self.index
        with self._lock:
            seen, robot, drive = self._session.last_run(), self._session.survey.pose.copy(), self._session.drive
            shorter = [] if seen is None else list(self._session.shorter_runs(seen))
            latest, continuity = self._session.latest(), self._session.survey.continuity
        if localizer is None or index is None or seen is None:
            return None
        if drive != self._drive:
            localizer.reset()
        self._drive = drive
        place = localizer.locate(seen, robot, shorter, latest, continuity)
        return Located(place, *_drawn(index, seen, robot, place))

    def warm_up(self) -> None:
        """Compiles all that a request needs, on a short simulated drive, and what leaps of odometry need."""
        warm([Group.MAPPING])
        log = simulate(Simulation(length=24.0, travel=8.0, beams=60))
        session = Session(PROFILES["default"], poses=False, laser_pose=log.laser_pose)
        for scan in log.scans:
            list(session.take(Swept(scan, True)))
        seen = session.last_run()
        assert seen is not None
        with TemporaryDirectory(prefix="m2t-text-") as folder:
            index = MapIndex.create(folder, PROFILES["default"])
            index.replace("warm", [describe(seen, "warm", PROFILES["default"])])
            Localizer(index).locate(seen)
        if self.index is not None and self.maps:
            Localizer(self.index).locate(self.index.document(self.index.ids[0]))


def _drawn(index: MapIndex, seen: LocalMap, robot: Floats, place: Place) -> tuple[Floats, Floats]:
    from m2t_text.util.geometry import between, compose, transform

    if place.pose is None or place.map_id is None:
        return np.empty((0, 2)), np.empty((0, 2))
    begin = compose(place.pose, between(robot, seen.pose))  # of the run
    hit = index.document(place.map_id)
    cells = (hit.text.positions() + 0.5) * index.parameters.mapping.cell
    return transform(begin, seen.points), transform(compose(hit.pose, hit.viewpoint), cells)
