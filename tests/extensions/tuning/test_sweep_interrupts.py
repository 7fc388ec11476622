"""Ctrl-C while many runs are made on several processes."""

import os
import signal
import time

import psutil
import pytest

from simrob_drake.cli import ExitCode
from tests.test_cli_interrupts import start


@pytest.mark.long
def test_many_runs_end_at_once_with_one_line(tmp_path):
    """Ctrl-C of a terminal goes to the processes of the runs, too."""
    sweep = [
        "sweep",
        "double_pendulum",
        "--vary",
        "duration=900,901,902",
        "--workers",
        "2",
        "--out",
        "x",
    ]
    with start(tmp_path, sweep, start_new_session=True) as command:
        while (
            sum(child.cpu_times().user > 1.0 for child in psutil.Process(command.pid).children())
            < 2
        ):
            time.sleep(0.05)  # until both processes have loaded Drake
        os.killpg(command.pid, signal.SIGINT)
        _, err = command.communicate(timeout=30)
    assert command.returncode == ExitCode.INTERRUPTED
    assert err.splitlines()[-1] == "simrob: interrupted"
    assert "Traceback" not in err
