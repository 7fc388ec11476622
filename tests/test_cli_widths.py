"""Outputs of the command line fit a screen of 80 columns."""

import json

import pytest

from simrob_drake.base.files import models_root
from simrob_drake.cli.app import run_command
from tests.widths import too_wide

pytestmark = pytest.mark.usefixtures("no_plots")

SLEWED = ["--set", "servo.kp=150", "--set", "duration=0.5"]
"""An arm that sags and goes through the floor: a table, warnings and remedies."""

COMMANDS = {
    "list": ["list"],
    "run": ["run", "irb120_dynamic", "--duration", "0.2", "--no-recording", "--verdict"],
    "a run with warnings": ["run", "irb120_dynamic", "--no-recording", *SLEWED],
    "a run that diverges": [
        *["run", "irb120_dynamic", "--no-recording", "--set", "servo.torque_limit=1e12"],
        *["--set", "solver.scheme=explicit_euler", "--set", "solver.max_step=0.01"],
    ],
    "a run of two arms": ["run", "two_irb120", "--duration", "0.1", "--no-recording"],
    "--converge": ["run", "double_pendulum", "--duration", "0.1", "--no-recording", "--converge"],
    "check of a station": ["check", "irb120_dynamic"],
    "check of a station with warnings": [
        "check",
        "irb120_dynamic",
        "--set",
        "servo.torque_limit=10",
    ],
    "check of a robot": ["check", "puma560"],
    "check of a file": ["check", str(models_root() / "irb120" / "irb120.urdf")],
    "import": ["import", str(models_root() / "irb120" / "irb120.urdf"), "--out", "made"],
    "station": ["station", str(models_root() / "irb120" / "irb120.urdf")],
    "acts": ["act", "roid1_dynamic"],
    "extensions": ["extensions"],
    "help": ["run", "--help"],
}


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_an_output_fits_80_columns(command, capsys):
    run_command(command)

    captured = capsys.readouterr()
    assert captured.out
    assert too_wide(captured.out + captured.err) == []


@pytest.mark.long
@pytest.mark.parametrize(
    "command",
    [
        ["walk", "roid1_dynamic", "--steps", "1", "--no-recording"],
        ["act", "humanoid_fixed", "wave", "--no-recording"],
    ],
)
def test_an_output_of_a_legged_robot_fits_80_columns(command, capsys):
    assert run_command(command) == 0
    captured = capsys.readouterr()
    assert too_wide(captured.out + captured.err) == []


@pytest.mark.long
def test_an_output_of_a_sweep_fits_80_columns(capsys):
    assert (
        run_command(["sweep", "double_pendulum", "--vary", "servo.kp=5,10", "--out", "swept"]) == 0
    )
    captured = capsys.readouterr()
    assert too_wide(captured.out + captured.err) == []


def test_a_path_is_never_broken(tmp_path, capsys):
    folder = tmp_path / ("a_long_name_of_a_folder_" * 4)
    assert (
        run_command(
            ["run", "double_pendulum", "--duration", "0.1", "--no-recording", "--out", str(folder)]
        )
        == 0
    )
    assert str(folder) in capsys.readouterr().out.splitlines()


def test_acts_are_listed_and_chained(capsys):
    assert run_command(["act", "roid1_dynamic"]) == 0
    out = capsys.readouterr().out
    assert "acts of roid1: bow, wave, kick" in out
    assert "next      simrob act roid1_dynamic bow" in out
    assert run_command(["act", "humanoid_fixed", "wave", "--no-recording"]) == 0
    assert "program.yaml (moves: [{act: wave}, ...])" in " ".join(capsys.readouterr().out.split())
    assert run_command(["act", "irb120_dynamic"]) != 0


def test_capitals_of_a_key_do_not_hide_the_nearest_one(capsys):
    """``servo.Kp`` was answered with all keys of a servo."""
    assert run_command(["run", "irb120_dynamic", "--set", "servo.Kp=3"]) != 0
    assert capsys.readouterr().err == "simrob: --set servo.Kp: unknown key; did you mean 'kp'?\n"


def test_two_results_are_drawn_over_each_other(tmp_path, capsys):
    for name, gain in (("soft", 300), ("stiff", 1000)):
        settings = ["--set", f"servo.kp={gain}", "--duration", "0.2", "--no-recording"]
        assert run_command(["run", "irb120_dynamic", *settings, "--out", name]) == 0
    servo = json.loads((tmp_path / "soft" / "summary.json").read_text())["servos"]["robot"]
    assert servo["kp"] == {f"joint_{number}": 300.0 for number in range(1, 7)}
    assert run_command(["plot", "soft", "stiff", "--signal", "q.joint_2", "--out", "both.svg"]) == 0
    picture = (tmp_path / "both.svg").read_text()
    for text in ("soft: servo.kp 300", "stiff: servo.kp 1000", "q.joint_2", "position [deg]"):
        assert text in picture

    capsys.readouterr()
    assert run_command(["plot", "soft", "--signal", "q.jont_2", "--out", "new.png"]) != 0
    assert "did you mean 'q.joint_2'" in capsys.readouterr().err
    assert run_command(["plot", "soft", "nowhere", "--out", "new.png"]) != 0
    assert (
        "nowhere: must be the folder of a result, which contains signals.csv"
        in capsys.readouterr().err
    )
    assert not (tmp_path / "new.png").exists()
    for _ in range(2):
        assert run_command(["plot", "soft", "--signal", "q.joint_2"]) == 0
    assert (tmp_path / "plot.png").is_file()
    assert (tmp_path / "plot-2.png").is_file()


def test_a_table_that_is_a_little_too_wide_breaks_no_name(capsys):
    """The table of the humanoid's joints fits with one space between its columns."""
    assert run_command(["run", "humanoid_dynamic", "--duration", "0.02", "--no-recording"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("right_shoulder_pitch ") for line in lines)
    assert max(map(len, lines)) <= 80
