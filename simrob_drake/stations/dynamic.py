"""Wire a station's robots: each is moved by the torques of its servos, or its motion is the input."""

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
from simrob_drake.blocks.model_torque import add_admittance, add_computed_torque, add_feedforward, add_model_torque
from simrob_drake.blocks.monitor import SteadySteps
from simrob_drake.blocks.passive_joints import add_external_force, add_joint_stops
from simrob_drake.blocks.servo import ServoSignals, add_actuator_servos, add_motor, add_servos
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
from simrob_drake.stations.prescribed import add_prescribed_motion, add_prescribed_torque, uses_reaction_forces

_DERIVATIVES = "reference_velocity", "reference_acceleration"
_STABLE = 2.0
"""An explicit damper on a mass is stable while kd·h / M stays below this (forward Euler on v' = -(kd/M) v)."""


def add_dynamic_robots(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add inputs, state, servos, friction and joint stops for every robot of a plant that stands in the diagram."""
    config, robots = ports.config, ports.plant.robots
    if robots and not any(robot.tcp for robot in robots.values()):
        for external in config.inputs:
            if external.startswith("external"):
                expected = message(
                    "stations.robot_with_tool",
                    "for a robot with a tool, and none has one here; the section forces acts on any link",
                )
                raise InvalidParameter("inputs", external, expected)
    signals = _with_feedforward(builder, ports, {name: _add_signals(builder, ports, robots[name]) for name in robots})
    for robot in robots.values():
        _add_servos(builder, ports, robot, signals[robot.name])
        for external in ("external_force", "external_torque"):
            if external not in config.inputs or robot.tcp not in robot.tools:
                continue
            name, tool, turns = f"{robot.prefix}{external}", robot.tools[robot.tcp], external == "external_torque"
            block = add_external_force(builder, ports.plant.stepped, tool, name=name, turns=turns)
            entry = builder.AddNamedSystem(f"{name}.input", PassThrough(3))
            builder.Connect(entry.get_output_port(), block.get_command_input_port())
            ports.inputs[name] = entry.get_input_port()
            output, unit = name.replace("external", "applied"), "N·m" if turns else "N"
            place = f"{robot.prefix}{robot.tcp}"
            title, label = _external_words(place, turns=turns)
            ports.outputs.add(output, entry.get_output_port(), applied_signal(output, unit, title))
            ports.spatial_forces.append(block.get_spatial_forces_output_port())
            ports.picture.draw(name, "force", label)
    wire_friction(builder, ports)
    if not config.engine.holds_joint_limits:
        stiffness, damping = stops_of(config, ports.plant)
        joints = ports.plant.joints
        stops = add_joint_stops(builder, ports.plant.plant, stiffness=stiffness, damping=damping, joints=joints)
        ports.generalized_forces.extend([stops] if stops is not None else [])
    for name, coupling in config.couplings.items():
        coupling.add_forces(builder, ports, f"couplings.{name}")


def stops_of(config: StationConfig, plant: StationPlant) -> Vector:
    """Return stiffness and damping of the stop at each of the plant's velocities, shape (2, nv).

    Joints that are no axes have what the station says of all.
    """
    stated, usual = config.joint_stops.model_dump(), JointStops().model_dump()
    of_all = [usual[key] if isinstance(value, list | dict) else value for key, value in stated.items()]
    stops = np.tile(np.array(of_all)[:, np.newaxis], plant.plant.num_velocities())
    for robot in plant.robots.values():
        stops[:, robot.axis_map.velocity_places] = robot.stops
    return stops


def servo_inertias(config: StationConfig, robot: StationRobot, context: Context | None = None) -> Vector:
    """Return what the gains of a robot's servos are to be compared with, (n,): 1 where they are by inertia already."""
    by_inertia = config.servo_of(robot.name).law == "computed_torque"
    return np.ones(len(robot.axes)) if by_inertia else robot.free_inertias(context)


def largest_explicit_steps(config: StationConfig, robot: StationRobot) -> Vector:
    """Return the largest step (n,) [s] at which each joint's damping is stable when it is stepped explicitly."""
    with np.errstate(divide="ignore"):
        return np.asarray(_STABLE * servo_inertias(config, robot) / robot.gains.kd)


def check_servo_steps(config: StationConfig, plant: StationPlant) -> None:
    """Check that servo blocks are stable at an explicit engine's steps; raises InvalidParameter: a joint's are not."""
    for robot in plant.robots.values():
        steps = largest_explicit_steps(config, robot)
        worst = int(np.argmin(steps))
        step = config.engine.time_step
        if config.servo_of(robot.name).realization != "implicit" and step > steps[worst]:
            why = message(
                "stations.blocks_damp",
                "blocks damp {prefix}{axis} with a kd of {kd:g}",
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
    """Return what an output of one value an axis is."""
    units = robot.model.units
    shown = [f"{unit.si}/s" if columns == "v" else unit.effort if role == "effort" else unit.si for unit in units]
    names = tuple(f"{robot.prefix}{columns}.{axis}" for axis in robot.axes)
    return Signal(names, tuple(shown), role, f"{robot.prefix}{output}")


def add_motion(
    site: Site, robot: StationRobot, reference: OutputPort, position: OutputPort, velocity: OutputPort
) -> None:
    """Declare what a robot is asked and how it moves, which the plant's state tells at once."""
    rows, count = robot.axis_map.state_matrix, len(robot.axes)
    site.outputs.add(f"{robot.prefix}reference", reference, axis_signal(robot, "q_ref", "reference", "reference"))
    motion = axis_signal(robot, "q", "position", "motion")
    site.outputs.add(f"{robot.prefix}position", position, motion, of_state=FromState(rows[:count]))
    speed = axis_signal(robot, "v", "velocity", "motion")
    site.outputs.add(f"{robot.prefix}velocity", velocity, speed, of_state=FromState(rows[count:]))


def _add_signals(builder: DiagramBuilder, ports: StationPorts, robot: StationRobot) -> ServoSignals:
    prefix, count, listed = robot.prefix, len(robot.joints), ports.config.inputs
    state = add_matrix_gain(builder, f"{prefix}axes", robot.axis_map.state_matrix, ports.state)
    split = Demultiplexer([count, count])
    ports.outputs.add_report(builder, f"{prefix}state", split, state, f"{prefix}position", f"{prefix}velocity")
    reference = ports.add_input(builder, robot, "reference")
    if robot.prescribed:
        reference = add_prescribed_motion(builder, ports, robot, reference)
    add_motion(ports, robot, reference, split.get_output_port(0), split.get_output_port(1))
    read = {*listed, *(_DERIVATIVES if ports.config.servo_of(robot.name).follows_motion else ())}
    optional = {name: ports.add_input(builder, robot, name) for name in (*_DERIVATIVES, "feedforward") if name in read}
    if (bus := ports.config.servo_of(robot.name).bus) is not None:
        reference = _add_bus(builder, ports, robot, bus, reference, optional)
    return ServoSignals(reference, state, **optional)


def _add_bus(
    builder: DiagramBuilder,
    ports: StationPorts,
    robot: StationRobot,
    bus: CommandBusConfig,
    reference: OutputPort,
    optional: dict[str, OutputPort],
) -> OutputPort:
    """Add the bus that brings a robot's servos their commands; return the references behind it, velocities in place."""
    fast = next((name for name in optional if name != "reference_velocity"), None)
    if fast is not None:
        raise Unsuitable(
            "servo.bus",
            message("stations.bus_brings_positions", "a bus brings positions and speeds alone, not {fast}", fast=fast),
            message("stations.leave_out_bus", "leave out the bus, or {fast}", fast=fast),
        )
    own_steps = [0.0 if motor is None else motor.resolution_deg or 0.0 for motor in robot.motors]
    steps = np.array(own_steps) if bus.resolution_deg is None else np.full(len(robot.axes), bus.resolution_deg)
    own = {"reference": reference, **optional}
    block = CommandBus(
        period=1 / bus.rate,
        delay=bus.delay,
        resolution=robot.model.user_units * steps,
        with_velocity=bool(optional),
    )
    name = f"{robot.prefix}command_bus"
    builder.AddNamedSystem(name, block)
    for key, port in own.items():
        builder.Connect(port, block.GetInputPort(key))
        own[key] = block.GetOutputPort(key)
    optional.update({key: own[key] for key in optional})
    label = message("stations.block_bus", "Bus\n{rate:g} Hz", rate=bus.rate)
    if bus.delay:
        label += message("stations.block_late", ", {delay:g} ms late", delay=1000 * bus.delay / bus.rate)
    ports.picture.draw(name, "servo", label, robot)
    return own["reference"]


def _with_feedforward(
    builder: DiagramBuilder, ports: StationPorts, signals: Mapping[str, ServoSignals]
) -> dict[str, ServoSignals]:
    """Add the torques that the model predicts, and return what the servos read, by robot, with them in it."""
    read, servo_of = dict(signals), ports.config.servo_of
    fed_forward = {name: own for name, own in signals.items() if servo_of(name).feedforward != "none"}
    if not fed_forward:
        return read
    robots = [(ports.plant.robots[name].axis_map, own) for name, own in fed_forward.items()]
    torques = add_feedforward(builder, ports.plant.plant, robots, name="model_feedforward")
    for (name, own), torque in zip(fed_forward.items(), torques, strict=True):
        prefix = ports.plant.robots[name].prefix
        parts = [port for port in (own.feedforward,) if port is not None]
        damping = ports.plant.robots[name].gains.damping
        if damping.any() and servo_of(name).feedforward == "inverse_dynamics":  # dampers of motors need no torque
            assert own.reference_velocity is not None
            matrix = -np.diag(damping)
            parts.append(add_matrix_gain(builder, f"{prefix}motors.feedforward", matrix, own.reference_velocity))
        read[name] = replace(own, feedforward=add_sum(builder, f"{prefix}whole_feedforward", torque, *parts))
    draw_feedforward(ports, list(fed_forward))
    return read


def declare_torque(site: Site, robot: StationRobot, torque: OutputPort) -> None:
    """Declare the torques of a robot's axes, size n [N·m or N]."""
    site.outputs.add(f"{robot.prefix}torque", torque, axis_signal(robot, "tau", "torque", "effort"))


def _add_servos(builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, signals: ServoSignals) -> None:
    servo, plant = ports.config.servo_of(robot.name), ports.plant.plant
    if servo.realization == "implicit":
        actuation = robot.axis_map.actuation_matrix(plant, robot.instance, robot.gains.passive)
        torque = add_actuator_servos(
            builder,
            ports.plant.stepped,
            robot.instance,
            signals,
            robot.gains,
            actuation_map=actuation,
            prefix=robot.prefix,
        )
        if ports.config.engine.actuator_torques_lack_friction:
            driven = [int(axis) for axis in np.flatnonzero(~robot.gains.passive)]
            torque = with_friction(builder, ports, robot, torque, axes=driven)
        declare_torque(ports, robot, torque)
        draw_actuator_servos(ports, robot)
        if (robot.gains.ki > 0).any():
            draw_integral(
                ports,
                robot,
                "servo",
                list(range(len(robot.axes))),
                message("stations.block_joints", "{count} joints", count=len(robot.axes)),
            )
    elif servo.admittance_gain > 0:
        _add_admittance_servos(builder, ports, robot, signals)
    else:
        torque = _add_servo_blocks(builder, ports, robot, signals)
        if robot.prescribed:
            torque = add_prescribed_torque(builder, ports, robot, torque)
            if uses_reaction_forces(ports.config):
                torque = with_friction(builder, ports, robot, torque, axes=list(robot.prescribed))
        declare_torque(ports, robot, torque)


def _add_servo_blocks(
    builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, signals: ServoSignals
) -> OutputPort:
    """Add servos as blocks; return their torques. With some engines the actuators limit the torques, not blocks."""
    plant, servo, count = ports.plant.plant, ports.config.servo_of(robot.name), len(robot.axes)
    in_actuators = ports.config.engine.limits_torques_in_actuators
    prefix = robot.prefix
    per_joint = servo.realization == "per_joint"
    speed, every = np.eye(2 * count)[count:], list(range(count))

    def limited(command: OutputPort) -> OutputPort:
        name, limiter = f"{prefix}motors", f"{prefix}torque"
        return add_motor(builder, command, robot.gains, every, name, bus=signals.state, speed=speed, limiter=limiter)

    if servo.law == "computed_torque":
        name = f"{prefix}computed_torque"
        command = add_computed_torque(builder, plant, ports.state, robot.axis_map, signals, robot.gains, name=name)
        command = command if in_actuators else limited(command)
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
    matrix = robot.axis_map.actuation_matrix(plant, robot.instance, robot.gains.passive)
    driven = command
    if robot.gains.damping.any():
        bus = add_multiplexer(builder, f"{prefix}motors.commands", command, signals.state)
        dampers = np.hstack([np.eye(count), np.diag(robot.gains.damping) @ speed])
        driven = add_matrix_gain(builder, f"{prefix}motors.driven", dampers, bus)
    if len(matrix) > 0:  # a robot without any motor has no actuators to connect
        actuation = add_matrix_gain(builder, f"{prefix}actuators", matrix, driven)
        builder.Connect(actuation, ports.plant.stepped.get_actuation_input_port(robot.instance))
    return limited(command) if in_actuators else command


def _external_words(place: str, *, turns: bool) -> tuple[str, str]:
    """Words for a force from outside: title of its plot, and label of its block.

    Args:
        place: name of the tool on which the force acts.
        turns: whether it is a torque.
    """
    if turns:
        title = message("stations.external_torque_at", "external torque at {place}, in its axes", place=place)
        return title, message("stations.block_external_torque", "External torque\nat {place}", place=place)
    title = message("stations.external_force_at", "external force at {place}, in its axes", place=place)
    return title, message("stations.block_external_force", "External force\nat {place}", place=place)


def _add_admittance_servos(
    builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, signals: ServoSignals
) -> None:
    prefix, gain = robot.prefix, ports.config.servo_of(robot.name).admittance_gain
    plant, name = ports.plant.plant, f"{prefix}model_torque"
    steady = add_and_connect(builder, f"{name}.acceleration", ConstantVectorSource(np.zeros(plant.num_velocities())))
    force = add_model_torque(builder, plant, ports.state, steady, name=name)
    model = add_matrix_gain(builder, f"{name}.axes", robot.axis_map.velocity_matrix, force)
    extra = add_admittance(builder, signals, robot.gains, model, gain=gain, prefix=prefix)
    feedforward = [port for port in (signals.feedforward,) if port is not None]
    total = add_sum(builder, f"{prefix}feedforward_sum", *feedforward, extra)
    torque = _add_servo_blocks(builder, ports, robot, replace(signals, feedforward=total))
    declare_torque(ports, robot, torque)
    ports.picture.draw(
        f"{prefix}admittance",
        "servo",
        message("stations.block_admittance", "Admittance\nintegrator, {gain:g} 1/s", gain=gain),
        robot,
    )
    ports.picture.draw(
        f"{prefix}model_torque",
        "servo",
        message("stations.block_model_torque", "Torque of the model\nat this speed"),
        robot,
    )
    ports.picture.draw_nothing(f"{prefix}felt_torque", f"{prefix}model_torque.axes", f"{prefix}admittance.bus")
    felt = add_multiplexer(builder, f"{prefix}felt_torque.bus", model, torque)
    difference = np.hstack([np.eye(len(robot.joints)), -np.eye(len(robot.joints))])
    output, port = f"{prefix}felt_torque", add_matrix_gain(builder, f"{prefix}felt_torque", difference, felt)
    ports.outputs.add(output, port, axis_signal(robot, "felt", "felt_torque", "effort"))


STEP = 0.01  # how often monitors look [s]: nothing is integrated here, so a simulator would go to the end in one step

_MOTION = ("reference", "reference_velocity", "reference_acceleration")


def add_motion_inputs(builder: DiagramBuilder, plant: StationPlant) -> tuple[InputPorts, OutputPort]:
    """Add inputs of position, velocity and acceleration for every robot.

    Returns them, each handed on by its block, and the state of the whole plant that they make.
    """
    inputs = InputPorts()
    motions: list[OutputPort] = []
    for robot in plant.robots.values():
        for signal in _MOTION:
            block = builder.AddNamedSystem(f"{robot.prefix}{signal}", PassThrough(len(robot.joints)))
            inputs[f"{robot.prefix}{signal}"] = block.get_input_port()
            motions += [] if signal == _MOTION[-1] else [block.get_output_port()]
    spread = np.hstack([robot.axis_map.state_matrix.T for robot in plant.robots.values()])
    return inputs, add_matrix_gain(builder, "multibody_state", spread, add_multiplexer(builder, "motions", *motions))


def add_kinematic_robots(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add outputs, inverse dynamics and geometry poses of robots, their plant out of the diagram, never stepped."""
    for robot in ports.plant.robots.values():
        sources = {signal: ports.inputs[f"{robot.prefix}{signal}"].get_system() for signal in _MOTION}
        position, velocity = (sources[signal].get_output_port() for signal in _MOTION[:2])
        add_motion(ports, robot, position, position, velocity)
    robots = ports.plant.robots.values()
    dynamics = InverseDynamics(ports.plant.plant, InverseDynamics.InverseDynamicsMode.kInverseDynamics)
    builder.AddNamedSystem("inverse_dynamics", dynamics)
    builder.Connect(ports.state, dynamics.get_input_port_estimated_state())
    accelerations = [ports.inputs[f"{robot.prefix}{_MOTION[-1]}"].get_system().get_output_port() for robot in robots]
    spread = np.hstack([robot.axis_map.velocity_matrix.T for robot in robots])
    desired = add_matrix_gain(
        builder, "accelerations", spread, add_multiplexer(builder, "robot_accelerations", *accelerations)
    )
    builder.Connect(desired, dynamics.get_input_port_desired_acceleration())
    force = dynamics.get_output_port_generalized_force()
    for robot in ports.plant.robots.values():
        torque = add_matrix_gain(builder, f"{robot.prefix}torque", robot.axis_map.velocity_matrix, force)
        declare_torque(ports, robot, with_friction(builder, ports, robot, torque))
    builder.Connect(ports.state, ports.plant.add_geometry_poses(builder, of_state=True))
    builder.AddNamedSystem("steady_steps", SteadySteps(STEP))
