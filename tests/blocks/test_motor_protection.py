"""Motor protection as a block: heat against its closed form, giving way, stopping and releasing the robot."""

import numpy as np
import pytest

from simrob_drake.blocks.sampled import RunEnds
from simrob_drake.parts.controllers.efforts import GuardedMotors, MotorProtection
from tests.blocks.test_loop import Driven

PERIOD = 0.01  # s between samples
LIMIT = 40.0  # N·m, of the first axis
NOMINAL = 20.0  # N·m, that its motor may give forever
KP = 1000.0  # N·m/rad, of its servo
THERMAL_TIME = 2.0  # s
UNWATCHED = np.full(2, np.inf)

# Stages, as the output `stage` gives them.
WATCHES, WARNS, GIVES_WAY, STOPPED = range(4)


def motors(limit=(LIMIT, np.inf), nominal=(NOMINAL, np.inf), fastest=1.0, **changed):
    """A loop for two axes, of which only the first one is watched; ``changed`` are keys of its section."""
    section = {
        "kind": "motor_protection",
        "thermal_time": THERMAL_TIME,
        "hold": 0.02,
        "patience": 0.1,
        **changed,
    }
    return GuardedMotors(
        MotorProtection.model_validate(section),
        limit=np.array(limit),
        nominal=np.array(nominal),
        stiffness=np.array([KP, 500.0]),
        return_speed=np.full(2, fastest),
        names=["hip", "knee"],
        units=["N·m", "N·m"],
    )


def sample(driven, torque, *, position=(0.1, 0.2), asked=(0.5, 0.6), **read):
    """Sample with a torque of the first axis [N·m]."""
    return driven.sample(
        torque=np.array([torque, 7.0]), position=np.array(position), asked=np.array(asked), **read
    )


def begun_memory(**changed):
    """Memory of a loop that has just begun, but for what is changed."""
    memory = {name: np.zeros(2) for name in ("offset", "heat", "above")}
    memory |= {name: np.zeros(1) for name in ("stage", "pressed", "lasts")}
    return {**memory, **changed}


def test_heat_follows_its_differential_equation_and_the_sign_of_a_torque_is_of_no_effect():
    """The heat approaches (torque / nominal)² exponentially at a constant torque, and 0 without a torque."""
    driven = Driven(motors(limit=UNWATCHED))
    torques = [16.0] * 50 + [-16.0] * 50

    heats = np.array([sample(driven, torque)["heat"] for torque in torques])
    cooling = np.array([sample(driven, 0.0)["heat"][0] for _ in range(100)])

    decay = np.exp(-PERIOD * np.arange(1, 101) / THERMAL_TIME)
    assert heats[:, 0] == pytest.approx((16 / NOMINAL) ** 2 * (1 - decay), rel=1e-12)
    assert (heats[:, 1] == 0).all()
    assert cooling == pytest.approx(heats[-1, 0] * decay, rel=1e-12)


def test_an_axis_gives_way_until_the_torque_of_its_servo_is_at_the_limit():
    """A joint that is stuck: its servo gives what is left between reference and position, up to 150 N·m."""
    deviation = 0.3  # rad, of the joint from its reference
    driven = Driven(motors(nominal=UNWATCHED, patience=1.0))
    offset = 0.0
    torques = []
    stages = []
    for _ in range(20):
        torques.append(min(KP * (deviation + offset), 150.0))
        outputs = sample(driven, torques[-1])
        offset = outputs["offset"][0]
        stages.append(outputs["stage"][0])

    assert stages[:3] == [WATCHES, WATCHES, GIVES_WAY]  # an overload must last
    assert torques[:3] == [150, 150, 150]
    assert torques[3:6] == pytest.approx([150, 80, 40])  # it was saturated: 0.3 rad would give 300
    assert torques[6:] == pytest.approx([LIMIT] * 14)
    assert offset == pytest.approx(LIMIT / KP - deviation)


