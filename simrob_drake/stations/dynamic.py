"""Wire a dynamic station: every robot is moved by the torques of its servos."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pydrake.multibody.plant import ExternallyAppliedSpatialForceMultiplexer
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Demultiplexer

from simrob_drake.blocks.actuator_servo import add_actuator_servos
from simrob_drake.blocks.external_force import add_external_force
from simrob_drake.blocks.joint_stops import add_joint_stops
from simrob_drake.blocks.push import add_pushes
from simrob_drake.blocks.servo import ServoSignals, add_saturation, add_servos
from simrob_drake.blocks.wiring import joined, mapped, summed
from simrob_drake.blocks.yielding import add_model_torque, add_yielding
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.forces import pushes_of, takes_force
from simrob_drake.stations.plant import StationPlant
from simrob_drake.stations.ports import StationPorts, add_input
from simrob_drake.stations.robots import StationRobot


def add_dynamic_robots(builder: DiagramBuilder, plant: StationPlant, config: StationConfig) -> StationPorts:
    """Add inputs, state, servos and joint stops for every robot of a plant that stands in the diagram."""
    ports = StationPorts(config, plant, plant.plant.get_state_output_port())
    for robot in plant.robots.values():
        signals = _add_signals(builder, ports, robot)
        ports.outputs[f"{robot.prefix}torque"] = _add_servos(builder, ports, robot, signals)
    if not config.solver.holds_joint_limits:
        stops = config.joint_stops
        add_joint_stops(builder, plant.plant, stiffness=stops.stiffness, damping=stops.damping)
    _add_external_forces(builder, ports)
    return ports


def _add_signals(builder: DiagramBuilder, ports: StationPorts, robot: StationRobot) -> ServoSignals:
    """Add what a robot's servos read, and the outputs for it."""
    prefix, count, listed = robot.prefix, len(robot.joints), ports.config.inputs
    state = mapped(builder, f"{prefix}axes", ports.plant.state_map(robot), ports.state)
    split = builder.AddNamedSystem(f"{prefix}state", Demultiplexer([count, count]))
    builder.Connect(state, split.get_input_port())
    reference = add_input(builder, ports.inputs, robot, "reference")
    ports.outputs[f"{prefix}reference"] = reference
    ports.outputs[f"{prefix}position"] = split.get_output_port(0)
    ports.outputs[f"{prefix}velocity"] = split.get_output_port(1)
    velocity = add_input(builder, ports.inputs, robot, "reference_velocity") if "reference_velocity" in listed else None
    feedforward = add_input(builder, ports.inputs, robot, "feedforward") if "feedforward" in listed else None
    return ServoSignals(reference, state, velocity, feedforward)


def _add_servos(builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, signals: ServoSignals) -> OutputPort:
    """Add a robot's servos as they are realized; return their torques, size n [N·m or N]."""
    servo, plant = ports.config.servo_of(robot.name), ports.plant
    if servo.realization == "implicit":
        return add_actuator_servos(
            builder,
            plant.plant,
            robot.instance,
            signals,
            robot.gains,
            actuation_map=plant.actuation_map(robot),
            prefix=robot.prefix,
            velocity_sense=-1 if ports.config.solver.scheme == "cenic" else 1,
        )
    return (_add_yielding_servos if servo.yield_gain > 0 else _add_servo_blocks)(builder, ports, robot, signals)


def _add_servo_blocks(
    builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, signals: ServoSignals
) -> OutputPort:
    """Add servos as blocks; return their torques. Under ``cenic`` the actuators are what saturates."""
    plant, cenic = ports.plant, ports.config.solver.scheme == "cenic"
    command = add_servos(
        builder,
        signals,
        robot.gains,
        names=robot.axes,
        prefix=robot.prefix,
        per_joint=ports.config.servo_of(robot.name).realization == "per_joint",
        saturated=not cenic,
    )
    actuation = mapped(builder, f"{robot.prefix}actuators", plant.actuation_map(robot), command)
    builder.Connect(actuation, plant.plant.get_actuation_input_port(robot.instance))
    limit = robot.gains.torque_limit
    return add_saturation(builder, command, limit, f"{robot.prefix}torque") if cenic else command


def _add_yielding_servos(
    builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, signals: ServoSignals
) -> OutputPort:
    """Add servos that give in to what the arm's model does not explain, and the output that tells that torque."""
    prefix, gain, pick = robot.prefix, ports.config.servo_of(robot.name).yield_gain, ports.plant.velocity_map(robot)
    model = add_model_torque(builder, ports.plant.plant, ports.state, pick=pick, prefix=prefix)
    extra = add_yielding(builder, signals, robot.gains, model, gain=gain, prefix=prefix)
    given = [port for port in (signals.feedforward,) if port is not None]
    total = summed(builder, f"{prefix}feedforward_sum", *given, extra)
    torque = _add_servo_blocks(builder, ports, robot, replace(signals, feedforward=total))
    felt = joined(builder, f"{prefix}felt_torque.bus", model, torque)
    difference = np.hstack([np.eye(len(robot.joints)), -np.eye(len(robot.joints))])
    ports.outputs[f"{prefix}felt_torque"] = mapped(builder, f"{prefix}felt_torque", difference, felt)
    return torque


def _add_external_forces(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add the forces that act from outside, if there are any: at tools by input, on bases by pushes."""
    plant, found = ports.plant.plant, []
    for robot in ports.plant.robots.values():
        if takes_force(ports.config):
            name = f"{robot.prefix}external_force"
            block = add_external_force(builder, plant, robot.tools[robot.tcp], name=name)
            ports.inputs[name] = block.get_command_input_port()
            found.append(block.get_spatial_forces_output_port())
        pushes = pushes_of(ports.config.robots[robot.name].pushes)
        if pushes:
            found.append(add_pushes(builder, plant, robot.root, pushes, name=f"{robot.prefix}pushes"))
    if found:
        forces = builder.AddNamedSystem("external_forces", ExternallyAppliedSpatialForceMultiplexer(len(found)))
        for index, port in enumerate(found):
            builder.Connect(port, forces.get_input_port(index))
        builder.Connect(forces.get_output_port(), plant.get_applied_spatial_force_input_port())
