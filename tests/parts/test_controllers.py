"""Loops in a station: how they drive joints, act together, continue in a second run, and are refused."""

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.parts.controllers.touchdown import Touchdown
from simrob_drake.stations.load import station_yaml
from simrob_drake.stations.resolve import resolve

STILL = {
    "pieces": {},
    "floor": None,
    "solver": {"kind": "discrete", "time_step": 1e-3},
    "servo.realization": "implicit",
    "reference": {"kind": "hold", "target_deg": 0},
}
CELLS = [
    {"targets_deg": {"joint_5": 30}, "duration": 0.3},
    {"targets_deg": {"joint_1": -20, "joint_5": 0}},
]


def arm(**controllers):
    """Load the arm with a discrete solver, whose runs can be continued to the last bit."""
    return load_station("irb120_dynamic", {**STILL, "controllers": controllers})


def sequence(**changed):
    """Section of a sequencer with two cells."""
    return {"kind": "sequencer", "cells": CELLS, **changed}


def objective(**changed):
    """Section of an objective that raises the tool."""
    return {
        "kind": "objective",
        "measures": "tcp.z",
        "target": 0.6,
        "weights": {"joint_2": -1},
        "kp": 50,
        **changed,
    }


def balance(**changed):
    """Section of a balance with one strategy."""
    strategy = {"measures": "sagittal", "moves_deg": {"joint_5": 20}, "full": 0.1, **changed}
    return {"kind": "balance", "strategies": {"tip": strategy}}


@pytest.mark.long
def test_a_sequencer_waits_for_slow_servos_and_skips_no_cell():
    """Each cell is left once the robot is at its targets, which takes longer with a quarter of the stiffness."""
    ends = {}

    for factor in (1.0, 0.25):
        gains = {"servo.kp": 1000 * factor, "servo.kd": 20 / factor}
        controllers = {"controllers": {"sequence": sequence(speed_deg=1)}}
        config = load_station("irb120_dynamic", {**STILL, **gains, **controllers})
        result = simulate(config, duration=4.5)

        cell = result["sequence.cell"]
        done = result["sequence.done"]
        assert sorted(set(cell)) == [0, 1]
        assert (np.diff(cell) >= 0).all()
        assert done[-1] == 1
        end_of_first = np.argmax(cell > 0)
        end_of_last = np.argmax(done > 0)
        for section, row in zip(CELLS, (end_of_first, end_of_last), strict=True):
            for axis, target in section["targets_deg"].items():
                assert np.rad2deg(result[f"q.{axis}"][row]) == pytest.approx(target, abs=2.05)
        ends[factor] = result.times[end_of_last]

    assert ends[0.25] > ends[1.0] + 0.2


def test_a_late_cell_ends_the_run_and_names_the_joint():
    slow = load_station(
        "irb120_dynamic",
        {
            **STILL,
            "servo.torque_limit": {"joint_1": 0.001},
            "controllers": {"sequence": sequence(timeout=1.5)},
        },
    )

    result = simulate(slow, duration=5)

    assert result.ending == "monitor"
    assert result.stopped_by == "sequence"
    assert "cell 1 was not reached within 1.5 s; late: joint_1" in result.message


ACTING_GUARD = {
    "kind": "fall_guard",
    "height": 2.0,
    "duration": 0,
    "posture_deg": {"joint_5": 50, "joint_6": 10},
    "priority": 1,
}
"""A guard that acts at once: the base of the arm is below its bound."""


def test_a_loop_of_higher_priority_drives_its_own_axes_alone():
    result = simulate(arm(sequence=sequence(), above=ACTING_GUARD), duration=1.0)

    assert np.rad2deg(result["q_ref.joint_5"][-1]) == pytest.approx(50)
    assert np.rad2deg(result["q_ref.joint_6"][-1]) == pytest.approx(10)
    assert result["q_ref.joint_1"][-1] == result["sequence.target.joint_1"][-1]


