"""Laser logs: one reader for all of them, and the name a dataset gets from its file."""

from collections.abc import Callable
from pathlib import Path

from m2t_text.logs.log import Log, LogOptions, Scan
from m2t_text.util.names import is_bag

__all__ = ["Log", "LogOptions", "Scan", "read_log"]


def read_log(
    path: str | Path,
    name: str | None = None,
    progress: Callable[[int, int], None] | None = None,
    options: LogOptions | None = None,
) -> Log:
    """Read a laser log, CARMEN's or a ROS bag; ``name`` defaults to ``dataset_name(path)``.

    ``progress`` is called with how much was read so far and how much there is: bytes, or messages of a bag.
    ``options`` say what the file leaves open.
    Raises LogError with one line that says what is wrong, where, and what to do.

    Examples:
        >>> import m2t_text as m2t
        >>> log = m2t.read_log("drive.log")
        >>> log.name, log.odometry.shape == (len(log.scans), 3)
        ('drive', True)
    """
    file = Path(path)
    if is_bag(file):
        from m2t_text.logs.ros.bag import read_bag

        return read_bag(file, name, progress, options)
    from m2t_text.logs.carmen.reading import read_carmen

    return read_carmen(file, name, progress, options)
