r"""Joint servos from Drake's primitives: PID with a clamped integrator, and saturation.

A servo controls the position of one axis of a robot, by the torque of its motor. A passive axis has no motor. For a
prismatic joint, read force for torque. The signals that a group of servos reads are stacked in one vector, the bus:
references, positions, velocities, then reference velocities and feedforward if they are wired (connected).

The law of each joint is that of the Simulink stations (subsystem ``ABB_irb120_qLC``), with an optional integral part:

.. math::
    \tau = \mathrm{sat}\bigl(k_p (q_r - q) - k_d\,(v - v_r) + i + \tau_{ff}\bigr), \qquad
    \dot x = k_i (q_r - q) + \frac{\mathrm{clip}(x) - x}{T}, \quad i = \mathrm{clip}(x)

where :math:`v_r = 0` unless a reference velocity is wired. The integral part is clipped to a torque, and its state
leaks back to that bound with time constant T, so it neither winds up nor chatters.

A cascade has a loop for the velocity inside of the one for the position, whose command is limited to a speed:

.. math::
    v_c = \mathrm{clip}\Bigl(\frac{k_p}{k_d}\,(q_r - q) + v_r\Bigr), \qquad
    \tau = \mathrm{sat}\bigl(k_d\,(v_c - v) + i + \tau_{ff}\bigr), \qquad
    \dot x = k_i \frac{k_d}{k_p}\,(v_c - v) + \frac{\mathrm{clip}(x) - x}{T}.

Without an integral part it is the law above, as long as the speed is not limited.

A motor on a voltage has less torque the faster it turns (:mod:`simrob_drake.robots.motors`): its stall torque
:math:`\tau_s` at rest falls with the slope D. Such a motor acts as a damper D together with a servo of constant limit,

.. math:: \tau = \mathrm{clip}_{\tau_p}\bigl(\mathrm{clip}_{\tau_s}(\tau_c + D v) - D v\bigr),

with the commanded torque :math:`\tau_c`. If the motor's current is limited below that of the stall, :math:`\tau_p` is
the torque of the limited current.

Drake's PidController has no clamped integrator, and keeps an integrator state even if ki is 0, which made an implicit
integrator 1.4 times slower on six joints. So the PD part is a MatrixGain here. Servos get blocks for each joint, as in
the Simulink picture (``per_joint``), or the same blocks once for all joints as a vector.

Inside the plant's own actuators, discrete and convex solvers treat the same law implicitly. PD gains and torque limits
are set in the actuators before the plant is finalized. Feedforward, integral part and reference velocity are torques
:math:`\tau_e = \tau_{ff} + i + k_d v_r`, which enter through the desired position,

.. math:: k_p (q_r + \tau_e / k_p - q) - k_d v = k_p (q_r - q) - k_d (v - v_r) + i + \tau_{ff},

so that the actuator clamps their sum. No other port of the plant is then wired: the scheme ``cenic`` differentiates
each of them at every step. (Drake 1.51 to 1.58 also take a desired velocity with the wrong sign in this scheme.) If a
joint has no stiffness, :math:`\tau_e` of the whole robot enters through the actuation port. A motor whose torque limit
is its stall torque is exact and implicit there, too: the joint has the damper D, and the servo has the gain
:math:`k_d - D` and the constant limit :math:`\tau_s`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    JointActuatorIndex,
    JointIndex,
    ModelInstanceIndex,
    PdControllerGains,
)
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import (
    ConstantVectorSource,
    LinearSystem,
    MatrixGain,
    Multiplexer,
    Saturation,
    Selector,
    SelectorParams,
)

from simrob_drake.base.constants import LARGEST_GAIN
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Flags, Vector
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import keep_former_attributes
from simrob_drake.blocks.block import add_and_connect, add_matrix_gain, add_multiplexer

AT_LIMIT = 0.999
"""A motor is at its limit if it takes at least this share of what it can give (`ServoGains.torque_shares`)."""
NO_TORQUE = 1e-6
"""Torque below which a passive axis rests by itself [N·m or N]: rounding of sums of weights."""
CLAMP_TIME = 0.02
"""Time constant T of the integrator's clamp [s].

