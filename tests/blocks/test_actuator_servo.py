"""Servos inside the actuators against the explicit law, and a guard for a sign in Drake."""

from collections.abc import Callable

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from simrob_drake.blocks.servo import (
    ServoGains,
    ServoSignals,
    add_actuator_servos,
    add_servos,
    set_actuators,
)

AddPendulum = Callable[..., MultibodyPlant]


def gains(*, kp: float, kd: float, ki: float = 0.0, limit: float = 100.0) -> ServoGains:
    return ServoGains(*(np.array([figure]) for figure in (kp, ki, kd, limit, limit)))


def servo_simulator(
    add_pendulum: AddPendulum,
    figures: ServoGains,
    *,
    implicit: bool,
    scheme: str = "runge_kutta3",
    time_step: float = 0.0,
    reference: float = 0.5,
    velocity: float | None = None,
    feedforward: float | None = None,
    sign: float = 1.0,
) -> Simulator:
    """Simulate a pendulum whose axis is the joint times ``sign``, with the servo in the actuator or as blocks."""
    builder = DiagramBuilder()
    plant = add_pendulum(builder, time_step=time_step)
    if implicit:
        set_actuators(plant, [plant.GetJointByName("hinge").index()], figures)
    plant.Finalize()

    def constant(value: float | None) -> ConstantVectorSource | None:
        return (
            None
            if value is None
            else builder.AddSystem(ConstantVectorSource([value])).get_output_port()
        )

    signals = ServoSignals(
        constant(reference),
        plant.get_state_output_port(),
        constant(velocity),
        constant(feedforward),
    )
    if implicit:
        torque = add_actuator_servos(
            builder,
            plant,
            plant.GetModelInstanceByName("DefaultModelInstance"),
            signals,
            figures,
            actuation_map=np.array([[sign]]),
        )
    else:
        torque = add_servos(builder, signals, figures, names=["hinge"])
        builder.Connect(torque, plant.get_actuation_input_port())
    builder.ExportOutput(torque, "torque")
    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(
        SimulatorConfig(integration_scheme=scheme, accuracy=1e-6, max_step_size=0.01), simulator
    )
    return simulator


def motion(simulator: Simulator, duration: float) -> np.ndarray:
    """Return position, velocity and torque after ``duration`` [s]."""
    simulator.AdvanceTo(duration)
    system = simulator.get_system()
    context = simulator.get_context()
    plant = system.GetSubsystemByName("plant")
    state = plant.get_state_output_port().Eval(plant.GetMyContextFromRoot(context))
    return np.concatenate([state, system.GetOutputPort("torque").Eval(context)])


@pytest.mark.parametrize(
    "case",
    [
        {"figures": gains(kp=100, kd=5)},
        {"figures": gains(kp=100, kd=5), "feedforward": 2.0},
        {"figures": gains(kp=100, kd=5), "velocity": 0.3},
        {"figures": gains(kp=100, kd=5, ki=80)},
        {"figures": gains(kp=100, kd=5, ki=80), "feedforward": -1.0, "velocity": 0.3},
        {"figures": gains(kp=100, kd=5, limit=1.5), "feedforward": 0.5},
    ],
    ids=["PD", "feedforward", "reference velocity", "integral", "all", "saturated"],
)
@pytest.mark.parametrize("duration", [0.05, 1.0])
def test_the_servo_in_the_actuator_follows_the_explicit_law(
    add_pendulum: AddPendulum, case: dict, duration: float
) -> None:
    inside = motion(servo_simulator(add_pendulum, implicit=True, **case), duration)
    outside = motion(servo_simulator(add_pendulum, implicit=False, **case), duration)
    # both at accuracy 1e-6, torques up to 50 N m
    np.testing.assert_allclose(inside, outside, atol=2e-4)


def test_torque_and_limit_are_per_axis_and_in_its_sense(add_pendulum: AddPendulum) -> None:
    turned = motion(
        servo_simulator(add_pendulum, gains(kp=100, kd=5), implicit=True, reference=-0.5, sign=-1),
        3.0,
    )
    plain = motion(
        servo_simulator(add_pendulum, gains(kp=100, kd=5), implicit=True, reference=0.5), 3.0
    )
    np.testing.assert_allclose(turned, plain * [1, 1, -1], atol=1e-9)


@pytest.mark.parametrize("time_step", [1e-3, 1e-2])
def test_stiff_gains_are_safe_on_a_discrete_plant(
    add_pendulum: AddPendulum, time_step: float
) -> None:
    # kd dt / M = 1e3 * 1e-2 / 0.25 = 40, where the explicit law is unstable from 2 on
    simulator = servo_simulator(
        add_pendulum, gains(kp=1e4, kd=1e3, limit=1e6), implicit=True, time_step=time_step
    )
    q, v, _ = motion(simulator, 3.0)

    sag = 9.80665 * 0.5 * np.sin(0.5) / 1e4
    assert q == pytest.approx(0.5 - sag, abs=1e-6)
    assert v == pytest.approx(0.0, abs=1e-6)


def first_torque(add_pendulum: AddPendulum, scheme: str, *, time_step: float = 0.0) -> float:
    """Return the mean torque over the first millisecond [N m], from the change of momentum; gravity pulls not yet."""
    simulator = servo_simulator(
        add_pendulum,
        gains(kp=100, kd=50, limit=1e6),
        implicit=True,
        scheme=scheme,
        time_step=time_step,
        reference=0.2,
        velocity=1.0,
    )
    return float(motion(simulator, 1e-3)[1]) * 0.25 / 1e-3  # moment of inertia 1 kg * (0.5 m)^2


# At rest the law asks for 100 * 0.2 + 50 * 1 = 70 N m, and with the wrong sign for 20 - 50 = -30 N m. Within the
# millisecond the damper takes up to kd h / M = 20 % off.
RIGHT = 70.0
DAMPED = 0.2


@pytest.mark.parametrize(
    ("scheme", "time_step"),
    [("runge_kutta3", 0.0), ("radau3", 0.0), ("runge_kutta3", 1e-3), ("cenic", 0.0)],
)
def test_a_desired_velocity_has_the_right_sign(
    add_pendulum: AddPendulum, scheme: str, time_step: float
) -> None:
    """Under `cenic` Drake 1.51 to 1.58 take one that is wired to the plant with the wrong sign."""
    torque = first_torque(add_pendulum, scheme, time_step=time_step)
    assert torque == pytest.approx(RIGHT, rel=DAMPED)


@pytest.mark.parametrize(("feedforward", "limit"), [(None, 1e6), (3.0, 1e6), (3.0, 40.0)])
def test_the_torque_told_under_cenic_is_that_of_the_law(
    add_pendulum: AddPendulum, feedforward: float | None, limit: float
) -> None:
    simulator = servo_simulator(
        add_pendulum,
        gains(kp=100, kd=50, limit=limit),
        implicit=True,
        scheme="cenic",
        reference=0.2,
        velocity=1.0,
        feedforward=feedforward,
    )
    q, v, torque = motion(simulator, 5e-3)

    law = 100 * (0.2 - q) + 50 * (1.0 - v) + (feedforward or 0.0)
    assert torque == pytest.approx(np.clip(law, -limit, limit), abs=1e-9)
    assert abs(torque) > 1  # the plant's own port would be 100 N m off here
