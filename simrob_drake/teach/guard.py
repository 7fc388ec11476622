"""Who may speak to the pendant: its user's browser, and no other page, name or program."""

import secrets
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Headers = Iterable[tuple[bytes, bytes]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

_TOKEN = "token"
"""What a token is called in an address."""
_NAMES = ("127.0.0.1", "localhost")
_HEADERS = (
    (b"content-security-policy", b"frame-ancestors 'self'"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
)
_NEWEST = "open the newest address that simrob teach shows in the terminal, all of it. Each opens one browser, once."
_ENTRANCE = b"""<!DOCTYPE html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url=./">
<title>simrob teach</title><a href="./">simrob teach</a>"""
"""Leads on to the page in place of the address with the token. A redirect by status would not bring the cookie along
where another program than the browser began the journey, as the file that opens it does."""


class Guard:
    """Lets through to an application (ASGI) who comes by this computer's name, from its own page, with its cookie.

    The application lies under a path that nobody can guess, so its cookie goes to no other server of this computer,
    which a browser does not tell from this one by the port. No script reads the cookie, and no other site sends it. A
    browser gets it by an address with a token, which is of no more use then: addresses are seen in lists of processes,
    in histories and on screens.

    Attributes:
        app: what is guarded; its ``root_path`` is the path.
        path: under which it lies, between slashes.
    """

    def __init__(self, app: App, port: int) -> None:
        """Guard an application that listens on a port of this computer."""
        self.app = app
        self.path = f"/{secrets.token_urlsafe(16)}/"
        self._hosts = [f"{name}:{port}" for name in _NAMES]
        self._cookie, self._key = f"simrob_{port}", secrets.token_urlsafe(24)
        self._tokens: dict[str, Callable[[], object]] = {}

    def address(self, used: Callable[[], object] = lambda: None) -> str:
        """Return an address that opens the page in one browser, once; ``used`` is called then."""
        token = secrets.token_urlsafe(24)
        self._tokens[token] = used
        return f"http://{self._hosts[0]}{self.path}?{_TOKEN}={token}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a question, or open a websocket, or refuse to."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        known = secrets.compare_digest(_cookie(scope, self._cookie).encode(), self._key.encode())
        token = self._token(scope)
        if why := self._refusal(scope) or ("" if known else self._refused_token(token)):
            await _refuse(scope, send, why)
        elif token is not None:
            self._tokens.pop(token, lambda: None)()
            cookie = f"{self._cookie}={self._key}; Path={self.path}; HttpOnly; SameSite=Strict"
            headers = (
                (b"content-type", b"text/html; charset=utf-8"),
                (b"cache-control", b"no-store"),
                (b"set-cookie", cookie.encode()),
            )
            await _answer(send, 200, headers, _ENTRANCE)
        else:
            await self.app({**scope, "root_path": self.path[:-1]}, receive, _with_headers(send))

    def _refusal(self, scope: Scope) -> str:
        """Return why nobody is let through who comes like this; nothing if somebody may be."""
        hosts, origins = _all(scope, b"host"), _all(scope, b"origin")
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return f"This page is at http://{self._hosts[0]} and at no other name."
        if origins not in ([], [f"http://{hosts[0]}"]):
            return "Another page asked for this one; it answers its own alone."
        if not scope["path"].startswith(self.path):
            return f"The page is not at this address: {_NEWEST}"
        return ""

    def _refused_token(self, token: str | None) -> str:
        if token is None:
            return f"This browser has not opened the page yet, or it was started anew: {_NEWEST}"
        if token not in self._tokens:
            return f"This address is incomplete, or was used by another browser, be it yours or not: {_NEWEST}"
        return ""

    def _token(self, scope: Scope) -> str | None:
        """Return the token in the address of the page; None of any other."""
        if scope["type"] != "http" or scope["method"] != "GET" or scope["path"] != self.path:
            return None
        return next(iter(parse_qs(scope["query_string"].decode("latin-1")).get(_TOKEN, ())), None)


def _with_headers(send: Send) -> Send:
    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", ()), *_HEADERS]
        await send(message)

    return sent


def _all(scope: Scope, name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in scope["headers"] if key.lower() == name]


def _cookie(scope: Scope, name: str) -> str:
    pairs = (pair.strip().partition("=") for line in _all(scope, b"cookie") for pair in line.split(";"))
    return next((value for key, _, value in pairs if key == name), "")


async def _refuse(scope: Scope, send: Send, why: str) -> None:
    """Answer 403 with the reason, to a websocket's handshake too where the server can."""
    kind = "http.response"
    if scope["type"] == "websocket":
        if "websocket.http.response" not in scope.get("extensions", {}):
            await send({"type": "websocket.close", "code": 1008})
            return
        kind = "websocket.http.response"
    headers = ((b"content-type", b"text/plain; charset=utf-8"), (b"cache-control", b"no-store"))
    await _answer(send, 403, headers, f"{why}\n".encode(), kind)


async def _answer(send: Send, status: int, headers: Headers, body: bytes, kind: str = "http.response") -> None:
    await send({"type": f"{kind}.start", "status": status, "headers": [*headers, *_HEADERS]})
    await send({"type": f"{kind}.body", "body": body})
