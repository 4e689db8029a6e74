"""Starting the server, and telling where it is."""

import contextlib
import os
import socket
import sys
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import uvicorn

from m2t_text.errors import M2TError
from m2t_text.sources.saved_map import SavedMap
from m2t_text.web.app import Site, create_app
from m2t_text.web.security import access_to, with_port
from m2t_text.web.served import Library

PORT = 8010
NEXT = 20  # ports after PORT that are tried, where none was asked for
TOKEN = "M2T_TOKEN"  # the environment variable that a token is taken from


@dataclass(frozen=True)
class Serving:
    """What to serve, and to whom.

    Attributes:
        index: folder; with ``others`` the indexes beside it are offered, too.
        port: None for PORT, or the next that is free.
        names: by which others reach the host.
        write: whether uploads may be added to the index.
        maps: YAML files of saved maps, whose images are shown where the datasets of their names are.
    """

    index: Path
    others: bool = False
    host: str = "127.0.0.1"
    port: int | None = None
    names: Sequence[str] = ()
    write: bool = False
    maps: Sequence[Path] = ()


@dataclass(frozen=True)
class Opened:
    """A server that listens, but does not answer yet.

    Attributes:
        address: of the page, with the token if there is one.
    """

    server: uvicorn.Server
    listening: socket.socket
    address: str

    def run(self) -> None:
        """Answers until it is interrupted, or `uvicorn.Server.should_exit` is set."""
        with self.listening:
            self.server.run([self.listening])


def open_server(what: Serving) -> Opened:
    """Raises M2TError if the host or port cannot be listened on, or a saved map cannot be read."""
    images = {saved.name: saved.grid for saved in map(SavedMap.read, what.maps)}
    listening = _listen(what.host, what.port)
    port = int(listening.getsockname()[1])
    access = access_to(what.host, port, what.names, os.environ.get(TOKEN) or None)
    app = create_app(Site(Library(what.index, what.others, images), what.write), access)
    names = [what.host] if with_port(what.host, port) in access.hosts else [*what.names, socket.gethostname()]
    address = f"http://{with_port(names[0], port)}/" + (f"?token={access.token}" if access.token else "")
    config = uvicorn.Config(
        app, log_level="warning", access_log=False, server_header=False, timeout_graceful_shutdown=2
    )
    return Opened(uvicorn.Server(config), listening, address)


def serve(what: Serving, ready: Callable[[str], None], show: bool = False) -> None:
    """Serves until it is interrupted. ``ready`` is called with the address; with ``show`` a browser opens it.

    Raises:
        M2TError: if the host or port cannot be listened on, or a saved map cannot be read.
    """
    opened = open_server(what)
    ready(opened.address)
    if show:
        with contextlib.suppress(webbrowser.Error):
            webbrowser.open(opened.address)
    opened.run()


def has_screen() -> bool:
    """Whether a browser is likely to open where somebody sees it."""
    if not sys.stdout.isatty():
        return False
    screens = ("DISPLAY", "WAYLAND_DISPLAY")
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in screens)


def _listen(host: str, port: int | None) -> socket.socket:
    tried = [port] if port is not None else range(PORT, PORT + NEXT)
    for one in tried:
        try:
            family = socket.getaddrinfo(host, one, type=socket.SOCK_STREAM)[0][0]
            listening = socket.socket(family)
            if os.name == "posix":
                listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.bind((host, one))
            listening.listen(128)
            return listening
        except OSError as error:
            reason = error.strerror or str(error)
    where = f"port {port} of {host}" if port is not None else f"any port from {PORT} on of {host}"
    raise M2TError(f"cannot listen on {where}: {reason}; name another with --host and --port")
