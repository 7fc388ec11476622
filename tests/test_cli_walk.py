"""Legged robots from the command line: walk, act."""

import json
import re

import numpy as np
import pytest

from simrob_drake import LeggedRobot, Workcell
from simrob_drake.base.errors import SimrobError
from simrob_drake.cli import ExitCode
from simrob_drake.cli.app import run_command
from simrob_drake.cli.legged import _steps_taken
from simrob_drake.programs.moves.walk import WalkMove

pytestmark = pytest.mark.usefixtures("no_plots")


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.long
def test_a_walk_is_that_of_the_program_and_its_way_is_told(tmp_path, capsys):
    arguments = [
        "walk",
        "roid1_dynamic",
        "--steps",
        "2",
        "--amplitude",
        "0.5",
        "--gait",
        "walk",
        "--out",
        "r",
    ]

    assert run_command([*arguments, "--no-recording", "--set", "sample_rate=50"]) == 0

    out = " ".join(capsys.readouterr().out.split())
    way = json.loads((tmp_path / "r" / "summary.json").read_text())["locomotion"]

    told = re.search(
        r"robot moved ([\d.]+) m at ([\d.]+) m/s .* turned by ([\d.]+) deg to the (left|right)", out
    )

    assert told is not None
    assert float(told[1]) == pytest.approx(way["distance"], abs=6e-4)
    assert float(told[2]) == pytest.approx(way["speed"], abs=6e-4)
    assert float(told[3]) == pytest.approx(abs(np.rad2deg(way["yaw"])), abs=0.06)
    assert told[4] == ("left" if way["yaw"] >= 0 else "right")

    robot = LeggedRobot(Workcell("roid1_dynamic", {"sample_rate": 50}))
    expected = robot.walk(2, 0.5, "walk")

    header, *rows = (tmp_path / "r" / "signals.csv").read_text().splitlines()
    saved = np.array([row.split(",") for row in rows], dtype=float)
    np.testing.assert_array_equal(saved[:, header.split(",").index("base.x")], expected["base.x"])
    assert "ran to its end" in out
    assert "result r" in out


MISTAKES = {
    "an unknown gait": (
        ["roid1_dynamic", "--gait", "wlak"],
        "there is no gait of roid1 'wlak'; did you mean 'walk'?",
    ),
    "an unknown gait that would be watched": (
        ["roid1_dynamic", "--gait", "wlak", "--live"],
        "there is no gait of roid1 'wlak'; did you mean 'walk'?",
    ),
    "a gait that names all": (["roid1_dynamic", "--gait", "x"], "known: .*turn.*walk"),
    "no legs": (["irb120_dynamic"], "robot irb120 is a robot without gaits"),
    "no step": (["roid1_dynamic", "--steps", "0"], "steps"),
    "no number": (["roid1_dynamic", "--amplitude", "nan"], "amplitude"),
    "no time of a step": (["roid1_dynamic", "--step-time", "0"], "step_time"),
    "a duration": (
        ["roid1_dynamic", "--set", "duration=3"],
        "--set duration=3: the gait or act",
    ),
    "a reference": (
        ["roid1_dynamic", "--set", "reference.kind=hold"],
        "the gait or act decides how the robot moves",
    ),
    "a reference of the robot": (
        ["roid1_dynamic", "--set", "robot.reference.kind=hold"],
        "the gait or act decides how the robot moves",
    ),
    "a reference in a section": (
        [
            "three_humanoids",
            "--robot",
            "roid1",
            "--set",
            "robots={roid1: {reference: {kind: hold}}}",
        ],
        "the gait or act decides how the robot moves",
    ),
    "an unknown robot": (["roid1_dynamic", "--robot", "roid"], "roid"),
    "one of several": (["three_humanoids"], "one of humanoid, roid1, zjudancer"),
    "an unknown station": (["roid1_dynamc"], "did you mean 'roid1_dynamic'?"),
}


