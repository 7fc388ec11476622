r"""Joint servos from Drake's primitives: PID with a clamped integrator, and saturation.

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

A motor on a voltage has less torque the faster it turns (:mod:`simrob_drake.robots.motors`). Its line of stall torque
:math:`\tau_s` and slope D is a damper beside a servo of constant limit,

.. math:: \tau = \mathrm{clip}_{\tau_p}\bigl(\mathrm{clip}_{\tau_s}(\tau_c + D v) - D v\bigr),

with the command :math:`\tau_c` and, where its current is limited below that of the stall, the limit :math:`\tau_p`.

Drake's PidController has no such clamp, and keeps an integrator state even where ki is 0, which made an implicit
integrator 1.4 times slower on six joints; so the PD part is a MatrixGain here. ``per_joint`` gives each joint blocks
of its own, as the Simulink picture does; ``vector`` is the same with one group that holds all joints.

Inside the plant's own actuators discrete and convex solvers treat the same law implicitly; PD and torque limit are set
in them before the plant is finalized. Feedforward, integral part and reference velocity, torques
:math:`\tau_e = \tau_{ff} + i + k_d v_r`, enter through the desired position,

.. math:: k_p (q_r + \tau_e / k_p - q) - k_d v = k_p (q_r - q) - k_d (v - v_r) + i + \tau_{ff},

which the actuator clamps as one. So no other port of the plant is wired: the scheme ``cenic`` differentiates each of
them at every step. (Drake 1.51 to 1.58 take a desired velocity with the wrong sign under it, too.) Where a joint has no
stiffness, :math:`\tau_e` of the whole robot enters through the actuation port. A motor's line whose limit of torque is
its stall torque is exact and implicit there, too: the joint has the damper D, and the servo the gain :math:`k_d - D`
and the constant limit :math:`\tau_s`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointActuatorIndex, JointIndex, ModelInstanceIndex, PdControllerGains
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
from simrob_drake.blocks.block import add_and_connect, add_matrix_gain, add_multiplexer

AT_LIMIT = 0.999
"""A motor is at its limit if it takes at least this share of what it can give, see `ServoGains.torque_shares`."""
NO_TORQUE = 1e-6
"""Torque below which a passive axis rests by itself [N·m or N]: rounding of sums of weights."""
CLAMP_TIME = 0.02
"""T [s]: slow enough for fixed steps of 10 ms, far faster than the load that an integrator is there to find."""


@dataclass(frozen=True)
class MotorLine:
    """How the torque of n motors falls with their speed.

    Attributes:
        stall: torque at rest by the voltage, shape (n,) [N·m]; infinite of axes without a motor.
        slope: D, shape (n,) [N·m·s/rad]; 0 of axes without a motor.
        damping: the part of D that the plant's joints have as dampers, shape (n,).
    """

    stall: Vector
    slope: Vector
    damping: Vector

    def bounds(self, speed: Vector, limit: Vector) -> tuple[Vector, Vector]:
        """Return the least and the largest torque (..., n) at a speed (..., n), within a limit (n,) to both sides.

        A limit that the line reaches at rest alone is none: against its turning a motor has more than its stall torque.
        """
        cap = self.cap(limit)
        lower, upper = (np.clip(side * self.stall - self.slope * speed, -cap, cap) for side in (-1.0, 1.0))
        return lower, upper

    def share(self, torque: Vector, speed: Vector, limit: Vector) -> Vector:
        """Return which part of the voltage or of the current torques (..., n) take at their speeds; 1 is all."""
        return np.asarray(np.fmax(np.abs(torque + self.slope * speed) / self.stall, np.abs(torque) / self.cap(limit)))

    def cap(self, limit: Vector) -> Vector:
        """Return the limit (n,) where it is below the stall torque, else infinity."""
        return np.where(limit < self.stall, limit, np.inf)


@dataclass(frozen=True)
class ServoGains:
    """Gains and limits of n servos, each of shape (n,): gains are not negative, limits are positive.

    An axis without a motor is passive: its gains and its limits are 0, and its torque is always 0. Of joints that slide
    the units are N for N·m and m for rad.
    """

    kp: Vector  # N·m/rad
    ki: Vector  # N·m/(rad·s)
    kd: Vector  # N·m·s/rad
    torque_limit: Vector  # N·m
    integral_limit: Vector  # N·m, of the integral part alone
    speed_limit: Vector | None = None  # rad/s, of what the outer loop of a cascade commands; None: no cascade
    line: MotorLine | None = None  # of the motors; None: the limit is all

    @property
    def passive(self) -> Flags:
        """Whether each axis is without a motor, shape (n,)."""
        return np.asarray(self.torque_limit == 0)

    @property
    def limit_at_rest(self) -> Vector:
        """Largest torque of each motor at rest, shape (n,) [N·m]: the limit, or the stall torque if that is smaller."""
        return self.torque_limit if self.line is None else np.minimum(self.torque_limit, self.line.stall)

    @property
    def judged_limit(self) -> Vector:
        """Torque limits that torques are compared with, shape (n,) [N·m]: infinite for passive axes.

        A passive axis has no torque, and no motor that could be too weak.
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
        limit = np.where(self.passive, 1.0, self.limit_at_rest)
        held_by_nothing = np.where(needed > NO_TORQUE, np.inf, 0.0)
        return np.where(self.passive, held_by_nothing, needed / limit)

    def torque_shares(self, torque: Vector, speed: Vector) -> Vector:
        """Compare torques with what the motors can give at their speeds.

        All judgements of motors use this function: those of plans, of runs, of walks and of monitors.

        Args:
            torque: torques, shape (..., n) [N·m].
            speed: speeds of the axes, shape (..., n) [rad/s].

        Returns:
            shares, shape (..., n): 1 is all that the motor can give. The limit counts, and of a motor whose torque
            falls with its speed its line, too. The share of a passive axis is 0.
        """
        if self.line is None:
            return np.asarray(np.abs(torque) / self.judged_limit)
        return self.line.share(torque, speed, self.judged_limit)

    @property
    def damping(self) -> Vector:
        """What the plant's joints have as dampers of the motors' lines, (n,) [N·m·s/rad]."""
        return np.zeros(len(self.kp)) if self.line is None else self.line.damping

    @property
    def cap(self) -> Vector:
        """What bounds torques at any speed, (n,) [N·m]; infinite of motors that their voltage bounds alone."""
        return self.torque_limit if self.line is None else self.line.cap(self.torque_limit)

    @property
    def actuator_limit(self) -> Vector:
        """The limit of actuators beside those dampers, (n,) [N·m]: the stall torque where there is one."""
        return (
            self.torque_limit if self.line is None else np.where(self.damping > 0, self.line.stall, self.torque_limit)
        )

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            InvalidParameter: a gain is negative or beyond `LARGEST_GAIN`, or is not 0 although the axis is passive; a
                limit is negative; the integral limit of an axis with a motor is 0; or a gain kp or kd is 0 in a
                cascade.
        """
        for name in ("kp", "ki", "kd"):
            values = getattr(self, name)
            if not ((values >= 0) & (values <= LARGEST_GAIN)).all():
                raise InvalidParameter(
                    name, values, message("blocks.of_zero_to", "of 0 to {largest:g}", largest=LARGEST_GAIN)
                )
        has_no_gains = (self.kp == 0) & (self.ki == 0) & (self.kd == 0)
        if not ((self.torque_limit > 0) | (self.passive & has_no_gains)).all():
            raise InvalidParameter(
                "torque_limit",
                self.torque_limit,
                message(
                    "blocks.positive_torque_or_passive",
                    "positive [N·m or N], or 0 of an axis without a motor, whose gains are 0",
                ),
            )
        if not (self.integral_limit[~self.passive] > 0).all():
            raise InvalidParameter(
                "integral_limit", self.integral_limit, message("blocks.positive_torque", "positive [N·m or N]")
            )
        if self.speed_limit is not None:
            if not (self.speed_limit > 0).all():
                raise InvalidParameter(
                    "speed_limit", self.speed_limit, message("blocks.positive_speed", "positive [rad/s or m/s]")
                )
            for name in ("kp", "kd"):
                least = float(getattr(self, name).min())
                if not least > 0:
                    raise InvalidParameter(
                        message("blocks.smallest", "the smallest {name}", name=name),
                        least,
                        message("blocks.positive_in_cascade", "positive in a cascade"),
                    )


@dataclass(frozen=True)
class ServoSignals:
    """What a bank of n servos reads: output ports of size n, but ``state`` of 2n."""

    reference: OutputPort  # desired positions [rad]
    state: OutputPort  # measured positions and velocities [rad, rad/s]
    reference_velocity: OutputPort | None = None  # [rad/s]
    feedforward: OutputPort | None = None  # [N·m], added before the saturation
    reference_acceleration: OutputPort | None = None  # [rad/s²], of which only the model's torques tell


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
    """Add servos for n joints and wire them to the signals that they read.

    Blocks are called ``<prefix><name>.pd`` and so on, by the names of the joints (``servo.pd`` for a vector):
    ``per_joint`` blocks for each of them, or one group for all. They saturate, unless the actuators that take the
    torques do.

    Returns:
        the torques, after saturation if the blocks saturate, size n [N·m].
    """
    count = len(names)
    groups = {name: [index] for index, name in enumerate(names)} if per_joint else {"servo": list(range(count))}
    selector = _add_selector(builder, signals, list(groups.values()), f"{prefix}joint_signals")
    name_of_all = f"{prefix}torque" if saturated else f"{prefix}command"
    torque = builder.AddNamedSystem(name_of_all, Multiplexer([len(group) for group in groups.values()]))
    for place, (name, group) in enumerate(groups.items()):
        bus, row = selector.get_output_port(place), f"{prefix}{name}"
        command = _add_group(builder, bus, gains, group, signals, row)
        if saturated:
            speed = _speeds_of_bus(signals, len(group))
            limiter = f"{row}.saturation"
            command = add_motor(builder, command, gains, group, row, bus=bus, speed=speed, limiter=limiter)
        builder.Connect(command, torque.get_input_port(place))
    return torque.get_output_port()


def add_motor(
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
    """Add what bounds the torques that a group of n joints is commanded: its motors' lines, if any, and its limits.

    Their speeds are ``speed`` (n, size of the bus) times what the bus carries; the last block is called ``limiter``.
    """
    if gains.line is not None and gains.line.slope[group].any():
        each, slope = np.eye(len(group)), gains.line.slope[group, np.newaxis] * speed
        driven = add_matrix_gain(
            builder, f"{name}.drive", np.hstack([each, slope]), add_multiplexer(builder, f"{name}.drives", command, bus)
        )
        driven = add_saturation(builder, driven, gains.line.stall[group], f"{name}.stall")
        pair = add_multiplexer(builder, f"{name}.brakes", driven, bus)
        command = add_matrix_gain(builder, f"{name}.brake", np.hstack([each, -slope]), pair)
    return add_saturation(builder, command, gains.cap[group], limiter)


def add_saturation(builder: DiagramBuilder, command: OutputPort, limit: Vector, name: str) -> OutputPort:
    """Add a saturation at ``limit`` (n,) [N·m] to both sides, and return what it lets through."""
    return add_and_connect(builder, name, Saturation(-limit, limit), command)


def _add_selector(builder: DiagramBuilder, signals: ServoSignals, groups: list[list[int]], name: str) -> Selector:
    """Add the bus: for each group of joints its references, positions, velocities and what else is wired."""
    count = signals.reference.size()
    rows = [(signals.reference, 0), (signals.state, 0), (signals.state, count)]
    rows += [(port, 0) for port in (signals.reference_velocity, signals.feedforward) if port is not None]
    inputs = list(dict.fromkeys(port for port, _ in rows))
    params = SelectorParams(
        inputs=[SelectorParams.InputPortParams(name=f"u{k}", size=port.size()) for k, port in enumerate(inputs)],
        outputs=[
            SelectorParams.OutputPortParams(
                name=f"joints_{group[0]}",
                selections=[
                    SelectorParams.OutputSelection(input_port_index=inputs.index(port), input_offset=offset + joint)
                    for port, offset in rows
                    for joint in group
                ],
            )
            for group in groups
        ],
    )
    selector = Selector(params)
    add_and_connect(builder, name, selector, *inputs)
    return selector


def _add_group(
    builder: DiagramBuilder, bus: OutputPort, gains: ServoGains, group: list[int], signals: ServoSignals, name: str
) -> OutputPort:
    """Add the law of one group of joints, whose signals ``bus`` carries, and return what it commands."""
    if gains.speed_limit is not None:
        return _add_cascade(builder, bus, gains, group, signals, name)
    proportional, derivative = np.diag(gains.kp[group]), np.diag(gains.kd[group])
    matrix = _of_bus(signals, proportional, -proportional, -derivative, derivative, np.eye(len(group)))
    if (gains.ki[group] > 0).any():
        integral = add_integral(builder, [bus], gains, group, name)
        matrix, bus = (
            np.hstack([matrix, np.eye(len(group))]),
            add_multiplexer(builder, f"{name}.signals", bus, integral),
        )
    return add_and_connect(builder, f"{name}.pd", MatrixGain(matrix), bus)


def _of_bus(signals: ServoSignals, *parts: Vector) -> Vector:
    """Return the matrix from a bus: parts of references, positions, velocities, reference velocities, feedforward."""
    wired = (True, True, True, signals.reference_velocity is not None, signals.feedforward is not None)
    return np.hstack([part for part, there in zip(parts, wired, strict=True) if there])


def _speeds_of_bus(signals: ServoSignals, count: int) -> Vector:
    """Return the matrix from the bus of a group of joints to their speeds."""
    each, none = np.eye(count), np.zeros((count, count))
    return _of_bus(signals, none, none, each, none, none)


def _add_cascade(
    builder: DiagramBuilder, bus: OutputPort, gains: ServoGains, group: list[int], signals: ServoSignals, name: str
) -> OutputPort:
    """Add the loop of the positions of one group of joints, and within it that of the velocities."""
    assert gains.speed_limit is not None
    each, none = np.eye(len(group)), np.zeros((len(group), len(group)))
    rate, damping = np.diag(gains.kp[group] / gains.kd[group]), np.diag(gains.kd[group])
    outer = MatrixGain(_of_bus(signals, rate, -rate, none, each, none))
    desired = add_and_connect(builder, f"{name}.position_loop", outer, bus)
    speed = add_saturation(builder, desired, gains.speed_limit[group], f"{name}.speed_limit")
    parts, columns = [speed, bus], [damping, _of_bus(signals, none, none, -damping, none, each)]
    if (gains.ki[group] > 0).any():
        measured = add_matrix_gain(builder, f"{name}.speed", _speeds_of_bus(signals, len(group)), bus)
        scaled = replace(gains, ki=gains.ki * gains.kd / gains.kp)
        parts.append(add_integral(builder, [speed, measured], scaled, group, name))
        columns.append(each)
    inner = MatrixGain(np.hstack(columns))
    return add_and_connect(builder, f"{name}.velocity_loop", inner, add_multiplexer(builder, f"{name}.signals", *parts))


def add_integral(
    builder: DiagramBuilder, ports: Sequence[OutputPort], gains: ServoGains, group: list[int], name: str
) -> OutputPort:
    """Add the clamped integrator of a group: x' = ki e + (clip(x) - x) / T, with clip(x) as its output.

    The ports carry the group's references and positions first, or speeds; what follows them is not used.
    """
    count, ki, limit = len(group), np.diag(gains.ki[group]), gains.integral_limit[group]
    size = sum(port.size() for port in ports)
    unused = np.zeros((count, size - 2 * count))
    leak = np.eye(count) / CLAMP_TIME
    nothing = np.zeros((count, size + count))
    integrator = LinearSystem(A=-leak, B=np.hstack([ki, -ki, unused, leak]), C=np.eye(count), D=nothing)
    builder.AddNamedSystem(f"{name}.integrator", integrator)
    clipped = add_saturation(builder, integrator.get_output_port(), limit, f"{name}.integral_clip")
    fed_back = add_multiplexer(builder, f"{name}.integrator_input", *ports, clipped)
    builder.Connect(fed_back, integrator.get_input_port())
    return clipped


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
    if len(actuation_map) == 0:  # a robot without any motor has no actuators to connect
        return add_and_connect(builder, f"{prefix}applied_torque", ConstantVectorSource(np.zeros(len(gains.kp))))
    extra, torque_of = _extra_torques(builder, signals, gains, prefix)
    driven = ~gains.passive
    stiff = bool((gains.kp[driven] > 0).all())
    ports = [signals.reference]
    columns: list[Vector] = [np.eye(len(gains.kp))]
    if stiff:
        # An axis without a motor has no kp, and no actuator that would read its position: its rows are zero.
        ports = [*ports, *extra]
        for matrix in torque_of:
            offsets = np.zeros(matrix.shape)
            offsets[driven] = matrix[driven] / gains.kp[driven, np.newaxis]
            columns.append(offsets)
    elif extra:
        bus = add_multiplexer(builder, f"{prefix}extra_torques", *extra)
        torque = add_matrix_gain(builder, f"{prefix}actuation", actuation_map @ np.hstack(torque_of), bus)
        builder.Connect(torque, plant.get_actuation_input_port(instance))
    position = actuation_map @ np.hstack(columns)
    desired = np.vstack([position, np.zeros_like(position)])
    source = add_multiplexer(builder, f"{prefix}desired", *ports)
    state = add_matrix_gain(builder, f"{prefix}desired_state", desired, source)
    builder.Connect(state, plant.get_desired_state_input_port(instance))
    applied, matrix = plant.get_net_actuation_output_port(instance), actuation_map.T
    if gains.damping.any():
        applied = add_multiplexer(builder, f"{prefix}applied_and_state", applied, signals.state)
        matrix = np.hstack([matrix, np.zeros_like(np.diag(gains.kp)), -np.diag(gains.damping)])
    return add_matrix_gain(builder, f"{prefix}applied_torque", matrix, applied)


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
