"""The scripts of examples/drake: short, typed, and each does in Drake's own diagrams what it says."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SCRIPTS = sorted((ROOT / "examples" / "drake").glob("*.py"))
SLOW = {"many_runs", "together"}
LONGEST = 25  # lines


def run(script, folder):
    """Run a script in a folder, in a process of its own. Returns what it prints."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, str(script)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def output_of(name, folder):
    return run(ROOT / "examples" / "drake" / f"{name}.py", folder)


def test_there_are_six():
    assert len(SCRIPTS) == 6


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_is_short(script):
    assert len(script.read_text(encoding="utf-8").splitlines()) <= LONGEST


def test_the_feedforward_holds_the_arm(tmp_path):
    (error,) = re.findall(r"off by (\S+) rad", output_of("feedforward", tmp_path))
    assert float(error) < 1e-5  # without it joint 2 sags by 0.02 rad


def test_the_servos_of_the_own_plant_hold_it(tmp_path):
    joints = [
        float(angle) for angle in re.findall(r"\d\.\d*", output_of("servo_and_motor", tmp_path))
    ]
    assert len(joints) == 7
    assert joints == pytest.approx([0.5] * 7, abs=0.03)  # torque of gravity over kp


def test_the_monitor_ends_the_run(tmp_path):
    assert output_of("monitor", tmp_path).startswith(
        "kReachedTerminationCondition at 0.66 s: the pendulum is at 1.22"
    )


def test_meshcat_and_a_log(tmp_path):
    (torque,) = re.findall(
        r"at most (\S+) N·m; watch it at http://localhost", output_of("meshcat_and_log", tmp_path)
    )
    assert 0 < float(torque) <= 150.0


@pytest.mark.long
def test_stations_together(tmp_path):
    ends = dict(re.findall(r"(\w+) ends at (\S+) rad", output_of("together", tmp_path)))

    assert float(ends["turning"]) < 1.45 < float(ends["alone"])
    assert abs(float(ends["hit"])) > 0.01
    assert abs(float(ends["beside"])) < 0.01


@pytest.mark.long
def test_many_runs(tmp_path):
    printed = output_of("many_runs", tmp_path)
    forward, backward = (float(moved) for moved in re.findall(r"move it by (\S+) m", printed))

    assert forward > 0 > backward
    assert "200 runs" in printed


@pytest.mark.long
def test_type_checkers_accept_the_scripts():
    """The settings of the project are those of ``--strict``."""
    command = [sys.executable, "-m", "mypy", *map(str, SCRIPTS)]
    checked = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stdout
