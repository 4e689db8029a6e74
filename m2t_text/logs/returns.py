"""Which readings of a laser are no returns, told from the readings alone.

Drivers tell a beam that did not return in many ways: not as a number, as zero, below the least range, at the
greatest range, or as some number that means so, which often is nowhere written down. A number that means so
recurs: it is the greatest reading (or the least) of many scans, and wide fans of beams share it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m2t_text.util.types import Floats

MIN_RANGE = 0.02  # m; no laser measures less, but some report error codes so
TICK = 0.001  # m; readings are compared to the millimetre, as most lasers round to it or to more
LONGEST = 200.0  # m; beyond it no reading is looked at
FEWEST, SHARE = 100, 1e-3  # readings that recur, in number and of all
BEYOND = 0.05  # of as many readings as recur may be greater (or smaller): noise of walls as far away
CLIPPED = 20.0  # m; at such a distance no wall gives one reading so often, as noise spreads them
NEIGHBOURHOOD = 0.1  # share of the reading; of walls, readings near to it are as frequent
OUTSTANDING = 20.0  # times as frequent as those readings
FAN = np.radians(15.0)  # a wall gives one reading over a smaller angle, even to the centimetre
FANNED = 0.1  # share of the scans with the reading that have such a fan of it
RECURRING_UP_TO = 0.5  # m; a least reading that recurs in fans is looked for up to here
CODES = 4  # numbers that mean no return; some lasers have several


@dataclass(frozen=True)
class Recurring:
    """A reading that means no return: metres, how often it is told, and whether walls are seen beyond it."""

    value: float
    count: int
    seen_beyond: bool


def no_returns(ranges: Sequence[Floats], angles: Sequence[Floats]) -> list[Recurring]:
    """The readings of one laser that recur as walls do not, the greatest first.

    ``ranges`` and ``angles`` hold (B,) of each scan; what is known to be no return is ``inf``.
    """
    counts = _counts(ranges)
    found = []
    for least in (False, True):
        for _ in range(CODES):
            tick = _recurring(counts, ranges, angles, least)
            if tick is None:
                break
            beyond = counts[:tick] if least else counts[tick + 1 :]
            seen = bool(beyond.sum() > BEYOND * counts[tick])
            found.append(Recurring(tick * TICK, int(counts[tick]), seen))
            if least:
                counts[: tick + 1] = 0
            else:
                counts[tick:] = 0
    return found


def without(ranges: Floats, found: Sequence[Recurring]) -> Floats:
    """The readings (B,) with ``inf`` for those that are found to be no returns, or too small to be any."""
    least = max((one.value + TICK for one in found if one.value < RECURRING_UP_TO), default=MIN_RANGE)
    limits = [one.value for one in found if one.value >= RECURRING_UP_TO and not one.seen_beyond]
    kept = (ranges >= least - TICK / 2) & (ranges < min(limits, default=np.inf) - TICK / 2)
    for one in found:
        if one.seen_beyond:
            kept &= np.abs(ranges - one.value) >= TICK / 2
    return np.where(kept, ranges, np.inf)


def told(found: Sequence[Recurring], total: int) -> Iterator[str]:
    """A warning for each of the readings that are found to be no returns, of so many in all."""
    for one in found:
        which = (
            "next to the largest"
            if one.seen_beyond
            else "the smallest"
            if one.value < RECURRING_UP_TO
            else "the largest"
        )
        times = f"recur {one.count:,} times in {total:,}"
        yield f"readings of {one.value:g} m, {which}, {times}: taken as no return"


def _ticks(ranges: Floats) -> NDArray[np.int64]:
    return np.rint(ranges[ranges < LONGEST] / TICK).astype(np.int64)


def _counts(ranges: Sequence[Floats]) -> NDArray[np.int64]:
    counts = np.zeros(int(LONGEST / TICK) + 2, dtype=np.int64)
    for one in ranges:
        np.add.at(counts, _ticks(one), 1)
    return counts


def _recurring(
    counts: NDArray[np.int64], ranges: Sequence[Floats], angles: Sequence[Floats], least: bool
) -> int | None:
    """The greatest reading (or the least), in ticks, if it recurs as walls do not."""
    total = counts.sum()
    frequent = np.flatnonzero(counts >= max(FEWEST, SHARE * total))
    if least:
        frequent = frequent[(frequent * TICK < RECURRING_UP_TO) & (frequent > 0)]
    if not len(frequent):
        return None
    tick = int(frequent[0] if least else frequent[-1])
    beyond = counts[:tick] if least else counts[tick + 1 :]
    if beyond.sum() > BEYOND * counts[tick]:
        sure = not least and beyond.sum() < counts[tick] and _outstanding(counts, tick)
        return tick if sure and _fanned(tick, ranges, angles) else None
    if not least and (tick * TICK >= CLIPPED or _outstanding(counts, tick)):
        return tick
    return tick if _fanned(tick, ranges, angles) else None


def _outstanding(counts: NDArray[np.int64], tick: int) -> bool:
    """Whether a reading is far more frequent than the smaller ones near to it."""
    near = counts[int(tick * (1 - NEIGHBOURHOOD)) : tick - 1]
    near = near[near > 0]
    return len(near) >= 5 and counts[tick] >= OUTSTANDING * near.mean()


def _fanned(tick: int, ranges: Sequence[Floats], angles: Sequence[Floats]) -> bool:
    """Whether neighbouring beams share the reading over wider angles than a wall gives."""
    scans = fans = 0
    for one, turned in zip(ranges, angles, strict=True):
        shared = np.abs(one - tick * TICK) < TICK / 2
        if shared.any():
            scans += 1
            fans += _widest(shared, turned) >= FAN
    return scans >= 3 and fans >= FANNED * scans


def _widest(shared: NDArray[np.bool_], angles: Floats) -> float:
    """Radians of the widest run of beams that share a reading."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], shared, [False]]).astype(np.int8)))
    firsts, lasts = edges[::2], edges[1::2] - 1
    return float(np.abs(angles[lasts] - angles[firsts]).max())
