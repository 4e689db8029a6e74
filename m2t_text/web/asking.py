"""What a request asks, read from its address or its JSON, and checked."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from m2t_text.errors import QueryError
from m2t_text.recognition.answer import SearchOptions

MAX_LISTED = 10_000  # maps in one list
LAID = 10  # hits that one answer lays the query on, at most
TRUE, FALSE = ("true", "1", "yes"), ("false", "0", "no")


@dataclass(frozen=True)
class Search:
    """A search.

    Attributes:
        query: what is looked up, a name or a text.
        options: as on the command line.
        where: only maps that this query of Whoosh's language finds; None for all.
        compare: on so many of the best hits the query is laid, keypoint by keypoint.
        index: the name of the index, None for the first.
    """

    query: str
    options: SearchOptions
    where: str | None
    compare: int
    index: str | None

    @classmethod
    def read(cls, values: Mapping[str, Any]) -> "Search":
        """Raises QueryError, naming what is wrong."""
        known = {"query", "text", "top", "exclude_travel", "verify", "where", "compare", "index"}
        unknown = sorted(set(values) - known)
        if unknown:
            raise QueryError(f"unknown parameter {unknown[0][:40]!r}; there are {', '.join(sorted(known))}")
        query = values.get("query") or values.get("text")
        if not isinstance(query, str) or not query.strip():
            raise QueryError("name what to look up: query=MAP_ID, or a text of tokens")
        exclude = values.get("exclude_travel")
        options = SearchOptions(
            top=whole(values, "top", 10, MAX_LISTED),
            exclude_travel=None if exclude in (None, "") else _number("exclude_travel", exclude),
            verify=truth(values, "verify", True),
        )
        return cls(
            query, options, words(values, "where"), whole(values, "compare", 0, LAID), words(values, "index")
        )


def whole(values: Mapping[str, Any], name: str, default: int, most: int) -> int:
    """A whole number from 0 on."""
    value = values.get(name, default)
    try:
        if isinstance(value, bool) or (isinstance(value, float) and not value.is_integer()):
            raise ValueError
        number = int(value)
    except (ValueError, TypeError, OverflowError) as error:
        raise QueryError(f"{name} must be a whole number of 0 to {most}") from error
    if not 0 <= number <= most:
        raise QueryError(f"{name} must be a whole number of 0 to {most}")
    return number


def truth(values: Mapping[str, Any], name: str, default: bool) -> bool:
    value = values.get(name, default)
    if isinstance(value, bool):
        return value
    if str(value).lower() not in TRUE + FALSE:
        raise QueryError(f"{name} must be true or false")
    return str(value).lower() in TRUE


def words(values: Mapping[str, Any], name: str) -> str | None:
    value = values.get(name)
    if value is not None and not isinstance(value, str):
        raise QueryError(f"{name} must be a string")
    return value or None


def _number(name: str, value: Any) -> float:
    try:
        number = float(value)
    except (ValueError, TypeError) as error:
        raise QueryError(f"{name} must be a number of metres") from error
    if isinstance(value, bool) or not math.isfinite(number) or number < 0:
        raise QueryError(f"{name} must be a number of metres, 0 or more")
    return number
