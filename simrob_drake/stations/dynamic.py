"""Wire a station's robots: each is moved by the torques of its servos, or its motion is the input.

The ports of a robot have one value for each of its n axes. The plant has its own order of positions and velocities; a
robot's *axis map* converts between the two by constant matrices.

In a *dynamic* station *servos* move the axes to the *reference*, the desired positions, and add a *feedforward*, which
are torques that are given or predicted. Servos are blocks, or parts of the actuators of Drake's plant (the realization
``implicit``). In a *kinematic* station the reference is the motion itself, and inverse dynamics gives the torques. The
names of a robot's ports and blocks begin with its *prefix*, which is empty for the only robot. The block *picture*
shows the diagram; `draw` labels a block in it, and `draw_nothing` makes a block a part of the arrows.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import Context, DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, Demultiplexer, PassThrough

from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.signals import Role, Signal, applied_signal
from simrob_drake.blocks.block import add_and_connect, add_matrix_gain, add_multiplexer, add_sum
from simrob_drake.blocks.command_bus import CommandBus
from simrob_drake.blocks.model_torque import (
    add_admittance,
    add_computed_torque,
    add_feedforward,
    add_model_torque,
)
from simrob_drake.blocks.monitor import SteadySteps
from simrob_drake.blocks.passive_joints import add_external_force, add_joint_stops
from simrob_drake.blocks.servo import (
    ServoSignals,
    add_actuator_servos,
    add_motor_limits,
    add_servos,
)
from simrob_drake.parts.inputs import InputPorts
from simrob_drake.parts.outputs import FromState
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationPlant, StationRobot
from simrob_drake.robots.motors import CommandBusConfig
from simrob_drake.stations.config import JointStops, StationConfig
from simrob_drake.stations.contact import wire_friction, with_friction
from simrob_drake.stations.ports import (
    StationPorts,
    draw_actuator_servos,
    draw_computed_torque,
    draw_feedforward,
    draw_integral,
    draw_servos,
)
from simrob_drake.stations.prescribed import (
    add_prescribed_motion,
    add_prescribed_torque,
    uses_reaction_forces,
)

_DERIVATIVES = "reference_velocity", "reference_acceleration"
"""Inputs of a robot's desired motion in addition to the positions."""

_STABLE = 2.0
"""An explicit damper on a mass is stable while kd·h / M stays below this (forward Euler on v' = -(kd/M) v)."""


