"""Starting and ending what this host does in clusters."""

import json
import os
import signal
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from subprocess import DEVNULL
from time import monotonic, sleep

import platformdirs

from m2t_text.cluster.connection import PORT, is_loopback, loaded, own_address, settings, split
from m2t_text.cluster.node import Node
from m2t_text.cluster.node import start as start_process
from m2t_text.cluster.ray_carrier import cluster_index
from m2t_text.cluster.remote import open_store
from m2t_text.errors import ClusterError
from m2t_text.util.files import make_folder
from m2t_text.util.workers import cores

READY = 180.0  # s in which a cluster that was started must serve
ENDED = 6.0  # s for its processes to end
STEP = 0.5  # s
LOOPBACK = "127.0.0.1"


@dataclass(frozen=True)
class Started:
    """A process that was started here.

    Attributes:
        address: HOST:PORT of the cluster.
        folder: of the sharded index; empty where the cluster was joined.
        pid: of the process that watches over it.
        log: the file of what it prints.
    """

    address: str
    folder: str
    pid: int
    log: str

    @property
    def runs(self) -> bool:
        """Whether the process is still there, and no other has its number."""
        try:
            os.kill(self.pid, 0)
        except OSError:
            return False
        command = Path(f"/proc/{self.pid}/cmdline")
        try:
            return b"m2t_text.cluster.node" in command.read_bytes()
        except OSError:
            return not Path("/proc/self").exists()  # a system without such files


def start(
    folder: Path, replicas: int = 1, host: str = LOOPBACK, port: int = PORT, cpus: int | None = None
) -> Started:
    """Starts a cluster on this host that serves a sharded index, and waits until it does.

    Raises:
        ClusterError: if there is no such index, a cluster runs there already, or it does not come up.
    """
    store = open_store(folder)
    store.manifest()
    served = str(store.path if isinstance(store.path, str) else store.path.absolute())
    address = f"{host}:{port}"
    if any(one.address == address for one in all_started()):
        raise ClusterError(
            f"a cluster runs at {address} already; end it with `m2t-text cluster stop {address}`"
        )
    settings(make_token=True)
    loaded(host)
    node = Node("head", address, host, served, replicas, cpus or cores(None))
    started = _run(node)
    end = monotonic() + READY
    problem = ""
    while monotonic() < end:
        if not started.runs:
            break
        try:
            own_address(host, port)
            with cluster_index(address) as index:
                len(index)
            return started
        except ClusterError as error:
            problem = str(error)
        sleep(STEP)
    stop(started)
    raise ClusterError(f"the cluster at {address} did not come up; {started.log} says more ({problem})")


def join(address: str, host: str | None = None, cpus: int | None = None, serves: bool = True) -> Started:
    """Makes this host a node of the cluster at ``HOST:PORT``.

    Raises:
        ClusterError: if nothing answers there.
    """
    head, port = split(address)
    own = host or own_address(head, port)
    settings()
    loaded(own)
    return _run(Node("join", f"{head}:{port}", own, cpus=cpus or cores(None), serves=serves))


def _run(node: Node) -> Started:
    make_folder(_folder())
    name = f"{node.role}-{node.address.replace(':', '-')}-{os.getpid()}"
    log = _folder() / f"{name}.log"
    with log.open("wb") as opened:
        process = start_process(
            node.role, node.to_json(), stdin=DEVNULL, stdout=opened, stderr=opened, start_new_session=True
        )
    started = Started(node.address, node.folder, process.pid, str(log))
    (_folder() / f"{name}.json").write_text(json.dumps(asdict(started)))
    while not started.runs and process.poll() is None:  # it is about to become what it is to be
        sleep(STEP / 50)
    return started


def all_started() -> list[Started]:
    """What runs on this host and was started by this user."""
    return [started for _, started in _recorded() if started.runs]


def _recorded() -> Iterator[tuple[Path, Started]]:
    folder = _folder()
    for file in sorted(folder.glob("*.json")) if folder.is_dir() else ():
        with suppress(OSError, ValueError, TypeError):
            yield file, Started(**json.loads(file.read_text()))


def chosen(address: str | None) -> Started:
    """The cluster of an address, or the only one that runs here. Raises ClusterError."""
    running = [one for one in all_started() if address in (None, one.address)]
    if not running:
        raise ClusterError(
            f"no cluster{f' at {address}' if address else ''} runs on this host that was started here"
        )
    if len({one.address for one in running}) > 1:
        raise ClusterError(
            f"several clusters run here; name one of {', '.join(one.address for one in running)}"
        )
    return running[0]


def stop(started: Started) -> None:
    """Ends a process and all that it started.

    Raises:
        ClusterError: if it does not end.
    """
    own = _descendants(started.pid)
    with suppress(ProcessLookupError):
        os.kill(started.pid, signal.SIGTERM)
    end = monotonic() + ENDED
    while monotonic() < end and any(_alive(pid) for pid in own):
        sleep(STEP / 5)
    for pid in own:
        if _alive(pid):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
    with suppress(ChildProcessError):
        os.waitpid(started.pid, os.WNOHANG)
    for file, other in _recorded():
        if other.pid == started.pid or not other.runs:
            file.unlink(missing_ok=True)
    if started.runs:
        raise ClusterError(f"process {started.pid} of the cluster at {started.address} does not end")


def _descendants(root: int) -> list[int]:
    """A process, its children, theirs, and so on."""
    parents: dict[int, int] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, ValueError, IndexError):
            parents[int(folder.name)] = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
    found = [root]
    for pid in found:
        found += [child for child, parent in parents.items() if parent == pid]
    return found


def _alive(pid: int) -> bool:
    """Whether there is a process that has not ended; one that nobody has waited for has."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def serving(folder: Path) -> str | None:
    """The address of the cluster on this host, for this host alone, that serves a sharded index; or None."""
    path = open_store(folder).path
    own = str(path if isinstance(path, str) else path.absolute())
    held = (one.address for one in all_started() if one.folder == own and is_loopback(split(one.address)[0]))
    return next(held, None)


def local(folder: Path) -> str:
    """Starts a cluster on this host for this host alone that serves a sharded index; returns its address."""
    taken = {split(one.address)[1] for one in all_started()}
    port = next(PORT + 100 * k for k in range(100) if PORT + 100 * k not in taken)
    return start(folder, port=port).address


def _folder() -> Path:
    return Path(platformdirs.user_state_dir("m2t-text")) / "clusters"
