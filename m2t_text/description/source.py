"""What can be described: the protocol that every kind of source follows."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.util.types import StageProgress


@dataclass(frozen=True)
class Described:
    """The maps of a source, made as they are asked for, and its drive: scans and metres of travel."""

    documents: Iterator[Document]
    drive: tuple[int, float]


class Source(Protocol):
    """What can be indexed: one dataset, read but not yet described."""

    @property
    def name(self) -> str:
        """The dataset's."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """One line for each kind of damage that was skipped."""

    def describe(self, parameters: Parameters, jobs: int, tell: StageProgress) -> Described:
        """Its maps, at least one. Raises SourceError if there is none."""
