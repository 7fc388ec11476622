"""The state that goes from one run to the next: resumed runs against runs in one go."""

from dataclasses import replace

import numpy as np
import pytest

from simrob_drake import SimrobError, State, load_station, simulate
from simrob_drake.results.record.state import JointState

HOLD = {"reference": {"kind": "hold", "target_deg": None}}


@pytest.mark.long
@pytest.mark.parametrize(
    ("overrides", "tolerance"),
    [
        ({}, 3e-4),  # that of the solver; a fresh start from rest would be off by 0.01
        ({"solver.accuracy": 1e-5, "solver.max_step": 0.01}, 1e-6),
        ({"servo.ki": 300}, 5e-4),  # the integrators go on
        ({"servo.ki": 300, "servo.realization": "implicit"}, 5e-4),
        ({"solver.kind": "discrete", "servo.realization": "implicit"}, 0),
    ],
)
def test_two_halves_are_the_whole(overrides, tolerance):
    """A run that begins in the final state of another one continues its motion, within the accuracy of the solver."""
    whole = simulate(load_station("irb120_dynamic", overrides))
    first = simulate(load_station("irb120_dynamic", overrides), duration=1.5)
    second = simulate(
        load_station("irb120_dynamic", {**overrides, **HOLD}), duration=1.5, start=first.final_state
    )

    row = int(np.searchsorted(whole.times, 1.5 - 1e-9))

    assert np.abs(first.axes("v")[-1]).max() > 1e-4  # it has not come to rest
    np.testing.assert_allclose(second.axes("q"), whole.axes("q")[row:], atol=tolerance)
    np.testing.assert_array_equal(second.axes("q")[0], first.axes("q")[-1])
    np.testing.assert_array_equal(second.axes("v")[0], first.axes("v")[-1])
    assert second.times[0] == 0.0


def test_the_references_of_a_station_begin_where_the_last_ended():
    """The reference of a run with a start state begins at the last reference of the run before."""
    first = simulate(load_station("irb120_kinematic"))
    back = {"reference.target_deg": {"joint_1": 0}}

    second = simulate(load_station("irb120_kinematic", back), start=first.final_state)

    np.testing.assert_allclose(second.axes("q")[0], np.full(6, np.pi / 6))
    # the station's stays what it is
    np.testing.assert_array_equal(second.plant.robots["robot"].initial, np.zeros(6))
    np.testing.assert_allclose(second.axes("q")[-1], [0, *[np.pi / 6] * 5], atol=1e-12)


def test_a_kinematic_state_starts_a_dynamic_run():
    """Positions and velocities are passed on from a kinematic run, which has no plant that is stepped."""
    state = simulate(load_station("irb120_kinematic"), duration=0.5).final_state
    result = simulate(load_station("irb120_dynamic", HOLD), duration=0.1, start=state)

    np.testing.assert_allclose(result.axes("q")[0], state.positions["robot"], atol=1e-15)
    np.testing.assert_allclose(result.axes("v")[0], state.velocities["robot"], atol=1e-15)
    assert np.abs(state.velocities["robot"]).max() > 0.5


def test_a_changed_station_takes_what_it_has_in_common():
    """States of joints and servos are passed on by name if a piece of the station has another parent."""
    overrides = {
        "servo.ki": 100,
        "servo.realization": "vector",
        "monitors": {"settled": {"after": 5}},
    }
    first = simulate(load_station("irb120_dynamic", overrides), duration=1.5)

    # no monitor: its times are those of a run
    assert list(first.final_state.blocks) == ["servo.integrator"]

    lighter = {**HOLD, **overrides, "pieces": {"gripper": {"parent": "world"}}}
    second = simulate(
        load_station("irb120_dynamic", lighter), duration=0.2, start=first.final_state
    )

    np.testing.assert_array_equal(second.axes("q")[0], first.axes("q")[-1])
    # the same servo state
    np.testing.assert_array_equal(second.axes("tau")[0], first.axes("tau")[-1])
    # the arm rises, two kilograms lighter
    assert second["q.joint_2"][-1] < first["q.joint_2"][-1] - 0.002


