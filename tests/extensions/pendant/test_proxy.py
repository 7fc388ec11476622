"""The pendant behind a proxy that shows it under a path of its own, as a JupyterHub does."""

import http.client
import re
import socket
from contextlib import closing, contextmanager, suppress
from threading import Thread

import pytest
from serving import serving
from stub_session import StubSession

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.extensions.pendant.guard import PROXY_TOKEN, Guard
from simrob_drake.extensions.pendant.pages import shell

PREFIX, TOKEN = "/user/ana/simrob", "a token of the proxy's own"
SITE = "hub.school.example"
SOCKET = "_nicegui_ws/socket.io/?EIO=4&transport=websocket"
UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}


@pytest.fixture(scope="module")
def served():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shell, "TABS", {"station": lambda *_: None})
        patch.setenv(PROXY_TOKEN, TOKEN)
        opened = StubSession, [{"type": "delete", "path": "/x"}]
        with serving(
            lambda subject, _: opened[0](subject, drawn=opened[1]), root_path=PREFIX
        ) as served:
            yield served


@contextmanager
def proxy(port, *said, strips=True):
    """Pass on what comes under the prefix, which may be left out, with more lines in the head; give the port."""
    listening = socket.create_server(("127.0.0.1", 0))

    def pump(source, sink):
        with suppress(OSError):
            while part := source.recv(65536):
                sink.sendall(part)
            sink.shutdown(socket.SHUT_WR)

    def serve(line):
        with line, socket.create_connection(("127.0.0.1", port)) as onward:
            head = b""
            while b"\r\n\r\n" not in head:
                head += line.recv(65536)
            first, _, rest = head.partition(b"\r\n")
            if strips:
                first = first.replace(f" {PREFIX}".encode(), b" ", 1)
            onward.sendall(b"\r\n".join([first, *(one.encode() for one in said), rest]))
            back = Thread(target=pump, args=(onward, line), daemon=True)
            back.start()
            pump(line, onward)
            back.join(timeout=5)

    def accept():
        with suppress(OSError):
            while True:
                Thread(target=serve, args=(listening.accept()[0],), daemon=True).start()

    Thread(target=accept, daemon=True).start()
    try:
        yield listening.getsockname()[1]
    finally:
        listening.close()


def asked(port, path, read=True, **headers):
    """Return the status and the body of an answer to a browser in front of the proxy."""
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=10)) as line:
        line.request("GET", PREFIX + path, headers={"Host": SITE, **headers})
        answer = line.getresponse()
        return answer.status, answer.read().decode() if read else answer.read1(200).decode()


@pytest.mark.parametrize("strips", [True, False])
def test_a_proxy_that_lets_in_its_user_shows_page_view_and_socket_under_its_path(served, strips):
    lines = f"X-Simrob-Token: {TOKEN}", f"X-Forwarded-Prefix: {PREFIX}"
    with proxy(served.port, *lines, strips=strips) as port:
        status, page = asked(port, "/")
        assert status == 200
        assert PREFIX * 2 not in page
        files = set(re.findall(rf'(?:src|href)="{PREFIX}(/[^"]+\.(?:js|css))"', page))
        assert files
        # nothing beside the proxy's path
        assert not re.findall(r'(?:src|href)="/(?!user/ana/simrob/)', page)
        assert asked(port, sorted(files)[0])[0] == 200
        assert asked(port, "/view/")[0] == 200
        assert "data: " in asked(port, "/view/events?after=0", read=False)[1]
        assert asked(port, f"/{SOCKET}", read=False, Origin=f"https://{SITE}", **UPGRADE)[0] == 101


def test_others_are_refused_and_an_address_of_the_terminal_lets_one_in(served):
    with proxy(
        served.port
    ) as port:  # one that says nothing of who it lets in, or another user of the computer
        assert asked(port, "/")[0] == 403
        assert asked(port, "/", **{"X-Simrob-Token": ""})[0] == 403
        assert asked(port, "/", **{"X-Simrob-Token": TOKEN[:-1]})[0] == 403
        assert asked(port, "/", Cookie=served.cookie)[0] == 200
        told = served.address()
        assert told.startswith(f"{PREFIX}/?token=")
        assert asked(port, told.removeprefix(PREFIX))[0] == 200
        assert asked(port, told.removeprefix(PREFIX))[0] == 403  # once
    with proxy(served.port, f"X-Simrob-Token: {TOKEN}") as port:
        assert asked(port, "/view/", Origin="https://evil.example")[0] == 403
        assert (
            asked(port, f"/{SOCKET}", read=False, Origin="https://evil.example", **UPGRADE)[0]
            == 403
        )


@pytest.mark.parametrize(
    "path", ["", "/", "simrob", "/a b", "/../x?y", "ftp://hub/x", "//", "/x\r\ny"]
)
def test_what_is_no_path_is_refused(path):
    with pytest.raises(InvalidParameter, match="--root-path"):
        Guard(None, 8100, path)


def test_a_whole_address_is_told_and_a_short_token_refused(monkeypatch):
    assert (
        Guard(None, 8100, "https://hub.school.example/user/ana")
        .address()
        .startswith("https://hub.school.example/user/ana/?token=")
    )
    monkeypatch.setenv(PROXY_TOKEN, "short")
    with pytest.raises(InvalidParameter, match=f"{PROXY_TOKEN}.*at least 16"):
        Guard(None, 8100, PREFIX)
    assert Guard(None, 8100).path != "/"  # without a proxy nobody reads it
