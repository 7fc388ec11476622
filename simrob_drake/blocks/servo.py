r"""Joint servos from Drake's primitives: PID with a clamped integrator, and saturation.

The law of each joint is that of the Simulink stations (subsystem ``ABB_irb120_qLC``), with an optional integral part:

.. math::
    \tau = \mathrm{sat}\bigl(k_p (q_r - q) - k_d\,(v - v_r) + i + \tau_{ff}\bigr), \qquad
    \dot x = k_i (q_r - q) + \frac{\mathrm{clip}(x) - x}{T}, \quad i = \mathrm{clip}(x)

where :math:`v_r = 0` unless a reference velocity is wired. The integral part is clipped to a torque, and its state
leaks back to that bound with time constant T, so it neither winds up nor chatters.

Drake's PidController has no such clamp, and keeps an integrator state even where ki is 0, which made an implicit
integrator 1.4 times slower on six joints; so the PD part is a MatrixGain here. ``per_joint`` gives each joint blocks
of its own, as the Simulink picture does; ``vector`` is the same with one group that holds all joints.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import LinearSystem, MatrixGain, Multiplexer, Saturation, Selector, SelectorParams

from simrob_drake.blocks.wiring import fed, joined
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector

LARGEST_GAIN = 1e9
"""Of any servo, in its units: a hydraulic cylinder has a tenth of it, and solvers creep through more."""
CLAMP_TIME = 0.02
"""T [s]: slow enough for fixed steps of 10 ms, far faster than the load that an integrator is there to find."""


@dataclass(frozen=True)
class ServoGains:
    """The figures of n servos, each of shape (n,): gains not negative, limits positive.

    Of joints that slide the units are N for N·m and m for rad.
    """

    kp: Vector  # N·m/rad
    ki: Vector  # N·m/(rad·s)
    kd: Vector  # N·m·s/rad
    torque_limit: Vector  # N·m
    integral_limit: Vector  # N·m, of the integral part alone

    def __post_init__(self) -> None:
        """Check the figures.

        Raises:
            InvalidParameter: a gain that is negative or beyond `LARGEST_GAIN`, or a limit that is not positive.
        """
        for name in ("kp", "ki", "kd"):
            values = getattr(self, name)
            if not ((values >= 0) & (values <= LARGEST_GAIN)).all():
                raise InvalidParameter(name, values, f"of 0 to {LARGEST_GAIN:g}")
        for name in ("torque_limit", "integral_limit"):
            if not (getattr(self, name) > 0).all():
                raise InvalidParameter(name, getattr(self, name), "positive [N·m or N]")


@dataclass(frozen=True)
class ServoSignals:
    """What a bank of n servos reads: output ports of size n, but ``state`` of 2n."""

    reference: OutputPort  # desired positions [rad]
    state: OutputPort  # measured positions and velocities [rad, rad/s]
    reference_velocity: OutputPort | None = None  # [rad/s]
    feedforward: OutputPort | None = None  # [N·m], added before the saturation


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
        command = _add_group(builder, selector.get_output_port(place), gains, group, signals, f"{prefix}{name}")
        if saturated:
            command = add_saturation(builder, command, gains.torque_limit[group], f"{prefix}{name}.saturation")
        builder.Connect(command, torque.get_input_port(place))
    return torque.get_output_port()


def add_saturation(builder: DiagramBuilder, command: OutputPort, limit: Vector, name: str) -> OutputPort:
    """Add a saturation at ``limit`` (n,) [N·m] to both sides, and return what it lets through."""
    return fed(builder, name, Saturation(-limit, limit), command)


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
    fed(builder, name, selector, *inputs)
    return selector


def _add_group(
    builder: DiagramBuilder,
    bus: OutputPort,
    gains: ServoGains,
    group: list[int],
    signals: ServoSignals,
    name: str,
) -> OutputPort:
    """Add PD and integral part of one group of joints, whose signals ``bus`` carries, and return what they command."""
    proportional, derivative = np.diag(gains.kp[group]), np.diag(gains.kd[group])
    columns = [proportional, -proportional, -derivative]
    if signals.reference_velocity is not None:
        columns.append(derivative)
    if signals.feedforward is not None:
        columns.append(np.eye(len(group)))
    matrix = np.hstack(columns)
    if (gains.ki[group] > 0).any():
        integral = add_integral(builder, [bus], gains, group, name)
        matrix, bus = np.hstack([matrix, np.eye(len(group))]), joined(builder, f"{name}.signals", bus, integral)
    return fed(builder, f"{name}.pd", MatrixGain(matrix), bus)


def add_integral(
    builder: DiagramBuilder, ports: Sequence[OutputPort], gains: ServoGains, group: list[int], name: str
) -> OutputPort:
    """Add the clamped integrator of a group: x' = ki e + (clip(x) - x) / T, with clip(x) as its output.

    The ports carry the group's references and positions first; what follows them is not used.
    """
    count, ki, limit = len(group), np.diag(gains.ki[group]), gains.integral_limit[group]
    size = sum(port.size() for port in ports)
    unused = np.zeros((count, size - 2 * count))
    leak = np.eye(count) / CLAMP_TIME
    nothing = np.zeros((count, size + count))
    integrator = LinearSystem(A=-leak, B=np.hstack([ki, -ki, unused, leak]), C=np.eye(count), D=nothing)
    builder.AddNamedSystem(f"{name}.integrator", integrator)
    clipped = add_saturation(builder, integrator.get_output_port(), limit, f"{name}.integral_clip")
    fed_back = joined(builder, f"{name}.integrator_input", *ports, clipped)
    builder.Connect(fed_back, integrator.get_input_port())
    return clipped
