"""The guard of the pages that we serve: who may read them, who may press a button, and what a message can do."""

import http.client
import json
import re
import socket
from contextlib import closing
from itertools import islice
from threading import Thread
from urllib.parse import urlsplit

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.results.animation.live import LiveView
from simrob_drake.results.animation.scene import LINES, ViewedStation, floor_under
from simrob_drake.results.animation.window import Board, Control, Window

HOSTILE = [
    b"",
    b"[",
    b"[" * 500,
    b"null",
    b"{}",
    b'"ab"',
    b"[1, 2]",
    b'["slider"]',
    b'["slider", 1, 2]',
    b'["slider", null]',
    b'["slider", NaN]',
    b'["slider", -Infinity]',
    b'["slider", 1e999]',
    b'["slider", "nan"]',
    b'["slider", [1]]',
    b'["other", 1]',
    b'[["slider"], 1]',
    b'["slider", 1' + b"0" * 490 + b"]",
    b'["slider", 1]' + b" " * 600,
    b"\xff\xfe\x00",
    bytes(range(256)),
]


def asked(url, what="", message=None, **headers):
    """Ask for a part of a page, or tell it a message; return the status and what came with it."""
    place = urlsplit(url)
    with closing(http.client.HTTPConnection(place.hostname, place.port, timeout=5)) as line:
        line.request(
            "GET" if message is None else "POST", place.path + what, body=message, headers=headers
        )
        answer = line.getresponse()
        return answer.status, b"" if what == "events" else answer.read()


def events(url, wanted):
    """Return the commands of the first events, up to one that moves something if poses are wanted."""
    place, told = urlsplit(url), []
    with closing(http.client.HTTPConnection(place.hostname, place.port, timeout=5)) as line:
        line.request("GET", f"{place.path}events")
        for row in line.getresponse():
            if row.startswith(b"data:"):
                told += json.loads(row[5:])
            if wanted == "menu" or any("matrix" in command for command in told):
                return told
    return told


def said(url, raw):
    """Send bytes as they are, and return what is answered."""
    place = urlsplit(url)
    with socket.create_connection((place.hostname, place.port), timeout=5) as line:
        line.sendall(raw)
        line.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: line.recv(65536), b""))


@pytest.fixture
def window():
    window = Window({"slider": Control(0.25, -1.0, 1.0, 0.01), "Stop": Control(key="Escape")})
    yield window
    window.close()


def test_its_user_reads_the_page_moves_the_slider_and_presses_the_button(window):
    status, page = asked(window.url)
    assert (status, page) == (200, window.page)

    own = f"http://{urlsplit(window.url).netloc}"
    assert asked(window.url, "told", b'["slider", 0.5]', Origin=own)[0] == 204
    assert asked(window.url, "told", b'["Stop", 1]', Origin=own)[0] == 204
    assert [control.value for control in window.controls.values()] == [0.5, 1.0]

    asked(window.url, "told", b'["slider", 7]')
    assert window.controls["slider"].value == 1.0  # as far as it goes

    slider, button = events(window.url, "menu")
    assert (slider["name"], slider["value"], slider["min"]) == ("slider", 1.0, -1.0)
    assert (button["name"], button["keycode1"]) == ("Stop", "Escape")


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example:7000"},
        {"Host": ""},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:1"},  # another server of this computer
        {"Origin": "http://localhost"},
    ],
    ids=str,
)
def test_others_are_refused(window, headers):
    for what in ("", "events"):
        assert asked(window.url, what, **headers) == (403, b"")
    assert asked(window.url, "told", b'["Stop", 1]', **headers)[0] == 403
    assert window.controls["Stop"].value == 0


def test_who_comes_again_is_told_what_is_new():
    board = Board()
    board.tell("scene", [{"type": "a"}])
    board.tell("poses", [{"type": "b"}])
    seen = list(islice(board.events(), 2))[1].decode()
    number = int(re.match(r"id: (\d+)\n", seen)[1])
    board.tell("poses", [{"type": "c"}])

    again = list(islice(board.events(number), 2))[1].decode()

    assert [json.loads(one.partition("data: ")[2]) for one in (seen, again)] == [
        [{"type": "a"}, {"type": "b"}],
        [{"type": "c"}],
    ]


def test_the_last_word_is_told_though_the_board_is_closed_at_once():
    board = Board()
    board.tell("said", ["it fell"])

    board.close()

    assert [one.partition(b"data:")[2].strip() for one in board.events()] == [
        b"[]",
        b'["it fell"]',
        b"",
    ]


