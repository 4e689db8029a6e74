"""The actors of a cluster: servers answer for shards, and a keeper sees to it that each shard has enough."""

import os
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import monotonic, sleep
from typing import Any

from m2t_text.cluster.connection import NAMESPACE, SERVES
from m2t_text.cluster.manifest import Manifest
from m2t_text.cluster.remote import open_store
from m2t_text.cluster.shard import ShardServer
from m2t_text.errors import M2TError
from m2t_text.util.workers import THREADS

KEEPER = "keeper"
STEP = 0.5  # s between two looks at the store and the nodes
GRACE = 60.0  # s to wait for all replicas of a new generation, once each shard has one
SHOWN = 16  # digits of a node's id in a server's name


@dataclass(frozen=True)
class Served:
    """What is served now.

    Attributes:
        version: another number whenever anything of it has changed.
        folder: of the sharded index, as the hosts that serve name it.
        manifest: the generation.
        table: the names of the servers of each shard, by number.
    """

    version: int
    folder: str
    manifest: Manifest
    table: Mapping[int, Sequence[str]]


@dataclass(frozen=True)
class Status:
    """How a cluster is.

    Attributes:
        served: None until each shard has a server that has opened it.
        nodes: the addresses of hosts that serve, and their cores.
        servers: of each its node's address, and whether it has opened all of its shards.
        replicas: how many servers each shard is to have.
        problem: what went wrong last; empty if nothing did.
    """

    folder: str
    served: Served | None
    nodes: list[tuple[str, int]]
    servers: dict[str, tuple[str, bool]]
    replicas: int
    problem: str


class Server:
    """Answers for some shards."""

    def __init__(self, folder: str, threads: int) -> None:
        os.environ[THREADS] = str(threads)
        self._shards = ShardServer(open_store(folder))

    def answer(
        self, method: str, generation: int, numbers: Sequence[int], arguments: tuple[Any, ...]
    ) -> dict[int, Any]:
        """What a method of `ShardServer` returns for each of these shards."""
        return self._shards.answer(method, generation, numbers, arguments)


@dataclass
class _Known:
    """What the keeper knows of its servers.

    Attributes:
        handles: by name.
        nodes: the id of each one's node.
        opened: shards that a server has opened, as (name, generation, number).
        asked: references to answers that are awaited, and what they are about.
    """

    handles: dict[str, Any] = field(default_factory=dict)
    nodes: dict[str, str] = field(default_factory=dict)
    opened: set[tuple[str, int, int]] = field(default_factory=set)
    asked: dict[Any, tuple[str, int, list[int]]] = field(default_factory=dict)


