"""A drive, looked up place by place as it went."""

from typing import Any, Protocol

import numpy as np

from m2t_text.description.document import Document
from m2t_text.recognition.answer import SearchOptions, answer
from m2t_text.recognition.queries import Query
from m2t_text.util.workers import beside_others
from m2t_text.web.naming import UPLOAD
from m2t_text.web.served import Committed
from m2t_text.web.uploads.drives import SPACING
from m2t_text.web.uploads.files import Upload

OTHER_VISITS = 10.0  # m; of a drive that is in the index, maps nearer by travel are the same visit
TOP = 3  # hits told of each place
PROGRESS_INTERVAL = 0.5  # s to wait for the next place of a drive that is being read


class Drive(Protocol):
    """The places of a drive, in their order."""

    def places(self, begin: int, most: int, seconds: float) -> list[Document]:
        """Some from ``begin`` on, as many as are known; none if no more come within some ``seconds``."""

    @property
    def total(self) -> int | None:
        """How many there are; None while it is not known."""

    def progress(self) -> dict[str, Any]:
        """How far it has been read."""


class UploadedDrive:
    """The places of an upload, as soon as they are described."""

    def __init__(self, upload: Upload) -> None:
        self._upload = upload

    def places(self, begin: int, most: int, seconds: float) -> list[Document]:
        self._upload.wait(begin, seconds)
        return self._upload.documents[begin : begin + most]

    @property
    def total(self) -> int | None:
        return len(self._upload.documents) if self._upload.done else None

    def progress(self) -> dict[str, Any]:
        return self._upload.to_json()


class IndexedDrive:
    """The places of a dataset of the index, SPACING metres apart."""

    def __init__(self, dataset: str, committed: Committed) -> None:
        part = committed.slice_of(dataset)
        begins = committed.overview.records["travel"][part, 0]
        if np.ptp(begins) > 0:
            chosen = np.unique(np.floor(begins / SPACING), return_index=True)[1]
        else:
            chosen = np.arange(len(begins))
        self._numbers = committed.overview.numbers[part][chosen].tolist()
        self._index = committed.index

    def places(self, begin: int, most: int, seconds: float) -> list[Document]:
        return list(self._index.numbered(self._numbers[begin : begin + most]))

    @property
    def total(self) -> int | None:
        return len(self._numbers)

    def progress(self) -> dict[str, Any]:
        return {}


def looked_up(number: int, document: Document, committed: Committed, upload: str | None) -> dict[str, Any]:
    """A place looked up in the index, as the page is told of it: where it lies in the drive, its text, and the
    answer of ``search --json``. Of the dataset of its own name, only other visits count."""
    query = Query.of(document)
    exclude = OTHER_VISITS if query.driven and document.dataset in committed.overview.names else None
    options = SearchOptions(top=TOP, exclude_travel=exclude)
    found = beside_others(lambda: answer(query, committed.index, options))
    name = document.map_id if upload is None else f"{UPLOAD}{upload}/{document.first_scan:06d}"
    return {
        "number": number,
        "query": name,
        "travel": document.travel.tolist(),
        "own_pose": document.pose.tolist(),
        "text": str(document.text),
        "answer": found.to_json(),
    }
