"""A page on this computer that shows what it is told, and hears of sliders and buttons from nobody but its user.

The page is Meshcat's; what it is told comes as server-sent events. So a browser lets no other page read it, and nothing
that anybody sends is ever parsed but a short list of a name and a number.
"""

import json
import math
import secrets
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import count
from pathlib import Path
from threading import Condition, Thread
from types import MappingProxyType
from typing import Any

from simrob_drake.results.animation.drawn import Command, empty_page

_HOST = "127.0.0.1"
_NAMES = (_HOST, "localhost")  # of this computer, in a page's address; any other leads here by a trick
_FIRST_PORT, _PORTS = 7000, 100
_SCRIPT = Path(__file__).with_suffix(".js")
_LONGEST = 512  # bytes of a message
_BREATH = 5.0  # s without news after which a word keeps the connection, and finds out whether anybody is there


Hears = Mapping[str, Callable[[Any], object]]
"""Take what a page tells beside its controls, by its name; ValueError or TypeError: it is none of ours."""


@dataclass
class Control:
    """A slider between two values, or a button, whose value is 1 once it was pressed.

    A key presses the button, or moves the slider down by a step; another one moves it up.
    """

    value: float = 0.0
    low: float = 0.0
    high: float = 1.0
    step: float | None = None
    key: str | None = None
    key_up: str | None = None

    def command(self, name: str) -> Command:
        """Return what puts the control into the page's menu."""
        tell = f"tell({json.dumps(name)}"
        if self.step is None:
            return {"type": "set_control", "name": name, "callback": f"() => {tell}, 1)", "keycode1": self.key}
        limits = {"value": self.value, "min": self.low, "max": self.high, "step": self.step}
        keys = {"keycode1": self.key, "keycode2": self.key_up}
        return {"type": "set_control", "name": name, "callback": f"(value) => {tell}, value)", **limits, **keys}


class Board:
    """What Meshcat's page shows in every browser that looks, and what its users set there, whoever serves it."""

    def __init__(
        self,
        controls: dict[str, Control] | None = None,
        *,
        script: Path | None = None,
        hears: Hears = MappingProxyType({}),
    ) -> None:
        """Begin with an empty page of controls by name, and perhaps a script of its own, and what takes its words."""
        self.controls = controls or {}  # what the users may set, by name
        self._hears = hears
        self._news = Condition()
        self._commands: dict[str, Sequence[Command]] = {}
        self._versions: dict[str, int] = {}
        self._count = count(1)
        self._open = True
        before, end, after = empty_page().rpartition("</body>")
        own = [one.read_text(encoding="utf-8") for one in (_SCRIPT, script) if one is not None]
        scripts = "".join(f"<script>{one}</script>" for one in own)
        self.page = f"{before}{scripts}{end}{after}".encode()  # served beside ``events`` and ``told``

    def tell(self, subject: str, commands: Sequence[Command]) -> None:
        """Tell all pages, and those that come later, in place of what they were told of the same subject."""
        with self._news:
            self._commands[subject] = commands
            self._versions[subject] = next(self._count)
            self._news.notify_all()

    def show(self, name: str) -> None:
        """Show a slider where it was set by the program."""
        command = {"type": "set_control_value", "name": name, "value": self.controls[name].value}
        self.tell(f"control {name}", [{**command, "invoke_callback": False}])

    def wipe(self) -> None:
        """Forget all that was told; pages that are open show it until they are loaded anew."""
        with self._news:
            self._commands.clear()
            self._versions.clear()

    def hear(self, message: bytes) -> None:
        """Hear of a control that is set to a number, or what else is heard: lists in JSON. All else is not heard."""
        try:
            name, content = json.loads(message)
            if name in self._hears:
                self._hears[name](content)
                return
            control, value = self.controls[name], float(content)
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
            return
        if math.isfinite(value):
            control.value = min(max(value, control.low), control.high)
            with self._news:  # what the program set it to is past
                self._commands.pop(f"control {name}", None)
                self._versions.pop(f"control {name}", None)

    def events(self, after: int = 0) -> Iterator[bytes]:
        """Yield what a page is to know from now on, as server-sent events, until the board is closed.

        ``after`` is the number of the last event that the page has seen, as it comes with each.
        """
        menu = [control.command(name) for name, control in self.controls.items() if not after]
        yield f"data: {json.dumps(menu)}\n\n".encode()
        with self._news:
            known = {subject: version for subject, version in self._versions.items() if version <= after}
        while (news := self.news(known)) is not None:
            yield news
        yield b"event: end\ndata:\n\n"

    def news(self, known: dict[str, int]) -> bytes | None:
        """Wait for what a page does not know, and return it as an event; None when the board is closed."""
        with self._news:
            self._news.wait_for(lambda: self._unknown(known) or not self._open, timeout=_BREATH)
            if not (self._open or self._unknown(known)):
                return None
            new = [command for subject in self._unknown(known) for command in self._commands[subject]]
            known.update(self._versions)
        last = max(known.values(), default=0)
        return f"id: {last}\ndata: {json.dumps(new)}\n\n".encode() if new else b": nothing new\n\n"

    def close(self) -> None:
        """Tell the pages that nothing more will come."""
        with self._news:
            self._open = False
            self._news.notify_all()

    def _unknown(self, known: dict[str, int]) -> list[str]:
        return [subject for subject, version in self._versions.items() if known.get(subject) != version]


def is_short(length: str) -> bool:
    """Tell whether a message of a length, as its header says it, is one that a page of ours may send."""
    return 0 <= number_of(length, -1) <= _LONGEST


def number_of(text: str, otherwise: int = 0) -> int:
    """Return the whole number that a text from outside is, if it has a few digits and nothing else."""
    return int(text) if text.isascii() and text.isdigit() and len(text) < 12 else otherwise


class Window(Board):
    """A board in a browser on this computer, at an address that nobody can guess."""

    def __init__(self, controls: dict[str, Control] | None = None) -> None:
        """Open the window, with the controls that its user may set, by name."""
        super().__init__(controls)
        self._server = _server(self)
        self.path = f"/{secrets.token_urlsafe(9)}/"
        self.url = f"http://{_HOST}:{self._server.server_port}{self.path}"  # where to look
        Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()

    def close(self) -> None:
        """Close the window and its port."""
        super().close()
        self._server.shutdown()
        self._server.server_close()


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
        elif self.path.partition("?")[0] == f"{window.path}events":
            self._answer(200, "text/event-stream")
            for event in window.events(number_of(self.path.rpartition("=")[2])):
                self.wfile.write(event)
        else:
            self._answer(404)

    def do_POST(self) -> None:
        """Hear what the page's user set."""
        if self._allowed():
            length = self.headers.get("Content-Length", "")
            known = self.path == f"{self.server.window.path}told"
            if known and is_short(length):
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
