"""Packed texts, read by compiled code. Unsigned indices spare the checks that negative ones need."""

from typing import Any

import numpy as np

from m2t_text.index.kernels.packed import RUN
from m2t_text.util.compiling import inlined, inner

U = np.uint64


@inlined
def run_of(runs: Any, place: Any) -> Any:
    """The word and the length of a run; all are unsigned."""
    run = U(runs[U(2) * place]) | U(runs[U(2) * place + U(1)]) << U(8)
    return run >> U(6), (run & U(63)) + U(1)


@inlined
def word_of(runs: Any, place: Any, end: Any) -> Any:
    """A word, its number of keypoints, and the place behind it: runs of one word belong together."""
    word, count = run_of(runs, place)
    place += U(1)
    if count == U(RUN):  # only a full run is continued
        more = count
        while more == U(RUN) and place < end:
            other, more = run_of(runs, place)
            if other != word:
                break
            count += more
            place += U(1)
    return word, count, place


@inner
def cells_of(texts: Any, document: Any, x: Any, y: Any) -> Any:
    """Writes a document's cells to the begin of ``x`` and ``y``, and returns their number."""
    low_x, low_y, high = texts.x, texts.y, texts.high  # once: each is counted when it is taken out
    begin = U(texts.starts[document])
    count = texts.starts[document + 1] - texts.starts[document]
    for k in range(U(count)):
        x[k], y[k] = low_x[begin + k], low_y[begin + k]
    first = U(texts.wide_starts[document])
    for k in range(U(texts.wide_starts[document + 1] - texts.wide_starts[document])):
        place = U(2) * (first + k)
        x[k] = np.int16(x[k] + np.int64(high[place]) * 256)  # 16 bits, as the high byte of 32,767 overflows
        y[k] = np.int16(y[k] + np.int64(high[place + U(1)]) * 256)
    return count


@inner
def some_cells_of(texts: Any, document: Any, every: Any, x: Any, y: Any) -> Any:
    """The same of every so many keypoints alone, from the first on."""
    low_x, low_y, high = texts.x, texts.y, texts.high
    begin, step = U(texts.starts[document]), U(every)
    count = (texts.starts[document + 1] - texts.starts[document] + every - 1) // every
    for k in range(U(count)):
        x[k], y[k] = low_x[begin + step * k], low_y[begin + step * k]
    first = U(texts.wide_starts[document])
    if texts.wide_starts[document + 1] > texts.wide_starts[document]:
        for k in range(U(count)):
            place = U(2) * (first + step * k)
            x[k] = np.int16(x[k] + np.int64(high[place]) * 256)
            y[k] = np.int16(y[k] + np.int64(high[place + U(1)]) * 256)
    return count


@inner
def words_of(texts: Any, document: Any, count: Any, wa: Any) -> None:
    """Writes the words of a document's ``count`` keypoints to the begin of ``wa``, and no more."""
    k, size, runs = U(0), U(count), texts.runs
    for place in range(U(texts.run_starts[document]), U(texts.run_starts[document + 1])):
        word, length = run_of(runs, place)
        end = min(k + length, size)
        while k < end:
            wa[k] = word
            k += U(1)
    while k < size:  # where a damaged index holds too few
        wa[k] = 0
        k += U(1)
