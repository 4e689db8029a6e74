"""The lines of a plain or compressed file that may be damaged, one at a time, and an account of the damage."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from m2t_text.errors import LogError
from m2t_text.logs.unpacking import is_broken, packing, unpacked
from m2t_text.util.files import opened, shown
from m2t_text.util.types import Progress

LINE_LIMIT = 1 << 20  # bytes; the longest honest line, 361 readings and their remissions, has about 4 kB
GIVE_UP = 1 << 26  # bytes without an end of line: no log, however long we read on
PROGRESS_STEP = 256  # lines between two calls of progress


@dataclass
class Damage:
    """What was skipped: for each kind, how many times and on which line (or other unit) first."""

    unit: str = "line"
    kinds: dict[str, tuple[int, int]] = field(default_factory=dict)

    def add(self, kind: str, number: int) -> None:
        """Count one more damage of a kind."""
        count, first = self.kinds.get(kind, (0, number))
        self.kinds[kind] = (count + 1, first)

    def report(self) -> tuple[str, ...]:
        """One line for each kind."""
        unit = self.unit
        return tuple(
            f"{kind}: {unit} {first}" if count == 1 else f"{kind}: {count} {unit}s, the first is {unit} {first}"
            for kind, (count, first) in self.kinds.items()
        )


def read_lines(
    path: Path, damage: Damage, progress: Progress | None = None
) -> Iterator[tuple[int, bytes, bool]]:
    """Yield (number from 1, text, whether its end of line is there). Compression is told by the first bytes.

    Memory is bounded whatever the file holds. Too long lines and broken compression are added to ``damage``.
    Raises LogError if the file cannot be opened or read.
    """
    with opened(path, LogError) as raw:
        size = os.fstat(raw.fileno()).st_size
        how = packing(raw)
        stream = unpacked(raw, how) if how else raw
        for number, text, whole in _bounded_lines(path, stream, damage, how):
            yield number, text, whole
            if progress and number % PROGRESS_STEP == 0:
                progress(raw.tell(), size)
        if progress:
            progress(size, size)


def _bounded_lines(
    path: Path, stream: BinaryIO, damage: Damage, how: str | None
) -> Iterator[tuple[int, bytes, bool]]:
    number, length = 0, 0  # length of the too long line that is being skipped, else 0
    while True:
        try:
            text = stream.readline(LINE_LIMIT)
        except Exception as error:
            if how is None or not is_broken(error):
                raise
            damage.add(f"the {how} data is cut off or corrupt, the rest was not read", number + 1)
            return
        if not text:
            return
        whole = text.endswith(b"\n")
        number += length == 0
        if length == 0 and (whole or len(text) < LINE_LIMIT):
            yield number, text, whole
            continue
        if length == 0:
            damage.add(f"longer than {LINE_LIMIT} bytes", number)
        length = 0 if whole else length + len(text)
        if length >= GIVE_UP:
            raise LogError(f"{shown(path)}:{number}: the line does not end: this is not a laser log")
