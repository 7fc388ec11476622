"""A page on this computer that a program draws into, and whose sliders and buttons only its user can set.

The page is Meshcat's. It receives its commands as server-sent events, which the browser allows no other page to read.
The page itself sends short messages: a JSON list of a name and a value. Nothing else that arrives is parsed. A
*control* is a slider or a button in the menu of the page.
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
_NAMES = (_HOST, "localhost")
"""Names of this computer in the address of a page. With another name, a foreign page tries to look like ours."""

_FIRST_PORT = 7000
_PORT_COUNT = 100
"""Ports that are tried, before any free one is taken."""

_SCRIPT = Path(__file__).with_suffix(".js")
"""Script that the page has in addition to Meshcat's own."""

_LONGEST = 512
"""Longest message of a page [bytes]."""

_MOST_DIGITS = 11
"""Most digits of a number in a header or an address."""

_PAUSE = 5.0
"""Time without news after which a line keeps the connection, and shows whether the page is still there [s]."""

Hears = Mapping[str, Callable[[Any], object]]
"""Callbacks for messages that set no control, by the name in the message. They get the message's value.

A callback raises ValueError or TypeError if the value is not one of its own; the message is ignored then.
"""


@dataclass
class Control:
    """A slider, or a button.

    Attributes:
        value: value of the slider; that of a button is 1 after it was pressed.
        low: smallest value.
        high: largest value.
        step: step of the slider; None for a button.
        key: key of the keyboard that presses the button, or moves the slider down by a step; None for no key.
        key_up: key that moves the slider up by a step; None for no key.
    """

    value: float = 0.0
    low: float = 0.0
    high: float = 1.0
    step: float | None = None
    key: str | None = None
    key_up: str | None = None

    def command(self, name: str) -> Command:
        """Command that adds the control to the menu of the page, under a name.

        When the user moves or presses the control, the page sends the name with the new value, or with 1 for a button.
        """
        # Beginning of a call of the page's JavaScript function `tell`, with the name as its first argument.
        tell = f"tell({json.dumps(name)}"
        if self.step is None:
            return {
                "type": "set_control",
                "name": name,
                "callback": f"() => {tell}, 1)",
                "keycode1": self.key,
            }
        limits = {"value": self.value, "min": self.low, "max": self.high, "step": self.step}
        keys = {"keycode1": self.key, "keycode2": self.key_up}
        return {
            "type": "set_control",
            "name": name,
            "callback": f"(value) => {tell}, value)",
            **limits,
            **keys,
        }


