"""From files to a sharded index: on this host, or by the hosts of a cluster."""

from collections.abc import Callable, Sequence
from typing import Any

from m2t_text.cluster.connection import connected
from m2t_text.cluster.manifest import Manifest, Shard
from m2t_text.cluster.parts import Job, Part, build_shard, describe_part, remove_parts
from m2t_text.cluster.remote import open_store
from m2t_text.cluster.store import Store
from m2t_text.cluster.writing import Target, at_least, following, place
from m2t_text.errors import ClusterError
from m2t_text.sources.indexing import IndexRequest, Report, index_sources, parameters_for
from m2t_text.sources.opening import dataset_names
from m2t_text.util.types import SourceProgress

RETRIES = 20  # times that a log is begun again elsewhere, if its host ends or cannot be reached
AT_ONCE = 4  # tasks that wait for each core


def index_sharded(request: IndexRequest, shards: int | None, progress: SourceProgress | None = None) -> Report:
    """As `index_sources` does, into a sharded index of so many ``shards``; None for as many as before."""
    return index_sources(request, progress, Target(open_store(request.index), shards))


def index_on_cluster(
    request: IndexRequest, shards: int | None, address: str, progress: SourceProgress | None = None
) -> Report:
    """Has the hosts of a cluster read and describe sources, and put all of them into a sharded index at once.

    All hosts must see the sources and the index at the same paths. What was described before an interruption
    is not described again.

    Raises:
        M2TError: if the request cannot be met; the index is as it was then.
    """
    tell = progress or (lambda what, stage, done, of: None)
    if isinstance(open_store(request.index).path, str):
        raise ClusterError(
            f"the hosts of a cluster write to a folder that all see, not to {request.index}; index there, or "
            "on one host without --cluster"
        )
    store = Store(request.index.absolute())
    target = Target(store, shards)
    names = dataset_names(request.sources, "indexed", request.options.name)
    parameters = parameters_for(request, target)
    jobs = [
        Job(path.absolute(), name, request.options, parameters)
        for path, name in zip(request.sources, names, strict=True)
    ]
    store.check_new()
    with connected(address) as ray, store.locked():
        before = at_least(store, parameters, shards)
        remote = _Remote(ray, str(store.path))
        parts = remote.parts(jobs, lambda done: tell("logs", "describing", done, len(jobs)))
        failed = [part.failure for part in parts if part.failure]
        good = [part for part in parts if not part.failure]
        if good:
            changed = remote.shards(before, good, lambda done, of: tell("shards", "writing", done, of))
            store.publish(following(before, changed))
            remove_parts(store, good)
    return Report([part.indexed for part in good], failed)


class _Remote:
    """Work of a cluster, in the order of what is asked for."""

    def __init__(self, ray: Any, root: str) -> None:
        self._ray, self._root = ray, root
        self._options = {"num_cpus": 1, "max_retries": RETRIES}

    def parts(self, jobs: Sequence[Job], tell: Callable[[int], None]) -> list[Part]:
        """What the sources give."""
        work = self._ray.remote(describe_part).options(**self._options)
        calls = [lambda job=job: work.remote(self._root, job) for job in jobs]
        return self._all(calls, lambda done, of: tell(done))

    def shards(
        self, before: Manifest, parts: Sequence[Part], tell: Callable[[int, int], None]
    ) -> dict[int, Shard]:
        """The new states of the shards that parts go into."""
        maps = [shard.maps for shard in before.shards]
        placed: dict[int, list[Part]] = {}
        for part in sorted(parts, key=lambda part: (-part.maps, part.name)):
            number = before.places.get(part.name, place(maps))
            maps[number] += part.maps
            placed.setdefault(number, []).append(part)
        work = self._ray.remote(build_shard).options(**self._options)
        held = self._ray.put(before)
        calls = [
            lambda number=number, own=own: work.remote(self._root, number, held, own)
            for number, own in sorted(placed.items())
        ]
        return dict(zip(sorted(placed), self._all(calls, tell), strict=True))

    def _all(self, calls: Sequence[Callable[[], Any]], tell: Callable[[int, int], None]) -> list[Any]:
        """The results of calls, few of which wait at any time."""
        ray, begun = self._ray, 0
        results: dict[int, Any] = {}
        pending: dict[Any, int] = {}
        tell(0, len(calls))
        while len(results) < len(calls):
            room = AT_ONCE * max(1, int(ray.cluster_resources().get("CPU", 1))) - len(pending)
            for number in range(begun, min(begun + room, len(calls))):
                pending[calls[number]()] = number
                begun = number + 1
            done, _ = ray.wait(list(pending), num_returns=1, timeout=1.0)
            for reference in done:
                results[pending.pop(reference)] = self._result(reference)
                tell(len(results), len(calls))
        return [results[number] for number in range(len(calls))]

    def _result(self, reference: Any) -> Any:
        try:
            return self._ray.get(reference)
        except self._ray.exceptions.RayError as error:
            cause = getattr(error, "cause", None)
            reason = str(cause or error).strip().splitlines()[0]
            raise ClusterError(
                f"a host of the cluster failed ({reason}); the index is as it was, and the same command goes "
                "on where this one ended"
            ) from error
