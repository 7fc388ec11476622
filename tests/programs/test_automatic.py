"""Programs in the robot's own time: every cell in order, its time told, and the robot goes on from its end."""

import json

import numpy as np
import pytest

from simrob_drake import Arm, LeggedRobot, Program, load_station
from simrob_drake.base.errors import InvalidConfig, InvalidParameter
from simrob_drake.cli.app import run_command
from simrob_drake.programs.errors import JointLimitExceeded

pytestmark = pytest.mark.usefixtures("no_plots")

WAVE = [
    {"left_shoulder_pitch": 60, "left_elbow": 40},
    {"right_shoulder_roll": 30, "neck_yaw": -30},
    {"left_shoulder_pitch": 0, "left_elbow": 0},
    {"right_shoulder_roll": 0, "neck_yaw": 0},
]
ARM = {
    "pieces": {},
    "floor": None,
    "solver": {"kind": "discrete", "time_step": 1e-3},
    "servo.realization": "implicit",
}
POSTURES = np.deg2rad([[20, 0, 0, 0, 30, 0], [0, 10, 0, 0, 0, 40], [0, 0, 0, 0, 0, 0]])


def standing(**changes):
    """Return the humanoid on its feet, with quick servos, and cells of arms and head."""
    robot = LeggedRobot(load_station("humanoid_dynamic", {"servo.kd": 20, **changes}))
    for target in WAVE:
        robot.add_reference(target, 0.5)
    return robot


def arm(**changes):
    made = Arm(load_station("irb120_dynamic", {**ARM, **changes}))
    made.add_reference(POSTURES, 0.4)
    return made


def check_visited(result, targets, tolerance):
    """Check that each cell ends with its targets reached, in order and no later than told; return when [s]."""
    times = result.cells["automatic"]
    assert None not in times
    assert (np.diff(times, prepend=0.0) > 0).all()
    for time, target in zip(times, targets, strict=True):
        seen = np.searchsorted(result.times, time - 1e-9)
        for axis, value in target.items():
            assert np.rad2deg(result[f"q.{axis}"][seen]) == pytest.approx(
                value, abs=tolerance + 0.05
            )
    assert times[-1] < result.stop_time < times[-1] + 0.03  # not the whole horizon
    assert result.stopped_by == "automatic"
    assert "the last of" in result.message
    return times


@pytest.mark.parametrize("part", [pytest.param(1.0, marks=pytest.mark.long), 0.5])
def test_a_legged_robot_goes_through_its_references_slow_or_not(part):
    robot = standing(**{"servo.kp": 100 * part})
    times = check_visited(robot.simulate(automatic=True), WAVE, 2.0)

    assert times[-1] == pytest.approx({1.0: 3.7, 0.5: 6.1}[part], abs=0.5)
    assert robot.runs[-1].summary()["cells"] == robot.runs[-1].cells


@pytest.mark.long
def test_no_cell_is_skipped_while_one_joint_is_late():
    """An elbow that is five times as slow as the others sets the time of its own cells alone."""
    quick = standing().simulate(automatic=True).cells["automatic"]
    slow = standing(
        **{
            "servo.kd": {
                **dict.fromkeys(LeggedRobot("humanoid_dynamic").axes, 20),
                "left_elbow": 100,
            }
        }
    )

    times = check_visited(slow.simulate(automatic=True), WAVE, 2.0)

    extra = np.diff(times, prepend=0.0) - np.diff(quick, prepend=0.0)
    assert (extra[[0, 2]] > 1.0).all()
    assert extra[[1, 3]] == pytest.approx(0, abs=0.1)


@pytest.mark.long
def test_the_robot_goes_on_from_its_end_and_undo_takes_it_back():
    robot = standing()
    result = robot.simulate(automatic=True)
    np.testing.assert_array_equal(robot.position, result.axes("q")[-1])
    assert robot.cell.config.controllers == {}

    again = robot.simulate(automatic=True)  # from the start
    np.testing.assert_array_equal(again.values, result.values)

    # from the last state, and from the first cell
    onward = robot.run(robot.program.with_automatic(True))
    assert None not in onward.cells["automatic"]
    assert onward.axes("q")[0] == pytest.approx(result.axes("q")[-1], abs=1e-12)

    robot.undo()
    np.testing.assert_array_equal(robot.position, result.axes("q")[-1])


@pytest.mark.long
def test_a_cell_that_cannot_be_reached_ends_the_run_and_names_the_joint():
    robot = standing(**{"servo.torque_limit": {"left_elbow": 1e-4}})
    result = robot.simulate(automatic={"timeout": 2})

    assert result.cells == {"automatic": [None] * 4}
    assert "cell 0 was not reached within 2 s; late: left_elbow" in result.message

    went_on = robot.simulate(automatic={"timeout": 2, "on_timeout": "go_on"})
    assert went_on.cells["automatic"][0] is None
    assert went_on.cells["automatic"][1] is not None


