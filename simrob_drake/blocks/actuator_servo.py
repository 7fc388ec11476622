r"""Joint servos inside the plant's own actuators, which discrete and convex solvers treat implicitly.

The law is that of :mod:`simrob_drake.blocks.servo`; PD and torque limit are set in the plant's actuators before it is
finalized. Feedforward, integral part and reference velocity, torques :math:`\tau_e = \tau_{ff} + i + k_d v_r`, enter
through the desired position,

.. math:: k_p (q_r + \tau_e / k_p - q) - k_d v = k_p (q_r - q) - k_d (v - v_r) + i + \tau_{ff},

which the actuator clamps as one. So no other port of the plant is wired: the scheme ``cenic`` differentiates each of
them at every step. (Drake 1.51 to 1.58 take a desired velocity with the wrong sign under it, too.) Where a joint has no
stiffness, :math:`\tau_e` of the whole robot enters through the actuation port.

The line of a motor whose limit of torque is its stall torque (:class:`~simrob_drake.blocks.servo.MotorLine`) is exact
and implicit, too: the joint has the damper D, and the servo the gain :math:`k_d - D` and the constant limit
:math:`\tau_s`.
"""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointActuatorIndex, JointIndex, ModelInstanceIndex, PdControllerGains
from pydrake.systems.framework import DiagramBuilder, OutputPort

from simrob_drake.blocks.servo import ServoGains, ServoSignals, add_integral
from simrob_drake.blocks.wiring import joined, mapped
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
        actuator.set_effort_limit(float(gains.actuator_limit[axis]))
        actuator.joint().set_default_damping(actuator.joint().default_damping() + float(gains.damping[axis]))
        if with_servos:
            derivative = float(gains.kd[axis] - gains.damping[axis])
            actuator.set_controller_gains(PdControllerGains(p=float(gains.kp[axis]), d=derivative))


def add_actuator_servos(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    instance: ModelInstanceIndex,
    signals: ServoSignals,
    gains: ServoGains,
    *,
    actuation_map: Vector,
    prefix: str = "",
) -> OutputPort:
    """Wire the desired state of a finalized plant's model instance whose actuators hold the PD gains.

    Signals and gains are in axis order; ``actuation_map`` is the matrix (actuators, n) from axis torques to actuator
    torques.

    Returns:
        the torques that the actuators apply, size n [N·m], in axis order.
    """
    extra, torque_of = _extra_torques(builder, signals, gains, prefix)
    stiff = bool((gains.kp > 0).all())
    ports, columns = [signals.reference], [np.eye(len(gains.kp))]
    if stiff:
        ports, columns = [*ports, *extra], [*columns, *(matrix / gains.kp[:, np.newaxis] for matrix in torque_of)]
    elif extra:
        bus = joined(builder, f"{prefix}extra_torques", *extra)
        torque = mapped(builder, f"{prefix}actuation", actuation_map @ np.hstack(torque_of), bus)
        builder.Connect(torque, plant.get_actuation_input_port(instance))
    position = actuation_map @ np.hstack(columns)
    desired = np.vstack([position, np.zeros_like(position)])
    source = joined(builder, f"{prefix}desired", *ports)
    state = mapped(builder, f"{prefix}desired_state", desired, source)
    builder.Connect(state, plant.get_desired_state_input_port(instance))
    applied, matrix = plant.get_net_actuation_output_port(instance), actuation_map.T
    if gains.damping.any():
        applied = joined(builder, f"{prefix}applied_and_state", applied, signals.state)
        matrix = np.hstack([matrix, np.zeros_like(np.diag(gains.kp)), -np.diag(gains.damping)])
    return mapped(builder, f"{prefix}applied_torque", matrix, applied)


def _extra_torques(
    builder: DiagramBuilder, signals: ServoSignals, gains: ServoGains, prefix: str
) -> tuple[list[OutputPort], list[Vector]]:
    """Return the ports that make torques beside the PD part, and the matrices (n, n) that make these of them."""
    ports, torque_of = [], []
    if signals.reference_velocity is not None:
        ports.append(signals.reference_velocity)
        torque_of.append(np.diag(gains.kd))
    if signals.feedforward is not None:
        ports.append(signals.feedforward)
        torque_of.append(np.eye(len(gains.kp)))
    if (gains.ki > 0).any():
        sources = [signals.reference, signals.state]
        ports.append(add_integral(builder, sources, gains, list(range(len(gains.kp))), f"{prefix}servo"))
        torque_of.append(np.eye(len(gains.kp)))
    return ports, torque_of