def test_a_stopped_run_ends_in_the_state_of_its_stop():
    """The final state of a run that a monitor ended is the state at the time of the stop."""
    config = load_station(
        "irb120_dynamic", {"servo.torque_limit": 10, "monitors": {"joint_limit": {}}}
    )
    result = simulate(config)

    assert result.final_state.positions["robot"][1] == pytest.approx(np.deg2rad(110), abs=1e-3)
    np.testing.assert_array_equal(result.final_state.positions["robot"], result.axes("q")[-1])


def test_a_state_survives_as_text():
    """A state that was written as JSON and read again gives the same run to the last bit."""
    state = simulate(load_station("irb120_dynamic", {"servo.ki": 100}), duration=0.3).final_state
    again = State.from_json(state.to_json())

    runs = [
        simulate(load_station("irb120_dynamic", {"servo.ki": 100}), duration=0.2, start=start)
        for start in (state, again)
    ]

    np.testing.assert_array_equal(runs[0].values, runs[1].values)
    assert runs[1].start is again


EMPTY = '{"positions": {}, "velocities": {}, "references": {}, "joints": {}, "blocks": {}}'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "state: is not JSON"),
        ("[]", "state: must be a section with keys among: positions"),
        ("{}", "state: positions: this key is required"),
        ('{"positions": 1}', "state: positions: must be a section"),
        (
            EMPTY.replace("{}", '{"robot": [1, "2"]}', 1),
            r"state: positions.robot.*number \(it is '2'\)",
        ),
        (
            EMPTY.replace("{}", '{"robot": [NaN]}', 1),
            "state: is not JSON: NaN is not a finite number",
        ),
        (EMPTY.replace("joints", "joint"), "state: joint: unknown key; did you mean 'joints'"),
        (
            EMPTY.replace('"joints": {}', '"joints": {"robot/elbow": [[0]]}'),
            "state: joints.robot/elbow",
        ),
        (EMPTY.replace("{}}", '{"servo": [[0], [0], []]}}'), "state: blocks.servo"),
    ],
)
def test_other_texts_are_refused(text, told):
    """Each fault of a file with a state raises an error that names the key."""
    with pytest.raises(SimrobError, match=told):
        State.from_json(text)


def test_a_state_that_does_not_fit_its_blocks_and_joints_is_refused():
    """A joint of another size raises an error with its name and both sizes."""
    state = simulate(load_station("double_pendulum"), duration=0.01).final_state
    joint = next(iter(state.joints))

    odd = replace(state, joints={joint: JointState(np.zeros(1), np.zeros(3))})

    with pytest.raises(
        SimrobError, match=f"'{joint}' has size 3; it must be a state in which it has size 1"
    ):
        simulate(load_station("double_pendulum"), duration=0.01, start=odd)


def test_the_state_of_other_robots_is_refused():
    """A state whose robot has another count of axes, or is missing, raises an error with the name of the robot."""
    state = simulate(load_station("double_pendulum"), duration=0.1).final_state
    with pytest.raises(
        SimrobError,
        match="start is a state in which 'robot' has 2 axes; it must be a state in which it has 6 axes",
    ):
        simulate(load_station("irb120_dynamic"), duration=0.1, start=state)
    with pytest.raises(SimrobError, match="start is a state in which 'left' is missing"):
        simulate(load_station("two_irb120"), duration=0.1, start=state)


@pytest.mark.parametrize(("scale", "length"), [(0.0, "0"), (0.5, "0.5"), (2.0, "2")])
def test_a_quaternion_of_another_length_is_refused(scale, length):
    """A quaternion of another length than 1 raises an error instead of being normalized silently."""
    state = simulate(load_station("bouncing_ball"), duration=0.01, progress=False).final_state
    ((name, joint),) = state.joints.items()
    position = joint.position.copy()
    position[:4] *= scale

    wrong = replace(state, joints={name: JointState(position, joint.velocity)})

    with pytest.raises(
        SimrobError, match=rf"the quaternion of .* is of length {length}; it must be of length 1"
    ):
        simulate(load_station("bouncing_ball"), duration=0.01, progress=False, start=wrong)
