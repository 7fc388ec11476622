"""A page on this computer that shows what it is told, and hears of sliders and buttons from nobody but its user.

The page is Meshcat's; what it is told comes as server-sent events. So a browser lets no other page read it, and nothing
that anybody sends is ever parsed but a short list of a name and a number.
"""

import json
import math
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Condition, Thread

from simrob_drake.results.animation.drawn import Command, empty_page

_HOST = "127.0.0.1"
_NAMES = (_HOST, "localhost")  # of this computer, in a page's address; any other leads here by a trick
_FIRST_PORT, _PORTS = 7000, 100
_SCRIPT = Path(__file__).with_suffix(".js")
_LONGEST = 512  # bytes of a message
_BREATH = 5.0  # s without news after which a word keeps the connection, and finds out whether anybody is there


@dataclass
class Control:
    """A slider between two values, or a button, whose value is 1 once it was pressed."""

    value: float = 0.0
    low: float = 0.0
    high: float = 1.0
    step: float | None = None
    key: str | None = None

    def command(self, name: str) -> Command:
        """Return what puts the control into the page's menu."""
        told = json.dumps(name)
        if self.step is None:
            return {"type": "set_control", "name": name, "callback": f"() => tell({told}, 1)", "keycode1": self.key}
        limits = {"value": self.value, "min": self.low, "max": self.high, "step": self.step}
        return {"type": "set_control", "name": name, "callback": f"(value) => tell({told}, value)", **limits}


class Window:
    """Meshcat's page in a browser on this computer, at an address that nobody can guess.

    Attributes:
        url: where to look.
        controls: what the page's user may set, by name.
    """

    def __init__(self, controls: dict[str, Control] | None = None) -> None:
        """Open the window.

        Args:
            controls: what the page's user may set, by name.
        """
        self.controls = controls or {}
        self._news = Condition()
        self._told: dict[str, Sequence[Command]] = {}
        self._versions: dict[str, int] = {}
        self._open = True
        script = f"<script>{_SCRIPT.read_text(encoding='utf-8')}</script>"
        before, end, after = empty_page().rpartition("</body>")
        self._server = _server(self)
        self.page = f"{before}{script}{end}{after}".encode()
        self.path = f"/{secrets.token_urlsafe(9)}/"
        self.url = f"http://{_HOST}:{self._server.server_port}{self.path}"
        Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()

    def tell(self, subject: str, commands: Sequence[Command]) -> None:
        """Tell all pages, and those that come later, in place of what they were told of the same subject."""
        with self._news:
            self._told[subject] = commands
            self._versions[subject] = self._versions.get(subject, 0) + 1
            self._news.notify_all()

    def hear(self, message: bytes) -> None:
        """Set a control to what a page says: a list of its name and a number, in JSON. All else is not heard."""
        try:
            name, given = json.loads(message)
            control, value = self.controls[name], float(given)
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
            return
        if math.isfinite(value):
            control.value = min(max(value, control.low), control.high)

    def news(self, known: dict[str, int]) -> bytes | None:
        """Wait for what a page does not know, and return it as an event; None when the window is closed."""
        with self._news:
            self._news.wait_for(lambda: known != self._versions or not self._open, timeout=_BREATH)
            if not self._open:
                return None
            new = [command for subject in self._new(known) for command in self._told[subject]]
        return f"data: {json.dumps(new)}\n\n".encode() if new else b": nothing new\n\n"

    def close(self) -> None:
        """Close the window and its port."""
        with self._news:
            self._open = False
            self._news.notify_all()
        self._server.shutdown()
        self._server.server_close()

    def _new(self, known: dict[str, int]) -> list[str]:
        new = [subject for subject, version in self._versions.items() if known.get(subject) != version]
        known.update(self._versions)
        return new


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    window: Window

    def handle_error(self, *_: object) -> None:
        """Let a connection that breaks go without a word."""


def _server(window: Window) -> _Server:
    """Return a server at the first free port."""
    for port in (*range(_FIRST_PORT, _FIRST_PORT + _PORTS), 0):
        try:
            server = _Server((_HOST, port), _Handler)
        except OSError:
            if port == 0:
                raise
            continue
        server.window = window
        return server
    raise AssertionError


class _Handler(BaseHTTPRequestHandler):
    timeout = 60.0  # s; a connection that says nothing
    server: _Server

    def do_GET(self) -> None:
        """Give the page, or its events."""
        if not self._allowed():
            return
        window = self.server.window
        if self.path == window.path:
            self._answer(200, "text/html; charset=utf-8", window.page)
        elif self.path == f"{window.path}events":
            self._answer(200, "text/event-stream")
            menu = [control.command(name) for name, control in window.controls.items()]
            self.wfile.write(f"data: {json.dumps(menu)}\n\n".encode())
            known: dict[str, int] = {}
            while (news := window.news(known)) is not None:
                self.wfile.write(news)
            self.wfile.write(b"event: end\ndata:\n\n")
        else:
            self._answer(404)

    def do_POST(self) -> None:
        """Hear what the page's user set."""
        if self._allowed():
            length = self.headers.get("Content-Length", "")
            known = self.path == f"{self.server.window.path}told"
            if known and length.isascii() and length.isdigit() and len(length) < 9 and int(length) <= _LONGEST:
                self.server.window.hear(self.rfile.read(int(length)))
            self._answer(204 if known else 404)

    def _allowed(self) -> bool:
        """Refuse who comes by another name than this computer's, or from another page."""
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        allowed = host.rpartition(":")[0] in _NAMES and origin in (None, f"http://{host}")
        if not allowed:
            self._answer(403)
        return allowed

    def _answer(self, code: int, kind: str = "text/plain", content: bytes = b"") -> None:
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Frame-Options", "DENY")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_: object) -> None:
        """Say nothing: the terminal is the run's."""
