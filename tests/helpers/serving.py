"""A server in this process, and a client that says what it gets."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import urlencode, urlsplit

import numpy as np

from m2t_text.web.serving import Opened, Serving, open_server

BINARY = {"Content-Type": "application/octet-stream"}


@dataclass(frozen=True)
class Answer:
    status: int
    headers: dict[str, str]
    body: bytes

    def json(self) -> Any:
        return json.loads(self.body)


@dataclass(frozen=True)
class Client:
    """Asks a server; every request has a connection of its own."""

    opened: Opened

    @property
    def port(self) -> int:
        return int(urlsplit(self.opened.address).port or 0)

    def ask(
        self,
        path: str,
        parameters: dict[str, Any] | None = None,
        method: str = "GET",
        body: Any = None,
        headers: dict[str, str] | None = None,
    ) -> Answer:
        connection = HTTPConnection("127.0.0.1", self.port, timeout=120)
        query = f"?{urlencode(parameters)}" if parameters else ""
        try:
            connection.request(method, path + query, body, headers or {})
            response = connection.getresponse()
            told = {name.lower(): value for name, value in response.getheaders()}
            return Answer(response.status, told, response.read())
        finally:
            connection.close()

    def get(self, path: str, **parameters: Any) -> Any:
        """The JSON of an answer that is all right."""
        answer = self.ask(path, parameters)
        assert answer.status == 200, (path, answer.status, answer.body[:300])
        return answer.json()

    def send(self, file: Path, name: str | None = None) -> Answer:
        """Uploads a file."""
        return self.ask("/api/uploads", {"name": name or file.name}, "POST", file.read_bytes(), BINARY)


def unpacked(body: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and columns of an answer in binary."""
    length = int.from_bytes(body[:4], "little")
    header = json.loads(body[4 : 4 + length])
    at, columns = 4 + length, {}
    for column in header["columns"]:
        array = np.frombuffer(body, f"<{column['type']}", column["length"], at)
        columns[column["name"]] = array
        at += array.nbytes + -array.nbytes % 8
    assert at == len(body)
    return header, columns


@contextmanager
def served(index: Path, write: bool = False, port: int = 0, **more: Any) -> Iterator[Client]:
    """A server of an index, on a port that is free if none is asked for."""
    opened = open_server(Serving(index, port=port, write=write, **more))
    thread = threading.Thread(target=opened.run, daemon=True)
    thread.start()
    try:
        yield Client(opened)
    finally:
        opened.server.should_exit = True
        thread.join(20)
    assert not thread.is_alive()