It is slow enough for fixed steps of 10 ms, and far faster than loads, which the integrator has to find.
"""


@dataclass(frozen=True)
class MotorLine:
    """Torque of n motors that falls linearly with their speed.

    Attributes:
        stall: torque at rest, which the voltage limits, shape (n,) [N·m]; infinite for axes without a motor.
        slope: fall D of the torque with the speed, shape (n,) [N·m·s/rad]; 0 for axes without a motor.
        damping: the part of D that dampers of the plant's joints represent, shape (n,) [N·m·s/rad].
    """

    stall: Vector
    slope: Vector
    damping: Vector

    def bounds(self, speed: Vector, limit: Vector) -> tuple[Vector, Vector]:
        """Compute the least and the largest torque at a speed.

        A limit at or above the stall torque is ignored, since the voltage alone limits a motor that drives. A motor
        that is turned against its torque may then give more than its stall torque, and more than the limit. A limit
        below the stall torque holds at any speed (see `cap`).

        Args:
            speed: speeds of the axes, shape (..., n) [rad/s].
            limit: torque limits of the motors in both directions, shape (n,) [N·m].

        Returns:
            The lower and the upper bounds, each shape (..., n) [N·m].
        """
        # The line -tau_s - D v <= tau <= tau_s - D v, and |tau| <= cap where the current is limited.
        cap = self.cap(limit)
        lower = np.clip(-self.stall - self.slope * speed, -cap, cap)
        upper = np.clip(self.stall - self.slope * speed, -cap, cap)
        return lower, upper

    def share(self, torque: Vector, speed: Vector, limit: Vector) -> Vector:
        """Compute the part of the motors' voltage or current, whichever is larger, that torques need at their speeds.

        Args:
            torque: torques, shape (..., n) [N·m].
            speed: speeds of the axes, shape (..., n) [rad/s].
            limit: torque limits of the motors in both directions, shape (n,) [N·m].

        Returns:
            The shares, shape (..., n); 1 is all.
        """
        # The voltage drives the torque and balances the voltage that the turning motor induces: both in units of
        # torque, |tau + D v| of tau_s. The current is proportional to the torque.
        voltage_share = np.abs(torque + self.slope * speed) / self.stall
        current_share = np.abs(torque) / self.cap(limit)
        return np.asarray(np.fmax(voltage_share, current_share))

    def cap(self, limit: Vector) -> Vector:
        """Limits that hold at any speed, shape (n,) [N·m]: those below the stall torque; the others are infinite.

        Args:
            limit: torque limits of the motors in both directions, shape (n,) [N·m].
        """
        return np.where(limit < self.stall, limit, np.inf)


@dataclass(frozen=True)
class ServoGains:
    """Gains and limits of n servos, each of shape (n,).

    Gains are not negative, limits are positive. An axis without a motor is passive: its gains and its limits are 0, and
    its torque is always 0. For prismatic joints, read N instead of N·m and m instead of rad.

    Attributes:
        kp: stiffness [N·m/rad].
        ki: integral gain [N·m/(rad·s)].
        kd: damping [N·m·s/rad].
        torque_limit: limit of the whole torque [N·m].
        integral_limit: limit of the integral part alone [N·m].
        speed_limit: largest speed that the outer loop of a cascade commands [rad/s]. If it is None, the servo is no
            cascade.
        line: torque of the motors over their speed. If it is None, only the torque limit counts.
    """

    kp: Vector
    ki: Vector
    kd: Vector
    torque_limit: Vector
    integral_limit: Vector
    speed_limit: Vector | None = None
    line: MotorLine | None = None

    @property
    def passive(self) -> Flags:
        """Whether each axis is without a motor, shape (n,)."""
        return np.asarray(self.torque_limit == 0)

    @property
    def limit_at_rest(self) -> Vector:
        """Largest torque of each motor at rest, shape (n,) [N·m]: the limit, or the stall torque if that is smaller."""
        return (
            self.torque_limit
            if self.line is None
            else np.minimum(self.torque_limit, self.line.stall)
        )

    @property
    def judged_limit(self) -> Vector:
        """Torque limits with which torques in motion are compared, shape (n,) [N·m].

        They are the limits of the servos (`torque_limit`), whatever torque the motors can give, and infinite for
        passive axes. A passive axis has no torque, and no motor that could be too weak.
        """
        return np.where(self.passive, np.inf, self.torque_limit)

    def holding_shares(self, torque: Vector) -> Vector:
        """Compare torques that hold a robot still with what the motors can give at rest.

        Args:
            torque: torques that hold the robot, shape (..., n) [N·m].

        Returns:
            shares, shape (..., n): 1 is all that the motor can give. Of a passive axis the share is 0 if no torque is
            needed, else infinite, as nothing holds the axis.
        """
        needed = np.abs(torque)
        # 1 instead of the limit 0 of a passive axis, by which NumPy would divide and warn.
        limit = np.where(self.passive, 1.0, self.limit_at_rest)
        held_by_nothing = np.where(needed > NO_TORQUE, np.inf, 0.0)
        return np.where(self.passive, held_by_nothing, needed / limit)

    def torque_shares(self, torque: Vector, speed: Vector) -> Vector:
        """Compare torques with what the motors can give at their speeds.

        Plans, walks, dynamic runs and monitors judge torques in motion by this function. Torques at rest are judged by
        :meth:`holding_shares` and :attr:`limit_at_rest`. Torques of kinematic runs, in which motors have no effect, are
        only compared with :attr:`judged_limit`.

        Args:
            torque: torques, shape (..., n) [N·m].
            speed: speeds of the axes, shape (..., n) [rad/s].

        Returns:
            shares, shape (..., n): 1 is all that the motor can give. Without a line, the share is the magnitude of the
            torque over the torque limit. With a motor line, the larger share of voltage and current counts; the current
            has a limit only if the torque limit is below the stall torque. The share of a passive axis is 0.
        """
        if self.line is None:
            return np.asarray(np.abs(torque) / self.judged_limit)
        return self.line.share(torque, speed, self.judged_limit)

    @property
    def damping(self) -> Vector:
        """Damping of the plant's joints that represents the fall of the torque with speed, shape (n,) [N·m·s/rad]."""
        return np.zeros(len(self.kp)) if self.line is None else self.line.damping

    @property
    def limit_at_any_speed(self) -> Vector:
        """Torque limits that hold at any speed, shape (n,) [N·m]; infinite for motors limited by their voltage only."""
        return self.torque_limit if self.line is None else self.line.cap(self.torque_limit)

    @property
    def actuator_limit(self) -> Vector:
        """Torque limits of the plant's actuators, shape (n,) [N·m].

        The limit is the stall torque if the axis's joint has a damper that makes the motor's torque fall with the speed
        (:attr:`MotorLine.damping` is above 0); otherwise it is the torque limit of the servo.
        """
        if self.line is None:
            return self.torque_limit
        return np.where(self.line.damping > 0, self.line.stall, self.torque_limit)

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            InvalidParameter: a gain is negative, not a number or above `LARGEST_GAIN`; a torque limit is not positive,
                except 0 for a passive axis whose gains are all 0; the integral limit of an axis with a motor is
                not positive; or, in a cascade (which has a `speed_limit`), a speed limit, kp or kd is not positive.
        """
        for name in ("kp", "ki", "kd"):
            values = getattr(self, name)
            # The negation also refuses values that are not a number.
            if not ((values >= 0) & (values <= LARGEST_GAIN)).all():
                expected = message(
                    "blocks.of_zero_to", "from 0 to {largest:g}", largest=LARGEST_GAIN
                )
                raise InvalidParameter(name, values, expected)
        has_no_gains = (self.kp == 0) & (self.ki == 0) & (self.kd == 0)
        # An axis with the limit 0 has no motor: gains there are most likely a mistake of the user.
        is_valid_limit = (self.torque_limit > 0) | (self.passive & has_no_gains)
        if not is_valid_limit.all():
            expected = message(
                "blocks.positive_torque_or_passive",
                "positive [N·m or N], or 0 for an axis without a motor, whose gains must be 0",
            )
            raise InvalidParameter("torque_limit", self.torque_limit, expected)
        if not (self.integral_limit[~self.passive] > 0).all():
            expected = message("blocks.positive_torque", "positive [N·m or N]")
            raise InvalidParameter("integral_limit", self.integral_limit, expected)
        if self.speed_limit is not None:
            if not (self.speed_limit > 0).all():
                expected = message("blocks.positive_speed", "positive [rad/s or m/s]")
                raise InvalidParameter("speed_limit", self.speed_limit, expected)
            # A cascade divides by both: by kd in its outer loop, and by kp for its integral part.
            for name in ("kp", "kd"):
                least = float(getattr(self, name).min())
                if not least > 0:
                    parameter = message("blocks.smallest", "the smallest {name}", name=name)
                    expected = message("blocks.positive_in_cascade", "positive in a cascade")
                    raise InvalidParameter(parameter, least, expected)


keep_former_attributes(ServoGains, cap="limit_at_any_speed")


@dataclass(frozen=True)
class ServoSignals:
    """Output ports that the servos of n joints read, each of size n, except ``state`` of size 2n.

    Attributes:
        reference: desired positions [rad].
        state: measured positions and velocities [rad, rad/s].
        reference_velocity: desired velocities [rad/s]. If it is None, the servos damp towards rest.
        feedforward: torques that are added before the saturation [N·m], or None.
        reference_acceleration: desired accelerations [rad/s²], or None. Only torques of the model use them.
    """

    reference: OutputPort
    state: OutputPort
    reference_velocity: OutputPort | None = None
    feedforward: OutputPort | None = None
    reference_acceleration: OutputPort | None = None


def add_servos(
    builder: DiagramBuilder,
    signals: ServoSignals,
    gains: ServoGains,
    *,
    names: Sequence[str],
    prefix: str = "",
    per_joint: bool = True,
    saturated: bool = True,
) -> OutputPort:
    """Add servos for n joints, and connect them to the signals that they read.

    Args:
        builder: builder of the diagram.
        signals: the signals.
        gains: gains and limits of the servos.
        names: names of the joints.
        prefix: prefix of the names of all blocks.
        per_joint: whether each joint gets blocks of its own, with the name of the joint; otherwise, there is one group
            of blocks for all joints, with the name ``servo``.
        saturated: whether the blocks limit the torques; not needed if the actuators that take the torques do.

    Returns:
        The torques, size n [N·m], limited if `saturated`.
    """
    # Indices of the joints of each group, by the name of the group's blocks. The groups keep the order of the joints,
    # since their torques are stacked at the end.
    groups = {"servo": list(range(len(names)))}
    if per_joint:
        groups = {name: [index] for index, name in enumerate(names)}
    selector = _add_selector(builder, signals, list(groups.values()), f"{prefix}joint_signals")
    name_of_all = f"{prefix}torque" if saturated else f"{prefix}command"
    sizes = [len(group) for group in groups.values()]
    torque = builder.AddNamedSystem(name_of_all, Multiplexer(sizes))
    for number, (name, group) in enumerate(groups.items()):
        bus = selector.get_output_port(number)
        group_name = f"{prefix}{name}"
        command = _add_group(builder, bus, gains, group, signals, group_name)
        if saturated:
            command = add_motor_limits(
                builder,
                command,
                gains,
                group,
                group_name,
                bus=bus,
                speed=_speeds_of_bus(signals, len(group)),
                limiter=f"{group_name}.saturation",
            )
        builder.Connect(command, torque.get_input_port(number))
    return torque.get_output_port()


def add_motor_limits(
    builder: DiagramBuilder,
    command: OutputPort,
    gains: ServoGains,
    group: list[int],
    name: str,
    *,
    bus: OutputPort,
    speed: Vector,
    limiter: str,
) -> OutputPort:
    """Add the limits of motors to commanded torques: the fall of the torque with speed, if any, and the torque limits.

    If the torque of no motor of the group falls with its speed, only the saturation is added. Its limits are infinite
    for motors that only their voltage limits.

    Args:
        builder: builder of the diagram.
        command: commanded torques of n joints [N·m].
        gains: gains and limits of all servos of the robot.
        group: indices of the n joints among these servos.
        name: prefix of the names of the blocks.
        bus: port that contains the speeds of the joints.
        speed: matrix from the bus to the speeds, shape (n, size of the bus).
        limiter: name of the last block, the saturation.

    Returns:
        The limited torques, size n [N·m].
    """
    if gains.line is not None and gains.line.slope[group].any():
        identity = np.eye(len(group))
        slope = gains.line.slope[group, np.newaxis] * speed
        # The module's equation: add D v, clip to the stall torque, subtract D v. Axes whose torque does not fall have
        # the slope 0.
        command_and_bus = add_multiplexer(builder, f"{name}.drives", command, bus)
        to_drive = np.hstack([identity, slope])
        driven = add_matrix_gain(builder, f"{name}.drive", to_drive, command_and_bus)
        driven = add_saturation(builder, driven, gains.line.stall[group], f"{name}.stall")
        driven_and_bus = add_multiplexer(builder, f"{name}.brakes", driven, bus)
        to_torque = np.hstack([identity, -slope])
        command = add_matrix_gain(builder, f"{name}.brake", to_torque, driven_and_bus)
    return add_saturation(builder, command, gains.limit_at_any_speed[group], limiter)


def add_saturation(
    builder: DiagramBuilder,
    port: OutputPort,
    limit: Vector,
    name: str,
) -> OutputPort:
    """Add a saturation of a port at a limit (n,) in both directions, in its unit, and return the saturated port."""
    return add_and_connect(builder, name, Saturation(-limit, limit), port)


class _BusEntry(NamedTuple):
    """Part of a port that the bus contains for each joint.

    Attributes:
        port: the port.
        offset: index in the port of the value of the first joint.
    """

    port: OutputPort
    offset: int


def _add_selector(
    builder: DiagramBuilder,
    signals: ServoSignals,
    groups: list[list[int]],
    name: str,
) -> Selector:
    """Add the block that sorts the signals by groups of joints.

    Its outputs are the buses of the groups: references, positions, velocities, then reference velocities and
    feedforward if they are wired, each for all joints of the group.

    Args:
        builder: builder of the diagram.
        signals: signals of all joints.
        groups: indices of the joints of each group.
        name: name of the block.

    Returns:
        the block, whose output number i is the bus of group i.
    """
    count = signals.reference.size()
    # The state has the positions of all joints, then, from index `count` on, their velocities.
    entries = [
        _BusEntry(signals.reference, offset=0),
        _BusEntry(signals.state, offset=0),
        _BusEntry(signals.state, offset=count),
    ]
    if signals.reference_velocity is not None:
        entries.append(_BusEntry(signals.reference_velocity, 0))
    if signals.feedforward is not None:
        entries.append(_BusEntry(signals.feedforward, 0))
    # Each port once, in order.
    inputs = list(dict.fromkeys(entry.port for entry in entries))

    input_parameters = []
    for number, port in enumerate(inputs):
        input_parameters.append(SelectorParams.InputPortParams(name=f"u{number}", size=port.size()))
    output_parameters = []
    for group in groups:
        # Signal by signal, each for all joints of the group: matrices of the laws have blocks in this order.
        selections = []
        for entry in entries:
            port_index = inputs.index(entry.port)
            for joint in group:
                selection = SelectorParams.OutputSelection(
                    input_port_index=port_index, input_offset=entry.offset + joint
                )
                selections.append(selection)
        output = SelectorParams.OutputPortParams(name=f"joints_{group[0]}", selections=selections)
        output_parameters.append(output)
    selector = Selector(SelectorParams(inputs=input_parameters, outputs=output_parameters))
    add_and_connect(builder, name, selector, *inputs)
    return selector


def _add_group(
    builder: DiagramBuilder,
    bus: OutputPort,
    gains: ServoGains,
    group: list[int],
    signals: ServoSignals,
    name: str,
) -> OutputPort:
    """Add the law of one group of n joints.

    Args:
        builder: builder of the diagram.
        bus: signals of the group, in the order that the module names.
        gains: gains and limits of all servos.
        group: indices of the joints among these servos.
        signals: signals of all joints, which define what the bus contains.
        name: prefix of the names of the blocks.

    Returns:
        The commanded torques before saturation, size n [N·m].
    """
    if gains.speed_limit is not None:
        return _add_cascade(builder, bus, gains, group, signals, name)
    identity = np.eye(len(group))
    kp = np.diag(gains.kp[group])
    kd = np.diag(gains.kd[group])
    # tau_c = kp (q_r - q) - kd (v - v_r) + tau_ff, as the product of a matrix with the bus.
    law = _bus_matrix(
        signals,
        reference=kp,
        position=-kp,
        velocity=-kd,
        reference_velocity=kd,
        feedforward=identity,
    )
    # An integrator costs the solver a state for each joint, so it is left out if no joint needs it.
    if (gains.ki[group] > 0).any():
        integral = add_integral(builder, [bus], gains, group, name)
        # The integral part i is appended to the bus, with the factor 1.
        law = np.hstack([law, identity])
        bus = add_multiplexer(builder, f"{name}.signals", bus, integral)
    return add_and_connect(builder, f"{name}.pd", MatrixGain(law), bus)


def _bus_matrix(
    signals: ServoSignals,
    *,
    reference: Vector,
    position: Vector,
    velocity: Vector,
    reference_velocity: Vector,
    feedforward: Vector,
) -> Vector:
    """Put together a matrix (n, size of the bus) that multiplies the bus of a group of n joints.

    Args:
        signals: signals of all joints. Reference velocity and feedforward are left out if they are not wired.
        reference: factors of the reference, shape (n, n), as all factors.
        position: factors of the position.
        velocity: factors of the velocity.
        reference_velocity: factors of the reference velocity.
        feedforward: factors of the feedforward.
    """
    blocks = [reference, position, velocity]
    if signals.reference_velocity is not None:
        blocks.append(reference_velocity)
    if signals.feedforward is not None:
        blocks.append(feedforward)
    return np.hstack(blocks)


def _speeds_of_bus(signals: ServoSignals, count: int) -> Vector:
    """Compute the matrix (count, size of the bus) from the bus of a group of joints to the joints' speeds.

    Args:
        signals: signals of all joints, which define what the bus contains.
        count: count of joints in the group.
    """
    zero = np.zeros((count, count))
    return _bus_matrix(
        signals,
        reference=zero,
        position=zero,
        velocity=np.eye(count),
        reference_velocity=zero,
        feedforward=zero,
    )


def _add_cascade(
    builder: DiagramBuilder,
    bus: OutputPort,
    gains: ServoGains,
    group: list[int],
    signals: ServoSignals,
    name: str,
) -> OutputPort:
    """Add the cascade of one group of n joints: a loop for the velocities inside of the one for the positions.

    Args:
        builder: builder of the diagram.
        bus: signals of the group, in the order that the module names.
        gains: gains and limits of all servos, with a speed limit.
        group: indices of the joints among these servos.
        signals: signals of all joints, which define what the bus contains.
        name: prefix of the names of the blocks.

    Returns:
        The commanded torques before saturation, size n [N·m].
    """
    assert gains.speed_limit is not None
    identity = np.eye(len(group))
    zero = np.zeros((len(group), len(group)))
    kd = np.diag(gains.kd[group])

    # Outer loop: v_c = clip(kp / kd (q_r - q) + v_r).
    rate = np.diag(gains.kp[group] / gains.kd[group])
    outer = _bus_matrix(
        signals,
        reference=rate,
        position=-rate,
        velocity=zero,
        reference_velocity=identity,
        feedforward=zero,
    )
    desired = add_and_connect(builder, f"{name}.position_loop", MatrixGain(outer), bus)
    speed = add_saturation(builder, desired, gains.speed_limit[group], f"{name}.speed_limit")

    # Inner loop: kd (v_c - v) + feedforward + integral part.
    inner = _bus_matrix(
        signals,
        reference=zero,
        position=zero,
        velocity=-kd,
        reference_velocity=zero,
        feedforward=identity,
    )
    ports = [speed, bus]
    columns = [kd, inner]
    if (gains.ki[group] > 0).any():
        measured = add_matrix_gain(
            builder, f"{name}.speed", _speeds_of_bus(signals, len(group)), bus
        )
        # The loop integrates an error of the speed, not of the position: x' = ki kd / kp (v_c - v).
        scaled_gains = replace(gains, ki=gains.ki * gains.kd / gains.kp)
        ports.append(add_integral(builder, [speed, measured], scaled_gains, group, name))
        columns.append(identity)
    law = MatrixGain(np.hstack(columns))
    all_ports = add_multiplexer(builder, f"{name}.signals", *ports)
    return add_and_connect(builder, f"{name}.velocity_loop", law, all_ports)


def add_integral(
    builder: DiagramBuilder,
    ports: Sequence[OutputPort],
    gains: ServoGains,
    group: list[int],
    name: str,
) -> OutputPort:
    """Add the clamped integrator of a group of n joints: x' = ki (r - y) + (clip(x) - x) / T, with the output clip(x).

    Args:
        builder: builder of the diagram.
        ports: ports whose first 2n values are the desired values r and the measured values y: positions, or speeds in
            a cascade. Further values are not used.
        gains: gains and limits of all servos.
        group: indices of the joints among these servos.
        name: prefix of the names of the blocks.

    Returns:
        the integral part clip(x), size n [N·m].
    """
    count = len(group)
    identity = np.eye(count)
    ki = np.diag(gains.ki[group])
    # Drake's A x + B u with u = (r, y, further values, clip(x)): A = -1/T, B = (ki, -ki, 0, 1/T).
    # The clipped state is fed back as an input. That is no algebraic loop, as D is 0.
    leak = identity / CLAMP_TIME
    size = sum(port.size() for port in ports)
    unused = np.zeros((count, size - 2 * count))
    integrator = LinearSystem(
        A=-leak,
        B=np.hstack([ki, -ki, unused, leak]),
        C=identity,
        D=np.zeros((count, size + count)),
    )
    builder.AddNamedSystem(f"{name}.integrator", integrator)
    integral_limit = gains.integral_limit[group]
    state = integrator.get_output_port()
    clipped = add_saturation(builder, state, integral_limit, f"{name}.integral_clip")
    inputs = add_multiplexer(builder, f"{name}.integrator_input", *ports, clipped)
    builder.Connect(inputs, integrator.get_input_port())
    return clipped


def set_actuators(
    plant: MultibodyPlant,
    joints: list[JointIndex],
    gains: ServoGains,
    *,
    with_servos: bool = True,
) -> None:
    """Set torque limits, dampers and PD gains of the actuators of joints, before the plant is finalized.

    Limits without gains are for the scheme ``cenic``, which clamps the torque of every actuator within its convex
    problem. The scheme linearises the input of an actuator at the start of a step. A block that saturates has no slope
    there, so a stiff servo would be stepped explicitly, and become unstable. Other solvers of Drake 1.51 only clamp
    actuators with gains.

    Args:
        plant: the plant.
        joints: joints of the n axes. Those without an actuator, as of passive axes, are left out.
        gains: gains and limits of the servos.
        with_servos: whether PD gains are set, too.
    """
    # All actuators are visited: those of one model instance are known only after Finalize().
    for index in range(plant.num_actuators()):
        actuator = plant.get_joint_actuator(JointActuatorIndex(index))
        joint = actuator.joint()
        if joint.index() not in joints:
            continue
        axis = joints.index(joint.index())
        actuator.set_effort_limit(float(gains.actuator_limit[axis]))
        # The damping D of a motor whose torque falls with its speed, in addition to the joint's own.
        joint.set_default_damping(joint.default_damping() + float(gains.damping[axis]))
        if with_servos:
            # The damper of the joint adds to the servo's gain, so the servo gets kd less the damping D.
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
    """Connect the desired state of a model instance whose actuators contain the PD gains.

    Args:
        builder: builder of the diagram.
        plant: the finalized plant.
        instance: the model instance.
        signals: signals of the servos, in axis order.
        gains: gains and limits of the servos, in axis order.
        actuation_map: matrix from axis torques to actuator torques, shape (actuators, n). Its entries are 0, or the
            sign 1 or -1 of an axis, so that it also converts positions.
        prefix: prefix of the names of the blocks.

    Returns:
        The torques that the motors apply, in axis order, size n [N·m]: those of the actuators, and of the dampers that
        make the torques fall with the speed. Those of passive axes are 0.
    """
    if len(actuation_map) == 0:  # a robot without any motor has no actuators to connect
        return add_and_connect(
            builder, f"{prefix}applied_torque", ConstantVectorSource(np.zeros(len(gains.kp)))
        )
    extra_torques = _extra_torques(builder, signals, gains, prefix)
    driven = ~gains.passive
    # Whether every axis that has a motor has a stiffness.
    is_stiff = bool((gains.kp[driven] > 0).all())
    ports = [signals.reference]
    columns: list[Vector] = [np.eye(len(gains.kp))]
    if is_stiff:
        # The module's equation of the desired position, q_r + tau_e / kp.
        # Each torque becomes an offset torque / kp of the desired position. An axis without a motor has no kp, and no
        # actuator that would read its position: its rows are zero.
        for extra in extra_torques:
            offsets = np.zeros(extra.matrix.shape)
            offsets[driven] = extra.matrix[driven] / gains.kp[driven, np.newaxis]
            ports.append(extra.port)
            columns.append(offsets)
    elif extra_torques:
        # A joint without stiffness cannot turn a torque into a position: the torques act directly. The desired position
        # stays the reference; where kp is 0 it has no effect.
        bus = add_multiplexer(
            builder, f"{prefix}extra_torques", *(extra.port for extra in extra_torques)
        )
        to_actuators = actuation_map @ np.hstack([extra.matrix for extra in extra_torques])
        torque = add_matrix_gain(builder, f"{prefix}actuation", to_actuators, bus)
        builder.Connect(torque, plant.get_actuation_input_port(instance))

    # The desired velocity is zero: the reference velocity is among the extra torques.
    position = actuation_map @ np.hstack(columns)
    to_desired_state = np.vstack([position, np.zeros_like(position)])
    source = add_multiplexer(builder, f"{prefix}desired", *ports)
    state = add_matrix_gain(builder, f"{prefix}desired_state", to_desired_state, source)
    builder.Connect(state, plant.get_desired_state_input_port(instance))

    applied = plant.get_net_actuation_output_port(instance)
    # With entries of 1 and -1, the transpose of the matrix converts the torques back.
    to_axes = actuation_map.T
    if gains.damping.any():
        # The joints' dampers are a part of the motors: their torques -D v count as the motors'.
        applied = add_multiplexer(builder, f"{prefix}applied_and_state", applied, signals.state)
        no_position_part = np.zeros_like(np.diag(gains.kp))
        to_axes = np.hstack([to_axes, no_position_part, -np.diag(gains.damping)])
    return add_matrix_gain(builder, f"{prefix}applied_torque", to_axes, applied)


class _ExtraTorque(NamedTuple):
    """A torque of the servos in addition to the PD part.

    Attributes:
        port: port with n values.
        matrix: matrix from these values to torques, shape (n, n).
    """

    port: OutputPort
    matrix: Vector


def _extra_torques(
    builder: DiagramBuilder, signals: ServoSignals, gains: ServoGains, prefix: str
) -> list[_ExtraTorque]:
    """Find the torques in addition to the PD part: of the reference velocity, the feedforward and the integral part.

    Adds the integrators to the diagram, if an axis has an integral gain.

    Args:
        builder: builder of the diagram.
        signals: signals of the servos, in axis order.
        gains: gains and limits of the servos, in axis order.
        prefix: prefix of the names of the blocks.

    Returns:
        the torques. Parts that are not wired are left out, and the integral part if no axis has an integral gain.
    """
    identity = np.eye(len(gains.kp))
    extra_torques = list[_ExtraTorque]()
    if signals.reference_velocity is not None:
        # The actuator damps by -kd v, towards rest: kd v_r makes it -kd (v - v_r).
        extra_torques.append(_ExtraTorque(signals.reference_velocity, np.diag(gains.kd)))
    if signals.feedforward is not None:
        extra_torques.append(_ExtraTorque(signals.feedforward, identity))
    if (gains.ki > 0).any():
        # The integrator acts on all axes as one group, in axis order: so the ports need no sorting.
        all_axes = list(range(len(gains.kp)))
        ports = [signals.reference, signals.state]
        integral = add_integral(builder, ports, gains, all_axes, f"{prefix}servo")
        extra_torques.append(_ExtraTorque(integral, identity))
    return extra_torques