@pytest.mark.long
def test_a_program_says_that_it_is_automatic(tmp_path):
    file = tmp_path / "step.yaml"
    text = {
        "automatic": {"tolerance_deg": 3.0},
        "references": [{"target_deg": target} for target in WAVE],
    }
    file.write_text(json.dumps(text))
    robot = LeggedRobot(load_station("humanoid_dynamic", {"servo.kd": 20}))

    robot.load(file)

    assert Program.load(robot.save(tmp_path / "again.yaml")) == robot.program

    loaded = robot.simulate()
    check_visited(loaded, WAVE, 3.0)

    np.testing.assert_array_equal(
        robot.simulate(automatic={"tolerance_deg": 3.0}).values, loaded.values
    )
    assert not robot.program.with_automatic(False).automatic


def test_a_station_s_own_sequencer_waits_and_its_other_loops_lie_above():
    guard = {
        "kind": "fall_guard",
        "height": 9,
        "duration": 0,
        "posture_deg": {"neck_yaw": 10},
        "priority": 3,
    }
    own = {"kind": "sequencer", "cells": [{"targets_deg": {"neck_yaw": 50}}]}
    robot = LeggedRobot(
        load_station(
            "humanoid_dynamic", {"controllers": {"own": own, "guard": guard}, "servo.kd": 20}
        )
    )
    robot.add_reference({"left_elbow": 20, "neck_yaw": 9})

    result = robot.simulate(automatic=True)

    assert set(result.config.controllers) == {"guard", "automatic"}
    assert np.rad2deg(result["q_ref.neck_yaw"][-1]) == pytest.approx(10)
    assert set(robot.cell.config.controllers) == {"own", "guard"}


@pytest.mark.parametrize("part", [pytest.param(1.0, marks=pytest.mark.long), 0.25])
def test_an_arm_does_the_same(part):
    made = arm(**{"servo.kp": 2000 * part, "servo.kd": 100})
    result = made.simulate(automatic={"speed_deg": 2})
    targets = [dict(zip(made.axes, row, strict=True)) for row in np.rad2deg(POSTURES)]

    times = check_visited(result, targets, 2.0)

    assert (times[-1] > 2.5) == (part < 1)  # the slow one takes its time
    np.testing.assert_array_equal(made.position, np.zeros(6))  # it stays


def test_an_arm_is_programmed_here_and_run_there():
    made = Arm("irb120_kinematic")
    made.add_reference(POSTURES[0])

    with pytest.raises(InvalidParameter, match="a kinematic station has no servos"):
        made.simulate(automatic=True)

    result = made.simulate(load_station("irb120_dynamic", ARM), automatic=True)
    assert np.rad2deg(result["q.joint_5"][-1]) == pytest.approx(30, abs=2)


@pytest.mark.long
def test_a_program_runs_from_the_shell(tmp_path, capsys):
    file = tmp_path / "wave.yaml"
    content = {
        "station": "humanoid_dynamic",
        "automatic": True,
        "references": [{"target_deg": {"left_elbow": 20}}],
    }

    file.write_text(json.dumps(content))

    folder = tmp_path / "out"
    assert (
        run_command(
            ["run", str(file), "--set", "servo.kd=20", "--out", str(folder), "--no-recording"]
        )
        == 0
    )
    (reached,) = json.loads((folder / "summary.json").read_text())["cells"]["automatic"]
    assert f"{reached:.2f}" in capsys.readouterr().out
    assert run_command(["run", str(file), "--duration", "3"]) == 2

    file.write_text(json.dumps({**content, "station": None}))
    assert run_command(["run", str(file)]) == 2
    assert "station: this key is required" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("ask", "error", "message"),
    [
        (
            lambda: LeggedRobot("humanoid_dynamic").simulate(automatic=True),
            InvalidParameter,
            "the program: it has no references",
        ),
        (lambda: standing().simulate(automatic=3), InvalidParameter, "automatic is 3"),
        (lambda: standing().simulate(automatic={"timeout": -1}), InvalidConfig, "timeout"),
        (
            lambda: standing().simulate(automatic={"timeout": 0.4}),
            InvalidConfig,
            r"cells\[0\]\.duration is 0\.5 s; it must be less than timeout",
        ),
        (
            lambda: standing().add_reference({"left_knee": 500}),
            JointLimitExceeded,
            "beyond its limit",
        ),
        (lambda: arm().add_reference(np.full(6, 9.0)), JointLimitExceeded, "beyond its limits"),
        (lambda: arm().add_reference([0.1, 0.2]), InvalidParameter, "6 finite numbers"),
        (
            lambda: arm().simulate(automatic=True, duration=3),
            InvalidParameter,
            "lasts as long as its references",
        ),
    ],
)
def test_what_cannot_be_is_told(ask, error, message):
    with pytest.raises(error, match=message):
        ask()