@pytest.mark.parametrize("incline", [0.0, 10.0])
def test_the_floor_is_below_a_robot_wherever_it_goes(incline):
    scene = ViewedStation(load_station("zjudancer_walking", {"floor.incline_deg": incline}))
    tilt = scene.station.ground.floor_pose

    under = {
        one["path"]: one["matrix"]
        for one in floor_under(scene, tilt @ np.array([31.26, -7.1, 0.3]))
    }

    for path, depth in (
        (LINES, 0.0),
        ("/drake/station/floor", -0.01),
    ):  # where that is drawn which is at the origin
        place = np.reshape(under[path], (4, 4)).T[:3, 3]
        np.testing.assert_allclose(tilt.inverse() @ place, [31.5, -7.0, depth], atol=1e-6)


def test_its_address_cannot_be_guessed(window):
    root = f"http://{urlsplit(window.url).netloc}"

    for path in ("/", "/events", "/told", window.path[:-2] + "/", window.path + "../etc/passwd"):
        assert asked(root, path) == (404, b"")
    assert asked(root, "/told", b'["Stop", 1]')[0] == 404

    other = Window()
    other.close()

    assert other.path != window.path
    assert window.controls["Stop"].value == 0


def test_no_websocket_is_opened(window):
    """Browsers let any page open one; the handshake is answered as any other question, by no more than a page."""
    key = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: eA==\r\n"
    host = f"Host: {urlsplit(window.url).netloc}\r\n"

    foreign = said(
        window.url, f"GET / HTTP/1.1\r\n{host}Origin: http://evil.example\r\n{key}\r\n".encode()
    )

    assert foreign.startswith(b"HTTP/1.0 403")
    assert said(window.url, f"GET / HTTP/1.1\r\n{host}{key}\r\n".encode()).startswith(
        b"HTTP/1.0 404"
    )


@pytest.mark.parametrize("message", HOSTILE, ids=lambda message: repr(message[:20]))
def test_what_is_no_name_and_number_changes_nothing(window, message):
    assert asked(window.url, "told", message)[0] == 204
    assert [control.value for control in window.controls.values()] == [0.25, 0.0]
    assert asked(window.url)[0] == 200


def told(board, known):
    """Return what a page is told that knows something."""
    return json.loads(board.news(known).decode().partition("data: ")[2])


def test_a_subject_told_again_takes_the_place_of_what_was_told(window):
    window.tell("scene", ["first"])
    window.tell("poses", ["second"])

    known = {}

    assert told(window, known) == ["first", "second"]

    window.tell("poses", ["third"])
    assert told(window, known) == ["third"]
    assert told(window, {}) == ["first", "third"]  # a page that comes late


def test_a_wiped_window_knows_only_what_is_told_from_then_on(window):
    known = {}
    window.tell("scene", ["first"])
    window.tell("ghosts", ["second"])
    window.news(known)
    window.wipe()

    window.tell("scene", ["third"])

    assert told(window, known) == ["third"]  # and it was never told before, however often it was
    assert told(window, {}) == ["third"]


def test_no_message_ends_a_run_that_is_watched(capfd):
    config = load_station("irb120_dynamic", {"duration": 0.5})
    alone = simulate(config, progress=False)
    view = LiveView(config)
    place = urlsplit(view.url)
    good = f"Host: {place.netloc}\r\n"
    raw = [
        b"\x00\xff" * 500,
        b"\r\n\r\n",
        b"GET",
        b"BREW / HTTP/1.1\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"A" * 70000,
    ]
    raw += [
        f"POST {place.path}told HTTP/1.1\r\n{good}Content-Length: {n}\r\n\r\nx".encode()
        for n in (-1, 9**99, "x")
    ]

    def disturb():
        for message in raw:
            try:
                said(view.url, message)
            except OSError:  # the line is cut
                continue
        for message in HOSTILE:
            asked(view.url, "told", message)

    disturbing = Thread(target=disturb)
    disturbing.start()
    watched = simulate(config, progress=False, on_step=view.on_step)
    disturbing.join(timeout=30)
    assert not disturbing.is_alive()
    assert asked(view.url)[0] == 200
    view.close()
    np.testing.assert_array_equal(watched.values, alone.values)
    assert capfd.readouterr() == ("", "")
