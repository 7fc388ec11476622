"""The loop that protects motors, alone: its heat against the closed form, giving way, stopping and release."""

import numpy as np
import pytest

from simrob_drake.blocks.sampled import RunEnds
from simrob_drake.parts.controllers.efforts import GuardedMotors, MotorProtection
from tests.blocks.test_loop import Driven

T = 0.01  # period of the samples [s]


def motors(limit=(40.0, np.inf), nominal=(20.0, np.inf), fastest=1.0, **changed):
    """A loop that protects the motor of a hip; the knee has no limits. Keys of the section may be changed."""
    section = {"kind": "motor_protection", "thermal_time": 2.0, "hold": 0.02, "patience": 0.1, **changed}
    return GuardedMotors(
        MotorProtection.model_validate(section),
        limit=np.array(limit),
        nominal=np.array(nominal),
        stiffness=np.array([1000.0, 500.0]),
        fastest=np.full(2, fastest),
        names=["hip", "knee"],
        units=["N·m", "N·m"],
    )


def sample(driven, torque, *, position=(0.1, 0.2), asked=(0.5, 0.6), **read):
    """Take a sample with a torque of the hip [N·m]. Returns the outputs by name."""
    return driven.sample(torque=np.array([torque, 7.0]), position=np.array(position), asked=np.array(asked), **read)


def test_heat_follows_its_differential_equation_and_knows_no_sign():
    """Heat goes to (tau / nominal)² with the thermal time, and back to 0 in the same way."""
    torque = 16.0
    nominal = 20.0
    thermal_time = 2.0
    times = T * np.arange(1, 101)
    driven = Driven(motors(limit=np.full(2, np.inf), nominal=(nominal, np.inf), thermal_time=thermal_time))

    heats = np.array([sample(driven, value)["heat"] for value in [torque] * 50 + [-torque] * 50])
    cooling = np.array([sample(driven, 0.0)["heat"][0] for _ in range(100)])

    assert heats[:, 0] == pytest.approx((torque / nominal) ** 2 * (1 - np.exp(-times / thermal_time)), rel=1e-12)
    assert (heats[:, 1] == 0).all()
    assert cooling == pytest.approx(heats[-1, 0] * np.exp(-times / thermal_time), rel=1e-12)


def test_an_axis_gives_way_until_the_torque_of_its_servo_is_at_the_limit():
    """A joint that is stuck: its servo gives what is left between reference and position, up to 150 N·m."""
    stiffness = 1000  # [N·m/rad]
    error = 0.3  # [rad]
    saturation = 150.0  # [N·m]
    driven = Driven(motors(nominal=np.full(2, np.inf), patience=1.0))

    offset = 0.0
    torques = []
    stages = []
    for _ in range(20):
        torques.append(min(stiffness * (error + offset), saturation))
        outputs = sample(driven, torques[-1])
        offset = outputs["offset"][0]
        stages.append(outputs["stage"][0])

    assert stages[:3] == [0, 0, 2]  # the overload must last
    assert torques[:3] == [saturation] * 3
    # The servo was saturated: 0.3 rad would give 300 N·m, so the first step back changes nothing.
    assert torques[3:6] == pytest.approx([150, 80, 40])
    assert torques[6:] == pytest.approx([40] * 14)
    assert offset == pytest.approx(40 / stiffness - error)


def test_it_comes_back_at_its_own_speed_once_it_can_and_guards_again():
    """The offset goes back by 2 rad/s where the torque allows it, and is 0 again in the end."""
    driven = Driven(motors(hold=0.0, patience=1.0, fastest=2.0))
    sample(driven, 90.0)
    seen = [sample(driven, torque) for torque in (10.0, 28.0, 10.0, 10.0)]
    assert [given["offset"][0] for given in seen] == pytest.approx([-0.03, -0.018, 0, 0])
    assert [given["stage"][0] for given in seen] == [2, 2, 0, 0]