def test_it_comes_back_at_its_own_speed_once_it_can_and_guards_again():
    """The offset of -0.05 rad returns by 0.02 rad a sample, or by what the limit permits."""
    driven = Driven(motors(hold=0.0, patience=1.0, fastest=2.0))
    sample(driven, 90.0)

    outputs = [sample(driven, torque) for torque in (10.0, 28.0, 10.0, 10.0)]

    assert [output["offset"][0] for output in outputs] == pytest.approx([-0.03, -0.018, 0, 0])
    assert [output["stage"][0] for output in outputs] == [GIVES_WAY, GIVES_WAY, WATCHES, WATCHES]


def test_a_motor_that_is_too_warm_warns_and_may_give_no_more_than_forever():
    """A torque of 1.5 times the nominal one heats up to 2.25; from 1 on the axis gives way to the nominal torque."""
    thermal_time = 0.1
    driven = Driven(motors(thermal_time=thermal_time, hold=0.02, patience=10.0))
    torque = 30.0
    stages = []
    heats = []
    for _ in range(60):
        outputs = sample(driven, torque)
        torque = 30.0 + KP * outputs["offset"][0]
        stages.append(outputs["stage"][0])
        heats.append(outputs["heat"][0])

    # 2.25 (1 - exp(-t / thermal_time)) = level
    times = [np.log(2.25 / (2.25 - level)) * thermal_time for level in (0.8, 1.0)]
    assert [stages.index(WARNS), stages.index(GIVES_WAY)] == [int(time / PERIOD) for time in times]
    assert torque == pytest.approx(NOMINAL, abs=1.0)
    assert max(heats) < 1.1
    assert heats[-1] == pytest.approx(1, abs=0.02)


def test_it_stops_when_it_has_given_way_for_too_long_and_holds_where_it_was():
    """The loop gives way after 0.02 s and stops after 0.1 s more, with the position of that sample as target."""
    driven = Driven(motors())

    outputs = [sample(driven, 60.0, position=(0.1 + 0.001 * number, 0.2)) for number in range(30)]

    stages = [output["stage"][0] for output in outputs]
    assert stages.index(GIVES_WAY) == 2
    assert stages.index(STOPPED) == 12
    assert outputs[-1]["target"] == pytest.approx([0.112, 0.2])
    assert (outputs[11]["active"], outputs[12]["active"]) == (0, 1)


def test_it_releases_the_robot_without_a_jump_once_all_was_well():
    """After 0.05 s without overload, the offset is that of the target from the reference, and returns to 0."""
    driven = Driven(motors(hold=0.02, patience=0.1, reset_after=0.05))
    while sample(driven, 60.0)["stage"] != STOPPED:
        pass
    target = sample(driven, 60.0)["target"]

    outputs = [sample(driven, 5.0) for _ in range(7)]

    assert [output["active"][0] for output in outputs] == [1, 1, 1, 1, 0, 0, 0]
    # offset from what is asked now
    assert outputs[4]["offset"] + [0.5, 0.6] == pytest.approx(target)
    assert outputs[6]["offset"] == pytest.approx(outputs[4]["offset"] + 2 * PERIOD)


def test_a_force_stops_it_at_once_and_can_end_the_run():
    """The size of the force counts, not its components: 80 N along each of three axes are 139 N."""
    driven = Driven(motors(force=140.0, hold=0.0, patience=0.1))
    loop_that_ends = motors(force=140.0, hold=0.0, patience=0.1, then="end")
    read = {"torque": np.zeros(2), "position": np.zeros(2), "force": np.array([0, 0, 141.0])}

    assert sample(driven, 5.0, force=[80.0, 80.0, -80.0])["stage"] == WATCHES
    assert sample(driven, 5.0, force=[0.0, 0.0, 141.0])["stage"] == STOPPED
    with pytest.raises(RunEnds, match="above 140 N"):
        loop_that_ends.sample(begun_memory(), read)


def test_the_reason_names_the_axis_and_its_limit():
    """The axis has given way for 0.1 s, the patience of the loop, and one sample more."""
    loop = motors(then="end")
    memory = begun_memory(stage=np.array([float(GIVES_WAY)]), lasts=np.array([0.1]))
    read = {"torque": np.array([60.0, 0.0]), "position": np.zeros(2)}

    with pytest.raises(RunEnds, match=r"hip was held at 40 N·m for 0\.11 s"):
        loop.sample(memory, read)
