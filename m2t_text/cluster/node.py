"""A host's part in a cluster, as a process of its own: `python -m m2t_text.cluster.node ROLE …`.

``head`` and ``join`` watch over Ray, and start it again whenever it ends: a head then starts its keeper by
``keep``, and others join again. ``ray`` is Ray itself, and ends with the process that started it.
"""

import json
import os
import signal
import subprocess
import sys
import threading
from dataclasses import asdict, dataclass
from pathlib import Path
from time import sleep
from types import FrameType
from typing import Any

from m2t_text.cluster.connection import (
    NAMESPACE,
    SERVES,
    connected,
    is_loopback,
    loaded,
    own_address,
    settings,
    split,
)
from m2t_text.cluster.servers import KEEPER, Keeper
from m2t_text.errors import ClusterError

NAMED_PORTS = (
    "node-manager",
    "object-manager",
    "dashboard-agent-grpc",
    "runtime-env-agent",
    "metrics-export",
    "dashboard-agent-listen",
)
AGAIN = 2.0  # s before Ray is started again
STARTED = 60.0  # s for a head to answer
STORE_BYTES = 200_000_000  # of memory that hosts share: answers are small
PORTS = 100  # from the cluster's on, where it is on a named interface


@dataclass(frozen=True)
class Node:
    """What one host does.

    Attributes:
        role: "head", or "join".
        address: HOST:PORT of the head.
        host: this host's own address.
        folder: of the sharded index, of a head.
        replicas: servers of each shard, of a head.
        cpus: cores for reading and describing logs, and for searches.
        serves: whether servers are started here; a host that only asks has none.
    """

    role: str
    address: str
    host: str
    folder: str = ""
    replicas: int = 1
    cpus: int = 1
    serves: bool = True

    def to_json(self) -> str:
        """The argument of the process."""
        return json.dumps(asdict(self))


def main() -> None:
    """Runs what the command line says."""
    role, *arguments = sys.argv[1:]
    if role == "ray":
        run_ray(arguments)
    elif role == "keep":
        keep(*arguments)
    else:
        watch(Node(**json.loads(arguments[0])))


def watch(node: Node) -> None:
    """Runs Ray, and again whenever it ends, until this process is told to end."""
    running: list[subprocess.Popen[bytes]] = []
    ending = threading.Event()

    def end(number: int, frame: FrameType | None) -> None:
        ending.set()
        for process in running:
            process.terminate()

    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGINT, end)
    while not ending.is_set():
        process = start("ray", *ray_arguments(node))
        running[:] = [process]
        if node.role == "head":
            running.append(start("keep", node.address, node.folder, str(node.replicas)))
        process.wait()
        for other in running:
            other.terminate()
        ending.wait(AGAIN)


def start(role: str, *arguments: str, **options: Any) -> subprocess.Popen[bytes]:
    """Starts a process of this module; the options are those of `subprocess.Popen`."""
    command = [sys.executable, "-P", "-m", "m2t_text.cluster.node", role, *arguments]
    return subprocess.Popen(command, env={**os.environ, **settings()}, **options)


def ray_arguments(node: Node) -> list[str]:
    """What Ray is started with."""
    host, port = split(node.address)
    shared = [
        "start",
        "--block",
        "--disable-usage-stats",
        f"--node-ip-address={node.host}",
        f"--num-cpus={node.cpus}",
        f"--object-store-memory={STORE_BYTES}",
        f"--resources={json.dumps({SERVES: 1} if node.serves else {})}",
    ]
    if not is_loopback(node.host):  # of a firewall's rules; several nodes on one host get others
        shared += [f"--{name}-port={port + 1 + k}" for k, name in enumerate(NAMED_PORTS)]
        shared += [f"--min-worker-port={port + 10}", f"--max-worker-port={port + PORTS - 1}"]
    if node.role == "head":
        folder = ray_folder()
        return [*shared, "--head", f"--port={port}", "--include-dashboard=false", f"--temp-dir={folder}"]
    return [*shared, f"--address={host}:{port}"]


def ray_folder() -> Path:
    """Where Ray keeps its sockets and logs; a short path, as those of sockets have to be."""
    folder = Path("/tmp") / f"m2t-text-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.is_symlink() or folder.stat().st_uid != os.getuid():
        raise ClusterError(f"{folder} belongs to somebody else; have it removed")
    return folder


def run_ray(arguments: list[str]) -> None:
    """Ray's own command line, in this process."""
    host = next(one.partition("=")[2] for one in arguments if one.startswith("--node-ip-address="))
    loaded(host)
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    from ray.scripts import scripts

    scripts.cli.main(arguments, prog_name="ray")


def _end_with(parent: int) -> None:
    """Whoever watches over this process may be killed, and it is to end then, too."""
    while os.getppid() == parent:
        sleep(1.0)
    os.kill(os.getpid(), signal.SIGTERM)


def keep(address: str, folder: str, replicas: str) -> None:
    """Starts the keeper, once the head answers; it goes on without this process."""
    for _ in range(int(STARTED)):
        try:
            own_address(*split(address))
            break
        except ClusterError:
            sleep(1.0)
    with connected(address) as ray:
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        head = ray.get_runtime_context().get_node_id()
        keeper = ray.remote(Keeper).options(
            name=KEEPER,
            namespace=NAMESPACE,
            lifetime="detached",
            get_if_exists=True,
            num_cpus=0,
            max_restarts=-1,
            max_concurrency=8,
            scheduling_strategy=NodeAffinitySchedulingStrategy(head, soft=True),
        )
        ray.get(keeper.remote(folder, int(replicas)).served.remote(), timeout=STARTED)


if __name__ == "__main__":
    main()
