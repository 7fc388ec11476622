"""A controller of an extension offers commands, sliders, remarks and the camera as the toolbox's own controllers do."""

import json

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.parts.controllers import KINDS
from simrob_drake.programs.timeline import Change, Timeline
from simrob_drake.results.animation.camera import robots_to_follow
from simrob_drake.results.animation.live import StationView, Steering
from simrob_drake.results.animation.window import Board
from simrob_drake.results.files import save_result
from simrob_drake.results.record.summary import remarks_of, summary_of
from tests.test_extension import install  # noqa: F401  # a fixture

SPIN = '''
import math
from typing import ClassVar, Literal

import numpy as np

from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.parts.controllers.loop import LoopSection
from simrob_drake.parts.controllers.section import CommandPart, TimedCommand


class Spin(LoopSection):
    """Turn the first axis at the speed of a command."""

    command_parts: ClassVar = (
        CommandPart("turn", "rad/s", "turn A D [deg/s]", keys=("KeyD", "KeyA"), slider_unit=math.radians(1)),
    )
    command_key: ClassVar[str] = "speeds"
    remarks: ClassVar = {"fast": "turns faster than 0.1 rad/s"}
    camera_follows: ClassVar[bool] = True

    kind: Literal["spin"]
    speeds: tuple[tuple[float, float], ...] = ()

    def command_limits(self, robot):
        return [(-30.0, 30.0)]

    def command_at(self, time):
        return (next((speed for since, speed in reversed(self.speeds) if since <= time), 0.0),)

    def with_commands(self, commands):
        return self.model_copy(update={"speeds": tuple((time, values[0]) for time, values in commands)})

    def axes(self, robot):
        return robot.axes[:1]

    def _block(self, key, robot, site):
        return SpinLoop(self, len(robot.axes))


class SpinLoop(SampledBlock):
    units = {"offset": "rad"}

    def __init__(self, section, size):
        self.section = section
        memory = {"offset": np.zeros(size), "fast": 0.0, "hand": np.zeros(2)}
        super().__init__(period=0.01, reads={}, memory=memory, gives=("offset", "fast"))

    def command_by_hand(self, context, values):
        self.remember(context, {"hand": np.array([1.0, *values])})

    def sample(self, memory, read):
        commanded, speed = memory["hand"]
        if not commanded:
            (speed,) = self.section.command_at(read["time"][0])
        offset = memory["offset"].copy()
        offset[0] += 0.01 * speed
        return {"offset": offset, "fast": float(abs(speed) > 0.1)}
'''


@pytest.fixture
def spinning(install):  # noqa: F811
    install("spin-kit", "core='>=0', controllers={'spin': 'spin_kit.parts:Spin'}", parts=SPIN)
    KINDS.forget_extensions()
    changes = {
        "controllers": {"spin": {"kind": "spin"}},
        "reference": {"kind": "hold"},
        "duration": 0.5,
    }
    yield load_station("irb120_dynamic", changes)
    KINDS.forget_extensions()


def test_commands_of_a_function_move_the_robot_and_stand_in_the_result(spinning, tmp_path):
    result = simulate(
        spinning, commands={"spin": lambda time: (0.2 if time < 0.3 else 0.0,)}, progress=False
    )
    assert result["spin.offset.joint_1"].max() == pytest.approx(0.2 * 0.3, abs=0.005)
    times = [time for time, _ in result.config.controllers["spin"].speeds]
    assert [speed for _, speed in result.config.controllers["spin"].speeds] == [0.2, 0.0]
    assert times[1] >= 0.3

    folder = save_result(result, result.verdict, tmp_path / "result", recording=False)
    assert "speeds" in (folder / "commands.yaml").read_text()
    again = simulate(result.config, progress=False)
    np.testing.assert_allclose(
        again["spin.offset.joint_1"][-1], result["spin.offset.joint_1"][-1], atol=0.005
    )


def test_a_command_of_another_size_is_an_error_that_lists_its_numbers(spinning):
    with pytest.raises(
        SimrobError, match=r"commands: spin at .* it must be a list of 1 numbers: turn \[rad/s\]"
    ):
        simulate(spinning, commands={"spin": lambda time: (0.1, 0.2)}, progress=False)


def test_the_live_page_has_its_slider_and_the_camera_follows(spinning):
    steering = Steering(spinning)
    board = steering.board = Board(steering.controls)
    assert list(steering.controls) == ["turn A D [deg/s]", "stop: space"]
    slider = steering.controls["turn A D [deg/s]"]
    assert (slider.low, slider.high, slider.key, slider.key_up) == (-30.0, 30.0, "KeyD", "KeyA")
    assert steering.hands["spin"](0.1) is None
    board.hear(json.dumps(["turn A D [deg/s]", 12]).encode())
    assert steering.hands["spin"](0.2) == (pytest.approx(np.deg2rad(12)),)

    assert "follow" in shown_commands(spinning)
    assert "follow" not in shown_commands(load_station("irb120_dynamic"))


def shown_commands(station):
    """Return the types of the commands by which a page shows a station."""
    commands = []
    StationView(lambda _, more: commands.extend(more)).draw(station)
    return {command["type"] for command in commands if isinstance(command, dict)}


def test_its_remarks_are_in_the_summary(spinning):
    result = simulate(
        spinning,
        commands={"spin": lambda time: (0.2 if 0.2 < time < 0.4 else 0.0,)},
        progress=False,
    )
    (remark,) = remarks_of(result)

    assert remark.startswith("spin turns faster than 0.1 rad/s: 0.2")
    assert summary_of(result, result.verdict)["remarks"] == [remark]


def test_a_program_drives_it(spinning):
    drive = {"commands": ((0.0, 0.3, 0.0, 10.0),)}
    timeline = Timeline(changes=[Change(time=0.1, drive=drive)])

    driver = timeline.walk_drivers(spinning)["spin"]

    assert driver(0.05) is None
    assert driver(0.2) == (pytest.approx(np.deg2rad(10.0)),)


@pytest.mark.parametrize(
    ("station", "followed"),
    [("zjudancer_walking", {"robot"}), ("zjudancer_balance", set()), ("irb120_dynamic", set())],
)
def test_the_camera_follows_robots_that_walk_and_no_others(station, followed):
    config = load_station(station)
    assert robots_to_follow(config.robots, config.controllers) == followed
