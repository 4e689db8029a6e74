"""The times of messages: their stamps, made to run on where they begin again, or the times of recording.

A stamp is the sender's clock. It may be missing (zero), as before simulated time begins; it may fall back, as
when a simulation is reset or a bag is played again; and two senders may have two clocks. The times of recording
are of one clock, but late by what the network takes. So stamps give the times, recording tells what they mean.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m2t_text.util.types import Floats

SLACK = 0.1  # s by which stamps of one sender may be out of order
LASTING = 3  # messages behind the latest stamp that are no stragglers: the clock was set back
TOGETHER = 5.0  # s of recording within which senders notice that the clock was set back
MAX_CLOCK_DIFFERENCE = 1.0  # s between two clocks; recording takes less
STEADY = 0.3  # s by which recording may be late, more or less, to tell two clocks apart


@dataclass(frozen=True)
class Stream:
    """Messages of one sender as recorded: ``stamps`` (N,), NaN where missing, ``recorded`` (N,), seconds."""

    stamps: Floats
    recorded: Floats


@dataclass(frozen=True)
class Timed:
    """The times (N,) of a stream's messages, seconds, and how often its clock was set back before each (N,)."""

    times: Floats
    epochs: NDArray[np.int64]


def settled(streams: Sequence[Stream]) -> tuple[list[Timed], list[str]]:
    """The times of all streams by one clock that runs on, and a warning for each thing that was odd."""
    falls = [_falls(stream) for stream in streams]
    resets = _resets(streams, falls)
    epochs = [_epochs(stream, fallen, resets) for stream, fallen in zip(streams, falls, strict=True)]
    warnings = []
    if resets:
        warnings.append(
            f"the clock was set back {_times(len(resets))}: the drive is cut there, and no map spans it"
        )
    behind = _behind(streams, epochs)
    timed, shifted, missing = [], 0.0, 0
    for stream, own in zip(streams, epochs, strict=True):
        offset = np.array([behind[epoch] for epoch in own])
        apart = _clock(stream, own, streams[0], epochs[0]) if stream is not streams[0] else 0.0
        shifted = max(shifted, apart, key=abs)
        times = stream.stamps + (apart + (offset - behind[0]))
        unstamped = np.isnan(stream.stamps)
        times[unstamped] = stream.recorded[unstamped] - behind[0]
        if not unstamped.all():  # a clock that began at zero is no missing stamp
            missing += int((np.abs(times[unstamped]) > SLACK).sum())
        timed.append(Timed(times, own))
    if shifted:
        warnings.append(f"stamps are of clocks {abs(shifted):.1f} s apart: joined by the times of recording")
    if missing:
        warnings.append(f"{missing:,} messages without a stamp are taken at the times of their recording")
    return timed, warnings


def _behind(streams: Sequence[Stream], epochs: Sequence[NDArray[np.int64]]) -> dict[int, float]:
    """By how many seconds stamps lie behind recording in each epoch, told by the first sender that stamps."""
    behind = {}
    for epoch in range(1 + max((int(own.max(initial=0)) for own in epochs), default=0)):
        late = [
            (stream.recorded - stream.stamps)[own == epoch] for stream, own in zip(streams, epochs, strict=True)
        ]
        behind[epoch] = next((_median(one) for one in late if np.isfinite(one).any()), 0.0)
    return behind


def _falls(stream: Stream) -> NDArray[np.int64]:
    """The messages of a stream from which on its stamps lie behind those before."""
    stamped = np.flatnonzero(~np.isnan(stream.stamps))
    stamps, falls, latest = stream.stamps[stamped], [], -np.inf
    for k, stamp in enumerate(stamps):
        after = stamps[k : k + LASTING]
        if stamp < latest - SLACK and len(after) == LASTING and after.max() < latest:
            falls.append(stamped[k])
            latest = stamp
        latest = max(latest, stamp)
    return np.array(falls, dtype=np.int64)


def _resets(streams: Sequence[Stream], falls: Sequence[NDArray[np.int64]]) -> list[tuple[float, float]]:
    """When the clock was set back, by recording: from the first sender that noticed to the last."""
    times = sorted(
        time for stream, own in zip(streams, falls, strict=True) for time in stream.recorded[own].tolist()
    )
    resets: list[tuple[float, float]] = []
    for time in times:
        if resets and time - resets[-1][0] <= TOGETHER:
            resets[-1] = (resets[-1][0], time)
        else:
            resets.append((time, time))
    return resets


def _epochs(stream: Stream, falls: NDArray[np.int64], resets: list[tuple[float, float]]) -> NDArray[np.int64]:
    """Of a stream's messages: a reset begins where its own stamps fall, or at once if they do not."""
    epochs = np.zeros(len(stream.recorded), dtype=np.int64)
    for first, last in resets:
        own = [fall for fall in falls if first <= stream.recorded[fall] <= last]
        begin = own[0] if own else int(np.searchsorted(stream.recorded, first))
        epochs[begin:] += 1
    return epochs


def _clock(stream: Stream, epochs: NDArray[np.int64], other: Stream, others: NDArray[np.int64]) -> float:
    """Seconds to add to the stamps of a stream to have them by the clock of another; 0 for one clock."""
    ours, theirs = stream.recorded - stream.stamps, other.recorded - other.stamps
    ours, theirs = ours[epochs == 0], theirs[others == 0]
    late, usual = _median(ours), _median(theirs)
    steady = _median(np.abs(ours - late)) < STEADY and _median(np.abs(theirs - usual)) < STEADY
    known = np.isfinite(ours).any() and np.isfinite(theirs).any()
    return late - usual if known and steady and abs(late - usual) > MAX_CLOCK_DIFFERENCE else 0.0


def _median(values: Floats) -> float:
    values = values[~np.isnan(values)]
    return float(np.median(values)) if len(values) else 0.0


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
