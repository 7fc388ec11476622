"""``simrob teach`` as a process: what listens, which port it takes, how it ends, and what it says of bad input."""

import contextlib
import http.client
import os
import re
import signal
import socket
import stat
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from simrob_drake.cli.app import run_command

pytest.importorskip("nicegui", reason="needs the extra gui")
from simrob_drake.base.errors import OutputError
from simrob_drake.extensions.pendant.server import PORT, bound, leading_to

PROC = Path("/proc")
LISTENS = "0A"  # state of a socket in /proc/net/tcp
LOOPBACK = re.compile(r"[0-9A-F]{6}7F")  # 127.x.x.x, the last byte first


def started(folder, browser, *options, subject="irb120"):
    command = [sys.executable, "-m", "simrob_drake.cli", "teach", subject, "--folder", str(folder)]
    own = {
        **os.environ,
        "PYTHONPATH": str(Path(__file__).parents[3]),
        "COLUMNS": "200",
        "BROWSER": f"{browser} %s",
    }
    return subprocess.Popen(
        [*command, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=own
    )


def browser_in(folder):
    """Return a browser that is called, notes what with, and does nothing else; and its notes."""
    browser, notes = folder / "browser", folder / "called"
    browser.write_text(f'#!/bin/sh\necho "$@" >> {notes}\n')
    browser.chmod(0o700)
    return browser, notes


def told_url(process):
    found = re.search(r"http://\S+", process.stdout.readline())
    assert found, process.stderr.read()
    return found[0]


def ended(process, how=signal.SIGINT):
    """End a process, and return its code and what else it said."""
    process.send_signal(how)
    try:
        out, wrong = process.communicate(timeout=30)
    finally:
        process.kill()
    return process.returncode, out, wrong


def family(pid):
    """Return a process and all that it has started."""
    children = [
        int(child)
        for task in (PROC / str(pid) / "task").iterdir()
        for child in _read(task / "children").split()
    ]
    return {pid}.union(*map(family, children))


def listening(pids):
    """Return where processes listen, as ``ss -ltn`` does: addresses and ports in hexadecimal figures."""
    sockets = set()
    for pid in pids:
        with contextlib.suppress(OSError):  # it has ended, or has just closed one
            sockets |= {os.readlink(handle) for handle in (PROC / str(pid) / "fd").iterdir()}
    rows = [
        row.split()
        for table in ("tcp", "tcp6")
        for row in _read(PROC / "net" / table).splitlines()[1:]
    ]
    return {
        tuple(row[1].split(":"))
        for row in rows
        if row[3] == LISTENS and f"socket:[{row[9]}]" in sockets
    }


def _read(file):
    try:
        return file.read_text()
    except OSError:  # it has ended
        return ""


@pytest.mark.long
@pytest.mark.skipif(not PROC.is_dir(), reason="looks at sockets and processes as Linux shows them")
def test_it_listens_on_loopback_alone_and_others_see_no_way_in(tmp_path):
    browser, called = browser_in(tmp_path)
    folder = tmp_path / "taught"
    process = started(folder, browser)
    address = told_url(process)
    port = int(re.search(r":(\d+)/", address)[1])
    seen, pids, commands, end = set(), set(), set(), time.monotonic() + 2.5
    while time.monotonic() < end or not called.is_file():  # the view is drawn meanwhile
        now = family(process.pid)
        seen, pids = seen | listening(now), pids | now
        commands |= {_read(PROC / str(pid) / "cmdline") for pid in now}
        time.sleep(0.01)
    assert len(pids) > 1  # the run has a process of its own
    assert all(LOOPBACK.fullmatch(address) for address, _ in seen), seen
    assert ("0100007F", f"{port:04X}") in seen
    # Meshcat listens on a hidden loopback address until the view is drawn; the page's own port alone stays.
    end = time.monotonic() + 60.0
    while (kept := listening(family(process.pid))) != {("0100007F", f"{port:04X}")}:
        assert time.monotonic() < end, kept
        time.sleep(0.05)
    assert not any("token" in command or f":{port}" in command for command in commands)
    check_opened(called.read_text(), folder, address)
    code, out, wrong = ended(process)
    assert (code, wrong) == (0, "")
    assert out.splitlines()[-1] == f"ended; what was taught is in {folder}"
    assert out.count("token=") == 0  # the address that was told first was not used yet
    end = time.monotonic() + 5.0
    while left := {pid for pid in pids if "simrob" in _read(PROC / str(pid) / "cmdline")}:
        assert time.monotonic() < end, left
        time.sleep(0.05)


def check_opened(called, folder, address):
    """The browser was called with a file that others cannot read and that leads on, and which is gone then."""
    assert re.fullmatch(rf"{folder.as_uri()}/open-\w+\.html\n", called)
    file = Path(unquote(urlsplit(called.strip()).path))
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    leads = re.search(r'url=([^"]+)', file.read_text())[1]
    assert leads.startswith(address.partition("?")[0])
    assert leads != address
    for status in (200, 403):
        with closing(
            http.client.HTTPConnection("127.0.0.1", urlsplit(leads).port, timeout=10)
        ) as line:
            line.request("GET", leads.partition(f":{urlsplit(leads).port}")[2])
            assert line.getresponse().status == status
    assert not file.exists()


def test_a_browser_that_does_not_come_leaves_nothing_behind(tmp_path):
    with leading_to('http://127.0.0.1:1/"x/?token=y', tmp_path) as uri:
        (file,) = tmp_path.iterdir()
        assert uri == file.as_uri()
        assert '0; url=http://127.0.0.1:1/&quot;x/?token=y"' in file.read_text()
    assert not list(tmp_path.iterdir())
    with (
        pytest.raises(OutputError, match="cannot be written"),
        leading_to("http://x", tmp_path / "gone"),
    ):
        pass


def test_the_terminal_shows_the_language_of_the_page(tmp_path):
    """The address is written from another thread, once the page can be opened."""
    browser, _ = browser_in(tmp_path)
    process = started(tmp_path / "taught", browser, "--no-browser", "--language", "es")
    lines = [process.stdout.readline(), process.stdout.readline()]
    _, out, _ = ended(process)
    assert lines[0].startswith("irb120 se enseña en http://")
    assert lines[1].startswith("lo enseñado se guarda en")
    assert out.startswith("terminado;")


def test_the_first_free_port_is_taken_and_one_asked_for_or_none():
    with bound(None) as first, bound(None) as second:
        assert PORT <= first.getsockname()[1] < second.getsockname()[1]
        assert first.getsockname()[0] == second.getsockname()[0] == "127.0.0.1"
        first.listen()
        with pytest.raises(
            OutputError,
            match=f"port {first.getsockname()[1]} is taken; choose another one with --port",
        ):
            bound(first.getsockname()[1])


def test_a_taken_port_or_a_bad_subject_or_language_is_one_line(tmp_path, capsys):
    with socket.create_server(("127.0.0.1", 0)) as other:
        taken = str(other.getsockname()[1])
        for options, told in [
            (["irb120", "--port", taken], f"port {taken} is taken"),
            (["irb12"], "there is no station or robot 'irb12'; did you mean 'irb120'?"),
            ([str(tmp_path / "gone.urdf")], "there is no such file"),
            (["irb120", "--language", "fr"], "'fr'"),
            (["irb120", "--port", "70000"], "65535"),
        ]:
            assert (
                run_command(
                    ["teach", *options, "--no-browser", "--folder", str(tmp_path / "taught")]
                )
                == 2
            )
            (line,) = capsys.readouterr().err.splitlines()
            assert told in line


def test_without_the_extra_one_line_names_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "nicegui", None)
    assert run_command(["teach", "irb120"]) == 2
    assert (
        'the teach pendant needs the extra gui: pip install "nicegui>=' in capsys.readouterr().err
    )
