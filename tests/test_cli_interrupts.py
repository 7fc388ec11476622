"""Ctrl-C, wherever it comes: the user is told in a line what became of the work, and nothing is left half done."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
import trimesh

from simrob_drake import load_station, simulate
from simrob_drake.base.interrupts import heard_afterwards
from simrob_drake.cli import ExitCode
from simrob_drake.results.record.signals import Sampler

RUN = ["run", "double_pendulum", "--out", "x"]
FILES = {"summary.json", "signals.csv", "station.yaml", "plots", "recording.html", "film_strip.png"}
WHILE_LOADING = """
import os, signal, sys

class Press:
    def find_spec(self, name, *_):
        if name == MODULE:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Press())
sys.argv = ["simrob", *ARGUMENTS]
from simrob_drake.cli.__main__ import main
main()
"""


def start(folder: Path, arguments: list[str], **options: bool) -> subprocess.Popen[str]:
    command = [sys.executable, "-u", "-m", "simrob_drake.cli", *arguments]
    return subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options
    )


def interrupted_while_loading(
    module: str, *arguments: str, first: str = ""
) -> subprocess.CompletedProcess[str]:
    """Run a command that is interrupted when it loads a module."""
    code = f"MODULE, ARGUMENTS = {module!r}, {arguments!r}; {first}{WHILE_LOADING}"
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60
    )


def wait_for_writing(folder: Path, command: subprocess.Popen[str]) -> None:
    """Wait until files lie in the folder that will take the result's name."""
    while command.poll() is None and not list(folder.glob(".x-*/**/signals.csv")):
        time.sleep(0.01)
    assert command.poll() is None


def test_while_the_program_loads_it_leaves_at_once():
    done = interrupted_while_loading("pydrake.systems.framework", "diagram", "irb120_kinematic")
    assert (done.returncode, done.stdout, done.stderr) == (
        ExitCode.INTERRUPTED,
        "",
        "simrob: interrupted\n",
    )


@pytest.mark.long
def test_a_caller_that_ignores_interrupts_is_heard():
    ignored = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
    done = interrupted_while_loading(
        "pydrake.systems.framework", "diagram", "irb120_kinematic", first=ignored
    )

    assert done.returncode == 0
    assert "digraph" in done.stdout


@pytest.mark.long
def test_a_library_that_loads_on_after_any_exception_does_not_keep_it(tmp_path, one_joint_urdf):
    """The library of meshes takes an interrupt for a missing Pillow: `simrob check` went on as if nothing were."""
    link = (
        '<link name="tip"><visual><geometry><mesh filename="tip.stl"/></geometry></visual></link>'
    )
    (tmp_path / "arm.urdf").write_text(one_joint_urdf.replace('<link name="tip"/>', link))
    (tmp_path / "tip.stl").write_bytes(
        trimesh.creation.box((0.1, 0.1, 0.1)).export(file_type="stl")
    )

    done = interrupted_while_loading("PIL", "check", str(tmp_path / "arm.urdf"))

    assert (done.returncode, done.stdout) == (ExitCode.INTERRUPTED, "")
    assert done.stderr.endswith("simrob: interrupted\n")


def test_a_library_that_swallows_any_exception_does_not_keep_it():
    @heard_afterwards()
    def swallow():
        with suppress(BaseException):
            os.kill(os.getpid(), signal.SIGINT)
            done.append(sum(range(1000)))  # where an interrupt would come

    done, before = [], signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        swallow()
    assert done
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.long
def test_while_a_run_is_stepped_its_part_is_saved(tmp_path):
    at_the_clocks_pace = [
        "run",
        "double_pendulum",
        "--duration",
        "900",
        "--live",
        "--out",
        "x",
        "--no-recording",
    ]
    with start(tmp_path, at_the_clocks_pace) as command:
        assert "watch the motion at" in command.stdout.readline()
        time.sleep(1)
        command.send_signal(signal.SIGINT)
        out, err = command.communicate(timeout=60)

    assert command.returncode == ExitCode.INTERRUPTED
    assert "double_pendulum: interrupted at" in out
    assert "Traceback" not in err
    summary = json.loads((tmp_path / "x" / "summary.json").read_text())
    assert summary["stopped_by"] == "interrupted"
    assert 0 < summary["stop_time"] < 60


@pytest.mark.long
def test_while_files_are_written_they_are_finished(tmp_path):
    with start(tmp_path, RUN) as command:
        wait_for_writing(tmp_path, command)
        command.send_signal(signal.SIGINT)
        out, err = command.communicate(timeout=60)

    assert command.returncode == ExitCode.INTERRUPTED
    assert (
        err
        == "simrob: interrupted; the files of x are being finished, interrupt again to abandon them\n"
    )
    assert "ran to its end" in out
    assert {file.name for file in (tmp_path / "x").iterdir()} == FILES
    assert [file.name for file in tmp_path.iterdir()] == ["x"]


@pytest.mark.long
def test_who_insists_gets_away_and_leaves_nothing(tmp_path):
    with start(tmp_path, RUN) as command:
        wait_for_writing(tmp_path, command)
        command.send_signal(signal.SIGINT)
        first = command.stderr.readline()
        command.send_signal(signal.SIGINT)
        out, err = command.communicate(timeout=60)

    assert command.returncode == ExitCode.INTERRUPTED
    assert "interrupt again" in first
    assert (out, err) == (
        "",
        "simrob: interrupted; the files of x are abandoned, nothing was saved\n",
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", ["completed", "monitor"])
def test_after_the_last_step_the_run_is_kept(monkeypatch, ending):
    """An interrupt while the signals are computed: they are computed all the same."""
    plain, presses = Sampler.sample, iter([True])

    def pressed_once(*given):
        if next(presses, False):
            os.kill(os.getpid(), signal.SIGINT)
        return plain(*given)

    monitors = {"monitors.joint_limit.margin_deg": 60} if ending == "monitor" else {}
    config = load_station("irb120_dynamic", monitors)
    expected = simulate(config, duration=0.6)
    assert expected.ending == ending
    monkeypatch.setattr(Sampler, "sample", pressed_once)
    result = simulate(config, duration=0.6)
    assert result.ending == "interrupted"
    assert result.stop_time >= expected.stop_time
    assert result["q.joint_2"][0] == expected["q.joint_2"][0]
