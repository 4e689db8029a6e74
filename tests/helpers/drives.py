"""Parts of drives."""

from dataclasses import replace

from m2t_text.logs import Log


def cut(log: Log, scans: int) -> Log:
    """The beginning of a log with ground truth."""
    assert log.ground_truth is not None
    return replace(log, scans=log.scans[:scans], ground_truth=log.ground_truth[:scans])
