"""Joint servos inside the plant's own actuators, which discrete and convex solvers treat implicitly.

The law is that of :mod:`simrob_drake.blocks.servo`; PD and torque limit are set in the plant's actuators before it is
finalized. Integral part and feedforward enter through the actuation port, and the sum is clamped at the limit.
"""

from __future__ import annotations

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointActuatorIndex, JointIndex, ModelInstanceIndex, PdControllerGains
from pydrake.systems.framework import DiagramBuilder, OutputPort

from simrob_drake.blocks.servo import ServoGains, ServoSignals, add_integral, add_saturation
from simrob_drake.blocks.wiring import joined, mapped, summed
from simrob_drake.frames import Vector


def set_actuators(
    plant: MultibodyPlant, joints: list[JointIndex], gains: ServoGains, *, with_servos: bool = True
) -> None:
    """Put torque limits and, ``with_servos``, PD gains into the actuators of ``joints``, before the plant is finalized.

    Limits without gains are for the scheme ``cenic``, which clamps the torque of every actuator inside of its convex
    problem. It linearises what feeds an actuator at the start of a step: behind a block that saturates there is no
    slope, and a stiff servo, then stepped explicitly, collapses. Other solvers of Drake 1.51 clamp actuators with gains
    alone.
    """
    for index in range(plant.num_actuators()):  # the indices of a model instance are known after Finalize() only
        actuator = plant.get_joint_actuator(JointActuatorIndex(index))
        if actuator.joint().index() not in joints:
            continue
        axis = joints.index(actuator.joint().index())
        actuator.set_effort_limit(float(gains.torque_limit[axis]))
        if with_servos:
            actuator.set_controller_gains(PdControllerGains(p=float(gains.kp[axis]), d=float(gains.kd[axis])))


def add_actuator_servos(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    instance: ModelInstanceIndex,
    signals: ServoSignals,
    gains: ServoGains,
    *,
    actuation_map: Vector,
    prefix: str = "",
    velocity_sense: int = 1,
) -> OutputPort:
    """Wire the desired state of a model instance whose actuators hold the PD gains.

    Args:
        builder: the diagram under construction.
        plant: finalized, with gains set.
        instance: the robot.
        signals: the ports to read, in axis order.
        gains: the figures, in axis order; of them only the integral part is used here.
        actuation_map: matrix (actuators, n) from axis torques to actuator torques.
        prefix: stands before the names of all blocks.
        velocity_sense: -1 for the scheme ``cenic`` of Drake 1.51, which takes the desired velocity with the wrong sign.

    Returns:
        the torques that the actuators apply, size n [N·m], in axis order.
    """
    nothing = np.zeros_like(actuation_map)
    desired = np.vstack([actuation_map, nothing])
    source = signals.reference
    if signals.reference_velocity is not None:
        desired = np.hstack([desired, np.vstack([nothing, velocity_sense * actuation_map])])
        source = joined(builder, f"{prefix}desired", signals.reference, signals.reference_velocity)
    builder.Connect(
        mapped(builder, f"{prefix}desired_state", desired, source), plant.get_desired_state_input_port(instance)
    )
    extra = [port for port in (signals.feedforward,) if port is not None]
    if (gains.ki > 0).any():
        bus = joined(builder, f"{prefix}servo.bus", signals.reference, signals.state)
        extra.append(add_integral(builder, bus, gains, list(range(len(gains.kp))), f"{prefix}servo"))
    if extra:
        total = mapped(
            builder, f"{prefix}actuation", actuation_map, summed(builder, f"{prefix}feedforward_sum", *extra)
        )
        builder.Connect(total, plant.get_actuation_input_port(instance))
    if velocity_sense < 0 and signals.reference_velocity is not None:
        return _torque_by_law(builder, signals, gains, signals.reference_velocity, extra, prefix)
    applied = plant.get_net_actuation_output_port(instance)
    return mapped(builder, f"{prefix}applied_torque", actuation_map.T, applied)


def _torque_by_law(
    builder: DiagramBuilder,
    signals: ServoSignals,
    gains: ServoGains,
    velocity: OutputPort,
    extra: list[OutputPort],
    prefix: str,
) -> OutputPort:
    """Add the servos' law once more, to be read only: the plant's port would tell it with the wrong sense, too."""
    proportional, derivative = np.diag(gains.kp), np.diag(gains.kd)
    law = np.hstack([proportional, -proportional, -derivative, derivative])
    bus = joined(builder, f"{prefix}applied_torque.bus", signals.reference, signals.state, velocity)
    total = mapped(builder, f"{prefix}applied_torque.pd", law, bus)
    if extra:
        total = summed(builder, f"{prefix}applied_torque.sum", total, *extra)
    return add_saturation(builder, total, gains.torque_limit, f"{prefix}applied_torque")
