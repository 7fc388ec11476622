"""Who is let through to the pendant: its user's browser alone, for the page, the websocket and the view."""

import json
import re
from urllib.parse import urlsplit

import pytest
from nicegui import Client
from serving import serving
from stub_session import StubSession

from simrob_drake.extensions.pendant.pages import shell

PLACES = ["", "view/", "view/events", "_nicegui_ws/socket.io/?EIO=4&transport=polling", "nowhere"]
SOCKET = "_nicegui_ws/socket.io/?EIO=4&transport=websocket"
HANDSHAKE = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {}\r\n"


@pytest.fixture(scope="module")
def served():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shell, "TABS", {"station": lambda *_: None})
        with serving(
            lambda subject, _: StubSession(subject, drawn=[{"type": "delete", "path": "/x"}])
        ) as served:
            yield served


def handshake(served, **headers):
    """Return what a browser gets that opens a websocket."""
    given = {
        "Host": served.host,
        "Origin": f"http://{served.host}",
        "Cookie": served.cookie,
    } | headers
    lines = "".join(f"{name}: {value}\r\n" for name, value in given.items() if value is not None)
    key = HANDSHAKE.format("dGhlIHNhbXBsZSBub25jZQ==")
    return served.said(f"GET {served.path}{SOCKET} HTTP/1.1\r\n{lines}{key}\r\n".encode())


def entered(served, query, **headers):
    return served.asked(f"?{query}", **{"Cookie": ""} | headers)


def test_an_address_of_the_terminal_leaves_a_cookie_and_leads_to_one_without_the_token(served):
    query = urlsplit(served.address()).query
    status, headers, page = entered(served, query)
    assert status == 200
    assert (
        headers["set-cookie"] == f"{served.cookie}; Path={served.path}; HttpOnly; SameSite=Strict"
    )
    assert b'content="0; url=./"' in page
    token = query.partition("=")[2]
    assert token not in f"{headers}{page}"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"
    assert headers["content-security-policy"] == "frame-ancestors 'self'"


def test_an_address_opens_one_browser_and_the_next_one_is_told(served):
    first = urlsplit(served.address()).query
    assert entered(served, first, method="HEAD")[0] == 403  # a glance at it does not use it up
    assert entered(served, first)[0] == 200
    status, headers, why = entered(served, first)  # who has seen it in the list of processes
    assert (status, "set-cookie" in headers) == (403, False)
    assert b"used by another browser" in why
    # another tab of the browser that used it
    assert entered(served, first, Cookie=served.cookie)[0] == 200
    second = urlsplit(served.address()).query
    assert second != first
    assert entered(served, second)[0] == 200


def test_the_cookie_is_no_token_and_goes_to_no_other_server(served):
    token = urlsplit(served.address())
    name, _, key = served.cookie.partition("=")
    assert key not in token.query
    assert entered(served, f"token={key}")[0] == 403
    assert served.asked(Cookie=f"{name}={token.query.partition('=')[2]}")[0] == 403
    assert len(token.path) > 20  # its path, under which no other server is
    assert entered(served, token.query)[0] == 200


def test_the_page_is_under_its_path_alone(served):
    own = {"Cookie": served.cookie}
    for path in (
        "/",
        "/view/",
        "/?token=x",
        "/_nicegui_ws/",
        f"/x{served.path}",
        served.path[:-1],
        served.path.upper(),
    ):
        status, _, why = served.asked(path, **own)
        assert status == 403
        assert served.path not in why.decode()
    query = urlsplit(served.address()).query
    # somewhere else the token does nothing, and stays good
    assert served.asked(f"/?{query}")[0] == 403
    assert entered(served, query)[0] == 200


def test_the_page_tells_neither_token_nor_key(served):
    name, _, key = served.cookie.partition("=")
    answers = [
        served.asked(path)
        for path in ("", "view/", "nowhere", "_nicegui/nowhere", "%00", "view/told")
    ]
    for status, headers, page in answers:
        assert status in (200, 404, 405)
        for secret in (served.query.partition("=")[2], key, name):
            assert secret not in f"{headers}{page}"


def test_the_cookie_opens_all_from_then_on(served):
    for path in PLACES[:-1]:
        status, headers, _ = served.asked(path, read="events" not in path)
        assert status == 200
        assert "set-cookie" not in headers
    assert handshake(served).startswith(b"HTTP/1.1 101")
    others = f"theme=dark; bad cookie;; simrob_1=x; {served.cookie}; last={'=' * 9}"
    # what other servers of this computer leave is sent, too
    assert served.asked(Cookie=others)[0] == 200


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
        {"Cookie": "simrob_1={key}"},  # of a pendant at another port
        {"Cookie": "simrob_{port}={token}"},
    ],
    ids=str,
)
def test_others_are_refused(served, path, headers):
    secrets = {"key": served.cookie.partition("=")[2], "token": served.query.partition("=")[2]}
    given = {name: value.format(port=served.port, **secrets) for name, value in headers.items()}
    status, told, why = served.asked(path, **given)
    assert status == 403
    assert told["content-type"] == "text/plain; charset=utf-8"
    assert "set-cookie" not in told
    expected = {
        "Host": "is at http://127.0.0.1:",
        "Origin": "Another page",
        "Cookie": "the newest address",
    }
    assert expected[next(iter(headers))] in why.decode()
    assert all(secret not in why.decode() for secret in (*secrets.values(), served.path))


