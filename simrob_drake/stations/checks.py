"""What can be said of a station before it runs: torques, contacts, and what its solver makes of it."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import Diagram

from simrob_drake.blocks.references import Course
from simrob_drake.dynamics import Dynamics
from simrob_drake.frames import Vector
from simrob_drake.parts.controllers import loops_of
from simrob_drake.parts.site import StationPlant, StationRobot
from simrob_drake.signals import Signal
from simrob_drake.stations.closed import check_course, closed_station, course_samples
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.contact import pairs_without_surface
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.standing import standing
from simrob_drake.stations.steps import Finding, step_findings

_TOUCH = 1e-4
"""Bodies that lie deeper in each other than this at the start are pushed apart [m]."""
_DROP = 2e-3
"""A robot that starts higher over the floor than this drops on it [m]."""

_FASTER = 1.001
"""A speed by straight lines between looks counts as beyond a limit from this part of it on."""

_DEEP = 1e-3  # m: things that rest on each other are less deep in each other


def check_station(config: StationConfig) -> list[Finding]:
    """Look at a station before it runs.

    Raises:
        SimrobError: what would keep it from running at all: a reference beyond the limits, an invalid inertia ...
    """
    closed = closed_station(resolve(config))
    ports, diagram = closed.ports, closed.diagram
    for name, course in closed.courses.items():
        check_course(ports.plant.robots[name], course, config.duration)
    findings = [Finding("ok", "references", "all within the joint limits")]
    for name, course in closed.courses.items():
        findings += _speed_findings(ports.plant.robots[name], course, config.duration)
    for robot in ports.plant.robots.values():
        findings += _import_findings(config, robot)
        if config.mode == "kinematic" or robot.model.base == "fixed":
            findings += _holding_findings(ports, robot, closed.courses.get(robot.name))
        else:
            findings += _standing_findings(ports, robot)
    for name, loop in loops_of(config.controllers).items():
        key = f"controllers.{name}"
        findings += [Finding("warning", key, text) for text in loop.warnings(key, ports.robot(loop.robot))]
    if config.mode == "dynamic":
        findings += step_findings(config, ports.plant, closed.courses)
        findings += _contact_findings(diagram, ports)
    return findings + [_declared(signal) for signal in ports.signals if signal.part]


def _declared(signal: Signal) -> Finding:
    """Say which columns a piece, a sensor, a force or a controller gives, and in what units."""
    stem = signal.names[0].rpartition(".")[0]
    ends = [name.removeprefix(f"{stem}.") for name in signal.names]
    columns = signal.names[0] if len(ends) == 1 else f"{stem}.{ends[0]} … {ends[-1]}"
    return Finding("ok", f"signals of {signal.part}", f"{columns} [{', '.join(dict.fromkeys(signal.units))}]")


def holding_torque(plant: StationPlant, robot: StationRobot, position: Vector) -> Vector:
    """Return the torques (n,) [N·m or N] that hold a robot still at a posture (n,) [rad or m]."""
    context = plant.plant.CreateDefaultContext()
    robot.axis_map.set_positions(plant.plant, context, position)
    return -robot.axis_map.efforts(plant.plant.CalcGravityGeneralizedForces(context))


def _import_findings(config: StationConfig, robot: StationRobot) -> list[Finding]:
    urdf = config.robots[robot.name].urdf
    if urdf is None or robot.model.folder == urdf.parent.resolve():
        return []
    from simrob_drake.importer.cache import import_summary

    text = f"{import_summary(robot.model)}; `simrob check {urdf}` tells all"
    return [Finding("ok", f"import of {urdf.name}", text)]


def _speed_findings(robot: StationRobot, course: Course, duration: float) -> list[Finding]:
    """Name the axes that a reference asks for more speed than they have."""
    times, positions = course_samples(course, duration)
    speeds, limits = np.abs(np.diff(positions, axis=0)).max(axis=0) / times[1], robot.model.speed_limits
    findings = []
    for axis in np.flatnonzero(speeds > _FASTER * limits):
        unit, name = robot.model.user_units[axis], f"{robot.model.unit_names[axis]}/s"
        text = f"{robot.prefix}{robot.axes[axis]} is asked for {speeds[axis] / unit:.4g} {name}"
        text += f", its limit is {limits[axis] / unit:.4g} {name}; give it more time"
        findings.append(Finding("warning", "references", text))
    return findings


def _holding_findings(ports: StationPorts, robot: StationRobot, course: Course | None) -> list[Finding]:
    if course is None:
        return [Finding("ok", f"torque of {robot.prefix}", "not known: a controller says where the robot goes")]
    positions = course_samples(course, ports.config.duration)[1]
    positions = positions[:: len(positions) // 50]
    dynamics = Dynamics(
        robot.model,
        ports.plant.plant,
        robot.joints,
        tool=robot.tools.get(robot.tcp),
        torque_limit=robot.gains.torque_limit,
    )
    torques = dynamics.gravity(positions)
    findings, servo = [], ports.config.servo_of(robot.name)
    for axis, name in enumerate(robot.axes):
        torque, limit, kp = torques[:, axis], robot.gains.torque_limit[axis], robot.gains.kp[axis]
        unit = robot.model.units[axis]
        subject, effort = f"torque of {robot.prefix}{name}", unit.effort
        text = f"holding takes {torque[0]:.2f} {effort} at the start and {torque[-1]:.2f} {effort} at the end"
        text += " of the reference"
        if ports.config.mode == "kinematic":
            findings.append(Finding("ok", subject, text))
            continue
        worst = torque[np.argmax(np.abs(torque))]
        if abs(worst) > limit:
            text += f", at most {worst:.2f} {effort}, and the limit is {limit:g} {effort}: the joint will not hold; "
            findings.append(Finding("warning", subject, f"{text}raise servo.torque_limit or lighten the load"))
            continue
        modelled = servo.feedforward != "none" or servo.law == "computed_torque"
        sag = f"; it sags by {abs(torque[-1]) / kp / unit.size:.3g} {unit.name} there" if kp > 0 else ""
        sag = "; the servo's model holds it without sagging" if modelled else sag
        findings.append(Finding("ok", subject, f"{text}; the limit is {limit:g} {effort}{sag}"))
    masses = dynamics.payload(positions).min(axis=0) if robot.tcp else np.array([np.inf])
    if np.isfinite(masses.min()):
        weakest = robot.axes[int(np.argmin(masses))]
        text = (
            f"at rest along the reference it holds {masses.min():.3g} kg more at {robot.tcp}, by the motor of {weakest}"
        )
        findings.append(Finding("ok", f"payload of {robot.name}", text))
    return findings


def _standing_findings(ports: StationPorts, robot: StationRobot) -> list[Finding]:
    """Say how a robot with a free base begins: on what it stands, whether it tips over, what its joints hold."""
    config, subject = ports.config, f"{robot.prefix}base"
    found = standing(ports.plant, robot)
    ground = ports.plant.ground
    nothing = not (ground.has_floor or ground.boxes)
    if nothing or config.contact is None or found is None:
        missing = "floor" if nothing else "contact" if config.contact is None else "collision shapes"
        return [Finding("warning", subject, f"the base is free and the robot has no {missing} to stand on: it falls")]
    findings = []
    parts = "feet's" if robot.feet else "collision shapes'"
    side = "over" if found.gap >= 0 else "below"
    place = f"the {parts} lowest point is {abs(found.gap) * 1e3:.2f} mm {side} the floor at the start"
    findings.append(Finding("ok" if -_DEEP <= found.gap <= _DROP else "warning", subject, place))
    inside = "inside" if found.margin >= 0 else "outside"
    area = (
        f"{found.mass:.3f} kg on {found.contacts} points, the centre of mass {abs(found.margin) * 1e3:.0f} mm {inside}"
    )
    tips = "" if found.margin > 0 else ": it tips over, unless it moves"
    findings.append(Finding("ok" if found.margin > 0 else "warning", subject, f"{area} of the support area{tips}"))
    if robot.feet and robot.feet.boxes and config.contact.model == "point":
        text = "box soles rock in point contact, which pushes at one point a box; set contact.model to "
        findings.append(Finding("warning", f"{robot.prefix}feet", f"{text}hydroelastic_with_fallback"))
    held = zip(found.torque, robot.gains.torque_limit, robot.gains.kp, strict=True)
    for name, unit, (torque, limit, kp) in zip(robot.axes, robot.model.units, held, strict=True):
        text = f"standing takes {torque:.2f} {unit.effort} and the limit is {limit:g} {unit.effort}"
        sag = f"; it sags by {abs(torque) / kp / unit.size:.2f} {unit.name}" if kp > 0 else ""
        weak = abs(torque) > limit
        end = ": the joint will not hold" if weak else sag
        findings.append(Finding("warning" if weak else "ok", f"torque of {robot.prefix}{name}", text + end))
    return findings


def _contact_findings(diagram: Diagram, ports: StationPorts) -> list[Finding]:
    config, plant = ports.config, ports.plant
    if config.contact is None:
        return [Finding("ok", "contact", "the station has none")]
    dissipates = [config.contact, *(piece.contact for piece in config.pieces.values() if piece.contact is not None)]
    findings = []
    if config.solver.scheme == "sap" and any(material.dissipation for material in dissipates):
        text = "the solver scheme sap does not know contact.dissipation; take lagged or similar"
        findings.append(Finding("warning", "contact", text))
    context = diagram.CreateDefaultContext()
    query = plant.scene_graph.get_query_output_port().Eval(plant.scene_graph.GetMyContextFromRoot(context))
    inspector = query.inspector()
    fallen_back = pairs_without_surface(plant.plant, plant.scene_graph.model_inspector())
    if fallen_back and config.contact.model != "point":
        text = f"both are rigid, so {', '.join(fallen_back)} meet in points; make one of them compliant"
        findings.append(Finding("warning", "contact", text))
    pairs = [pair for pair in query.ComputePointPairPenetration() if pair.depth > _TOUCH]
    if not pairs:
        return [*findings, Finding("ok", "contact", "nothing penetrates at the start")]
    deepest = max(pairs, key=lambda pair: pair.depth)
    names = " and ".join(inspector.GetName(geometry) for geometry in (deepest.id_A, deepest.id_B))
    text = f"{names} penetrate by {deepest.depth * 1e3:.1f} mm at the start"
    text += "; move one of them" if deepest.depth > _DEEP else ""
    return [*findings, Finding("warning" if deepest.depth > _DEEP else "ok", "contact", text)]
