"""Asking servers on many machines: another one if one fails or takes long, and an error rather than less."""

import threading
from collections import OrderedDict
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from time import monotonic, sleep
from typing import Any

from m2t_text.cluster.cluster_index import ClusterIndex
from m2t_text.cluster.connection import NAMESPACE, connected
from m2t_text.cluster.manifest import Manifest
from m2t_text.cluster.search import Search
from m2t_text.cluster.servers import KEEPER, Served, Status
from m2t_text.errors import ClusterError, DamageError, M2TError, listed

Question = tuple[str, int, tuple[Any, ...]]  # a method, the generation, and further arguments

PATIENCE = 2.0  # s after which another server is asked as well
ANSWERED = 60.0  # s in which every shard must have answered
AVOIDED = 30.0  # s for which a server that failed is asked after the others
HELD = 10_000  # searches and shards
PARTIAL = 8.0  # s after which an answer is given without the others, where that is allowed
RETRY = 0.2  # s between two rounds, where all servers of a shard have failed
FRESH = 0.2  # s for which it stands what the keeper said
KEEPER_SECONDS = 5.0  # for the keeper to say who serves what


@contextmanager
def cluster_index(address: str, partial: bool = False) -> Iterator[ClusterIndex]:
    """The index that the cluster at ``HOST:PORT`` serves, during the block.

    Raises:
        ClusterError: if nothing answers there, or nothing is served yet.
    """
    with connected(address) as ray:
        carrier = RayCarrier(ray, address)
        yield ClusterIndex(carrier, carrier.served().folder, partial)


def cluster_status(address: str) -> Status:
    """How the cluster at ``HOST:PORT`` is. Raises ClusterError if nothing answers there."""
    with connected(address) as ray:
        return RayCarrier(ray, address).status()


class RayCarrier:
    """The way to the shards of a Ray cluster, to which this process is connected."""

    def __init__(self, ray: Any, address: str) -> None:
        self._ray, self._address = ray, address
        self._handles: dict[str, Any] = {}
        self._served: Served | None = None
        self._heard = -FRESH  # when the keeper said that
        self._holders: OrderedDict[tuple[str, int], str] = OrderedDict()  # of searches that were begun
        self._failed: dict[str, float] = {}  # when a server failed, or took too long
        self._lock = threading.Lock()

    def manifest(self) -> Manifest:
        """That of the generation that is served. Raises ClusterError if nothing is."""
        return self.served().manifest

    def served(self) -> Served:
        """What is served; a moment ago, or if the keeper is silent, what it said last: whole, but maybe
        not the latest."""
        if self._served is not None and monotonic() - self._heard < FRESH:
            return self._served
        version = -1 if self._served is None else self._served.version
        try:
            reference = self._handle(KEEPER).served.remote(version)
            self._served = self._ray.get(reference, timeout=KEEPER_SECONDS) or self._served
            self._heard = monotonic()
        except self._ray.exceptions.RayError as error:
            self._handles.pop(KEEPER, None)
            if self._served is None:
                raise ClusterError(f"the keeper of the cluster at {self._address} does not answer") from error
        if self._served is None:
            raise ClusterError(
                f"the cluster at {self._address} serves nothing yet; `m2t-text cluster status` says why"
            )
        return self._served

    def status(self) -> Status:
        """How the cluster is. Raises ClusterError if its keeper does not answer."""
        try:
            status: Status = self._ray.get(self._handle(KEEPER).status.remote(), timeout=KEEPER_SECONDS)
        except self._ray.exceptions.RayError as error:
            raise ClusterError(f"the keeper of the cluster at {self._address} does not answer") from error
        return status

    def ask(
        self, method: str, generation: int, numbers: Iterable[int], *arguments: Any, partial: bool = False
    ) -> dict[int, Any]:
        """What a method of `ShardServer` returns for each of these shards.

        Raises:
            ClusterError: if a shard does not answer; if ``partial``, it is left out of the result instead.
            M2TError: what the shards themselves raise.
        """
        asking = _Asking(self, (method, generation, arguments), list(numbers))
        answers = asking.answers(PARTIAL if partial else ANSWERED)
        silent = sorted(set(asking.numbers) - answers.keys())
        if silent and not partial:
            shards = listed([str(number) for number in silent])
            why = f" ({asking.problem})" if asking.problem else ""
            raise ClusterError(
                f"the cluster at {self._address} cannot answer for all maps: no server of shard {shards} "
                f"does{why}; try again, or take what there is with --partial"
            )
        return answers

    def servers(self, number: int, key: str) -> list[str]:
        """Who answers for a shard: first who has begun the search of this key, and last who failed lately."""
        names = list(self._served.table.get(number, ())) if self._served else []
        first = int(key, 16) % len(names) if names and key else 0  # searches are spread over all
        turned = names[first:] + names[:first]
        holder, now = self._holders.get((key, number)), monotonic()
        return sorted(
            turned, key=lambda name: (now - self._failed.get(name, -AVOIDED) < AVOIDED, name != holder)
        )

    def send(self, name: str, question: "Question", numbers: list[int]) -> Any:
        """A reference to what a server will answer for these shards."""
        method, generation, arguments = question
        return self._handle(name).answer.remote(method, generation, numbers, arguments)

    def receive(self, references: list[Any], seconds: float) -> list[Any]:
        """Those of the references that are answered, at least one unless it takes more than so many seconds."""
        done: list[Any] = self._ray.wait(references, num_returns=1, timeout=max(0.0, seconds))[0]
        return done

    def answer(self, reference: Any) -> dict[int, Any]:
        """The answer of a reference that is there."""
        answer: dict[int, Any] = self._ray.get(reference)
        return answer

    def answered(self, name: str, numbers: Iterable[int], key: str) -> None:
        """Remembers who has begun a search."""
        with self._lock:
            self._holders.update({(key, number): name for number in numbers})
            while len(self._holders) > HELD:
                self._holders.popitem(last=False)

    def failed(self, name: str, gone: bool) -> None:
        """Asks others first for a while; a server that is ``gone`` is looked up anew when it is asked next."""
        self._failed[name] = monotonic()
        if gone:
            self._handles.pop(name, None)

    @property
    def failure(self) -> type[Exception]:
        """What is raised where a server cannot be reached, has died, or raised something itself."""
        failure: type[Exception] = self._ray.exceptions.RayError
        return failure

    def _handle(self, name: str) -> Any:
        if name not in self._handles:
            try:
                self._handles[name] = self._ray.get_actor(name, namespace=NAMESPACE)
            except ValueError as error:
                raise ClusterError(f"the cluster at {self._address} has no {name}") from error
        return self._handles[name]


