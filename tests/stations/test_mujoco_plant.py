"""A station whose plant MuJoCo steps: its steps compared with their equations, and its runs with those of Drake."""

import gc

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import LeafSystem

from simrob_drake import build_station, load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.simulation.runner import Runner

pytest.importorskip("mujoco", reason="installed with the extra mujoco")

STEP = 0.002
MUJOCO = {"solver": {"kind": "mujoco", "time_step": STEP}}
EACH_STEP = {**MUJOCO, "sample_rate": 1 / STEP}
TURN = {"kind": "move", "duration": 0.1, "target_deg": {"left_elbow": 40, "left_knee": 30}}


def in_both(station, overrides, **changes):
    """Run a station with its own solver and with MuJoCo. Returns both results."""
    return [
        simulate(load_station(station, {**overrides, **own}), **changes) for own in ({}, MUJOCO)
    ]


def test_motors_give_what_their_law_says_at_the_end_of_each_step_and_no_more_than_their_limit():
    """With light links, kd h / M far above 2, and torque limits that are reached, an explicit servo would chatter."""
    overrides = {**EACH_STEP, "servo.torque_limit": 0.8, "reference": TURN}
    result = simulate(load_station("humanoid_dynamic", overrides), duration=0.3)
    gains = result.plant.robots["robot"].gains

    law = (
        gains.kp * (result.axes("q_ref")[:-1] - result.axes("q")[1:])
        - gains.kd * result.axes("v")[1:]
    )

    np.testing.assert_allclose(result.axes("tau")[1:], np.clip(law, -0.8, 0.8), atol=1e-6)
    assert (np.abs(law) > 0.8).sum() > 20
    assert not any("torque" in text and "chatter" in text for text in result.warnings)


def test_contacts_stay_as_stiff_while_servos_are_at_their_limits():
    """MuJoCo softens a contact by the stiffness of the servos behind it, which is zero for a saturated ankle."""
    limits = {"torque_limit": {"left_ankle_pitch": 0.02, "right_ankle_pitch": 0.02}}
    drake, mujoco = in_both(
        "humanoid_dynamic",
        {"servo": {"kp": 100, "kd": 100, "realization": "implicit", **limits}},
        duration=0.3,
    )
    np.testing.assert_allclose(mujoco["base.z"], drake["base.z"], atol=2e-4)


def test_a_push_gives_a_free_box_its_impulse_and_moment_of_momentum():
    push = {
        "push": {"kind": "push", "at": "box", "force": [3, 0, 0], "start": 0.1, "duration": 0.1}
    }
    overrides = {
        **MUJOCO,
        "gravity": 0,
        "forces": push,
        "pieces.box.pose": [0, 0, 1, 0, 0, 0],
        "pieces.box.com": [0, 0, -0.02],
    }
    result = simulate(load_station("box_on_floor", overrides), duration=0.3)

    inertia = result.plant.free_pieces["box"].default_spatial_inertia()

    speed = result["piece.box.vx"][-1] - 0.02 * result["piece.box.wy"][-1]  # of the centre of mass
    assert speed * inertia.get_mass() == pytest.approx(0.3, rel=0.02)

    about_centre = inertia.Shift(inertia.get_com()).CalcRotationalInertia().get_moments()
    assert result["piece.box.wy"][-1] * about_centre[1] == pytest.approx(0.02 * 0.3, rel=0.03)


def test_a_force_sensor_feels_the_weight_that_rests_on_it():
    sensor = {"sensors": {"sole": {"kind": "force", "body": "box"}}}
    for result in in_both("box_on_floor", sensor, duration=1.0):
        weight = result.plant.free_pieces["box"].default_mass() * 9.80665
        np.testing.assert_allclose(
            result.vector("force.sole")[-1], [0, 0, weight], rtol=1e-3, atol=0.01
        )


@pytest.mark.long
def test_a_loop_balances_and_walks_as_in_drake():
    drake, mujoco = in_both("yobotics_walking", {}, duration=3.0)

    assert drake.ending == mujoco.ending == "completed"
    assert mujoco["base.x"][-1] == pytest.approx(drake["base.x"][-1], rel=0.05)
    assert not any("deep" in text for text in mujoco.warnings)


def test_runs_are_equal_and_go_on_from_each_other_across_engines():
    config = load_station("roid1_dynamic", MUJOCO)
    first, again = (Runner(config).run(duration=0.4) for _ in range(2))

    np.testing.assert_array_equal(first.values, again.values)

    there = simulate("roid1_dynamic", duration=0.2, start=first.final_state)
    back = simulate(config, duration=0.2, start=there.final_state)

    np.testing.assert_allclose(there["base.z"][0], first["base.z"][-1], atol=1e-12)
    np.testing.assert_allclose(back["q.left_knee"][0], there["q.left_knee"][-1], atol=1e-12)


def test_nothing_of_a_run_stays():
    def living():
        gc.collect()
        return sum(issubclass(type(each), MultibodyPlant | LeafSystem) for each in gc.get_objects())

    config = load_station("humanoid_dynamic", MUJOCO)
    before = living()
    result = simulate(config, duration=0.01)
    assert living() > before
    del result
    assert living() == before


def test_a_monitor_ends_a_run():
    overrides = {
        **MUJOCO,
        "monitors": {"fall": {"kind": "fall"}},
        "forces": {"push": {"kind": "push", "force": [60, 0, 0]}},
    }
    result = simulate(load_station("zjudancer_dynamic", overrides), duration=4.0)

    assert result.stopped_by == "fall"
    assert result.stop_time < 3


@pytest.mark.parametrize(
    ("station", "changes", "told"),
    [
        (
            "irb120_dynamic",
            {},
            "solver.time_step is 0.002 s; it must be at most 0.00025 s, or servo.realization implicit",
        ),
        (
            "humanoid_dynamic",
            {"contact.model": "hydroelastic"},
            "contact.model is hydroelastic; it must be point",
        ),
        (
            "irb120_dynamic",
            {"sensors.t.kind": "joint_torque"},
            "mujoco does not compute the reaction forces of joints",
        ),
    ],
)
def test_what_mujoco_does_not_know_is_refused(station, changes, told):
    with pytest.raises(SimrobError, match=told):
        build_station(load_station(station, {**changes, **MUJOCO}))