@pytest.mark.parametrize(("arguments", "message"), MISTAKES.values(), ids=MISTAKES)
def test_what_cannot_be_walked_is_one_line_and_leaves_nothing(tmp_path, capfd, arguments, message):
    assert run_command(["walk", *arguments]) == ExitCode.BAD_INPUT
    captured = capfd.readouterr()
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 1
    assert re.search(message, captured.err) or message in captured.err
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def planned(monkeypatch):
    """Walks that were planned, and the stations on which. Planning ends the command."""
    asked = []

    def plan_motion(self, robot, station):
        asked.append((self, station))
        raise SimrobError("enough")

    monkeypatch.setattr(WalkMove, "plan_motion", plan_motion)
    return asked


@pytest.mark.parametrize(
    ("content", "key"),
    [("duration: 3.0\n", "duration"), ("reference:\n  kind: hold\n", "reference.kind")],
)
def test_a_file_of_settings_may_not_change_how_the_robot_moves(tmp_path, capsys, content, key):
    (tmp_path / "quick.yaml").write_text(content)
    arguments = ["walk", "roid1_dynamic", "--set", "sample_rate=50", "--set", "quick.yaml"]

    assert run_command(arguments) == ExitCode.BAD_INPUT
    err = capsys.readouterr().err
    assert f"--set quick.yaml: {key}: the gait or act decides how the robot moves" in err


def test_a_file_of_settings_may_have_any_name(tmp_path, capsys, planned):
    (tmp_path / "duration.yaml").write_text("sample_rate: 50\n")
    run_command(["walk", "roid1_dynamic", "--set", "duration.yaml"])

    assert "enough" in capsys.readouterr().err
    [(_, station)] = planned
    assert station.sample_rate == 50


def test_the_time_of_a_step_is_that_of_the_gait(planned):
    for options in ([], ["--step-time", "0.8"]):
        assert (
            run_command(["walk", "roid1_dynamic", *options, "--steps", "3"]) == ExitCode.BAD_INPUT
        )
    assert [(walk.steps, walk.model_extra) for walk, _ in planned] == [
        (3, {}),
        (3, {"step_time": 0.8}),
    ]


@pytest.mark.long
def test_an_act_is_that_of_the_program(tmp_path, capsys):
    assert run_command(["act", "humanoid_fixed", "wave", "--out", "r", "--no-recording"]) == 0

    expected = LeggedRobot("humanoid_fixed").act("wave")
    header, *rows = (tmp_path / "r" / "signals.csv").read_text().splitlines()
    saved = np.array([row.split(",") for row in rows], dtype=float)
    np.testing.assert_array_equal(
        saved[:, header.split(",").index("q.left_elbow")], expected["q.left_elbow"]
    )
    assert "came" not in capsys.readouterr().out  # its trunk is held


def test_only_a_gait_with_shorter_steps_has_a_sentence_about_them():
    dog = LeggedRobot(Workcell("yobotics_dynamic"))

    trot = _steps_taken(dog, WalkMove(steps=6, gait="trot"))

    assert trot.startswith("it took 11 steps for the distance of 6 full steps")
    assert _steps_taken(dog, WalkMove(steps=6, gait="crawl")) == ""


def test_an_unknown_act_is_answered_with_those_that_there_are(capsys):
    assert run_command(["act", "humanoid_dynamic", "walk"]) == ExitCode.BAD_INPUT
    assert "there is no act of humanoid 'walk'; known: bow, crouch" in capsys.readouterr().err


@pytest.mark.long
def test_a_walk_can_be_watched(tmp_path, capsys):
    arguments = ["walk", "roid1_dynamic", "--steps", "2", "--live", "--no-recording", "--out", "r"]

    assert run_command(arguments) == 0
    assert "watch the motion at http://127.0.0.1:" in capsys.readouterr().out
    assert (tmp_path / "r" / "summary.json").is_file()


@pytest.mark.parametrize("command", ["walk", "act"])
def test_without_a_station_those_are_listed_on_which_the_command_works(capsys, command):
    """A robot whose trunk is held cannot step, but it can go through the postures of an act."""
    assert run_command([command]) == ExitCode.BAD_INPUT

    told = " ".join(capsys.readouterr().err.split())
    names = told.rpartition(": ")[2].split(", ")
    assert "humanoid_dynamic" in names
    assert ("humanoid_fixed" in names) == (command == "act")