class _Asking:
    """One question to some shards, until all are answered."""

    def __init__(self, carrier: RayCarrier, question: Question, numbers: list[int]) -> None:
        self.numbers = numbers
        self.problem = ""
        self._carrier, self._question = carrier, question
        self._answers: dict[int, Any] = {}
        self._pending: dict[Any, tuple[str, list[int]]] = {}
        self._tried: dict[int, set[str]] = {number: set() for number in numbers}
        self._damage: DamageError | None = None
        arguments = question[2]
        self._key = arguments[0].key if arguments and isinstance(arguments[0], Search) else ""

    def answers(self, seconds: float) -> dict[int, Any]:
        """What is answered within so many seconds, by shard."""
        end = monotonic() + seconds
        self._send(self.numbers)
        while self._open and monotonic() < end:
            if not self._pending:  # all servers have failed: Ray starts them anew, or others are chosen
                sleep(RETRY)
                self._carrier.served()
                self._tried = {number: set() for number in self.numbers}
                self._send(self._open)
                continue
            done = self._carrier.receive(list(self._pending), min(PATIENCE, end - monotonic()))
            for reference in done:
                self._hear(reference)
            if not done:
                for name, _ in self._pending.values():
                    self._carrier.failed(name, gone=False)
            awaited = {number for _, numbers in self._pending.values() for number in numbers}
            # Whoever takes long may be gone, and who failed is: others are asked.
            self._send([number for number in self._open if not done or number not in awaited])
        if self._damage is not None and self._open:
            raise self._damage
        return self._answers

    @property
    def _open(self) -> list[int]:
        return [number for number in self.numbers if number not in self._answers]

    def _send(self, numbers: list[int]) -> None:
        chosen: dict[str, list[int]] = {}
        for number in numbers:
            name = next(
                (one for one in self._carrier.servers(number, self._key) if one not in self._tried[number]),
                None,
            )
            if name is not None:
                self._tried[number].add(name)
                chosen.setdefault(name, []).append(number)
        for name, own in chosen.items():
            try:
                self._pending[self._carrier.send(name, self._question, own)] = (name, own)
            except (ClusterError, self._carrier.failure) as error:
                self._failed(name, error)

    def _hear(self, reference: Any) -> None:
        name, numbers = self._pending.pop(reference)
        try:
            answer = self._carrier.answer(reference)
        except self._carrier.failure as error:
            cause = getattr(error, "cause", None)
            if isinstance(cause, DamageError):  # of this server's copy; another may be whole
                self._damage = cause
            elif isinstance(cause, M2TError):
                raise cause from error
            self._failed(name, error)
            return
        self._carrier.answered(name, numbers, self._key)
        for number in numbers:
            self._answers.setdefault(number, answer[number])

    def _failed(self, name: str, error: Exception) -> None:
        self.problem = str(error).strip().splitlines()[0][:200]
        self._carrier.failed(name, gone=True)