def add_dynamic_robots(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add inputs, state, servos and friction of every robot, and the forces of all couplings.

    Joint stops are added if the engine does not hold joint limits itself. This is for dynamic stations. For kinematic
    ones, see :func:`add_kinematic_robots`.

    Raises:
        InvalidParameter: the station lists the input of an external force, but no robot has a tool.
        Unsuitable: a robot has a command bus, and an input that the bus does not transmit.
    """
    config = ports.config
    robots = ports.plant.robots
    _check_external_inputs(config, robots)
    # All robots first: the feedforward is one block that reads the references of all of them.
    signals = {name: _add_signals(builder, ports, robot) for name, robot in robots.items()}
    signals = _with_feedforward(builder, ports, signals)
    for robot in robots.values():
        _add_servos(builder, ports, robot, signals[robot.name])
        for external in ("external_force", "external_torque"):
            # Of several robots, only those with a tool get the input.
            if external in config.inputs and robot.tcp in robot.tools:
                _add_external_input(builder, ports, robot, external)
    # After the servos, which may have connected the desired state of friction already.
    wire_friction(builder, ports)
    # Schemes without joint limits need springs at the ends of the axes.
    if not config.engine.holds_joint_limits:
        stiffness, damping = stops_of(config, ports.plant)
        joints = ports.plant.joints
        stops = add_joint_stops(
            builder, ports.plant.plant, stiffness=stiffness, damping=damping, joints=joints
        )
        if stops is not None:
            ports.generalized_forces.append(stops)
    for name, coupling in config.couplings.items():
        coupling.add_forces(builder, ports, f"couplings.{name}")


def _check_external_inputs(config: StationConfig, robots: Mapping[str, StationRobot]) -> None:
    """Check that inputs of external forces have a tool on which they act. A station without robots passes.

    Raises:
        InvalidParameter: the station has robots and lists such an input, but none of the robots has a tool.
    """
    if not robots or any(robot.tcp for robot in robots.values()):
        return
    for name in config.inputs:
        if name.startswith("external"):
            expected = message(
                "stations.robot_with_tool",
                "for a robot with a tool, but no robot here has one; for a force on any link, use the section forces",
            )
            raise InvalidParameter("inputs", name, expected)


def _add_external_input(
    builder: DiagramBuilder,
    ports: StationPorts,
    robot: StationRobot,
    external: str,
) -> None:
    """Add the input of a force or torque at the tool centre point of a robot, in the tool's axes, size 3 [N or N·m].

    Args:
        builder: builder of the diagram.
        ports: ports of the station, which get the input, and an output with the applied values.
        robot: a robot with a tool.
        external: name of the input: ``external_force`` or ``external_torque``.
    """
    is_torque = external == "external_torque"
    name = f"{robot.prefix}{external}"
    tool = robot.tools[robot.tcp]
    block = add_external_force(builder, ports.plant.plant_block, tool, name=name, turns=is_torque)
    # Drake's inputs cannot be read: the block that passes the value on has an output, which is recorded below.
    entry = builder.AddNamedSystem(f"{name}.input", PassThrough(3))
    builder.Connect(entry.get_output_port(), block.get_command_input_port())
    ports.inputs[name] = entry.get_input_port()
    ports.spatial_forces.append(block.get_spatial_forces_output_port())

    output = name.replace("external", "applied")
    unit = "N·m" if is_torque else "N"
    title, label = _external_words(f"{robot.prefix}{robot.tcp}", turns=is_torque)
    ports.outputs.add(output, entry.get_output_port(), applied_signal(output, unit, title))
    ports.picture.draw(name, "force", label)


def stops_of(config: StationConfig, plant: StationPlant) -> Vector:
    """Collect the stiffness and damping of the stops at each of the plant's velocities.

    Joints that are no axes of a robot have the values that the station gives for all axes or, if it gives values by
    axis, the default values.

    Returns:
        stiffness [N·m/rad or N/m] and damping [N·m·s/rad or N·s/m], shape (2, nv).
    """
    stated = config.joint_stops.model_dump()  # by key: stiffness, then damping
    # Values by axis do not define the stops of a joint that is no axis, which gets the default values.
    usual = JointStops().model_dump()
    for_all = [
        usual[key] if isinstance(value, list | dict) else value for key, value in stated.items()
    ]
    stops = np.tile(np.array(for_all)[:, np.newaxis], plant.plant.num_velocities())
    # Each robot has its own stops, resolved for its axes.
    for robot in plant.robots.values():
        stops[:, robot.axis_map.velocity_places] = robot.stops
    return stops


def servo_inertias(
    config: StationConfig,
    robot: StationRobot,
    context: Context | None = None,
) -> Vector:
    """Inertias that the servos of a robot move, to judge their gains, shape (n,) [kg m² or kg].

    The inertia of an axis is that which it has while all other axes move freely. It is 1 for computed torque, whose
    gains are multiplied by the inertia already.

    Args:
        config: configuration of the station.
        robot: the robot.
        context: context of the plant with its positions; None for the positions at the start.
    """
    if config.servo_of(robot.name).law == "computed_torque":
        # tau = M (kp e + kd de/dt): the gains act on an inertia of 1.
        return np.ones(len(robot.axes))
    return robot.free_inertias(context)


def largest_explicit_steps(config: StationConfig, robot: StationRobot) -> Vector:
    """Largest time step at which the damping by the servo of each axis is stable in an explicit scheme, shape (n,) [s].

    The damping is the servo's gain kd. The step is infinite for an axis without it. The inertias are those at the
    start.
    """
    with np.errstate(divide="ignore"):  # an axis without damping has no largest step
        return np.asarray(_STABLE * servo_inertias(config, robot) / robot.gains.kd)


def check_servo_steps(config: StationConfig, plant: StationPlant) -> None:
    """Check that servos made of blocks are stable at the time step of an engine that evaluates blocks explicitly.

    Servos with the realization ``implicit`` pass.

    Raises:
        InvalidParameter: the servo of an axis is unstable; the message names the axis and the largest time step.
    """
    for robot in plant.robots.values():
        steps = largest_explicit_steps(config, robot)
        # A time step that suits the axis with the shortest one suits all axes.
        worst = int(np.argmin(steps))
        step = config.engine.time_step
        # An explicit damper is unstable if kd h / M exceeds 2, see `_STABLE`; servos in actuators are implicit.
        if config.servo_of(robot.name).realization != "implicit" and step > steps[worst]:
            why = message(
                "stations.blocks_damp",
                "the servo's blocks damp {prefix}{axis} with kd {kd:g}",
                prefix=robot.prefix,
                axis=robot.axes[worst],
                kd=robot.gains.kd[worst],
            )
            expected = message(
                "stations.largest_step",
                "at most {step:.2g} s, or servo.realization implicit: {why}",
                step=steps[worst],
                why=why,
            )
            raise InvalidParameter("solver.time_step", compound("{step:g} s", step=step), expected)


def axis_signal(robot: StationRobot, columns: str, output: str, role: Role) -> Signal:
    """Describe an output with one value for each axis of a robot.

    Args:
        robot: the robot.
        columns: beginning of the names of its columns, such as ``q`` in ``q.joint_1``; ``v`` stands for velocities.
        output: name of the output without the prefix of the robot.
        role: meaning of the values; ``effort`` for torques and forces.

    Returns:
        the description: names and SI units of the columns that the output has in results, its role and its full
        name.
    """
    units = []  # SI units of the values, one for each axis
    for unit in robot.model.units:
        if columns == "v":
            units.append(f"{unit.si}/s")
        elif role == "effort":
            units.append(unit.effort)
        else:
            units.append(unit.si)
    names = tuple(f"{robot.prefix}{columns}.{axis}" for axis in robot.axes)
    return Signal(names, tuple(units), role, f"{robot.prefix}{output}")


def add_motion(
    site: Site,
    robot: StationRobot,
    reference: OutputPort,
    position: OutputPort,
    velocity: OutputPort,
) -> None:
    """Declare the outputs of a robot's reference, position and velocity, size n each [rad or m, and rad/s or m/s].

    Position and velocity are linear functions of the plant's state, so that they can be computed from a record of
    states at once.

    Args:
        site: the station under construction, whose outputs are extended.
        robot: the robot.
        reference: port of the desired positions.
        position: port of the positions.
        velocity: port of the velocities.
    """
    count = len(robot.axes)
    rows = robot.axis_map.state_matrix
    # The state of the axes has n positions, then n velocities.
    positions_of_state = FromState(rows[:count])
    velocities_of_state = FromState(rows[count:])
    desired = axis_signal(robot, "q_ref", "reference", "reference")
    site.outputs.add(f"{robot.prefix}reference", reference, desired)
    motion = axis_signal(robot, "q", "position", "motion")
    site.outputs.add(f"{robot.prefix}position", position, motion, of_state=positions_of_state)
    speed = axis_signal(robot, "v", "velocity", "motion")
    site.outputs.add(f"{robot.prefix}velocity", velocity, speed, of_state=velocities_of_state)


def _add_signals(
    builder: DiagramBuilder,
    ports: StationPorts,
    robot: StationRobot,
) -> ServoSignals:
    """Add the inputs of a robot and the signals that its servos read.

    Returns:
        the signals: desired motion, state, and torques that are added. The derivatives of the desired motion are None
        if neither the station lists them as inputs nor the servos need them; the added torques are None if the station
        does not list them.
    """
    prefix = robot.prefix
    count = len(robot.joints)
    servo = ports.config.servo_of(robot.name)
    # The state of the axes: positions, then velocities, in the order and with the signs of the axes, size 2n.
    state = add_matrix_gain(builder, f"{prefix}axes", robot.axis_map.state_matrix, ports.state)
    split = Demultiplexer([count, count])
    # The block splits the state into the outputs `position` and `velocity`. Its own name is `state`.
    ports.outputs.add_report(
        builder, f"{prefix}state", split, state, f"{prefix}position", f"{prefix}velocity"
    )
    reference = ports.add_input(builder, robot, "reference")
    if robot.prescribed:
        # Prescribed axes follow their own input, so the servos' reference gets its position in
        # their places.
        reference = add_prescribed_motion(builder, ports, robot, reference)
    add_motion(ports, robot, reference, split.get_output_port(0), split.get_output_port(1))
    # The inputs that the station lists, and those that servos with a model of the robot need.
    names: set[str] = set(ports.config.inputs)
    if servo.follows_motion:
        names.update(_DERIVATIVES)
    optional = dict[str, OutputPort]()
    for name in (*_DERIVATIVES, "feedforward"):
        if name in names:
            optional[name] = ports.add_input(builder, robot, name)
    # Last: the bus delays all commands together, and the servos read the ports behind it.
    if servo.bus is not None:
        reference, optional = _add_bus(builder, ports, robot, servo.bus, reference, optional)
    return ServoSignals(reference, state, **optional)


def _add_bus(
    builder: DiagramBuilder,
    ports: StationPorts,
    robot: StationRobot,
    bus: CommandBusConfig,
    reference: OutputPort,
    optional: dict[str, OutputPort],
) -> tuple[OutputPort, dict[str, OutputPort]]:
    """Add the bus that brings the commands to a robot's servos: late, and with rounded positions.

    Args:
        builder: builder of the diagram.
        ports: ports of the station.
        robot: the robot.
        bus: parameters of the bus.
        reference: desired positions.
        optional: desired velocities by their name, if the station has them. A bus brings nothing else.

    Returns:
        the reference and the optional signals behind the bus.

    Raises:
        Unsuitable: the station has signals that a bus does not bring.
    """
    not_brought = next((name for name in optional if name != "reference_velocity"), None)
    if not_brought is not None:
        problem = message(
            "stations.bus_brings_positions",
            "a bus transmits only positions and velocities, not {signal}",
            signal=not_brought,
        )
        remedy = message(
            "stations.leave_out_bus", "leave out the bus, or {signal}", signal=not_brought
        )
        raise Unsuitable("servo.bus", problem, remedy)
    # Positions are rounded to the resolution of the bus or, if it has none, to that of each motor's encoder. 0 means no
    # rounding.
    own_steps = [0.0 if motor is None else motor.resolution_deg or 0.0 for motor in robot.motors]
    steps = np.array(own_steps)
    if bus.resolution_deg is not None:
        steps = np.full(len(robot.axes), bus.resolution_deg)
    # The resolution is given in the user's unit (deg, or m for a prismatic axis), and needed in rad or m.
    block = CommandBus(
        period=1 / bus.rate,
        delay=bus.delay,
        resolution=robot.model.user_units * steps,
        with_velocity=bool(optional),
    )
    name = f"{robot.prefix}command_bus"
    builder.AddNamedSystem(name, block)
    for key, port in {"reference": reference, **optional}.items():
        builder.Connect(port, block.GetInputPort(key))
    label = message("stations.block_bus", "Bus\n{rate:g} Hz", rate=bus.rate)
    if bus.delay:
        label += message(
            "stations.block_late", ", delay {delay:g} ms", delay=1000 * bus.delay / bus.rate
        )
    ports.picture.draw(name, "servo", label, robot)
    return block.GetOutputPort("reference"), {key: block.GetOutputPort(key) for key in optional}


def _with_feedforward(
    builder: DiagramBuilder, ports: StationPorts, signals: Mapping[str, ServoSignals]
) -> dict[str, ServoSignals]:
    """Add the torques that the model predicts for the desired motion to the signals that the servos read.

    Args:
        builder: builder of the diagram.
        ports: ports of the station.
        signals: signals of each robot's servos, by the robot's name.

    Returns:
        the signals, with the predicted torques in the feedforward of the robots that have such servos.
    """
    servo_of = ports.config.servo_of
    # The signals of the robots whose servos have a predicted torque.
    predicted = {name: own for name, own in signals.items() if servo_of(name).feedforward != "none"}
    if not predicted:
        return dict(signals)
    changed = dict(signals)
    maps = [(ports.plant.robots[name].axis_map, own) for name, own in predicted.items()]
    # One port of torques for each of these robots, size n each.
    torques = add_feedforward(builder, ports.plant.plant, maps, name="model_feedforward")
    for (name, own), torque in zip(predicted.items(), torques, strict=True):
        robot = ports.plant.robots[name]
        parts = [torque]
        if own.feedforward is not None:  # the station's own input of that name
            parts.append(own.feedforward)
        damping = robot.gains.damping
        if damping.any() and servo_of(name).feedforward == "inverse_dynamics":
            # The plant has the falling torque line of a motor as a damper of the joint. It is not a load, so the
            # torque d v_r that the inverse dynamics adds for it, at the desired velocity v_r, is subtracted.
            assert own.reference_velocity is not None
            matrix = -np.diag(damping)
            name_of_part = f"{robot.prefix}motors.feedforward"
            parts.append(add_matrix_gain(builder, name_of_part, matrix, own.reference_velocity))
        whole = add_sum(builder, f"{robot.prefix}whole_feedforward", *parts)
        changed[name] = replace(own, feedforward=whole)
    draw_feedforward(ports, list(predicted))
    return changed


def declare_torque(site: Site, robot: StationRobot, torque: OutputPort) -> None:
    """Declare the output of the torques of a robot's axes, size n [N·m or N]."""
    site.outputs.add(f"{robot.prefix}torque", torque, axis_signal(robot, "tau", "torque", "effort"))


def _add_servos(
    builder: DiagramBuilder,
    ports: StationPorts,
    robot: StationRobot,
    signals: ServoSignals,
) -> None:
    """Add the servos of a robot, in the plant's actuators or as blocks, and the output of their torques.

    Args:
        builder: builder of the diagram.
        ports: ports of the station, which get the output ``torque``.
        robot: the robot.
        signals: desired motion, state of the axes and feedforward that the servos read.
    """
    servo = ports.config.servo_of(robot.name)
    plant = ports.plant.plant
    if servo.realization == "implicit":
        # A joint may have an actuator for its friction, and a passive axis has no motor: neither
        # gets a torque of a servo.
        actuation = robot.axis_map.actuation_matrix(plant, robot.instance, robot.gains.passive)
        torque = add_actuator_servos(
            builder,
            ports.plant.plant_block,
            robot.instance,
            signals,
            robot.gains,
            actuation_map=actuation,
            prefix=robot.prefix,
        )
        if ports.config.engine.actuator_torques_lack_friction:
            # Only an axis with a motor has a torque that friction was subtracted from.
            driven = [int(axis) for axis in np.flatnonzero(~robot.gains.passive)]
            torque = with_friction(builder, ports, robot, torque, axes=driven)
        declare_torque(ports, robot, torque)
        draw_actuator_servos(ports, robot)
        if (robot.gains.ki > 0).any():
            all_axes = list(range(len(robot.axes)))
            label = message("stations.block_joints", "{count} joints", count=len(robot.axes))
            draw_integral(ports, robot, "servo", all_axes, label)
    elif servo.admittance_gain > 0:
        # This declares the output of the torques, too.
        _add_admittance_servos(builder, ports, robot, signals)
    else:
        torque = _add_servo_blocks(builder, ports, robot, signals)
        if robot.prescribed:
            # The motion of a prescribed axis is given: its torque is computed, and replaces that of
            # the servo.
            torque = add_prescribed_torque(builder, ports, robot, torque)
            # Torques from reaction forces lack the friction of the motors.
            if uses_reaction_forces(ports.config):
                torque = with_friction(builder, ports, robot, torque, axes=list(robot.prescribed))
        declare_torque(ports, robot, torque)


def _add_servo_blocks(
    builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, signals: ServoSignals
) -> OutputPort:
    """Add the servos of a robot as blocks, and connect them to the plant's actuators.

    With some engines, the actuators limit the torques themselves. The blocks then give commands without limits, and
    another block computes the torques that the actuators apply.

    Args:
        builder: builder of the diagram.
        ports: ports of the station.
        robot: the robot.
        signals: desired motion, state of the axes and feedforward that the servos read.

    Returns:
        the applied torques, size n [N·m or N].
    """
    plant = ports.plant.plant
    servo = ports.config.servo_of(robot.name)
    count = len(robot.axes)
    # Whether the engine limits the torques in the actuators, so that the servos must not.
    in_actuators = ports.config.engine.limits_torques_in_actuators
    prefix = robot.prefix
    per_joint = servo.realization == "per_joint"
    # Selects the velocities from the state of the axes, which has the positions first.
    to_speed = np.eye(2 * count)[count:]

    def add_limits(command: OutputPort) -> OutputPort:
        """Add a block that limits commands by the torque limits and motors of all axes. Returns the torques."""
        return add_motor_limits(
            builder,
            command,
            robot.gains,
            list(range(count)),
            f"{prefix}motors",
            bus=signals.state,
            speed=to_speed,
            limiter=f"{prefix}torque",
        )

    if servo.law == "computed_torque":
        # One block for all joints: the mass matrix couples them.
        name = f"{prefix}computed_torque"
        command = add_computed_torque(
            builder, plant, ports.state, robot.axis_map, signals, robot.gains, name=name
        )
        if not in_actuators:
            command = add_limits(command)
        draw_computed_torque(ports, robot)
    else:
        command = add_servos(
            builder,
            signals,
            robot.gains,
            names=robot.axes,
            prefix=prefix,
            per_joint=per_joint,
            saturated=not in_actuators,
        )
        draw_servos(ports, robot, per_joint=per_joint)
    # Maps the torques of the n axes to those of the robot's actuators, shape (actuators, n). A passive axis has no
    # actuator.
    matrix = robot.axis_map.actuation_matrix(plant, robot.instance, robot.gains.passive)
    driven = command  # torques with which the actuators drive
    if robot.gains.damping.any():
        # The plant's joints have the motors' dampers, -d v. Actuators that drive with tau + d v leave tau in all.
        bus = add_multiplexer(builder, f"{prefix}motors.commands", command, signals.state)
        dampers = np.hstack([np.eye(count), np.diag(robot.gains.damping) @ to_speed])
        driven = add_matrix_gain(builder, f"{prefix}motors.driven", dampers, bus)
    if len(matrix) > 0:  # a robot without any motor has no actuators to connect
        actuation = add_matrix_gain(builder, f"{prefix}actuators", matrix, driven)
        builder.Connect(actuation, ports.plant.plant_block.get_actuation_input_port(robot.instance))
    return add_limits(command) if in_actuators else command


def _external_words(place: str, *, turns: bool) -> tuple[str, str]:
    """Words for a force from outside: title of its plot, and label of its block.

    Args:
        place: name of the tool on which the force acts.
        turns: whether it is a torque.
    """
    if turns:
        title = message(
            "stations.external_torque_at",
            "external torque at {place}, in the tool's axes",
            place=place,
        )
        return title, message(
            "stations.block_external_torque", "External torque\nat {place}", place=place
        )
    title = message(
        "stations.external_force_at", "external force at {place}, in the tool's axes", place=place
    )
    return title, message(
        "stations.block_external_force", "External force\nat {place}", place=place
    )


def _add_admittance_servos(
    builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, signals: ServoSignals
) -> None:
    """Add servos that give way to external torques, and an output of these torques.

    An integrator of the external torque gives a further torque, which is added to that of the servos.

    The external ("felt") torque is the model's torque at the present state without acceleration, minus the torque of
    the servos.
    """
    prefix = robot.prefix
    gain = ports.config.servo_of(robot.name).admittance_gain
    plant = ports.plant.plant
    name = f"{prefix}model_torque"
    # Zero acceleration: the mode for gravity alone would leave out the Coriolis terms C v.
    no_acceleration = ConstantVectorSource(np.zeros(plant.num_velocities()))
    steady = add_and_connect(builder, f"{name}.acceleration", no_acceleration)
    force = add_model_torque(builder, plant, ports.state, steady, name=name)
    model = add_matrix_gain(builder, f"{name}.axes", robot.axis_map.velocity_matrix, force)
    yielding = add_admittance(builder, signals, robot.gains, model, gain=gain, prefix=prefix)
    feedforward = [] if signals.feedforward is None else [signals.feedforward]
    total = add_sum(builder, f"{prefix}feedforward_sum", *feedforward, yielding)
    torque = _add_servo_blocks(builder, ports, robot, replace(signals, feedforward=total))
    declare_torque(ports, robot, torque)
    label = message("stations.block_admittance", "Admittance\nintegrator, {gain:g} 1/s", gain=gain)
    ports.picture.draw(f"{prefix}admittance", "servo", label, robot)
    label = message("stations.block_model_torque", "Model torque\nwithout acceleration")
    ports.picture.draw(f"{prefix}model_torque", "servo", label, robot)
    # Sums and stacks of signals would only clutter the picture.
    hidden = [f"{prefix}felt_torque", f"{prefix}model_torque.axes", f"{prefix}admittance.bus"]
    ports.picture.draw_nothing(*hidden)
    # felt = torque of the model - torque of the servos, as a matrix on both.
    felt = add_multiplexer(builder, f"{prefix}felt_torque.bus", model, torque)
    difference = np.hstack([np.eye(len(robot.joints)), -np.eye(len(robot.joints))])
    output = f"{prefix}felt_torque"
    port = add_matrix_gain(builder, output, difference, felt)
    ports.outputs.add(output, port, axis_signal(robot, "felt", "felt_torque", "effort"))


STEP = 0.01
"""Step of a kinematic station [s]. Nothing is integrated there, so a simulator would go to the end in one step, and
monitors would miss all that happens before."""

_MOTION = ("reference", "reference_velocity", "reference_acceleration")
"""Inputs of a robot's motion in a kinematic station: positions, velocities and accelerations."""


def add_motion_inputs(
    builder: DiagramBuilder, plant: StationPlant
) -> tuple[InputPorts, OutputPort]:
    """Add inputs of position, velocity and acceleration for every robot of a kinematic station.

    Returns:
        the inputs, each that of a block that passes its values on, and a port with the state of the whole plant
        (nq + nv,) that follows from the positions and velocities.
    """
    inputs = InputPorts()
    motions: list[OutputPort] = []
    for robot in plant.robots.values():
        for signal in _MOTION:
            block = builder.AddNamedSystem(
                f"{robot.prefix}{signal}", PassThrough(len(robot.joints))
            )
            inputs[f"{robot.prefix}{signal}"] = block.get_input_port()
            if signal != "reference_acceleration":  # the state has no accelerations
                motions.append(block.get_output_port())
    # The transposed map of a robot's axes puts their values into the state of the plant.
    to_state = np.hstack([robot.axis_map.state_matrix.T for robot in plant.robots.values()])
    motion = add_multiplexer(builder, "motions", *motions)
    return inputs, add_matrix_gain(builder, "multibody_state", to_state, motion)


def add_kinematic_robots(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add the outputs, inverse dynamics and geometry poses of the robots of a kinematic station.

    The plant is not in the diagram and is never stepped: the inputs of `add_motion_inputs` determine its state. Another
    block bounds the length of the simulator's steps.
    """
    robots = ports.plant.robots.values()
    accelerations = []
    for robot in robots:
        # The blocks of the inputs pass the values on unchanged.
        position, velocity, acceleration = (
            ports.inputs[f"{robot.prefix}{signal}"].get_system().get_output_port()
            for signal in _MOTION
        )
        # The robot follows its reference exactly, so the position serves as the reference as well.
        add_motion(ports, robot, position, position, velocity)
        accelerations.append(acceleration)
    # tau = M(q) dv/dt + C(q, v) v + tau_g(q) of the desired motion.
    dynamics = InverseDynamics(
        ports.plant.plant, InverseDynamics.InverseDynamicsMode.kInverseDynamics
    )
    builder.AddNamedSystem("inverse_dynamics", dynamics)
    builder.Connect(ports.state, dynamics.get_input_port_estimated_state())
    # Accelerations are in the order of the plant's velocities.
    to_velocities = np.hstack([robot.axis_map.velocity_matrix.T for robot in robots])
    of_axes = add_multiplexer(builder, "robot_accelerations", *accelerations)
    desired = add_matrix_gain(builder, "accelerations", to_velocities, of_axes)
    builder.Connect(desired, dynamics.get_input_port_desired_acceleration())
    force = dynamics.get_output_port_generalized_force()
    for robot in robots:
        # Drake's plant has no friction of joints, so it is added to the torques that move the
        # robot.
        torque = add_matrix_gain(
            builder, f"{robot.prefix}torque", robot.axis_map.velocity_matrix, force
        )
        declare_torque(ports, robot, with_friction(builder, ports, robot, torque))
    builder.Connect(ports.state, ports.plant.add_geometry_poses(builder, of_state=True))
    # Nothing else limits the steps of a kinematic station, see STEP.
    builder.AddNamedSystem("steady_steps", SteadySteps(STEP))
