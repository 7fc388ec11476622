r"""Torques that the model of a plant predicts, computed by Drake's inverse dynamics.

.. math:: \tau = M(q)\,\dot v + C(q, v)\,v + \tau_g(q)

The block also adds the torques that the plant's dampers and springs take at this motion; if it only balances gravity,
it leaves them out. For a desired motion, this torque is a feedforward. For the measured state and a desired
acceleration it is a computed torque. For the measured state without acceleration it is the torque that keeps an arm
moving as it does.

A robot's axes are the coordinates of its servos; `AxisMap` converts between axes and the joints of the plant. Its
matrices pick the values of the axes from a vector of the plant, with the signs +1 or -1 of axes in the sense of their
joints or against it. Their transposes put the values back. For prismatic axes, read N for N·m.
"""

from collections.abc import Sequence
from typing import NamedTuple

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
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    state: OutputPort,
    acceleration: OutputPort | None,
    *,
    name: str,
) -> OutputPort:
    """Add the inverse dynamics of a finalized plant.

    Args:
        builder: builder of the diagram.
        plant: the finalized plant.
        state: positions and velocities of the plant, size nq + nv.
        acceleration: desired acceleration, size nv. If it is None, the result only balances gravity, which takes half
            of the computing time.
        name: name of the block.

    Returns:
        The generalized forces, size nv.
    """
    mode = InverseDynamics.InverseDynamicsMode
    # This mode computes tau_g(q) alone: the module's equation at rest.
    if acceleration is None:
        return add_and_connect(
            builder, name, InverseDynamics(plant, mode.kGravityCompensation), state
        )
    return add_and_connect(
        builder, name, InverseDynamics(plant, mode.kInverseDynamics), state, acceleration
    )


class _SpreadPort(NamedTuple):
    """A port of a robot, and the matrix that spreads its values into a vector of the plant.

    Attributes:
        port: the port, size n.
        matrix: shape (size of the plant's vector, n).
    """

    port: OutputPort
    matrix: Vector


def add_feedforward(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    robots: Sequence[tuple[AxisMap, ServoSignals]],
    *,
    name: str,
) -> list[OutputPort]:
    """Add the torques that robots of a finalized plant need for their reference motions.

    A robot without a reference velocity or acceleration is taken to rest at each position: its torques balance gravity,
    and also springs of its joints if another robot has a reference acceleration. All other joints of the plant rest at
    their default positions.

    Args:
        builder: builder of the diagram.
        plant: the finalized plant.
        robots: axes of each robot in the plant, and the signals of its servos, which contain the reference.
        name: name of the block, and prefix of the names of blocks around it.

    Returns:
        The torques of each robot in axis order, size n [N·m].
    """
    # State of the plant: x = rest + sum of the spread ports, so each entry is set by one of the two.
    rest = plant.GetPositionsAndVelocities(plant.CreateDefaultContext())
    states = list[_SpreadPort]()
    accelerations = list[_SpreadPort]()
    for axes, signals in robots:
        count = len(axes.signs)
        # Shape (size of the state, 2n): a column for the position of each axis, then one for its velocity.
        spread = axes.state_matrix.T
        # The entries that the robot's axes set.
        rest[spread.any(axis=1)] = 0.0
        states.append(_SpreadPort(signals.reference, spread[:, :count]))
        # Velocity and acceleration together, or neither: the Coriolis terms of a velocity alone are not the torque of
        # the motion.
        if signals.reference_velocity is not None and signals.reference_acceleration is not None:
            states.append(_SpreadPort(signals.reference_velocity, spread[:, count:]))
            accelerations.append(
                _SpreadPort(signals.reference_acceleration, axes.velocity_matrix.T)
            )

    state = _add_spread(builder, f"{name}.state", states, rest)
    # It stays None if no robot has a reference acceleration.
    acceleration = None
    if accelerations:
        no_acceleration = np.zeros(plant.num_velocities())
        acceleration = _add_spread(builder, f"{name}.acceleration", accelerations, no_acceleration)
    # Inverse dynamics are computed for the whole plant, so one block serves all robots.
    force = add_model_torque(builder, plant, state, acceleration, name=name)
    return [
        add_matrix_gain(builder, f"{name}.axes_{index}", axes.velocity_matrix, force)
        for index, (axes, _) in enumerate(robots)
    ]


