"""Several servers of shards in one process."""

from collections.abc import Iterable
from typing import Any

from m2t_text.cluster.carrier import InProcess
from m2t_text.cluster.cluster_index import ClusterIndex
from m2t_text.cluster.shard import ShardServer
from m2t_text.cluster.store import Store


class Apart(InProcess):
    """Servers each of which answers for so many shards; ``steps`` are the methods that they were asked for."""

    def __init__(self, store: Store, each: int) -> None:
        super().__init__(store)
        self._each = each
        self._servers: dict[tuple[int, ...], ShardServer] = {}
        self.steps: set[str] = set()

    def ask(
        self, method: str, generation: int, numbers: Iterable[int], *arguments: Any, partial: bool = False
    ) -> dict[int, Any]:
        self.steps.add(method)
        every, answers = list(numbers), {}
        for k in range(0, len(every), self._each):
            own = tuple(every[k : k + self._each])
            server = self._servers.setdefault(own, ShardServer(self._store))
            answers |= server.answer(method, generation, own, arguments)
        return answers


def apart(index: ClusterIndex, each: int) -> ClusterIndex:
    """The same shards, answered for by several servers."""
    return ClusterIndex(Apart(Store(index.path), each), index.path)
