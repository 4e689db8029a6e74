"""Ways to break an index while it is written: killing the writer, a disk that refuses, a loss of power."""

import errno
import os
import random
import resource
import shutil
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import children
from states import Change, State, changes, contents, copied, expected, litter

from m2t_text.config import Parameters
from m2t_text.errors import MapIndexError
from m2t_text.index.map_index import MapIndex, open_index
from m2t_text.index.writing.folder import holds_index

BEFORE = {"a": 3, "b": 11, "c": 4, "d": 17}
CHANGE = Change({"a": 8, "b": None, "e": 5}, False, {"a": 8, "c": 4, "d": 17, "e": 5})
MERGE = Change({"c": 2}, True, BEFORE | {"c": 2})
WHOLE = {"change": CHANGE, "merge": MERGE}

MOMENT = 0.25  # s within which a writer is killed
WRITERS = ("a", "b")  # of one index at the same time: what the names of their datasets begin with
CHANGES = (
    "os.rename",
    "os.mkdir",
    "os.remove",
    "os.rmdir",
    "shutil.rmtree",
    "os.fsync",
)  # beside opening to write


# --- Killed at random moments


def survive_kills(folder: Path, kills: int, seed: int) -> dict[str, int]:
    """Kills writers at random moments, two of each index.

    Returns how often nothing committed was lost, and how many pairs of writers left a commit half done.
    """
    rng, counts = random.Random(seed), {"survived": 0, "interrupted": 0}
    states: dict[str, State] = {name: {} for name in WRITERS}
    path = folder / "index"
    for trial in range(kills // len(WRITERS)):
        if rng.random() < 0.2:  # also while an index is made
            shutil.rmtree(path, ignore_errors=True)
            states = {name: {} for name in WRITERS}
        journals = {name: folder / f"{trial}-{name}" for name in WRITERS}
        processes = [
            children.start(_write, path, journals[name], states[name], seed + trial, name) for name in WRITERS
        ]
        for process in processes:
            time.sleep(rng.random() * MOMENT)
            os.kill(process, signal.SIGKILL)
            assert children.status(process) == -signal.SIGKILL
        held = contents(MapIndex.open(path)) if holds_index(path) else {}
        for name in WRITERS:
            states[name], whole = _found(held, journals[name], states[name], seed + trial, name)
            counts["survived"] += whole
        counts["interrupted"] += holds_index(path) and bool(litter(path))
        with opened(path).writer():  # cleans up
            pass
        assert litter(path) == []
    return counts


def opened(path: Path) -> MapIndex:
    return open_index(path, Parameters())


def _write(path: Path, journal: Path, state: State, seed: int, name: str) -> None:
    """Makes changes without end; the journal tells how many were reported to be done."""
    file = os.open(journal, os.O_CREAT | os.O_WRONLY)
    for number, change in enumerate(changes(seed, state, name)):
        change.apply(opened(path))
        os.pwrite(file, str(number + 1).zfill(9).encode(), 0)


def _found(held: Any, journal: Path, before: State, seed: int, name: str) -> tuple[State, bool]:
    """The state of one writer's datasets, and whether it is that of its latest reported commit, or the next."""
    done = int(journal.read_text() or 0) if journal.exists() else 0
    states = [before, *(change.after for change in islice(changes(seed, before, name), done + 1))]
    mine = {map_id: one for map_id, one in held.items() if map_id.startswith(name)}
    for state in (states[done], states[done + 1]):
        if mine == expected(state):
            return state, True
    return {}, False


# --- Stopped at every step


@dataclass
class Steps:
    """Counts what a process does to the files in a folder, and acts before one of its steps.

    Attributes:
        folder: what happens elsewhere does not count.
        act: called with the number of each step, from 0, and what it is: the event's name, and the path.
    """

    folder: Path
    act: Callable[[int, str, str], None]
    count: int = 0
    _open: bool = field(default=False, repr=False)

    def watch(self) -> None:
        """Begins; there is no end, so it is for a process of its own."""
        flush = os.fsync

        def fsync(descriptor: int) -> None:
            self._see("os.fsync", (f"/proc/self/fd/{descriptor}",))
            flush(descriptor)

        os.fsync = fsync  # type: ignore[assignment]
        sys.addaudithook(self._see)

    def _see(self, event: str, arguments: Any) -> None:
        if self._open or not (event in CHANGES or (event == "open" and _writes(arguments))):
            return
        self._open = True  # what is done here is no step
        try:
            path = os.fsdecode(arguments[0]) if isinstance(arguments[0], str | bytes | os.PathLike) else ""
            real = str(Path(path).readlink()) if path.startswith("/proc/self/fd/") else path
            if real.startswith(str(self.folder)):
                self.count += 1
                self.act(self.count - 1, event, real)
        finally:
            self._open = False


def _writes(arguments: Any) -> bool:
    flags = arguments[2]
    return bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))


def steps_of(path: Path, change: Change) -> int:
    """How many steps a change takes."""

    def count() -> int:
        steps = Steps(path, lambda number, event, real: None)
        index = MapIndex.open(path)
        steps.watch()
        change.apply(index)
        return steps.count

    return int(children.call(count))


def killed_before(path: Path, change: Change, step: int) -> bool:
    """Applies a change in a process that is killed before one of its steps; returns whether it was."""

    def kill(number: int, event: str, real: str) -> None:
        if number == step:
            os.kill(os.getpid(), signal.SIGKILL)

    def work() -> None:
        Steps(path, kill).watch()
        change.apply(opened(path))

    return children.status(children.start(work)) == -signal.SIGKILL


