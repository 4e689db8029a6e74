"""The one root of all errors that a user can cause or mend."""


class M2TError(Exception):
    """A known problem; its message is one line that says what, where and what to do."""


class LogError(M2TError):
    """A laser log that cannot be read."""


class TextError(M2TError):
    """A text that is not a sequence of tokens."""


class MapIndexError(M2TError):
    """An index that is missing, foreign, of another version, or locked."""


class DamageError(MapIndexError):
    """A file of an index that is not as it was written, or that nobody should trust."""


class QueryError(M2TError):
    """A query or target that names nothing that exists."""
