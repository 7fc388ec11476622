"""A suggested duration: by the speed limit and by the lag of the servos, and the verdict of a move that takes it."""

import numpy as np
import pytest

from simrob_drake import LeggedRobot, load_station
from simrob_drake.blocks.references import PEAK
from simrob_drake.programs.suggested_duration import suggest_duration
from simrob_drake.stations.resolve import resolve


def suggestion(station, angles_deg, overrides=None):
    """Duration that is suggested for a move from zero to angles [deg], by axis."""
    config = load_station(station, overrides or {})
    robot = next(iter(resolve(config).robots.values()))
    target = np.zeros(len(robot.axes))
    for axis, angle in angles_deg.items():
        target[robot.axes.index(axis)] = np.deg2rad(angle)
    return suggest_duration(config, robot, np.zeros(len(robot.axes)), target)


def test_a_short_move_takes_the_time_of_the_thesis():
    assert suggestion("irb120_kinematic", {"joint_1": 5}) == 1.0
    assert suggestion("irb120_kinematic", {}) == 1.0


def test_the_speed_limit_of_the_slowest_axis_decides():
    """Its peak speed is half of the limit; a smooth move peaks at 15/8 of its mean speed."""
    limit = resolve(load_station("irb120_kinematic")).robots["robot"].speed_limits[0]

    expected = np.deg2rad(160) * PEAK / (0.5 * limit)
    assert suggestion("irb120_kinematic", {"joint_1": -160, "joint_2": 5}) == pytest.approx(
        expected, abs=0.1
    )
    assert suggestion("irb120_kinematic", {"joint_1": 160}) >= expected


def test_the_lag_of_a_servo_makes_a_move_longer():
    """At the speed v it lags by kd/kp v: here 0.5 s v, so 2 degrees allow 4 degrees a second."""
    slow = {"servo.kp": 100, "servo.kd": 50}

    assert suggestion("irb120_dynamic", {"joint_1": 60}, slow) == pytest.approx(60 / 4, abs=0.1)
    assert (
        suggestion(
            "irb120_dynamic", {"joint_1": 60}, {**slow, "servo.feedforward": "inverse_dynamics"}
        )
        < 2.0
    )
    assert suggestion("irb120_dynamic", {"joint_1": 60}, {"servo.kp": 100, "servo.kd": 0}) < 2.0
    assert suggestion("irb120_dynamic", {"joint_1": 60}, {"servo.kp": 0, "servo.kd": 50}) < 2.0


def test_a_move_of_the_suggested_duration_has_no_warnings():
    """In the 1 s of the thesis the humanoid's shoulder reaches 21.6 of 60 degrees."""
    duration = suggestion("humanoid_dynamic", {"right_shoulder_pitch": 60})

    assert duration == pytest.approx(30.0)

    result = LeggedRobot("humanoid_dynamic").test_move(
        {"right_shoulder_pitch": 60}, duration=duration
    )
    assert not result.verdict.warnings
    assert np.rad2deg(result["q.right_shoulder_pitch"][-1]) == pytest.approx(60, abs=3)
