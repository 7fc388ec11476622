"""Legged robots that go by commands: as one table, in programs, and refused."""

import numpy as np
import pytest

from simrob_drake import LeggedRobot, load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.programs.program import Program
from simrob_drake.results.animation.live import Steering
from simrob_drake.results.animation.window import Board

pytestmark = pytest.mark.usefixtures("no_plots")


def crouched():
    """Return ZJUDancer in the posture of its walk, as the shipped station begins."""
    robots = load_station("zjudancer_walking").robots
    return load_station("zjudancer_dynamic").model_copy(update={"robots": robots})


@pytest.mark.long
def test_two_calls_are_one_table_and_a_third_without_speeds_stops():
    robot = LeggedRobot(crouched())
    first, second = robot.go(ahead=0.2, duration=1.3), robot.go(ahead=0.15, turn=0.2, duration=0.7)
    turn_deg = second.config.controllers["walk"].commands[0].turn_deg
    table = [{"ahead": 0.2}, {"time": 1.3, "ahead": 0.15, "turn_deg": turn_deg}]
    whole = simulate(first.config, duration=0.01, progress=False).config
    section = whole.controllers["walk"].model_validate({"kind": "walk", "commands": table})
    whole = whole.model_copy(update={"controllers": {"walk": section}})
    planned = simulate(whole, duration=2.0, progress=False)
    together = np.vstack([first.pose("base")[:-1], second.pose("base")])
    assert np.abs(planned.pose("base") - together).max() < 1e-9
    assert "walk" not in robot.cell.config.controllers
    robot.go(duration=2.0)
    assert np.abs(robot.velocity).max() < 0.1
    before = robot.base_pose.translation()
    robot.test_move({"right_elbow": 30}, 0.5)
    assert np.linalg.norm(robot.base_pose.translation() - before) < 0.01
    robot.undo()
    assert (robot.base_pose.translation() == before).all()


def test_a_program_goes_and_remembers_it(tmp_path):
    robot = LeggedRobot(crouched())
    robot.insert(0, {"go": {"ahead": 0.5, "turn_deg": 10, "duration": 1.2}})
    text = robot.save(tmp_path / "program.yaml").read_text()
    assert "go: {ahead: 0.5, turn_deg: 10.0, duration: 1.2}" in text
    result = robot.run(Program.load(tmp_path / "program.yaml"))
    assert (result.did, result.ending) == ("go", "completed")
    (remark,) = result.summary()["remarks"]
    assert "walk is asked for more than its legs can follow" in remark


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"ahead": 0.5, "strict": True}, "ahead.*0.5 m/s.*at most 0.35 m/s"),
        ({"ahead": "fast"}, "ahead"),
        ({"turn": float("nan")}, "turn.*finite"),
        ({"duration": 0}, "duration"),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(asked, told):
    robot = LeggedRobot(crouched())
    with pytest.raises(SimrobError, match=told):
        robot.go(**asked)
    assert robot.cell.state is None


def test_a_robot_without_a_walk_says_so():
    with pytest.raises(SimrobError, match=r"walk of robot.*of a robot that stands on feet of its own|no walk"):
        LeggedRobot("irb120_dynamic").go(ahead=0.1)


def test_keys_and_sliders_command_a_walk_from_the_first_touch_on():
    steering = Steering(load_station("zjudancer_walking"))
    board = steering.board = Board(steering.controls)
    hand, (ahead, left, turn, stop) = steering.hands["walk"], steering.controls
    assert hand(0.1) is None
    assert steering.controls[ahead].value == 0.0  # the station walks from 0.5 s on
    assert hand(0.6) is None
    assert steering.controls[ahead].value == 0.25
    assert board.news({}).decode().count("set_control_value") == 1
    assert [steering.controls[name].key_up for name in (ahead, left, turn)] == ["ArrowUp", "KeyQ", "ArrowLeft"]
    for name, value in ((ahead, 0.07), (left, 9.0), (turn, -16)):
        board.hear(f'["{name}", {value}]'.encode())
    assert hand(0.2) == (0.07, 0.1, pytest.approx(np.deg2rad(-16)))
    board.hear(f'["{stop}", 1]'.encode())
    assert hand(0.3) == hand(0.4) == (0.0, 0.0, 0.0)
    told = board.news({}).decode()
    assert told.count("set_control_value") == 3
    board.hear(f'["{ahead}", 0.14]'.encode())
    assert hand(0.5)[0] == 0.14
    assert board.news({}).decode().count("set_control_value") == 2  # what comes later begins with what is set
    assert Steering(load_station("irb120_dynamic")).hands == {}