class Board:
    """Content of Meshcat's page in all browsers that show it, and the controls that its users set.

    The board is independent of the server: it takes messages, and yields the events for each page. Commands belong to
    a *subject*, such as "scene": new commands replace those of the same subject for pages that are opened later.

    Attributes:
        controls: controls that the users may set, by name.
        page: HTML of the page, encoded. It reads the address ``events`` next to its own, and writes to ``told``.
    """

    def __init__(
        self,
        controls: dict[str, Control] | None = None,
        *,
        script: Path | None = None,
        hears: Hears = MappingProxyType({}),
    ) -> None:
        """Make an empty page.

        Args:
            controls: controls that the users may set, by name.
            script: file of a further script of the page, if any.
            hears: callbacks for messages that set no control.
        """
        self.controls = controls or {}
        self._hears = hears
        self._news = Condition()
        # By subject. A page that is opened later gets all of them, so it shows the same picture as the others.
        self._commands: dict[str, Sequence[Command]] = {}
        self._versions: dict[str, int] = {}  # number of the latest event of each subject
        self._count = count(1)
        self._open = True
        before, end, after = empty_page().rpartition("</body>")
        files = [_SCRIPT] if script is None else [_SCRIPT, script]
        texts = [file.read_text(encoding="utf-8") for file in files]
        scripts = "".join(f"<script>{text}</script>" for text in texts)
        self.page = f"{before}{scripts}{end}{after}".encode()

    def tell(self, subject: str, commands: Sequence[Command]) -> None:
        """Send commands to all pages, also to later ones, in place of earlier commands of the same subject.

        Args:
            subject: what the commands are about, such as "scene".
            commands: commands to Meshcat's page.
        """
        with self._news:
            self._commands[subject] = commands
            self._versions[subject] = next(self._count)
            self._news.notify_all()

    def show(self, name: str) -> None:
        """Move a slider in all pages to the value that the program has set in `controls`.

        Args:
            name: name of the slider.
        """
        command = {"type": "set_control_value", "name": name, "value": self.controls[name].value}
        self.tell(f"control {name}", [{**command, "invoke_callback": False}])

    def wipe(self) -> None:
        """Forget all commands. Pages that are open keep their picture until they are loaded again."""
        with self._news:
            self._commands.clear()
            self._versions.clear()

    def hear(self, message: bytes) -> None:
        """Take a message of a page: set a control, or call a callback. Other messages are ignored.

        Args:
            message: a JSON list of a name and a value.
        """
        try:
            name, content = json.loads(message)
            if name in self._hears:
                self._hears[name](content)
                return
            control = self.controls[name]
            value = float(content)
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
            return
        if math.isfinite(value):
            # The page keeps sliders within their limits, but the message may come from another program.
            control.value = min(max(value, control.low), control.high)
            # Forget the command of `show`: the value that the program has set is no longer valid.
            with self._news:
                self._commands.pop(f"control {name}", None)
                self._versions.pop(f"control {name}", None)

    def events(self, after: int = 0) -> Iterator[bytes]:
        """Yield the server-sent events for a page until the board is closed.

        Args:
            after: number of the last event that the page has received; 0 for a new page, which gets the menu, too.
        """
        menu = [control.command(name) for name, control in self.controls.items() if not after]
        yield f"data: {json.dumps(menu)}\n\n".encode()
        # Of each subject, the latest event, if the page has received it already.
        with self._news:
            known = {
                subject: version for subject, version in self._versions.items() if version <= after
            }
        while (news := self.news(known)) is not None:
            yield news
        yield b"event: end\ndata:\n\n"

    def news(self, known: dict[str, int]) -> bytes | None:
        """Wait for commands that a page has not received.

        Args:
            known: number of the last event that the page has received of each subject. It is brought up to date.

        Returns:
            the commands as an event; a comment if nothing is new for some seconds; None if the board is closed.
        """
        with self._news:
            # The lock of the condition is released while it waits, so that the program can send.
            self._news.wait_for(lambda: self._new_subjects(known) or not self._open, timeout=_PAUSE)
            # What was sent before the board was closed is still delivered.
            if not (self._open or self._new_subjects(known)):
                return None
            new = [
                command
                for subject in self._new_subjects(known)
                for command in self._commands[subject]
            ]
            known.update(self._versions)
        last = max(known.values(), default=0)
        return f"id: {last}\ndata: {json.dumps(new)}\n\n".encode() if new else b": nothing new\n\n"

    def close(self) -> None:
        """End the events of all pages."""
        with self._news:
            self._open = False
            self._news.notify_all()

    def _new_subjects(self, known: dict[str, int]) -> list[str]:
        """Subjects with commands that a page has not received, given its last event of each subject."""
        return [
            subject for subject, version in self._versions.items() if known.get(subject) != version
        ]


def is_short(length: str) -> bool:
    """Whether a message has at most 512 bytes.

    Args:
        length: length as the header of the message gives it. The result is False if it is not a number.
    """
    return 0 <= number_of(length, -1) <= _LONGEST


def number_of(text: str, otherwise: int = 0) -> int:
    """Read a number from a text of unknown origin.

    Args:
        text: the text.
        otherwise: result if the text is not a few digits and nothing else.
    """
    is_number = text.isascii() and text.isdigit() and len(text) <= _MOST_DIGITS
    return int(text) if is_number else otherwise


