"""`LeggedRobot.go`: calls, programs, invalid arguments, and keys and sliders that steer a walk."""

from typing import NamedTuple

import numpy as np
import pytest

from simrob_drake import LeggedRobot, load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.programs.program import Program
from simrob_drake.results.animation.live import Steering
from simrob_drake.results.animation.window import Board

pytestmark = pytest.mark.usefixtures("no_plots")


def crouching_robot():
    """ZJUDancer in the posture in which the shipped station begins."""
    robots = load_station("zjudancer_walking").robots
    return LeggedRobot(load_station("zjudancer_dynamic").model_copy(update={"robots": robots}))


@pytest.mark.long
def test_two_calls_are_equal_to_one_run_with_a_table():
    robot = crouching_robot()

    first = robot.go(ahead=0.2, duration=1.3)
    second = robot.go(ahead=0.15, turn=0.2, duration=0.7)

    turn_deg = second.config.controllers["walk"].commands[0].turn_deg
    table = [{"ahead": 0.2}, {"time": 1.3, "ahead": 0.15, "turn_deg": turn_deg}]
    config = simulate(first.config, duration=0.01, progress=False).config
    section = config.controllers["walk"].model_validate({"kind": "walk", "commands": table})
    config = config.model_copy(update={"controllers": {"walk": section}})
    whole = simulate(config, duration=2.0, progress=False)
    poses = np.vstack([first.pose("base")[:-1], second.pose("base")])
    assert np.abs(whole.pose("base") - poses).max() < 1e-9
    assert "walk" not in robot.cell.config.controllers


@pytest.mark.long
def test_a_robot_stands_after_a_call_without_speeds():
    robot = crouching_robot()
    robot.go(ahead=0.2, duration=1.3)

    robot.go(duration=2.0)

    speed_at_end = np.abs(robot.velocity).max()
    before = robot.base_pose.translation()
    robot.test_move({"right_elbow": 30}, 0.5)
    assert speed_at_end < 0.1
    assert np.linalg.norm(robot.base_pose.translation() - before) < 0.01

    robot.undo()
    assert (robot.base_pose.translation() == before).all()


def test_a_program_with_a_walk_is_saved_and_run(tmp_path):
    robot = crouching_robot()
    robot.insert(0, {"go": {"ahead": 0.5, "turn_deg": 10, "duration": 1.2}})
    file = robot.save(tmp_path / "program.yaml")

    result = robot.run(Program.load(file))

    (remark,) = result.summary()["remarks"]
    assert "go: {ahead: 0.5, turn_deg: 10.0, duration: 1.2}" in file.read_text()
    assert (result.did, result.ending) == ("go", "completed")
    assert "walk clips commands that are beyond the speed limits of the legs" in remark


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"ahead": 0.5, "strict": True}, "ahead.*0.5 m/s.*at most 0.35 m/s"),
        ({"ahead": "fast"}, "ahead"),
        ({"turn": float("nan")}, "turn.*finite"),
        ({"duration": 0}, "duration"),
    ],
)
def test_an_invalid_argument_is_refused_and_changes_nothing(arguments, message):
    robot = crouching_robot()

    with pytest.raises(SimrobError, match=message):
        robot.go(**arguments)
    assert robot.cell.state is None


def test_a_robot_without_a_walk_is_refused():
    robot = LeggedRobot("irb120_dynamic")

    with pytest.raises(
        SimrobError, match=r"robot has no feet, or its base is fixed|no section reacting"
    ):
        robot.go(ahead=0.1)


class Panel(NamedTuple):
    """Controls of a walk in the animation.

    Attributes:
        steering: the controls, with their present values.
        board: the connection to the page.
        names: names of the sliders ahead, left and turn, and of the button that stops.
    """

    steering: Steering
    board: Board
    names: list[str]

    def command_at(self, time):
        """Command of the user at a time [s]: ahead, left [m/s] and turn [rad/s], or None before the first touch."""
        return self.steering.hands["walk"](time)

    def set(self, index, value):
        """Set a control by its index."""
        self.board.hear(f'["{self.names[index]}", {value}]'.encode())

    def changes_on_page(self):
        """Count of values that change on the page since the last call."""
        return self.board.news({}).decode().count("set_control_value")


class TestSteering:
    """Keys and sliders command a walk from the first touch on."""

    @pytest.fixture
    def panel(self):
        steering = Steering(load_station("zjudancer_walking"))
        board = Board(steering.controls)
        steering.board = board
        return Panel(steering, board, list(steering.controls))

    def test_sliders_show_the_command_of_the_station_until_they_are_touched(self, panel):
        ahead = panel.steering.controls[panel.names[0]]

        before = panel.command_at(0.1), ahead.value
        after = panel.command_at(0.6), ahead.value

        assert before == (None, 0.0)
        assert after == (None, 0.25)  # the station walks from 0.5 s on
        assert panel.changes_on_page() == 1

    def test_each_slider_has_its_key(self, panel):
        keys = [panel.steering.controls[name].key_up for name in panel.names[:3]]

        assert keys == ["ArrowUp", "KeyQ", "ArrowLeft"]

    def test_sliders_command_within_the_limits_of_the_legs(self, panel):
        panel.set(0, 0.07)
        panel.set(1, 9.0)
        panel.set(2, -16)

        assert panel.command_at(0.2) == (0.07, 0.1, pytest.approx(np.deg2rad(-16)))

    def test_the_button_stops_the_walk(self, panel):
        panel.set(0, 0.07)
        panel.set(1, 0.05)
        panel.set(2, -16)
        panel.command_at(0.2)

        panel.set(3, 1)

        assert panel.command_at(0.3) == (0.0, 0.0, 0.0)
        assert panel.command_at(0.4) == (0.0, 0.0, 0.0)
        assert panel.changes_on_page() == 3

    def test_a_slider_walks_on_after_a_stop(self, panel):
        for index, value in enumerate((0.07, 0.05, -16)):
            panel.set(index, value)
        panel.command_at(0.2)
        panel.set(3, 1)
        panel.command_at(0.3)
        panel.changes_on_page()

        panel.set(0, 0.14)

        assert panel.command_at(0.5)[0] == 0.14
        # a page that opens later begins with the values that are set
        assert panel.changes_on_page() == 2

    def test_a_robot_without_a_walk_has_no_controls_for_one(self):
        assert Steering(load_station("irb120_dynamic")).hands == {}
