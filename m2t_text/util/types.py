"""Types that many modules share: arrays, and the callbacks that report progress."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Progress = Callable[[int, int], None]  # done, total
StageProgress = Callable[[str, int, int], None]  # stage, done, total
SourceProgress = Callable[[str, str, int, int], None]  # source, stage, done, total
