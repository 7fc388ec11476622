"""Stations stepped from outside: names that FMI takes, parameters by their keys, and errors in words."""

import numpy as np
import pytest

from simrob_drake import load_station
from simrob_drake.base.errors import InvalidConfig, InvalidParameter, UnknownName
from simrob_drake.extensions.simulink.stepping.parameters import (
    legal,
    parameters_of,
    with_parameters,
)
from simrob_drake.extensions.simulink.stepping.station import StepFailed, SteppedStation
from simrob_drake.stations.resolve import resolve


def test_names_are_those_of_fmi():
    for ours, theirs in (
        ("position.joint_1", "position.joint_1"),
        ("walk.capture.0", "walk.capture[1]"),
        ("A.0.2", "A[1,3]"),
        ("commands.1.ahead", "commands[2].ahead"),
        ("position.joint-1", "position.'joint-1'"),
        ("position.1st", "position.'1st'"),
        ("position.it's \\é", "position.'itu27s u5cue9'"),
    ):
        assert legal(ours) == theirs


def test_parameters_are_of_each_axis_piece_and_force():
    config = load_station("irb120_cobot", {"pieces.load.density": 500})
    found = parameters_of(config)
    assert (found["servo.kp.joint_2"].start, found["servo.kp.joint_2"].unit) == (
        config.servo.kp,
        "N·m/rad",
    )
    assert (found["forces.hand.amplitude[3]"].start, found["forces.hand.amplitude[3]"].unit) == (
        5.0,
        "N",
    )
    assert found["forces.hand.phase_deg"].unit == "deg"
    assert found["mass_factors.link_3"].start == 1.0
    assert (found["pieces.gripper.mass"].unit, "pieces.load.mass" in found) == ("kg", False)
    slides = parameters_of(load_station("belt_pick"))
    assert {
        parameter.unit for name, parameter in slides.items() if "belt" in name and ".kp." in name
    } == {"N/m"}


def test_outputs_are_called_as_signals_are():
    """Those of a controller by axis; without names of their own by their places."""
    outputs = SteppedStation("zjudancer_walking").outputs
    assert outputs["walk.target.left_knee"].unit == "rad"
    assert (outputs["walk.capture[2]"].port, outputs["walk.capture[2]"].index) == (
        "walk.capture",
        1,
    )
    assert outputs["walk.active"].unit == "1"
    assert outputs["base_velocity.wz"].unit == "rad/s"
    assert outputs["tcp_pose.head.qw"].unit == "1"


def test_a_parameter_of_one_robot_of_several_leaves_the_others():
    """They share a section of gains, which becomes one of each by axis."""
    config = load_station(
        "two_irb120", {"mode": "dynamic", "servo": {"kp": 300, "kd": 10, "torque_limit": 50}}
    )
    found = parameters_of(config)
    first, second = config.robots
    changed = with_parameters(
        config,
        {found[f"{first}.servo.kp.joint_2"]: 70.0, found[f"{second}.mass_factors.link_1"]: 1.5},
    )
    one, other = (resolve(changed).robots[name].gains for name in (first, second))
    np.testing.assert_array_equal(one.kp, [300, 70, 300, 300, 300, 300])
    np.testing.assert_array_equal(one.torque_limit, 50)
    np.testing.assert_array_equal(other.kp, 300)
    assert changed.robots[second].mass_factors == {"link_1": 1.5}
    assert changed.robots[first].mass_factors == {}


def test_inputs_stay_when_parameters_are_set():
    station = SteppedStation("double_pendulum")
    station.set("reference.joint_1", 0.9)
    station.set("gravity", 3.0)
    station.set("reference.joint_2", 0.2)
    assert (station.get("reference.joint_1"), station.get("reference.joint_2")) == (0.9, 0.2)
    station.advance(0.05)
    light = station.get("position.joint_1")
    station.reset({"gravity": 9.0})
    assert (station.time, station.get("gravity"), station.get("reference.joint_1")) == (
        0,
        9,
        station.get("position.joint_1"),
    )
    station.set("reference.joint_1", 0.9)
    station.set("reference.joint_2", 0.2)
    station.advance(0.05)
    assert station.get("position.joint_1") < light - 1e-5


def test_stepping_fails_in_words():
    station = SteppedStation("double_pendulum")
    with pytest.raises(
        InvalidParameter, match=r"reference\.joint_1 is nan; it must be a finite number \[rad\]"
    ):
        station.set("reference.joint_1", float("nan"))
    with pytest.raises(UnknownName, match=r"no variable 'position.joint_3'.*position.joint_2"):
        station.get("position.joint_3")
    with pytest.raises(UnknownName, match=r"no input or parameter 'position.joint_1'"):
        station.set("position.joint_1", 1.0)
    with pytest.raises(UnknownName, match=r"no parameter 'servo.kp.joint_3'"):
        station.reset({"servo.kp.joint_3": 1.0})
    with pytest.raises(InvalidConfig, match=r"parameters: .*gravity"):
        station.reset({"gravity": 1e9})
    station.reset()
    station.stopped = "the arm stands"
    with pytest.raises(StepFailed, match="was ended: the arm stands"):
        station.advance(1.0)