def _add_spread(
    builder: DiagramBuilder,
    name: str,
    parts: Sequence[_SpreadPort],
    rest: Vector,
) -> OutputPort:
    """Add the block that computes a vector of the plant: its values at rest plus the spread values of ports.

    Args:
        builder: builder of the diagram.
        name: name of the block.
        parts: ports, with the matrices that spread their values.
        rest: values at rest, of which those that a port sets are 0.
    """
    matrix = np.hstack([part.matrix for part in parts])
    bus = add_multiplexer(builder, f"{name}.bus", *(part.port for part in parts))
    # y = D u + y0: the constant costs nothing in the same block.
    if rest.any():
        return add_and_connect(builder, name, AffineSystem(D=matrix, y0=rest), bus)
    return add_matrix_gain(builder, name, matrix, bus)


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
    r"""Add the computed torque of a robot.

    .. math:: \tau = M(q)\,(\ddot q_r + k_d\,(\dot q_r - v) + k_p\,(q_r - q)) + C(q, v)\,v + \tau_g(q) + \tau_{ff}

    Without feedforward, and while no other forces act, the error then obeys
    :math:`\ddot e + k_d\,\dot e + k_p\,e = 0`. The torques are not saturated.

    Args:
        builder: builder of the diagram.
        plant: the finalized plant.
        state: positions and velocities of the plant, size nq + nv.
        axes: the robot's axes in the plant.
        signals: signals of the robot's servos. They must contain the reference's velocity and acceleration.
        gains: gains kp [1/s²] and kd [1/s] of the servos, which are per inertia; other gains are not used.
        name: name of the block, and prefix of the names of blocks around it.

    Returns:
        The torques in axis order, size n [N·m].
    """
    assert signals.reference_velocity is not None
    assert signals.reference_acceleration is not None
    kp = np.diag(gains.kp)
    kd = np.diag(gains.kd)
    identity = np.eye(len(gains.kp))

    # Desired acceleration of the plant: (ddq_r + kd (dq_r - v) + kp (q_r - q)) in the joints' signs. Columns:
    # reference, measured position, measured velocity, reference velocity, reference acceleration.
    law = axes.velocity_matrix.T @ np.hstack([kp, -kp, -kd, kd, identity])
    bus = add_multiplexer(
        builder,
        f"{name}.bus",
        signals.reference,
        signals.state,
        signals.reference_velocity,
        signals.reference_acceleration,
    )
    acceleration = add_and_connect(builder, f"{name}.law", MatrixGain(law), bus)
    # A torque of an axis is that of its joint, but for the sign: the same matrix as for velocities.
    force = add_model_torque(builder, plant, state, acceleration, name=name)
    torque = add_matrix_gain(builder, f"{name}.axes", axes.velocity_matrix, force)
    if signals.feedforward is None:
        return torque
    return add_sum(builder, f"{name}.sum", torque, signals.feedforward)


def add_admittance(
    builder: DiagramBuilder,
    signals: ServoSignals,
    gains: ServoGains,
    model: OutputPort,
    *,
    gain: float,
    prefix: str,
) -> OutputPort:
    r"""Add the integrator by which a robot's servos yield to external forces.

    It is the law of the Simulink station ``D30S2_Irb120_qLC_Fext``. The torque of a servo gets an additional part x,
    the integral of the torque that the model of the arm does not explain:

    .. math::
        \tau = k_p (q_r - q) - k_d (v - v_r) + \tau_{ff} + x, \qquad \dot x = K_t\,(\mathrm{ID}(q, v) - \tau),

    where ID is the inverse dynamics without acceleration and without external forces; the reference velocity v_r and
    the feedforward are 0 unless `signals` has them. At frequencies below :math:`K_t`, the servo's stiffness fades and a
    damping :math:`k_p/K_t` is left: gravity stays balanced, and the arm gives way when it is pushed. With
    :math:`K_t = 0` the servo acts alone.

    The block computes :math:`\dot x = K_t\,(\mathrm{ID} - k_p (q_r - q) + k_d (v - v_r) - \tau_{ff}) - K_t\,x`. This is
    the same as long as the servo is not saturated; if the servo saturates, x does not wind up.

    Args:
        builder: builder of the diagram.
        signals: signals of the servos.
        gains: gains of the servos, of which kp and kd are used.
        model: the torque ID of the arm's model in axis order, size n [N·m].
        gain: the gain :math:`K_t` [1/s], positive.
        prefix: prefix of the names of the blocks.

    Returns:
        The torque x, size n [N·m], to be added before the saturation.
    """
    identity = np.eye(len(gains.kp))
    kp = np.diag(gains.kp)
    kd = np.diag(gains.kd)
    # Factors of the ports in dx/dt / K_t. The state has two parts, positions and velocities, so it has two factors.
    ports = [model, signals.reference, signals.state]
    columns = [identity, -kp, kp, kd]
    if signals.reference_velocity is not None:
        ports.append(signals.reference_velocity)
        columns.append(-kd)
    if signals.feedforward is not None:
        ports.append(signals.feedforward)
        columns.append(-identity)

    # dx/dt = A x + B u with A = -K_t; u are the ports in their order, B their factors times K_t.
    inputs = gain * np.hstack(columns)
    integrator = LinearSystem(A=-gain * identity, B=inputs, C=identity, D=np.zeros_like(inputs))
    bus = add_multiplexer(builder, f"{prefix}admittance.bus", *ports)
    return add_and_connect(builder, f"{prefix}admittance", integrator, bus)
