"""Ray, as this package uses it: with a token, without usage statistics, on one interface."""

import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from ipaddress import ip_address
from pathlib import Path
from secrets import token_hex
from typing import Any

import platformdirs

from m2t_text.errors import ClusterError
from m2t_text.util.files import make_folder

PORT = 6399
NAMESPACE = "m2t-text"
PACKAGE = Path(__file__).parents[1]
SERVES = "m2t_serve"  # the resource of a node that serves shards
TOKEN_FILE = "M2T_CLUSTER_TOKEN_FILE"  # the variable that names another file
REACHED = 3.0  # s for a connection
SETTINGS = {
    "RAY_AUTH_MODE": "token",  # who has no token is refused
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_worker_niceness": "0",  # 15 otherwise
    "RAY_GRACEFUL_SHUTDOWN_DRAIN_TIMEOUT_S": "0",  # servers never end by themselves
    "RAY_health_check_initial_delay_ms": "2000",
    "RAY_health_check_period_ms": "1000",  # a node that cannot be reached is dead after some 10 s
    "RAY_health_check_timeout_ms": "2000",
    "RAY_health_check_failure_threshold": "4",
    "RAY_gcs_rpc_server_reconnect_timeout_s": "20",  # a node whose head is gone ends, and joins again
    "RAY_enable_metrics_collection": "0",
    "RAY_DEDUP_LOGS": "0",
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
    "RAY_py_gcs_connect_timeout_s": "5",  # for who has a wrong token, or asks for a head that hangs
    "RAY_gcs_rpc_server_connect_timeout_s": "5",
}
ASKING = {
    "RAY_gcs_rpc_server_reconnect_timeout_s": "1000000"
}  # otherwise Ray ends a process that lost the head


def token_file() -> Path:
    """The file of the token, which all hosts of a cluster share."""
    named = os.environ.get(TOKEN_FILE)
    return Path(named) if named else Path(platformdirs.user_config_dir("m2t-text")) / "cluster-token"


def token(make: bool = False) -> str:
    """The cluster's token; if there is none, ``make`` makes one that the user alone can read.

    Raises:
        ClusterError: if there is none, or it cannot be read.
    """
    file = token_file()
    try:
        if make and not file.exists():
            make_folder(file.parent)
            descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(descriptor, "w") as opened:
                opened.write(token_hex(32))
        held = file.read_text().strip()
    except FileNotFoundError as error:
        raise ClusterError(
            f"no token in {file}; copy that of the host where the cluster was started, or name its file in "
            f"{TOKEN_FILE}"
        ) from error
    except (OSError, UnicodeDecodeError) as error:
        raise ClusterError(f"the token in {file} cannot be read: {error}") from error
    if not held:
        raise ClusterError(f"{file} is empty; copy the token of the host where the cluster was started")
    return held


def settings(make_token: bool = False) -> dict[str, str]:
    """The environment of every process of a cluster, and of those who ask it."""
    path = os.pathsep.join(filter(None, [str(PACKAGE.parent), os.environ.get("PYTHONPATH")]))
    return SETTINGS | {"RAY_AUTH_TOKEN": token(make_token), "PYTHONPATH": path}


def loaded(host: str, asking: bool = False) -> Any:
    """Ray itself, ready for a cluster on this host's interface, to be asked or to be a node of it.

    Raises:
        ClusterError: if it is not installed.
    """
    os.environ.update(settings() | (ASKING if asking else {}))
    try:
        import ray
        from ray._private import services

        raylet: Any = import_module("ray._raylet")
        worker: Any = import_module("ray._private.worker")
    except ImportError as error:
        raise ClusterError("this takes Ray; install it with: pip install 'm2t-text[cluster]'") from error
    worker._worker_logs_enabled = False  # nothing of others on standard output, which is for results
    raylet.Config.initialize("")  # where Ray was imported before, it reads its settings again
    raylet.AuthenticationTokenLoader.instance().reset_cache()
    if is_loopback(host):  # otherwise Ray takes another interface for it, and listens on all
        services.resolve_ip_for_localhost = lambda host: host
    return ray


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """Ray, connected to the cluster at ``HOST:PORT`` during the block. This host must be a node of it.

    Raises:
        ClusterError: if nothing answers there, or refuses the token.
    """
    host, port = split(address)
    own = own_address(host, port)
    ray = loaded(own, asking=True)
    if ray.is_initialized():
        if ray.get_runtime_context().gcs_address != f"{host}:{port}":
            raise ClusterError(f"this process is connected to another cluster than {address} already")
        yield ray  # whoever connected first ends the connection
        return
    try:
        with _silence():
            ray.init(
                address=f"{host}:{port}",
                namespace=NAMESPACE,
                log_to_driver=False,
                logging_level="CRITICAL",
                _node_ip_address=own,
            )
    except (ConnectionError, RuntimeError, OSError, ValueError) as error:
        raise ClusterError(
            f"the cluster at {address} cannot be asked from this host: is its token in {token_file()}, and did "
            f"the host join with `m2t-text cluster join {address}`? ({str(error).splitlines()[0]})"
        ) from error
    try:
        yield ray
    finally:
        ray.shutdown()


@contextmanager
def _silence() -> Iterator[None]:
    """Keeps from standard error what Ray prints each second, and an error says in the end."""
    sys.stderr.flush()
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)


def split(address: str) -> tuple[str, int]:
    """Host and port of an address; ClusterError if it is none."""
    host, colon, port = address.rpartition(":")
    if not colon:
        host, port = address, str(PORT)
    if not host or not port.isdecimal() or not 0 < int(port) < 2**16:
        raise ClusterError(f"{address!r} is no address; give HOST:PORT, as 127.0.0.1:{PORT}")
    return ("127.0.0.1" if host == "localhost" else host), int(port)


def own_address(host: str, port: int) -> str:
    """This host's address as the other one sees it. Raises ClusterError if nothing answers there."""
    try:
        with socket.create_connection((host, port), REACHED) as connection:
            return str(connection.getsockname()[0])
    except OSError as error:
        raise ClusterError(
            f"no cluster at {host}:{port} ({error.strerror or error}); start one with "
            "`m2t-text cluster start DIR`"
        ) from error


def is_loopback(host: str) -> bool:
    """Whether an address is this host's own, which no other host reaches."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False
