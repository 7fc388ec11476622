"""Who may speak to the pendant: its user's browser, and no other page, name or program."""

import secrets
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

PARAMETER = "token"
"""What the token is called in the page's address."""
_NAMES = ("127.0.0.1", "localhost")
_HEADERS = (
    (b"content-security-policy", b"frame-ancestors 'self'"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
)


class Guard:
    """Lets through to an application (ASGI) who comes by this computer's name, from its own page, with the token.

    The token stands in the address that the terminal shows; the answer to it keeps it in a cookie that no script reads
    and no other site sends. A page of another server on this computer does send it, and is known by its origin.

    Attributes:
        app: what is guarded.
        token: that nobody guesses.
    """

    def __init__(self, app: App, port: int) -> None:
        """Guard an application that listens on a port of this computer."""
        self.app = app
        self.token = secrets.token_urlsafe(24)
        self._hosts = [f"{name}:{port}" for name in _NAMES]
        self._cookie = f"simrob_{port}"  # cookies are a computer's, whatever the port

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a question, or open a websocket, or refuse to."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        if why := self._refusal(scope):
            await _refuse(scope, send, why)
            return
        shown = self._shows_token(scope)

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *_HEADERS, *(self._told() if shown else ())]
            await send(message)

        await self.app(scope, receive, with_headers)

    def _refusal(self, scope: Scope) -> str:
        """Return why somebody is not let through; nothing if they are."""
        hosts, origins = _all(scope, b"host"), _all(scope, b"origin")
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return f"This page is at http://{self._hosts[0]} and at no other name."
        if origins not in ([], [f"http://{hosts[0]}"]):
            return "Another page asked for this one; it answers its own alone."
        if not (self._shows_token(scope) or self._same(_cookie(scope, self._cookie))):
            return "The address lacks the token: open the whole address that simrob teach shows in the terminal."
        return ""

    def _shows_token(self, scope: Scope) -> bool:
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get(PARAMETER, [""])
        return scope["type"] == "http" and self._same(given[0])

    def _same(self, given: str) -> bool:
        return secrets.compare_digest(given.encode(), self.token.encode())

    def _told(self) -> Iterable[tuple[bytes, bytes]]:
        yield b"set-cookie", f"{self._cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict".encode()


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
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"cache-control", b"no-store"), *_HEADERS]
    await send({"type": f"{kind}.start", "status": 403, "headers": headers})
    await send({"type": f"{kind}.body", "body": f"{why}\n".encode()})