def test_a_loop_with_a_weight_leaves_the_rest_to_the_loop_below():
    config = arm(sequence=sequence(weight=1), above={**ACTING_GUARD, "weight": 0.25})

    result = simulate(config, duration=1.0)

    below = result["sequence.target.joint_5"][-1]
    expected = 0.75 * below + 0.25 * np.deg2rad(50)
    assert result["q_ref.joint_5"][-1] == pytest.approx(expected)


def test_motor_protection_is_above_all_other_loops_whatever_their_priorities():
    guard = {
        "kind": "fall_guard",
        "height": 2.0,
        "duration": 0,
        "posture_deg": {"joint_2": 40},
        "priority": 7,
    }
    protection = {"kind": "motor_protection", "limit": {"joint_2": 5}, "hold": 0, "patience": 0.05}

    result = simulate(arm(protection=protection, guard=guard), duration=0.5)

    assert result["protection.stage"][-1] == 3
    assert result["guard.target.joint_2"][-1] == pytest.approx(np.deg2rad(40))
    reference = result["q_ref.joint_2"][-1]
    assert reference == pytest.approx(result["protection.target.joint_2"][-1], abs=1e-12)
    assert abs(reference - np.deg2rad(40)) > 0.1


def test_two_motor_protections_of_the_same_axes_are_refused():
    protection = {"kind": "motor_protection", "limit": {"joint_2": 5}, "hold": 0, "patience": 0.05}

    with pytest.raises(SimrobError, match=r"controllers\.protection also drives joint_1"):
        simulate(arm(protection=protection, other=protection), duration=0.1)


def test_a_run_is_continued_in_the_middle_of_a_cell_to_the_last_bit():
    guard = {"kind": "fall_guard", "height": 0.1, "posture_deg": {"joint_6": 5}, "priority": 1}
    config = arm(sequence=sequence(), guard=guard, lift=objective(ki=20, speed=0.05, priority=2))

    first = simulate(config, duration=0.5)
    second = simulate(config, duration=0.5, start=first.final_state)
    whole = simulate(config, duration=1.0)

    assert (second.values[-1] == whole.values[-1]).all()
    assert second["sequence.cell"][-1] == 1
    assert abs(whole["lift.offset.joint_2"][-1]) > 1e-3


def test_a_saved_station_runs_as_the_original(tmp_path):
    config = arm(sequence=sequence())
    (tmp_path / "station.yaml").write_text(station_yaml(config))

    result = simulate(config, duration=0.4)
    again = simulate(load_station(tmp_path / "station.yaml"), duration=0.4)

    assert (again.values == result.values).all()


@pytest.mark.parametrize(
    ("controllers", "words"),
    [
        ({"s": sequence(cells=[])}, "controllers.s.cells"),
        ({"s": sequence(cells=[{"targets_deg": {}}])}, "targets_deg"),
        (
            {"s": sequence(cells=[{"targets_deg": {"joint_5": 500}}])},
            "cells[0].targets_deg.joint_5 is 500",
        ),
        ({"s": sequence(cells=[{"targets_deg": {"joint_7": 5}}])}, "joint_7"),
        ({"s": sequence(timeout=None, on_timeout="wait")}, "on_timeout"),
        ({"s": sequence(on_timeout="go_on")}, "needs a timeout"),
        (
            {"g": {"kind": "fall_guard", "posture_deg": {"joint_1": 0}}},
            "height, tilt_deg or capture_point",
        ),
        (
            {"s": sequence(), "t": sequence()},
            "controllers.s also drives joint_1, joint_2, joint_3 ...; give the two loops different priorities",
        ),
        ({"s": sequence(reads={"position": "encoders"})}, "controllers.s.reads.position"),
        ({"s": sequence(reads={"angle": "encoders"})}, "controllers.s.reads"),
        ({"s": sequence(rate=5000)}, "time_step"),
        ({"s": sequence(robot="left")}, "left"),
        ({"s": sequence(weight=0)}, "weight"),
        ({"o": objective(weights={"joint_9": 1})}, "joint_9"),
        ({"o": objective(weights={"joint_2": 0})}, "all weights are 0"),
        ({"o": objective(kp=0)}, "kp and ki are both 0"),
        ({"o": objective(measures="base.height")}, "controllers.o.measures"),
        ({"o": objective(then_deg={"joint_5": 10})}, "needs the key tolerance"),
        ({"o": objective(target=[])}, "empty"),
        (
            {"b": balance()},
            "controllers.b: robot has no feet, or its base is fixed; name a robot that stands",
        ),
        ({"b": balance(moves_deg={"hip": 20})}, "hip"),
        ({"b": balance(moves_deg={"joint_5": 0})}, "all moves_deg are 0"),
        ({"b": balance(beyond=0.1)}, "full is 0.1 m; it must be larger than beyond, 0.1 m"),
        ({"b": balance(measures="up")}, "controllers.b.strategies.tip.measures"),
        ({"b": {"kind": "balance", "strategies": {}}}, "neither strategies nor steps"),
    ],
)
def test_what_cannot_be_is_refused_by_its_key(controllers, words):
    with pytest.raises(SimrobError) as caught:
        simulate(arm(**controllers), duration=0.1)
    assert words in str(caught.value)