class Keeper:
    """Starts servers on all nodes, has them open each new generation, and says who answers for which shard."""

    def __init__(self, folder: str, replicas: int) -> None:
        self._store, self._replicas = open_store(folder), replicas
        self._known, self._problem = _Known(), ""
        self._served: Served | None = None
        self._manifest: Manifest | None = None
        self._since = monotonic()
        self._addresses: dict[str, tuple[str, int]] = {}
        threading.Thread(target=self._keep, daemon=True).start()

    def served(self, version: int = -1) -> Served | None:
        """What is served now; None if it is the version that the caller has, or there is nothing yet."""
        served = self._served
        return None if served is None or served.version == version else served

    def status(self) -> Status:
        """How the cluster is."""
        manifest, table = self._manifest, self._table()
        servers = {}
        for name in list(self._known.handles):
            own = [number for number, names in table.items() if name in names]
            ready = manifest is not None and all(
                (name, manifest.generation, number) in self._known.opened for number in own
            )
            servers[name] = (self._addresses.get(self._known.nodes[name], ("gone", 0))[0], ready)
        nodes = sorted(self._addresses.values())
        return Status(str(self._store.path), self._served, nodes, servers, self._replicas, self._problem)

    def _keep(self) -> None:
        from ray.exceptions import RayError

        while True:
            try:
                self._step()
                self._problem = ""
            except (RayError, M2TError, OSError, ValueError) as error:
                self._problem = str(error).strip().splitlines()[-1]
            sleep(STEP)

    def _step(self) -> None:
        self._meet_nodes()
        generation = self._store.generation
        if self._manifest is None or generation > self._manifest.generation:
            self._manifest, self._since = self._store.manifest(), monotonic()
        self._ask_to_open(self._manifest)
        self._hear()
        self._publish(self._manifest)

    def _meet_nodes(self) -> None:
        """Starts servers on nodes that are new, and forgets those of nodes that are gone."""
        import ray
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        alive = {n["NodeID"]: n for n in ray.nodes() if n["Alive"] and n["Resources"].get(SERVES)}
        self._addresses = {
            node: (n["NodeManagerAddress"], int(n["Resources"].get("CPU", 1))) for node, n in alive.items()
        }
        each = max(1, -(-self._replicas // max(1, len(alive))))
        wanted = {f"server-{node[:SHOWN]}-{k}": node for k in range(each) for node in sorted(alive)}
        known = self._known
        for name, node in wanted.items():
            if name not in known.handles:
                threads = max(1, self._addresses[node][1] // each)
                options: dict[str, Any] = {
                    "name": name,
                    "namespace": NAMESPACE,
                    "lifetime": "detached",
                    "get_if_exists": True,
                    "num_cpus": 0,
                    "max_restarts": -1,
                    "scheduling_strategy": NodeAffinitySchedulingStrategy(node, soft=False),
                }
                known.handles[name] = (
                    ray.remote(Server).options(**options).remote(str(self._store.path), threads)
                )
                known.nodes[name] = node
        for name in set(known.handles) - set(wanted):
            ray.kill(known.handles.pop(name))
            del known.nodes[name]
            known.opened = {one for one in known.opened if one[0] != name}

    def _table(self) -> dict[int, list[str]]:
        """The servers that each shard is to have: neighbours in this order are on different nodes."""
        names = sorted(self._known.handles, key=lambda name: (int(name.rpartition("-")[2]), name))
        if not names or self._manifest is None:
            return {}
        count = min(self._replicas, len(names))
        return {
            number: [names[(number + k) % len(names)] for k in range(count)]
            for number in range(len(self._manifest.shards))
        }

    def _ask_to_open(self, manifest: Manifest) -> None:
        known, generation = self._known, manifest.generation
        awaited = {(name, at, number) for name, at, numbers in known.asked.values() for number in numbers}
        wanted: dict[str, list[int]] = {}
        for number, names in self._table().items():
            for name in names:
                if (name, generation, number) not in known.opened | awaited:
                    wanted.setdefault(name, []).append(number)
        for name, numbers in wanted.items():
            reference = known.handles[name].answer.remote("ready", generation, numbers, ())
            known.asked[reference] = (name, generation, numbers)

    def _hear(self) -> None:
        import ray

        known = self._known
        if not known.asked:
            return
        done, _ = ray.wait(list(known.asked), num_returns=len(known.asked), timeout=0)
        for reference in done:
            name, generation, numbers = known.asked.pop(reference)
            ray.get(reference)
            known.opened |= {(name, generation, number) for number in numbers if name in known.handles}

    def _publish(self, manifest: Manifest) -> None:
        """Makes a generation the one that is served, once each shard of it is open somewhere."""
        generation, opened = manifest.generation, self._known.opened
        whole = self._table()
        table = {
            number: [name for name in names if (name, generation, number) in opened]
            for number, names in whole.items()
        }
        if not table or not all(table.values()):
            return
        served = self._served
        fewer = table != whole and (served is None or served.manifest.generation != generation)
        if fewer and monotonic() - self._since < GRACE:
            return
        if served is None or (served.manifest.generation, served.table) != (generation, table):
            version = 0 if served is None else served.version + 1
            self._served = Served(version, str(self._store.path), manifest, table)
