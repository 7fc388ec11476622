"""Servos that use the model of the arm: how closely they follow the reference, and what is refused."""

import numpy as np
import pytest

from simrob_drake import build_station, load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.results.block_diagram.picture import station_dot
from simrob_drake.stations.checks import check_station

MOVE = {"reference.kind": "move", "reference.target_deg": 30}
COMPUTED = {"servo.law": "computed_torque", "servo.kp": 400, "servo.kd": 40}
DISCRETE = {
    "servo.realization": "implicit",
    "solver": {"kind": "discrete", "scheme": "sap", "time_step": 1e-3},
}


def errors(station, overrides):
    """Compute the position error of each axis over time [deg]."""
    result = simulate(load_station(station, overrides), progress=False)
    assert result.ending == "completed"
    return np.rad2deg(np.abs(result.axes("q") - result.axes("q_ref")))


@pytest.mark.parametrize("kind", ["ramp", "move"])
@pytest.mark.parametrize("mass", [0.5, 3.0])
def test_gravity_compensation_takes_the_sag_away_with_any_load(kind, mass):
    load = {"reference.kind": kind, "reference.target_deg": 30, "pieces.load.mass": mass}
    assert errors("irb120_dynamic", load)[-1].max() > 1.0
    assert errors("irb120_dynamic", {**load, "servo.feedforward": "gravity"})[-1].max() < 1e-3


@pytest.mark.parametrize(
    "servo",
    [
        {"servo.feedforward": "inverse_dynamics"},
        {"servo.feedforward": "inverse_dynamics", "servo.realization": "vector"},
        {"servo.feedforward": "inverse_dynamics", "servo.law": "cascade"},
        COMPUTED,
    ],
    ids=["per_joint", "vector", "cascade", "computed_torque"],
)
@pytest.mark.parametrize(
    "reference",
    [
        MOVE,
        {
            "reference": {
                "kind": "s_curve",
                "target_deg": 30,
                "speed_deg": 60,
                "acceleration_deg": 200,
            }
        },
    ],
    ids=["move", "s_curve"],
)
def test_the_whole_move_is_followed_within_a_fiftieth_of_a_degree(servo, reference):
    tight = {"solver.accuracy": 1e-3}  # at the station's 1e-2 the solver's own error is as large
    assert errors("irb120_dynamic", {**reference, **servo, **tight}).max() < 0.02


@pytest.mark.long
def test_actuators_take_the_feedforward_through_their_desired_state():
    found = errors("irb120_dynamic", {**MOVE, **DISCRETE, "servo.feedforward": "inverse_dynamics"})
    assert found.max() < 0.1  # a step behind: 30 degrees in a second go 0.056 degrees in 1 ms
    assert found[-1].max() < 1e-3


def test_the_error_of_a_computed_torque_obeys_its_own_law_in_every_joint():
    """The law e'' + kd e' + kp e = 0 gives e0 exp(-d t) (cos(w t) + d / w sin(w t)) in each axis, from rest."""
    kp = 100.0  # [1/s²]
    kd = 12.0  # [1/s]
    start_error_deg = 10
    changes = {
        "servo.law": "computed_torque",
        "servo.kp": kp,
        "servo.kd": kd,
        "reference": {"kind": "hold"},
        "reference.target_deg": start_error_deg,
        "solver.accuracy": 1e-5,
        "duration": 1.0,
    }

    result = simulate(load_station("irb120_dynamic", changes), progress=False)

    start_error = np.deg2rad(start_error_deg)
    decay = kd / 2
    frequency = np.sqrt(kp - decay**2)
    angle = frequency * result.times
    error = (
        start_error
        * np.exp(-decay * result.times)
        * (np.cos(angle) + decay / frequency * np.sin(angle))
    )
    found = start_error - result.axes("q")
    np.testing.assert_allclose(found, np.tile(error, (6, 1)).T, atol=2e-5)


def test_each_robot_has_its_own_and_pieces_that_fly_do_not_matter():
    stone = {
        "model": "half_die",
        "parent": "world",
        "free": True,
        "mass": 1.0,
        "pose": [0, 1, 1, 0, 0, 0],
    }
    change = {
        "robots.left.servo": {"kp": 1000, "kd": 10, "feedforward": "gravity"},
        "pieces.stone": stone,
    }
    result = simulate(load_station("two_irb120", change), progress=False)

    off = {
        name: np.rad2deg(np.abs(result.axes("q", name) - result.axes("q_ref", name)))[-1]
        for name in result.plant.robots
    }

    assert off["left"].max() < 1e-2
    assert off["right"].max() > 0.5


