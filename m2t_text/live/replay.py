"""A log as the messages of a robot that drives it now."""

from collections.abc import Callable, Iterator
from time import monotonic, sleep

from m2t_text.live.messages import robot_line, scan_line
from m2t_text.logs.log import Log

RATE = 10.0  # scans a second where the log has no times
PAUSE = 2.0  # s at most between two scans: a log may have been stopped for hours


def replayed(log: Log, speed: float, wait: Callable[[float], None] = sleep) -> Iterator[str]:
    """The lines of a log, each when it is due at ``speed`` times real time; at 0 as fast as they are taken.

    ``wait`` is called with the seconds that are left until a line is due.
    """
    yield robot_line(log)
    timed = len({scan.timestamp for scan in log.scans}) > len(log.scans) / 2
    due, last, begin = 0.0, None, monotonic()
    for number, scan in enumerate(log.scans):
        time = scan.timestamp if timed else number / RATE
        due += 0.0 if last is None else min(max(time - last, 0.0), PAUSE)
        last = time
        left = due / speed - (monotonic() - begin) if speed else 0.0
        if left > 0:
            wait(left)
        yield scan_line(scan, time)
