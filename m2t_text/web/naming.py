"""What is named in the page's search box or in a request, found. Nothing that is named is a file."""

from typing import Protocol

import numpy as np

from m2t_text.description.document import Document, map_id_of
from m2t_text.description.text import TOKEN, parse
from m2t_text.errors import QueryError
from m2t_text.recognition.queries import MAP_ID, ROUNDING, RUN, Query
from m2t_text.web.served import Committed

UPLOAD = "upload:"  # begins the ids of maps that were uploaded
KINDS = "a map id DATASET/NUMBER, DATASET@METRES, DATASET#SCAN, or a text of tokens as x12_y-3_a517"


class Uploaded(Protocol):
    """The maps that were uploaded."""

    def document(self, upload: str, first_scan: int) -> Document:
        """One of them. Raises QueryError if there is none."""


def named(target: str, committed: Committed, uploads: Uploaded) -> Query:
    """The query that a string names: a map of the index, an uploaded one, or a text.

    Raises:
        QueryError, TextError: one line that says what there is instead, or what is wrong.
    """
    target = target.strip()
    if target.startswith(UPLOAD):
        upload, _, number = target.removeprefix(UPLOAD).partition("/")
        if not number.isdecimal() or len(number) > 9:
            raise QueryError(f"{target!r} is no uploaded map; name one as {UPLOAD}ID/000123")
        return Query.of(uploads.document(upload, int(number)))
    if MAP_ID.fullmatch(target) and len(target) < 300:
        return Query.of(committed.index.document(target))
    run = RUN.fullmatch(target)
    if run and run["log"] in committed.overview.names:
        return Query.of(_begins(run["log"], run["kind"], run["number"], committed))
    first = target.split(maxsplit=1)[0] if target else ""
    if TOKEN.match(first) or ("_" in first and first.startswith(("x", "X"))):
        text = parse(target)
        return Query(text)
    raise QueryError(f"{target[:80]!r} is neither a map of this index nor a text; name {KINDS}")


def _begins(dataset: str, kind: str, number: str, committed: Committed) -> Document:
    """The map that begins at a scan of a dataset, or after so many metres of travel."""
    part = committed.slice_of(dataset)
    records = committed.overview.records[part]
    try:
        value = float(number)
    except ValueError as error:
        raise QueryError(f"'{dataset}{kind}{number}' does not end in a number") from error
    if kind == "#":
        after = np.flatnonzero(records["first_scan"] >= value)
    else:
        after = np.flatnonzero(records["travel"][:, 0] >= value - ROUNDING)
    if not len(after):
        last = map_id_of(dataset, int(records["first_scan"][-1]))
        end = float(records["travel"][-1, 0])
        raise QueryError(
            f"'{dataset}{kind}{number}' is past its last map, {last}, which begins after {end:.2f} m"
        )
    return committed.index.document(map_id_of(dataset, int(records["first_scan"][after[0]])))
