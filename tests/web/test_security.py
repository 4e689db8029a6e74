"""Who is let in, and what the page may do: hosts, origins, tokens, headers."""

from pathlib import Path

import pytest
from serving import BINARY, Client, served

from m2t_text.web.security import HEADERS, access_to


@pytest.fixture(scope="module")
def client(simulated_index: Path):
    with served(simulated_index) as client:
        yield client


@pytest.mark.parametrize("path", ["/", "/api/info", "/assets/main.js", "/api/nothing"])
def test_every_answer_has_the_headers(client: Client, path: str) -> None:
    headers = client.ask(path).headers
    for name, value in HEADERS.items():
        assert headers[name.lower()] == value
    assert "access-control-allow-origin" not in headers and "server" not in headers
    assert "'unsafe" not in headers["content-security-policy"]


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "127.0.0.1",
        "127.0.0.1:1",
        "127.0.0.1:{port}.evil.example",
        "[::1]",
        "localhost.:{port}",
        "",
    ],
)
def test_other_hosts_are_refused(client: Client, host: str) -> None:
    assert client.ask("/api/info", headers={"Host": host.format(port=client.port)}).status == 403


@pytest.mark.parametrize("host", ["127.0.0.1:{port}", "localhost:{port}", "LOCALHOST:{port}", "[::1]:{port}"])
def test_its_own_names_are_not(client: Client, host: str) -> None:
    assert client.ask("/api/info", headers={"Host": host.format(port=client.port)}).status == 200


@pytest.mark.parametrize(
    ("origin", "status"),
    [
        ("http://127.0.0.1:{port}", 200),
        ("http://[::1]:{port}", 200),
        ("https://127.0.0.1:{port}", 403),
        ("http://127.0.0.1", 403),
        ("http://evil.example", 403),
        ("null", 403),
        ("", 403),
    ],
)
def test_other_origins_are_refused(client: Client, origin: str, status: int) -> None:
    headers = {"Origin": origin.format(port=client.port)}
    assert client.ask("/api/info", headers=headers).status == status
    assert client.ask("/api/uploads", {"name": "a.exe"}, "POST", b"", headers | BINARY).status == (
        400 if status == 200 else status
    )


def test_a_form_of_another_page_cannot_send(client: Client) -> None:
    for kind in ("text/plain", "multipart/form-data", "application/x-www-form-urlencoded"):
        assert client.ask("/api/uploads", {"name": "a.log"}, "POST", b"x", {"Content-Type": kind}).status == 415


def test_others_need_the_token(simulated_index: Path) -> None:
    with served(simulated_index, host="0.0.0.0") as client:
        host = {"Host": f"127.0.0.1:{client.port}"}
        token = client.opened.address.partition("token=")[2]
        assert len(token) >= 24
        assert client.ask("/api/info", headers=host).status == 401
        assert client.ask("/", {"token": token[:-1]}, headers=host).status == 401
        assert client.ask("/api/info", headers=host | {"Authorization": f"Bearer {token}"}).status == 200
        assert client.ask("/api/info", headers=host | {"Authorization": f"Basic {token}"}).status == 401
        welcome = client.ask("/", {"token": token, "a": "b"}, headers=host)
        assert (welcome.status, welcome.headers["location"]) == (303, "/?a=b")
        cookie = welcome.headers["set-cookie"]
        assert "HttpOnly" in cookie and "SameSite=strict" in cookie
        assert client.ask("/api/info", headers=host | {"Cookie": cookie.partition(";")[0]}).status == 200
        elsewhere = client.ask("//evil.example/", {"token": token}, headers=host).headers["location"]
        assert elsewhere.startswith("/") and not elsewhere.startswith("//")


def test_a_host_of_ones_own_is_the_only_one() -> None:
    access = access_to("192.0.2.7", 8010, ["robot.example"])
    assert access.hosts == {"192.0.2.7:8010", "robot.example:8010"} and access.token
    assert (
        access_to("::1", 80).hosts >= {"[::1]:80", "[::1]", "localhost"} and access_to("::1", 80).token is None
    )
