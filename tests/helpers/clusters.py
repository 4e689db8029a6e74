"""Clusters for tests: started, looked into, and ended with all their processes."""

import os
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep

import pytest

from m2t_text.cluster import running
from m2t_text.cluster.connection import TOKEN_FILE
from m2t_text.cluster.ray_carrier import cluster_status
from m2t_text.cluster.servers import Status


@contextmanager
def own_state(folder: Path) -> Iterator[None]:
    """A token and records of clusters in a folder, instead of the user's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(TOKEN_FILE, str(folder / "token"))
        patch.setenv("XDG_STATE_HOME", str(folder / "state"))
        try:
            yield
        finally:
            for started in running.all_started():
                running.stop(started)


def free_port() -> int:
    """The first of 100 ports that nobody listens on now, or most of which nobody does."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return min(int(probe.getsockname()[1]), 64_000)


def processes(root: int, title: str = "") -> list[int]:
    """Those below a process, of which the title or command line begins so."""
    found = []
    for pid in running._descendants(root):
        try:
            command = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue
        if title in command and running._alive(pid):
            found.append(pid)
    return found


def kill(pids: list[int], number: int = signal.SIGKILL) -> None:
    """Sends all of them a signal."""
    for pid in pids:
        try:
            os.kill(pid, number)
        except ProcessLookupError:
            continue


def wait_for(address: str, condition, seconds: float = 90.0) -> Status:
    """How a cluster is, once that is as it should be."""
    end = monotonic() + seconds
    while True:
        status = cluster_status(address)
        if condition(status):
            return status
        assert monotonic() < end, status
        sleep(0.5)


def listening(pids: list[int]) -> set[str]:
    """The addresses on which processes accept connections, as the system writes them in hexadecimal."""
    inodes = set()
    for pid in pids:
        for link in Path(f"/proc/{pid}/fd").glob("*"):
            try:
                target = str(link.readlink())
            except OSError:
                continue
            if target.startswith("socket:["):
                inodes.add(target[8:-1])
    addresses = set()
    for name in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and fields[9] in inodes:
                addresses.add(fields[1].partition(":")[0])
    return addresses