def test_a_motor_that_is_too_warm_warns_and_may_give_no_more_than_forever():
    """The stages 1 and 2 begin at 0.8 and 1 of the heat; then the torque falls to the nominal one of 20 N·m."""
    overload = 30.0  # [N·m]
    stiffness = 1000  # [N·m/rad]
    thermal_time = 0.1  # [s]
    driven = Driven(motors(thermal_time=thermal_time, hold=0.02, patience=10.0))

    torque = overload
    stages = []
    heats = []
    for _ in range(60):
        outputs = sample(driven, torque)
        torque = overload + stiffness * outputs["offset"][0]
        stages.append(outputs["stage"][0])
        heats.append(outputs["heat"][0])

    # (30 / 20)² (1 - exp(-t / T)) = level
    final_heat = (overload / 20) ** 2
    crossing = [np.log(final_heat / (final_heat - level)) * thermal_time / T for level in (0.8, 1.0)]
    assert [stages.index(1), stages.index(2)] == [int(samples) for samples in crossing]
    assert torque == pytest.approx(20, abs=1.0)
    assert max(heats) < 1.1
    assert heats[-1] == pytest.approx(1, abs=0.02)


def test_it_stops_when_it_has_given_way_for_too_long_and_holds_where_it_was():
    """After 0.1 s of giving way, the loop takes the reference over, and holds the positions of that moment."""
    driven = Driven(motors())

    samples = [sample(driven, 60.0, position=(0.1 + 0.001 * k, 0.2)) for k in range(30)]

    stages = [outputs["stage"][0] for outputs in samples]
    assert stages.index(2) == 2
    assert stages.index(3) == 12
    assert samples[-1]["target"] == pytest.approx([0.112, 0.2])
    assert samples[11]["active"] == 0
    assert samples[12]["active"] == 1


def test_it_lets_go_without_a_jump_once_all_was_well():
    """After 0.05 s without overload the loop is released: its offset begins where it held, and goes back by 1 rad/s."""
    reference = np.array([0.5, 0.6])
    driven = Driven(motors(hold=0.02, patience=0.1, reset_after=0.05))
    while sample(driven, 60.0)["stage"] != 3:
        pass
    held = sample(driven, 60.0)["target"]

    samples = [sample(driven, 5.0, asked=reference) for _ in range(7)]

    assert [outputs["active"][0] for outputs in samples] == [1, 1, 1, 1, 0, 0, 0]
    assert samples[4]["offset"] + reference == pytest.approx(held)
    assert samples[6]["offset"] == pytest.approx(samples[4]["offset"] + 2 * T)


def test_a_force_stops_it_at_once():
    """The size of the force vector counts: 139 N are below the limit of 140 N, 141 N above."""
    driven = Driven(motors(force=140.0, hold=0.0, patience=0.1))

    assert sample(driven, 5.0, force=[80.0, 80.0, -80.0])["stage"] == 0
    assert sample(driven, 5.0, force=[0.0, 0.0, 141.0])["stage"] == 3


def test_a_force_can_end_the_run():
    """With `then: end`, a force above the limit ends the run, and the reason names the limit."""
    loop = motors(force=140.0, hold=0.0, patience=0.1, then="end")
    memory = {name: np.zeros(2) for name in ("offset", "heat", "above")}
    memory |= {name: np.zeros(1) for name in ("stage", "pressed", "lasts")}
    read = {"torque": np.zeros(2), "position": np.zeros(2), "force": np.array([0, 0, 141.0])}

    with pytest.raises(RunEnds, match="above 140 N"):
        loop.sample(memory, read)


def test_the_reason_names_the_axis_and_its_limit():
    loop = motors(then="end")
    memory = {name: np.zeros(2) for name in ("offset", "heat", "above")}
    memory |= {"stage": np.array([2.0]), "pressed": np.zeros(1), "lasts": np.array([0.1])}
    with pytest.raises(RunEnds, match=r"hip was held at 40 N·m for 0\.11 s"):
        loop.sample(memory, {"torque": np.array([60.0, 0.0]), "position": np.zeros(2)})