def killed_at(index: MapIndex, path: Path, change: Change, step: int) -> bool:
    """The same in a copy of the index; checks what is left, and returns whether the change was made."""
    before, after = contents(index), expected(change.after)
    copy = copied(index, path)
    assert killed_before(path, change, step)
    found = contents(copy)
    assert found in (before, after)
    with copy.writer():  # cleans up
        pass
    assert litter(path) == [] and contents(copy) == found
    return found == after


def refused_at(index: MapIndex, path: Path, change: Change, step: int, code: int) -> str | None:
    """Applies a change in a copy while the disk refuses that step, and all later ones that need room if it is
    full; what is said of it."""

    def refuse(number: int, event: str, real: str) -> None:
        needs_room = event in ("open", "os.mkdir", "os.fsync", "os.rename")
        if number == step or (number > step and needs_room and code == errno.ENOSPC):
            raise OSError(code, os.strerror(code))

    return _told(index, path, change, lambda: Steps(path, refuse).watch())


def limited(index: MapIndex, path: Path, change: Change, size: int) -> str | None:
    """Applies a change in a copy, in a process that may write files of so many bytes: what is said of it."""
    return _told(index, path, change, lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size)))


def forbidden(index: MapIndex, path: Path, change: Change) -> str | None:
    """Applies a change in a copy, as a user who may read it and no more: what is said of it."""

    def restrict() -> None:
        path.chmod(0o555)
        if os.getuid() == 0:
            os.setuid(65534)

    return _told(index, path, change, restrict)


def _told(index: MapIndex, path: Path, change: Change, restrict: Callable[[], None]) -> str | None:
    """What a writer says who cannot write; checks that it left nothing, or that the change was made."""
    copy = copied(index, path)

    def work() -> str | None:
        restrict()
        try:
            change.apply(copy)
        except MapIndexError as error:
            return str(error)
        return None

    told = children.call(work)
    path.chmod(0o755)
    assert contents(copy) == (expected(change.after) if told is None else contents(index))
    assert told is None or litter(path) == []
    return None if told is None else str(told)


# --- Power lost


@dataclass
class Disk:
    """What a disk surely holds of a folder: what was flushed. The rest may be there or not, in any order.

    Attributes:
        names: name -> inode, as of the last time that the folder was flushed.
        data: inode -> contents, as of the last time that the file was flushed.
        pending: changes of names since: (name that goes, name that comes, inode).
    """

    folder: Path
    names: dict[str, int] = field(default_factory=dict)
    data: dict[int, bytes] = field(default_factory=dict)
    pending: list[tuple[str | None, str | None, int]] = field(default_factory=list)
    seen: dict[str, int] = field(default_factory=dict)

    def settle(self) -> None:
        """All that the folder holds is on disk."""
        self.names = self.seen = self._listing()
        self.data = {(file.stat()).st_ino: file.read_bytes() for file in self._files()}
        self.pending = []

    def note(self, event: str, path: str) -> None:
        """Called before each step: takes note of what the one before changed, and of what is flushed now."""
        self._compare()
        if event == "os.fsync" and path == str(self.folder):
            self.names, self.pending = dict(self.seen), []
        elif event == "os.fsync":
            self.data[Path(path).stat().st_ino] = Path(path).read_bytes()

    def _compare(self) -> None:
        now = self._listing()
        come = {name: inode for name, inode in now.items() if self.seen.get(name) != inode}
        gone = {inode: name for name, inode in self.seen.items() if name not in now}
        for name, inode in come.items():
            self.pending.append((gone.pop(inode, None), name, inode))  # a file that moved does both or neither
        self.pending += [(name, None, inode) for inode, name in gone.items()]
        self.seen = now

    def lost(self, into: Path, rng: random.Random) -> None:
        """One of the folders that may be found after the power comes back."""
        shutil.rmtree(into, ignore_errors=True)
        into.mkdir()
        self._compare()
        names, share = dict(self.names), rng.choice((0.0, 0.5, 1.0))
        for gone, come, inode in self.pending:
            if rng.random() < share:
                if gone is not None:
                    names.pop(gone, None)
                if come is not None:
                    names[come] = inode
        written = {file.stat().st_ino: file.read_bytes() for file in self._files()}
        for name, inode in names.items():
            data = self.data.get(inode)
            if data is None:
                unsure = written.get(inode, b"")
                data = unsure[: int(len(unsure) * rng.choice((0.0, 0.5, 1.0)))]
            (into / name).write_bytes(data)

    def _files(self) -> list[Path]:
        return [file for file in self.folder.iterdir() if file.is_file()]

    def _listing(self) -> dict[str, int]:
        return {file.name: file.stat().st_ino for file in self._files()}


def _holds(path: Path, allowed: tuple[State, ...]) -> bool:
    try:
        return contents(MapIndex.open(path)) in [expected(state) for state in allowed]
    except MapIndexError:
        return False


def lose_power(path: Path, change: Change, before: State, tries: int, seed: int) -> dict[str, int]:
    """Applies a change, and loses the power before each of its steps and after it, in several ways each.

    Returns how many folders were looked at, and how many of them held neither the state before nor that after;
    once the change is reported, only the state after will do.
    """

    def work() -> dict[str, int]:
        rng, disk, lost = random.Random(seed), Disk(path), path.parent / "lost"
        index = MapIndex.open(path)
        disk.settle()
        counts = {"folders": 0, "wrong": 0}

        def look(*allowed: State) -> None:
            for _ in range(tries):
                disk.lost(lost, rng)
                counts["folders"] += 1
                counts["wrong"] += not _holds(lost, allowed)

        def act(number: int, event: str, real: str) -> None:
            look(before, change.after)
            disk.note(event, real)

        Steps(path, act).watch()
        change.apply(index)
        look(change.after)
        return counts

    return dict(children.call(work))
