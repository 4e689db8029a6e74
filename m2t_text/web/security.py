"""Who may ask what: exact lists of hosts and origins, a token where others can reach the server, and headers
that keep the page from loading or running anything that it did not bring along."""

import hmac
import secrets
import socket
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from ipaddress import ip_address
from urllib.parse import parse_qs, urlencode

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}
COOKIE = "m2t-text-token"


@dataclass(frozen=True)
class Access:
    """What is let in.

    Attributes:
        hosts: what the header Host may be, to the letter, in lower case.
        token: None where only this machine reaches the server.
    """

    hosts: frozenset[str]
    token: str | None = None

    @property
    def origins(self) -> frozenset[str]:
        """What the header Origin may be, where there is one."""
        return frozenset(f"http://{host}" for host in self.hosts)

    def knows(self, given: str | None) -> bool:
        """Whether this is the token."""
        return self.token is None or (
            given is not None and hmac.compare_digest(given.encode(), self.token.encode())
        )


def is_loopback(host: str) -> bool:
    """Whether nobody but this machine reaches a server that listens on this host."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def access_to(host: str, port: int, more: Iterable[str] = (), token: str | None = None) -> Access:
    """Who may reach a server that listens on a host and port.

    Args:
        more: names by which others reach it.
        token: to ask for; None for a new one, where others can reach it at all.
    """
    if is_loopback(host):
        names = {"127.0.0.1", "::1", "localhost", host}
    else:
        names = {host, *more} if not _is_any(host) else {"127.0.0.1", "::1", "localhost", *_own_names(), *more}
        token = token or secrets.token_urlsafe(24)
    hosts = {with_port(name.lower(), port) for name in names}
    if port == 80:
        hosts |= {in_brackets(name.lower()) for name in names}
    return Access(frozenset(hosts), token)


def _is_any(host: str) -> bool:
    try:
        return ip_address(host).is_unspecified
    except ValueError:
        return False


def _own_names() -> set[str]:
    """By which this machine is known."""
    name = socket.gethostname()
    names = {name, socket.getfqdn()}
    with suppress(OSError):
        names |= {str(info[4][0]).partition("%")[0] for info in socket.getaddrinfo(name, None)}
    return names


def in_brackets(host: str) -> str:
    """A host as it stands in an address: IPv6 in brackets."""
    return f"[{host}]" if ":" in host else host


def with_port(host: str, port: int) -> str:
    return f"{in_brackets(host)}:{port}"


class Guard:
    """Lets a request through, or answers it with 400, 401 or 403, and adds the headers to every answer."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
                headers.setdefault("Cache-Control", "no-cache")
            await send(message)

        refusal = self._refusal(scope)
        await (refusal or self._app)(scope, receive, guarded)

    def _refusal(self, scope: Scope) -> ASGIApp | None:
        headers = Headers(scope=scope)
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        if len(hosts) != 1 or hosts[0].lower() not in self._access.hosts:
            return _refused(403, "this server does not go by that name; use the address that it printed")
        if len(origins) > 1 or any(origin not in self._access.origins for origin in origins):
            return _refused(403, "a page of another origin may not ask this server")
        if self._access.knows(_bearer(headers)) or self._access.knows(_cookie(headers)):
            return None
        asked = parse_qs(scope["query_string"].decode("latin-1"))
        if scope["method"] == "GET" and self._access.knows(asked.pop("token", [None])[0]):
            return self._welcome(scope["path"], urlencode(asked, doseq=True))
        return _refused(
            401, "a token is needed; use the address that the server printed, or send it as a bearer"
        )

    def _welcome(self, path: str, query: str) -> ASGIApp:
        """Keeps the token in a cookie, and takes it out of the address."""
        response = RedirectResponse(f"/{path.lstrip('/')}" + (f"?{query}" if query else ""), 303)
        response.set_cookie(COOKIE, self._access.token or "", httponly=True, samesite="strict")
        return response


def _refused(status: int, reason: str) -> ASGIApp:
    return JSONResponse({"error": reason}, status)


def _bearer(headers: Headers) -> str | None:
    scheme, _, token = headers.get("authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else None


def _cookie(headers: Headers) -> str | None:
    try:
        morsel = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return None
    return morsel.value if morsel else None
