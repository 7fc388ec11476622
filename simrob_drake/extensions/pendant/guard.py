"""Who may speak to the pendant: its user's browser, and no other page, name or program."""

import os
import re
import secrets
from collections.abc import Callable
from urllib.parse import urlsplit

from starlette.requests import HTTPConnection
from starlette.responses import HTMLResponse, PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.messages import message

PROXY_TOKEN = "SIMROB_TOKEN"
"""The environment variable with what a proxy that lets in its user says in each question, in the header below."""
_PROXY_HEADER = "x-simrob-token"
_SHORTEST = 16  # letters of it
_PLACE = re.compile(r"(https?://[\w.-]+(:\d+)?)?(/[\w.~@%-]+)+/?")
_TOKEN = "token"  # what a token is called in an address
_NAMES = ("127.0.0.1", "localhost")
_HEADERS = {
    "content-security-policy": "frame-ancestors 'self'",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}
_FRESH = {"cache-control": "no-store", **_HEADERS}
_NEWEST = "open the newest address that simrob teach shows in the terminal, all of it. Each opens one browser, once."
LEADS_TO = """<!DOCTYPE html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url={0}">
<title>simrob teach</title><a href="{0}">simrob teach</a>
"""
"""A page that leads on to an address. A redirect by status would not bring the cookie along where another program than
the browser began the journey, as the file that opens it does."""


class Guard:
    """Lets through to an application (ASGI) who comes by this computer's name, from its own page, with its cookie.

    The application lies under a path that nobody can guess, so its cookie goes to no other server of this computer,
    which a browser does not tell from this one by the port. No script reads the cookie, and no other site sends it. A
    browser gets it by an address with a token, which is of no more use then: addresses are seen in lists of processes,
    in histories and on screens.

    Behind a proxy the path is the proxy's, and so is the name. Then there are the cookie and its tokens, and a page has
    to be of the same name. A proxy that lets in its user alone may say so by a token of its own.

    Attributes:
        app: what is guarded; its ``root_path`` is the path.
        path: under which it lies, between slashes.
    """

    def __init__(self, app: ASGIApp, port: int, root_path: str | None = None) -> None:
        """Guard an application that listens on a port of this computer.

        A proxy may show it at ``root_path``, a path or a whole address, which it may leave out when it asks. Raises
        InvalidParameter: no such path, or too short a token of the proxy.
        """
        self.app = app
        if root_path is not None and _PLACE.fullmatch(root_path) is None:
            raise InvalidParameter(
                "--root-path",
                root_path,
                message(
                    "pendant.path_of_proxy", "a path as /user/ana/simrob, or the address of one"
                ),
            )
        place = urlsplit(root_path or f"http://{_NAMES[0]}:{port}/{secrets.token_urlsafe(16)}")
        self.path, self._site = (
            f"{place.path.rstrip('/')}/",
            f"{place.scheme}://{place.netloc}".removeprefix("://"),
        )
        self._hosts = [f"{name}:{port}" for name in _NAMES] if root_path is None else []
        self._cookie, self._key = f"simrob_{port}", secrets.token_urlsafe(24)
        self._proxy_key = os.environ.get(PROXY_TOKEN, "") if root_path is not None else ""
        if 0 < len(self._proxy_key) < _SHORTEST:
            raise InvalidParameter(
                PROXY_TOKEN,
                message(
                    "pendant.count_of_letters", "of {count} letters", count=len(self._proxy_key)
                ),
                message("pendant.at_least_letters", "of at least {shortest}", shortest=_SHORTEST),
            )
        self._tokens: dict[str, Callable[[], object]] = {}

    def address(self, used: Callable[[], object] = lambda: None) -> str:
        """Return an address that opens the page in one browser, once; ``used`` is called then."""
        token = secrets.token_urlsafe(24)
        self._tokens[token] = used
        return f"{self._site}{self.path}?{_TOKEN}={token}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a question, or open a websocket, or refuse to."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        if not self._hosts:
            scope = self._from_proxy(scope)
        asked = HTTPConnection(scope)
        known = _same(asked.cookies.get(self._cookie, ""), self._key) or self._comes_by_proxy(asked)
        is_page = (
            scope["type"] == "http" and scope["method"] == "GET" and scope["path"] == self.path
        )
        token = next(iter(asked.query_params.getlist(_TOKEN)), None) if is_page else None
        if why := self._refusal(asked) or ("" if known else self._refused_token(token)):
            await _refuse(scope, receive, send, why)
        elif token is not None:
            self._tokens.pop(token, lambda: None)()
            cookie = f"{self._cookie}={self._key}; Path={self.path}; HttpOnly; SameSite=Strict"
            await HTMLResponse(LEADS_TO.format("./"), headers={"set-cookie": cookie, **_FRESH})(
                scope, receive, send
            )
        else:
            await self.app({**scope, "root_path": self.path[:-1]}, receive, _with_headers(send))

    def _from_proxy(self, scope: Scope) -> Scope:
        """Return a question with its whole path, of which a proxy may have left out what is the proxy's."""
        path = scope["path"]
        # which would count twice
        headers = [one for one in scope["headers"] if one[0] != b"x-forwarded-prefix"]
        whole = path if path.startswith(self.path) else f"{self.path[:-1]}{path}"
        return {**scope, "path": whole, "raw_path": whole.encode(), "headers": headers}

    def _comes_by_proxy(self, asked: HTTPConnection) -> bool:
        """Tell whether a proxy says that it has let in its user."""
        return bool(self._proxy_key) and _same(
            asked.headers.get(_PROXY_HEADER, ""), self._proxy_key
        )

    def _refusal(self, asked: HTTPConnection) -> str:
        """Return why nobody is let through who comes like this; nothing if somebody may be."""
        hosts, origins = asked.headers.getlist("host"), asked.headers.getlist("origin")
        if len(hosts) != 1 or (self._hosts and hosts[0] not in self._hosts):
            return f"This page is at {self._site or self.path} and at no other name."
        schemes = ("http",) if self._hosts else ("http", "https")
        if origins and origins not in [[f"{scheme}://{hosts[0]}"] for scheme in schemes]:
            return "Another page asked for this one; it answers its own alone."
        if not asked.scope["path"].startswith(self.path):
            return f"The page is not at this address: {_NEWEST}"
        return ""

    def _refused_token(self, token: str | None) -> str:
        if token is None:
            return f"This browser has not opened the page yet, or it was started anew: {_NEWEST}"
        if token not in self._tokens:
            return f"This address is incomplete, or was used by another browser, be it yours or not: {_NEWEST}"
        return ""


def _same(first: str, second: str) -> bool:
    return secrets.compare_digest(first.encode(), second.encode())


def _with_headers(send: Send) -> Send:
    own = [(name.encode(), text.encode()) for name, text in _HEADERS.items()]

    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", ()), *own]
        await send(message)

    return sent


async def _refuse(scope: Scope, receive: Receive, send: Send, why: str) -> None:
    """Answer 403 with the reason, to a websocket's handshake too where the server can."""
    if scope["type"] == "websocket" and "websocket.http.response" not in scope.get(
        "extensions", {}
    ):
        await send({"type": "websocket.close", "code": 1008})
    else:
        await PlainTextResponse(f"{why}\n", 403, _FRESH)(scope, receive, send)