def test_a_wrong_token_in_the_address_is_refused(served):
    good = urlsplit(served.address()).query.partition("=")[2]
    for token in ("", "x", good[:-1], good + "x", "%FF", "%C3%A9", "%00", good.swapcase()):
        assert entered(served, f"token={token}")[0] == 403
    assert entered(served, f"other={good}")[0] == 403
    assert entered(served, f"token=x&token={good}")[0] == 403
    for headers in ({"Host": "evil.example"}, {"Origin": "null"}, {"Origin": "http://127.0.0.1:1"}):
        assert entered(served, f"token={good}", **headers)[0] == 403
    assert entered(served, f"token={good}")[0] == 200  # none of that has used it up


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
    assert (
        b"This page is at" in answer or b"Another page" in answer or b"the newest address" in answer
    )


def test_a_websocket_needs_the_cookie_though_its_address_has_the_token(served):
    """What scripts can be given is not enough: an address may leak."""
    query = urlsplit(served.address()).query
    request = f"GET {served.path}{SOCKET}&{query} HTTP/1.1\r\nHost: {served.host}\r\n"
    assert served.said(f"{request}{HANDSHAKE.format('eA==')}\r\n".encode()).startswith(
        b"HTTP/1.1 403"
    )
    assert entered(served, query)[0] == 200


def test_two_hosts_or_origins_are_none(served):
    good = f"Host: {served.host}\r\nCookie: {served.cookie}\r\nOrigin: http://{served.host}\r\n"
    assert served.said(f"GET {served.path} HTTP/1.1\r\n{good}\r\n".encode()).startswith(
        b"HTTP/1.1 200"
    )
    for second in (
        f"Origin: http://{served.host}",
        "Origin: http://evil.example",
        "Host: evil.example",
    ):
        answer = served.said(f"GET {served.path} HTTP/1.1\r\n{good}{second}\r\n\r\n".encode())
        assert answer.startswith((b"HTTP/1.1 403", b"HTTP/1.1 400"))


def test_the_view_tells_what_the_session_tells_and_hears_of_drags(served):
    session = served.pendant.session
    served.do(lambda: session.told(description={"bodies": ["trunk"]}))
    own = {"Origin": f"http://{served.host}"}
    message = json.dumps(["drag", ["/drake/station/robot/humanoid/trunk", [0, 0, 0.1], [1, 2, 3]]])
    assert served.asked("view/told", method="POST", body=message, **own)[0] == 204
    assert session.calls == [("drag", "trunk", [0.0, 0.0, 0.1], [1.0, 2.0, 3.0])]
    trunk = '["drag", ["/drake/station/robot/humanoid/trunk", '
    wrong = [
        "",
        "[",
        "[" * 500,
        '["drag", 1]',
        '["drag", ["/drake/trunk", [0, 0, 0], null]]',
        "\xff",
    ]
    wrong += [
        '["drag", ["/drake/station/x/floor", [0, 0, 0], null]]',
        '["drag", [["a"], "abc", null]]',
    ]
    wrong += [
        f"{trunk}[0, 0], null]]",
        f"{trunk}[0, 0, NaN], [0, 0, 0]]]",
        f"{trunk}[0, 0, 0], [1e9, 0, 0]]]",
    ]
    for body in (*wrong, message + " " * 600):
        assert (
            served.asked("view/told", method="POST", body=body.encode("latin-1"), **own)[0] == 204
        )
    assert len(session.calls) == 1
    foreign = {"Origin": "http://evil.example"}
    assert served.asked("view/told", method="POST", body=message, **foreign)[0] == 403
    assert len(session.calls) == 1
    put = ["put", ["tool:", [0.1, 0, 0.2, 0, 90, 0], False, True]]
    good = [put, ["turn", ["joint_1", 12.5]]]
    wrong = [
        ["put", ["tool:", [0.1, 0], False, True]],
        ["put", ["tool:", [1e9] * 6, False, True]],
        ["put", "tool:"],
    ]
    wrong += [["turn", ["joint_1", "x"]], ["turn", ["joint_1", None]], ["turn", [1]]]
    for words in (*good, *wrong):
        assert served.asked("view/told", method="POST", body=json.dumps(words), **own)[0] == 204
    assert session.hand.calls == [
        ("put", "tool:", [0.1, 0.0, 0.2, 0.0, 90.0, 0.0], {"turned": False, "over": True}),
        ("turn", "joint_1", 12.5),
    ]


def test_a_tab_that_is_closed_takes_no_picture_from_the_others(served):
    served.asked()
    pictures = re.findall(rb"pictures/\w+", served.asked()[2])
    assert pictures
    served.do(next(iter(Client.instances.values())).delete)
    for picture in map(bytes.decode, pictures):
        status, headers, _ = served.asked(picture.lstrip("/"))
        assert (status, headers["content-type"]) == (200, "image/png")
