"""Who is let through to the pendant: its user's browser alone, for the page, the websocket and the view."""

import json

import pytest
from serving import serving
from stub_session import StubSession

from simrob_drake.teach.pages import shell

PLACES = ["/", "/view/", "/view/events", "/_nicegui_ws/socket.io/?EIO=4&transport=polling", "/nowhere"]
SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
HANDSHAKE = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {}\r\n"


@pytest.fixture(scope="module")
def served():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shell, "TABS", {"station": lambda *_: None})
        with serving(lambda subject, _: StubSession(subject, drawn=[{"type": "delete", "path": "/x"}])) as served:
            yield served


def handshake(served, **headers):
    """Return what a browser gets that opens a websocket."""
    given = {"Host": served.host, "Origin": f"http://{served.host}", "Cookie": served.cookie} | headers
    lines = "".join(f"{name}: {value}\r\n" for name, value in given.items() if value is not None)
    key = HANDSHAKE.format("dGhlIHNhbXBsZSBub25jZQ==")
    return served.said(f"GET {SOCKET} HTTP/1.1\r\n{lines}{key}\r\n".encode())


def test_the_address_of_the_terminal_opens_the_page_and_leaves_a_cookie(served):
    status, headers, page = served.asked(f"/?token={served.token}", Cookie="")
    assert status == 200
    assert b"Teach pendant" in page
    assert headers["set-cookie"] == f"{served.cookie}; Path=/; HttpOnly; SameSite=Strict"
    assert headers["referrer-policy"] == "no-referrer"  # the token goes nowhere
    assert headers["content-security-policy"] == "frame-ancestors 'self'"


def test_the_cookie_opens_all_from_then_on(served):
    for path in PLACES[:-1]:
        status, headers, _ = served.asked(path, read="events" not in path)
        assert status == 200
        assert "set-cookie" not in headers
    assert handshake(served).startswith(b"HTTP/1.1 101")
    others = f"theme=dark; bad cookie;; simrob_1=x; {served.cookie}; last={'=' * 9}"
    assert served.asked(Cookie=others)[0] == 200  # what other servers of this computer leave is sent, too


@pytest.mark.parametrize("path", PLACES)
@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example:{port}"},
        {"Host": "127.0.0.1"},
        {"Host": "127.0.0.1:1"},
        {"Host": "127.0.0.1.evil.example:{port}"},
        {"Host": ""},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "https://127.0.0.1:{port}"},
        {"Origin": "http://127.0.0.1:1"},  # another server of this computer
        {"Origin": "http://localhost:{port}"},  # of the other name
        {"Cookie": ""},
        {"Cookie": "simrob_{port}="},
        {"Cookie": "simrob_{port}=guessed"},
        {"Cookie": "simrob_1={token}"},  # of a pendant at another port
    ],
    ids=str,
)
def test_others_are_refused(served, path, headers):
    given = {name: value.format(port=served.port, token=served.token) for name, value in headers.items()}
    status, told, why = served.asked(path, **given)
    assert status == 403
    assert told["content-type"] == "text/plain; charset=utf-8"
    assert "set-cookie" not in told
    expected = {"Host": "is at http://127.0.0.1:", "Origin": "Another page", "Cookie": "the whole address"}
    assert expected[next(iter(headers))] in why.decode()
    assert served.token not in why.decode()


def test_a_wrong_token_in_the_address_is_refused(served):
    for token in ("", "x", served.token[:-1], served.token + "x", "%FF", "%C3%A9", "%00", served.token.swapcase()):
        assert served.asked(f"/?token={token}", Cookie="")[0] == 403
    assert served.asked(f"/?other={served.token}", Cookie="")[0] == 403


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Origin": "http://evil.example"},
        {"Origin": "http://127.0.0.1:1"},
        {"Cookie": None},
        {"Cookie": "simrob_{port}=guessed"},
    ],
    ids=str,
)
def test_a_foreign_websocket_is_refused_in_words(served, headers):
    given = {name: value and value.format(port=served.port) for name, value in headers.items()}
    answer = handshake(served, **given)
    assert answer.startswith(b"HTTP/1.1 403")
    assert b"This page is at" in answer or b"Another page" in answer or b"the whole address" in answer


def test_a_websocket_needs_the_cookie_though_its_address_has_the_token(served):
    """What scripts can be given is not enough: an address may leak."""
    request = f"GET {SOCKET}&token={served.token} HTTP/1.1\r\nHost: {served.host}\r\n"
    assert served.said(f"{request}{HANDSHAKE.format('eA==')}\r\n".encode()).startswith(b"HTTP/1.1 403")


def test_two_hosts_or_origins_are_none(served):
    good = f"Host: {served.host}\r\nCookie: {served.cookie}\r\nOrigin: http://{served.host}\r\n"
    assert served.said(f"GET / HTTP/1.1\r\n{good}\r\n".encode()).startswith(b"HTTP/1.1 200")
    for second in (f"Origin: http://{served.host}", "Origin: http://evil.example", "Host: evil.example"):
        answer = served.said(f"GET / HTTP/1.1\r\n{good}{second}\r\n\r\n".encode())
        assert answer.startswith((b"HTTP/1.1 403", b"HTTP/1.1 400"))


def test_the_view_tells_what_the_session_tells_and_hears_of_drags(served):
    session = served.pendant.session
    served.do(lambda: session.told(description={"bodies": ["trunk"]}))
    own = {"Origin": f"http://{served.host}"}
    message = json.dumps(["drag", ["/drake/station/robot/humanoid/trunk", [0, 0, 0.1], [1, 2, 3]]])
    assert served.asked("/view/told", method="POST", body=message, **own)[0] == 204
    assert session.calls == [("drag", "trunk", [0.0, 0.0, 0.1], [1.0, 2.0, 3.0])]
    trunk = '["drag", ["/drake/station/robot/humanoid/trunk", '
    wrong = ["", "[", "[" * 500, '["drag", 1]', '["drag", ["/drake/trunk", [0, 0, 0], null]]', "\xff"]
    wrong += ['["drag", ["/drake/station/x/floor", [0, 0, 0], null]]', '["drag", [["a"], "abc", null]]']
    wrong += [f"{trunk}[0, 0], null]]", f"{trunk}[0, 0, NaN], [0, 0, 0]]]", f"{trunk}[0, 0, 0], [1e9, 0, 0]]]"]
    for body in (*wrong, message + " " * 600):
        assert served.asked("/view/told", method="POST", body=body.encode("latin-1"), **own)[0] == 204
    assert len(session.calls) == 1
    foreign = {"Origin": "http://evil.example"}
    assert served.asked("/view/told", method="POST", body=message, **foreign)[0] == 403
    assert len(session.calls) == 1
