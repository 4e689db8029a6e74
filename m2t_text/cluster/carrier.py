"""Who carries questions to shards and answers back: here within one process."""

from collections.abc import Iterable
from typing import Any, Protocol

from m2t_text.cluster.manifest import Manifest
from m2t_text.cluster.shard import ShardServer
from m2t_text.cluster.store import Store


class Carrier(Protocol):
    """The way to the shards."""

    def manifest(self) -> Manifest:
        """The latest generation that is served. Raises ClusterError if nobody answers."""

    def ask(
        self, method: str, generation: int, numbers: Iterable[int], *arguments: Any, partial: bool = False
    ) -> dict[int, Any]:
        """What a method of `ShardServer` returns for each of these shards.

        Raises:
            ClusterError: if a shard does not answer; if ``partial``, it is left out of the result instead.
        """


class InProcess:
    """Opens the shards in this process."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._server = ShardServer(store)

    def manifest(self) -> Manifest:
        return self._store.manifest()

    def ask(
        self, method: str, generation: int, numbers: Iterable[int], *arguments: Any, partial: bool = False
    ) -> dict[int, Any]:
        return self._server.answer(method, generation, list(numbers), arguments)
