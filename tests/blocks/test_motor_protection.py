"""The loop that protects motors, alone: heat against its closed form, what gives way, what stops and lets go."""

import numpy as np
import pytest

from simrob_drake.blocks.sampled import RunEnds
from simrob_drake.parts.controllers.efforts import GuardedMotors, MotorProtection
from tests.blocks.test_loop import Driven

T = 0.01


def motors(limit=(40.0, np.inf), nominal=(20.0, np.inf), fastest=1.0, **changed):
    figures = {"kind": "motor_protection", "thermal_time": 2.0, "hold": 0.02, "patience": 0.1, **changed}
    return GuardedMotors(
        MotorProtection.model_validate(figures),
        limit=np.array(limit),
        nominal=np.array(nominal),
        stiffness=np.array([1000.0, 500.0]),
        fastest=np.full(2, fastest),
        names=["hip", "knee"],
        units=["N·m", "N·m"],
    )


def sample(driven, torque, *, position=(0.1, 0.2), asked=(0.5, 0.6), **read):
    return driven.sample(torque=np.array([torque, 7.0]), position=np.array(position), asked=np.array(asked), **read)


def test_heat_follows_its_differential_equation_and_knows_no_sign():
    driven, times = Driven(motors(limit=np.full(2, np.inf))), T * np.arange(1, 101)
    seen = np.array([sample(driven, torque)["heat"] for torque in [16.0] * 50 + [-16.0] * 50])
    assert seen[:, 0] == pytest.approx((16 / 20) ** 2 * (1 - np.exp(-times / 2.0)), rel=1e-12)
    assert (seen[:, 1] == 0).all()
    cooling = np.array([sample(driven, 0.0)["heat"][0] for _ in range(100)])
    assert cooling == pytest.approx(seen[-1, 0] * np.exp(-times / 2.0), rel=1e-12)


def test_an_axis_gives_way_until_the_torque_of_its_servo_is_at_the_limit():
    """A joint that is stuck: its servo gives what is left between reference and position, up to 150 N·m."""
    cold = {"nominal": np.full(2, np.inf), "patience": 1.0}
    driven, offset, seen = Driven(motors(**cold)), 0.0, []
    for _ in range(20):
        torque = min(1000 * (0.3 + offset), 150.0)
        given = sample(driven, torque)
        offset = given["offset"][0]
        seen.append((torque, given["stage"][0]))
    torques, stages = np.array(seen).T
    assert stages[:3].tolist() == [0, 0, 2]  # it must last
    assert (torques[:3] == 150).all()
    assert torques[3:6] == pytest.approx([150, 80, 40])  # it was saturated: 0.3 rad would give 300
    assert torques[6:] == pytest.approx(40)
    assert offset == pytest.approx(0.04 - 0.3)


def test_it_comes_back_at_its_own_speed_once_it_can_and_guards_again():
    driven = Driven(motors(hold=0.0, patience=1.0, fastest=2.0))
    sample(driven, 90.0)
    seen = [sample(driven, torque) for torque in (10.0, 28.0, 10.0, 10.0)]
    assert [given["offset"][0] for given in seen] == pytest.approx([-0.03, -0.018, 0, 0])
    assert [given["stage"][0] for given in seen] == [2, 2, 0, 0]


def test_a_motor_that_is_too_warm_warns_and_may_give_no_more_than_forever():
    driven = Driven(motors(thermal_time=0.1, hold=0.02, patience=10.0))
    torque, stages, heats = 30.0, [], []
    for _ in range(60):
        given = sample(driven, torque)
        torque = 30.0 + 1000 * given["offset"][0]
        stages.append(given["stage"][0])
        heats.append(given["heat"][0])
    crossing = [np.log(2.25 / (2.25 - level)) * 0.1 / T for level in (0.8, 1.0)]  # 2.25 (1 - exp(-t / 0.1)) = level
    assert [stages.index(1), stages.index(2)] == [int(samples) for samples in crossing]
    assert torque == pytest.approx(20, abs=1.0)
    assert max(heats) < 1.1
    assert heats[-1] == pytest.approx(1, abs=0.02)


def test_it_stops_when_it_has_given_way_for_too_long_and_holds_where_it_was():
    driven = Driven(motors())
    seen = [sample(driven, 60.0, position=(0.1 + 0.001 * k, 0.2)) for k in range(30)]
    stages = [given["stage"][0] for given in seen]
    assert (stages.index(2), stages.index(3)) == (2, 12)
    assert seen[-1]["target"] == pytest.approx([0.112, 0.2])
    assert (seen[11]["active"], seen[12]["active"]) == (0, 1)


def test_it_lets_go_without_a_jump_once_all_was_well():
    driven = Driven(motors(hold=0.02, patience=0.1, reset_after=0.05))
    while sample(driven, 60.0)["stage"] != 3:
        pass
    held = sample(driven, 60.0)["target"]
    seen = [sample(driven, 5.0) for _ in range(7)]
    assert [given["active"][0] for given in seen] == [1, 1, 1, 1, 0, 0, 0]
    assert seen[4]["offset"] + [0.5, 0.6] == pytest.approx(held)  # offset from what is asked now
    assert seen[6]["offset"] == pytest.approx(seen[4]["offset"] + 2 * T)


def test_a_force_stops_it_at_once_and_can_end_the_run():
    driven = Driven(motors(force=140.0, hold=0.0, patience=0.1))
    assert sample(driven, 5.0, force=[80.0, 80.0, -80.0])["stage"] == 0  # 139 N
    assert sample(driven, 5.0, force=[0.0, 0.0, 141.0])["stage"] == 3
    loop = motors(force=140.0, hold=0.0, patience=0.1, then="end")
    memory = {name: np.zeros(2) for name in ("offset", "heat", "above")}
    memory |= {name: np.zeros(1) for name in ("stage", "pressed", "lasts")}
    with pytest.raises(RunEnds, match="above 140 N"):
        loop.sample(memory, {"torque": np.zeros(2), "position": np.zeros(2), "force": np.array([0, 0, 141.0])})


def test_the_reason_names_the_axis_and_its_limit():
    loop = motors(then="end")
    memory = {name: np.zeros(2) for name in ("offset", "heat", "above")}
    memory |= {"stage": np.array([2.0]), "pressed": np.zeros(1), "lasts": np.array([0.1])}
    with pytest.raises(RunEnds, match=r"hip was held at 40 N·m for 0\.11 s"):
        loop.sample(memory, {"torque": np.array([60.0, 0.0]), "position": np.zeros(2)})