class Window(Board):
    """A board that a server of its own shows on this computer, at an address that cannot be guessed.

    Attributes:
        path: path of the page in its address.
        url: address of the page.
    """

    def __init__(self, controls: dict[str, Control] | None = None) -> None:
        """Start the server, for a page with controls by name. No browser is opened.

        The server takes the first free port from 7000 to 7099, or any free one if these are all in use.
        """
        super().__init__(controls)
        self._server = _server(self)
        self.path = f"/{secrets.token_urlsafe(9)}/"
        self.url = f"http://{_HOST}:{self._server.server_port}{self.path}"
        Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True
        ).start()

    def close(self) -> None:
        """Close the window and its port."""
        super().close()
        # The events end first: their threads would otherwise wait for news of a closed window.
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    """Server of one window."""

    daemon_threads = True  # an open page does not keep the program from ending
    window: Window

    def handle_error(self, *_: object) -> None:
        """Ignore a connection that breaks: a page was closed."""


def _server(window: Window) -> _Server:
    """Start a server of a window at the first free port from 7000 to 7099, or at any free one.

    Raises:
        OSError: no port is free.
    """
    any_port = 0  # the system chooses one
    for port in (*range(_FIRST_PORT, _FIRST_PORT + _PORT_COUNT), any_port):
        try:
            server = _Server((_HOST, port), _Handler)
        except OSError:
            if port == any_port:
                raise
            continue
        server.window = window
        return server
    raise AssertionError  # the loop ends with any free port, or with its error


class _Handler(BaseHTTPRequestHandler):
    """Handler of one request to the server of a window."""

    timeout = 60.0  # time after which a silent connection is closed [s]
    server: _Server

    def do_GET(self) -> None:
        """Answer with the page, or with its events, for as long as the window is open."""
        if not self._is_allowed():
            return
        window = self.server.window
        if self.path == window.path:
            self._answer(200, "text/html; charset=utf-8", window.page)
        elif self.path.partition("?")[0] == f"{window.path}events":
            self._answer(200, "text/event-stream")
            # A page that lost its connection asks for the events after the last one that it has received, such as
            # `events?after=12`. A text without a number gives 0, as for a new page.
            for event in window.events(number_of(self.path.rpartition("=")[2])):
                self.wfile.write(event)
        else:
            self._answer(404)

    def do_POST(self) -> None:
        """Take a message of the page: a control that its user has set."""
        if self._is_allowed():
            length = self.headers.get("Content-Length", "")
            is_known = self.path == f"{self.server.window.path}told"
            if is_known and is_short(length):
                self.server.window.hear(self.rfile.read(int(length)))
            self._answer(204 if is_known else 404)

    def _is_allowed(self) -> bool:
        """Whether a request comes from our page. All other requests are answered with an error.

        The page of another origin may not send messages, and a foreign name of this computer is not accepted: a page
        could make the browser look up such a name to reach this server.
        """
        host = self.headers.get("Host", "")
        # browsers leave it out if the page reads from its own server
        origin = self.headers.get("Origin")
        name, _, _ = host.rpartition(":")
        is_allowed = name in _NAMES and origin in (None, f"http://{host}")
        if not is_allowed:
            self._answer(403)
        return is_allowed

    def _answer(self, code: int, kind: str = "text/plain", content: bytes = b"") -> None:
        """Answer a request.

        Args:
            code: HTTP status.
            kind: media type of the content.
            content: the content. Events follow later.
        """
        self.send_response(code)
        self.send_header("Content-Type", kind)
        # The browser keeps no copy of the page, whose address belongs to this window only.
        self.send_header("Cache-Control", "no-store")
        # A foreign page could show ours in a frame and lead the user's clicks to our buttons.
        self.send_header("X-Frame-Options", "DENY")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_: object) -> None:
        """Write nothing: the terminal belongs to the run."""
