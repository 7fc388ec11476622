r"""Torques that the model of a plant predicts, by Drake's own inverse dynamics.

.. math:: \tau = M(q)\,\dot v + C(q, v)\,v + \tau_g(q)

For the motion that is asked for it is a feedforward, for the measured state and a wanted acceleration a computed
torque, and for none at all what keeps an arm on its way.
"""

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import AffineSystem, LinearSystem, MatrixGain

from simrob_drake.base.frames import Vector
from simrob_drake.blocks.block import add_and_connect, add_matrix_gain, add_multiplexer, add_sum
from simrob_drake.blocks.servo import ServoGains, ServoSignals
from simrob_drake.robots.axis_map import AxisMap


def add_model_torque(
    builder: DiagramBuilder, plant: MultibodyPlant, state: OutputPort, acceleration: OutputPort | None, *, name: str
) -> OutputPort:
    """Add the generalized forces (nv) that give a finalized plant an acceleration (nv); None for what gravity takes.

    The state is of size nq + nv. Against gravity alone it is half of the work.
    """
    mode = InverseDynamics.InverseDynamicsMode
    if acceleration is None:
        return add_and_connect(builder, name, InverseDynamics(plant, mode.kGravityCompensation), state)
    return add_and_connect(builder, name, InverseDynamics(plant, mode.kInverseDynamics), state, acceleration)


def add_feedforward(
    builder: DiagramBuilder, plant: MultibodyPlant, robots: Sequence[tuple[AxisMap, ServoSignals]], *, name: str
) -> list[OutputPort]:
    """Add the torques (n) [N·m] that robots of a finalized plant take on the way that each is asked to go.

    One whose signals have no reference acceleration is taken to rest at each position: its torques are those against
    gravity. What else there is in the plant rests where it is by default.
    """
    rest = plant.GetPositionsAndVelocities(plant.CreateDefaultContext())
    states, rates = [], []  # ports, each with the matrix that puts it into the vectors of the plant
    for axes, signals in robots:
        count, spread = len(axes.signs), axes.state_matrix.T
        rest[spread.any(axis=1)] = 0.0
        states.append((signals.reference, spread[:, :count]))
        if signals.reference_velocity is not None and signals.reference_acceleration is not None:
            states.append((signals.reference_velocity, spread[:, count:]))
            rates.append((signals.reference_acceleration, axes.velocity_matrix.T))
    state = _spread(builder, f"{name}.state", states, rest)
    rate = _spread(builder, f"{name}.acceleration", rates, np.zeros(plant.num_velocities())) if rates else None
    force = add_model_torque(builder, plant, state, rate, name=name)
    return [
        add_matrix_gain(builder, f"{name}.axes_{index}", axes.velocity_matrix, force)
        for index, (axes, _) in enumerate(robots)
    ]


def _spread(builder: DiagramBuilder, name: str, parts: Sequence[tuple[OutputPort, Vector]], rest: Vector) -> OutputPort:
    """Return a vector of the plant: that of its rest, and what the parts' matrices make of their ports."""
    matrix = np.hstack([part for _, part in parts])
    bus = add_multiplexer(builder, f"{name}.bus", *(port for port, _ in parts))
    return (
        add_and_connect(builder, name, AffineSystem(D=matrix, y0=rest), bus)
        if rest.any()
        else add_matrix_gain(builder, name, matrix, bus)
    )


def add_computed_torque(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    state: OutputPort,
    axes: AxisMap,
    signals: ServoSignals,
    gains: ServoGains,
    *,
    name: str,
) -> OutputPort:
    r"""Add the torques (n) [N·m] of a robot whose error obeys :math:`\ddot e + k_d\,\dot e + k_p\,e = 0`.

    .. math:: \tau = M(q)\,(\ddot q_r + k_d\,(\dot q_r - v) + k_p\,(q_r - q)) + C(q, v)\,v + \tau_g(q) + \tau_{ff}

    The gains are by inertia: kp [1/s²], kd [1/s]; others are not used. The torques are not saturated.

    Args:
        builder: of the diagram.
        plant: finalized.
        state: of the plant, size nq + nv.
        axes: where the robot's are in it.
        signals: what its servos read; the velocity and the acceleration that are asked for are among them.
        gains: of its servos.
        name: of the block, and what those around it begin with.
    """
    position, velocity, acceleration = signals.reference, signals.reference_velocity, signals.reference_acceleration
    assert velocity is not None
    assert acceleration is not None
    stiffness, damping, each = np.diag(gains.kp), np.diag(gains.kd), np.eye(len(gains.kp))
    law = axes.velocity_matrix.T @ np.hstack([stiffness, -stiffness, -damping, damping, each])
    bus = add_multiplexer(builder, f"{name}.bus", position, signals.state, velocity, acceleration)
    force = add_model_torque(
        builder, plant, state, add_and_connect(builder, f"{name}.law", MatrixGain(law), bus), name=name
    )
    torque = add_matrix_gain(builder, f"{name}.axes", axes.velocity_matrix, force)
    feedforward = [port for port in (signals.feedforward,) if port is not None]
    return add_sum(builder, f"{name}.sum", torque, *feedforward)


def add_admittance(
    builder: DiagramBuilder, signals: ServoSignals, gains: ServoGains, model: OutputPort, *, gain: float, prefix: str
) -> OutputPort:
    r"""Add the integrator of a gain K_t [1/s], positive, that gives a robot's servos their admittance.

    They give in to forces from outside; the law of the Simulink station ``D30S2_Irb120_qLC_Fext``. To the torque of a
    servo comes the integral of what the model of the arm does not explain,

    .. math::
        \tau = k_p (q_r - q) - k_d v + \tau_{ff} + x, \qquad \dot x = K_t\,(\mathrm{ID}(q, v) - \tau),

    with ID the torque that would keep the arm's velocity as it is (inverse dynamics without acceleration, without any
    external force). So below :math:`K_t` [rad/s] the servo's stiffness fades: what is left of it is a damping
    :math:`k_p/K_t`, gravity is balanced, and the arm yields to a hand. With :math:`K_t = 0` it is the servo alone.

    Here x has the form :math:`\dot x = K_t\,(\mathrm{ID} - k_p (q_r - q) + k_d v - \tau_{ff}) - K_t\,x`, the same as
    long as the servo is not saturated; when it is, x does not wind up. It reads what the servos read, and the torque of
    the arm's model, size n [N·m].

    Returns:
        x, size n [N·m], which belongs into the sum before the saturation.
    """
    count = len(gains.kp)
    each, stiffness, damping = np.eye(count), np.diag(gains.kp), np.diag(gains.kd)
    parts, columns = [model, signals.reference, signals.state], [each, -stiffness, stiffness, damping]
    if signals.reference_velocity is not None:
        parts, columns = [*parts, signals.reference_velocity], [*columns, -damping]
    if signals.feedforward is not None:
        parts, columns = [*parts, signals.feedforward], [*columns, -each]
    inputs = gain * np.hstack(columns)
    block = LinearSystem(A=-gain * each, B=inputs, C=each, D=np.zeros_like(inputs))
    return add_and_connect(
        builder, f"{prefix}admittance", block, add_multiplexer(builder, f"{prefix}admittance.bus", *parts)
    )