def test_a_kinematic_station_has_no_loops():
    with pytest.raises(SimrobError, match="dynamic"):
        load_station("irb120_kinematic", {"controllers": {"s": sequence()}})


GUARD = {"kind": "fall_guard", "height": 0.2}


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"controllers.touchdown.reads": {}}, "reads of the touchdown loop"),
        ({"controllers.touchdown.reads": {"rear_left_foot": "force.rear_lift"}}, "rear_left"),
        ({"controllers.touchdown.reads.hand": "force.rear_left"}, "hand"),
        ({"controllers.touchdown.force": 0}, "force"),
        ({"controllers.touchdown.holds": "heights"}, "torques"),
        (
            {
                "controllers.other": {
                    "kind": "fall_guard",
                    "height": 0.2,
                    "posture_deg": {"rear_left_knee": 0},
                }
            },
            "different priorities",
        ),
    ],
)
def test_a_touchdown_that_cannot_be_is_refused(overrides, message):
    with pytest.raises(SimrobError, match=message):
        simulate(
            load_station("yobotics_terrain", {"floor.terrain": None, **overrides}), duration=0.1
        )


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"foot": "left_hand"}, "foot 'left_hand'; known: left_foot, right_foot"),
        ({"reach_deg": {"tail": 5}}, "tail"),
        ({"lift_deg": {}}, "lift_deg"),
        ({"beyond": 0}, "beyond"),
        ({"duration": 0}, "duration"),
        ({"stance": 2}, "stance"),
    ],
)
def test_a_step_that_cannot_be_is_refused(changed, message):
    step = {f"controllers.balance.steps.forward.{key}": value for key, value in changed.items()}
    with pytest.raises(SimrobError, match=message):
        load_station("zjudancer_balance", step)


def test_touchdown_drives_the_legs_of_its_feet_alone():
    robot = resolve(load_station("yobotics_terrain")).robots["robot"]
    loop = Touchdown(kind="touchdown", reads={"front_left_foot": "force.front_left"})
    assert loop.axes(robot) == ["front_left_hip_roll", "front_left_hip_pitch", "front_left_knee"]


def test_an_objective_does_under_drakes_integrators_what_it_does_with_steps_of_the_plant():
    """Sampled expressions refuse to be asked for derivatives, as these integrators do with every system."""
    ends = []
    for solver in (
        {"kind": "continuous", "scheme": "radau3"},
        {"kind": "discrete", "time_step": 0.001},
    ):
        changes = {"controllers": {"lift": objective()}, "solver": solver, "duration": 0.5}
        result = simulate(load_station("irb120_dynamic", changes), progress=False)
        assert result.ending == "completed", result.message
        ends.append(result["lift.offset.joint_2"][-1])

    assert abs(ends[0]) > 0.01
    assert ends[0] == pytest.approx(ends[1], rel=0.05)