def test_gravity_asks_for_no_speed_and_an_input_of_torques_comes_on_top():
    """The torque is the weight, the input and kd v_r, even if another arm in the same model is moving."""
    kd = 10.0
    input_torque = 2.0  # [N·m]
    reference_velocity = 0.5  # [rad/s]
    changes = {"inputs": ["feedforward", "reference_velocity"]}
    for name, feedforward in {"left": "gravity", "right": "inverse_dynamics"}.items():
        changes[f"robots.{name}.servo"] = {"kp": 9, "kd": kd, "feedforward": feedforward}
    station = build_station(load_station("two_irb120", changes))
    context = station.CreateDefaultContext()
    for name in station.ports.inputs:
        value = 0.0
        if name.endswith("velocity"):
            value = reference_velocity
        elif name.endswith("feedforward"):
            value = input_torque
        station.GetInputPort(name).FixValue(context, np.full(6, value))

    torque = station.GetOutputPort("left.torque").Eval(context)

    plant = station.ports.plant.plant
    gravity = plant.CalcGravityGeneralizedForces(plant.CreateDefaultContext())
    weight = -station.ports.plant.robots["left"].axis_map.efforts(gravity)
    np.testing.assert_allclose(torque, weight + input_torque + kd * reference_velocity, atol=1e-12)


def test_a_cascade_goes_no_faster_than_its_limit():
    fast = {"reference": {"kind": "hold", "target_deg": {"joint_1": 60}}, "servo.law": "cascade"}
    slow = {**fast, "servo.speed_limit": 0.5, "servo.kd": 200, "servo.kp": 4000}

    result = simulate(load_station("irb120_dynamic", slow), progress=False)

    speed = np.abs(result["v.joint_1"])
    assert speed[50:150] == pytest.approx(0.5, abs=0.01)  # asked for 60 degrees at once, it cruises
    assert result["q.joint_1"][-1] == pytest.approx(np.deg2rad(60), abs=2e-3)


def test_the_picture_shows_them():
    dot = station_dot(load_station("irb120_dynamic", {"servo.feedforward": "inverse_dynamics"}))
    assert "Feedforward: inverse dynamics" in dot.replace("\\n", " ")
    for overrides, shown in (
        (COMPUTED, "Computed torque"),
        ({"servo.law": "cascade"}, "joint_1: velocity"),
    ):
        assert shown in station_dot(load_station("irb120_dynamic", overrides))


def test_check_foretells_no_sag():
    texts = [
        finding.text
        for finding in check_station(
            load_station("irb120_dynamic", {"servo.feedforward": "gravity"})
        )
    ]
    assert any(
        "the servo's model compensates gravity, so the joint does not sag" in text for text in texts
    )
    assert not any("sags by" in text for text in texts)


@pytest.mark.parametrize(
    ("station", "overrides", "message"),
    [
        ("irb120_dynamic", {"servo.feedforward": "full"}, "known: gravity, inverse_dynamics, none"),
        (
            "irb120_dynamic",
            {"servo.law": "cascade", "servo.realization": "implicit"},
            "needs realization per_joint or",
        ),
        (
            "irb120_dynamic",
            {"servo.law": "cascade", "servo.admittance_gain": 5},
            "admittance_gain needs law pid",
        ),
        (
            "irb120_dynamic",
            {"servo.law": "cascade", "servo.kd": 0},
            "the smallest kd is 0.0; it must be positive",
        ),
        (
            "irb120_dynamic",
            {"servo.law": "cascade", "servo.speed_limit": 0},
            "a speed limit must be positive",
        ),
        ("irb120_dynamic", {"servo.speed_limit": 1}, "speed_limit needs law cascade"),
        ("irb120_kinematic", {"servo": {"law": "computed_torque"}}, "needs kp .* and kd"),
        ("irb120_dynamic", {**COMPUTED, "servo.feedforward": "gravity"}, "remove feedforward"),
        (
            "irb120_dynamic",
            {**COMPUTED, "servo.ki": 5},
            "servo.ki is 5.* it must be 0 with law computed_torque",
        ),
        (
            "humanoid_dynamic",
            {"servo.feedforward": "gravity"},
            "servo.feedforward is gravity; it must be none, since .* floating base",
        ),
    ],
)
def test_what_does_not_go_together_is_refused(station, overrides, message):
    with pytest.raises(SimrobError, match=message):
        simulate(load_station(station, overrides), progress=False)
