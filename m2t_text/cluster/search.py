"""A search of many shards: what is asked, and what a shard says of it in between."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from whoosh.query import Query

from m2t_text.description.text import Text
from m2t_text.index.results import Hit
from m2t_text.util.types import Floats

if TYPE_CHECKING:  # the compiled kernels are slow to import
    from m2t_text.index.search.weighting import Method


@dataclass(frozen=True)
class Search:
    """A search of a whole cluster.

    Attributes:
        key: no other search has it.
        text, top, exclude, method, filter, texts, least, wanted: as for `MapIndex.search`.
    """

    key: str
    text: Text
    top: int
    exclude: tuple[str, float, float] | None
    method: "Method"
    filter: Query | None
    texts: bool
    least: float = 0.0
    wanted: Callable[[Hit], bool] | None = None


@dataclass(frozen=True)
class Known:
    """What a shard knows after a step.

    Attributes:
        scores: (K,) of its maps among the best that its server knows, in any order.
        sampled: whether the server looked at a sample, so that a further step tells more.
        hits: its maps among the best of all, where its server answers for all shards and has no need to agree
            with others; else None.
    """

    scores: Floats
    sampled: bool
    hits: list[Hit] | None = None
