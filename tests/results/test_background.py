"""Work in the background: done once, wherever; its errors are told, and it ends with what it runs beside."""

import subprocess
import sys

import pytest

from simrob_drake.results import files

_SETUP = """
import os, sys, time
from pathlib import Path
from simrob_drake.results import files
files._can_copy_process = lambda: True
here = os.getpid()
"""


def script(text, folder):
    command = [sys.executable, "-c", _SETUP + text]  # a process without threads
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=60, check=False
    )
    return done.stdout.strip() or done.stderr.strip().splitlines()[-1]


@pytest.mark.skipif(sys.platform != "linux", reason="copies are made on Linux alone")
class TestInACopy:
    @pytest.mark.long
    def test_work_is_done_by_another_process_while_this_one_goes_on(self, tmp_path):
        told = script(
            """
def work():
    while not Path("begun").exists():  # for ever, if the body came after
        time.sleep(0.01)
    Path("done").write_text(str(os.getpid()))
with files.in_background(work):
    Path("begun").touch()
print(int(Path("done").read_text()) != here)
""",
            tmp_path,
        )
        assert told == "True"

    @pytest.mark.long
    def test_work_that_fails_is_done_again_here_where_its_error_is_told(self, tmp_path):
        told = script("with files.in_background(lambda: 1 / 0): pass", tmp_path)
        assert told == "ZeroDivisionError: division by zero"

    @pytest.mark.long
    def test_a_body_that_fails_breaks_the_work_off(self, tmp_path):
        told = script(
            """
try:
    with files.in_background(lambda: time.sleep(30)):
        raise KeyError
except KeyError:
    try:
        os.waitpid(-1, os.WNOHANG)
    except ChildProcessError:
        print("nobody is left")
""",
            tmp_path,
        )
        assert told == "nobody is left"


def test_work_is_done_after_the_body_where_no_copy_can_be_made(monkeypatch):
    monkeypatch.setattr(files, "_can_copy_process", lambda: False)
    order = []

    with files.in_background(lambda: order.append("work")):
        order.append("body")

    assert order == ["body", "work"]
