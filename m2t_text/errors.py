"""The one root of all errors that a user can cause or mend, and how their messages are made fit to print."""

from collections.abc import Sequence

SHOWN = 5  # names in a message


class M2TError(Exception):
    """A known problem; its message is one line that says what, where and what to do."""


class SourceError(M2TError):
    """A source that cannot be read."""


class LogError(SourceError):
    """A laser log that cannot be read."""


class MapFileError(SourceError):
    """A saved map that cannot be read or written."""


class TextError(M2TError):
    """A text that is not a sequence of tokens."""


class CloudError(SourceError):
    """A point cloud that cannot be read."""


class MapIndexError(M2TError):
    """An index that is missing, foreign, of another version, or locked."""


class DamageError(MapIndexError):
    """A file of an index that is not as it was written, or that nobody should trust."""


class ClusterError(MapIndexError):
    """A cluster that cannot be reached, or that cannot answer for all of its maps."""


class QueryError(M2TError):
    """A query or target that names nothing that exists."""


class FetchError(M2TError):
    """A public log that is not known, or cannot be downloaded."""


class PartError(Exception):
    """What is wrong with a part of a file; who knows which file and where tells it, or skips the part."""


def clean(text: str) -> str:
    """The text in one line, with control characters spelled out: a name must not command the terminal."""
    spelled = (c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)
    return "".join(spelled)


def listed(names: Sequence[str]) -> str:
    """The first few of any number of names, for a message of one line."""
    more = len(names) - SHOWN
    return ", ".join(names[:SHOWN]) + (f" and {more} more" if more > 0 else "")
