"""What can be said of a station before it runs: torques, what touches and comes near, what its solver makes of it."""

import numpy as np
from pydrake.systems.framework import Diagram

from simrob_drake.blocks.references import Reference
from simrob_drake.dynamics import Dynamics
from simrob_drake.errors import listed
from simrob_drake.frames import Vector
from simrob_drake.parts.controllers import loops_of
from simrob_drake.parts.site import WORLD, StationPlant, StationRobot
from simrob_drake.robots.motors import rated_torques
from simrob_drake.robots.urdf import doubtful_efforts
from simrob_drake.signals import Signal
from simrob_drake.stations.clearance import KNEELING, standing
from simrob_drake.stations.clearance_checks import clearance_findings
from simrob_drake.stations.closed import check_reference, closed_station, reference_samples
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.contact import pairs_without_surface
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.steps import Finding, step_findings

_DEEP = 1e-3  # things that rest on each other are less deep in each other [m]
_PRESSED = 1e-4  # bodies that lie deeper in each other than this at the start are pushed apart [m]


_LISTED = 6  # links that carry
_DROP = 2e-3  # a robot that starts higher over the floor than this drops on it [m]

_STEADY = np.tan(np.deg2rad(1.0))
"""Part of its height by which the centre of mass has to be inside of the support area: servos sag."""

_FASTER = 1.001  # a speed by straight lines between looks counts as beyond a limit from this part of it on


def check_station(config: StationConfig) -> list[Finding]:
    """Look at a station before it runs; raises SimrobError: what keeps it from that, such as a reference or inertia."""
    closed = closed_station(resolve(config))
    ports, diagram = closed.ports, closed.diagram
    findings = _piece_findings(ports)
    if config.gravity < 0:
        text = f"{config.gravity:g} m/s² pulls up: {-config.gravity:g} pulls down, along -z"
        findings.append(Finding("warning", "gravity", text))
    for robot in ports.plant.robots.values():
        findings += _reference_findings(robot, closed.references.get(robot.name), config.duration)
    for robot in ports.plant.robots.values():
        findings += _import_findings(config, robot) + _effort_findings(config, robot) + _motor_findings(robot)
        if config.mode == "kinematic" or robot.model.base == "fixed":
            findings += _holding_findings(ports, robot, closed.references.get(robot.name))
        else:
            findings += _standing_findings(ports, robot)
    for name, coupling in config.couplings.items():
        findings.append(Finding("note", f"couplings.{name}", coupling.caption()))
    for name in config.controllers:
        text = "what it asks of the robot beyond the reference is not looked at: a run shows it"
        findings.append(Finding("note", f"controllers.{name}", text))
    for name, loop in loops_of(config.controllers).items():
        key = f"controllers.{name}"
        findings += [Finding("warning", key, text) for text in loop.warnings(key, ports.robot(loop.robot))]
    if config.mode == "dynamic":
        findings += _grip_findings(config, ports)
        findings += step_findings(config, ports.plant, closed.references)
        findings += contact_findings(diagram, ports)
    findings += clearance_findings(config, closed.references)
    return findings + [_declared(signal) for signal in ports.signals if signal.part]


def _grip_findings(config: StationConfig, ports: StationPorts) -> list[Finding]:
    wrong = None
    if config.contact is None:
        wrong = "the station has no contact: fingers hold nothing; add contact: {model: hydroelastic}"
    elif config.contact.model == "point":
        wrong = "points let a held piece turn and creep; take contact.model hydroelastic"
    elif config.solver.scheme == "sap":
        wrong = "sap lets fingers hold several times what friction holds; take solver.scheme lagged"
    fingers = [robot for robot in ports.plant.robots.values() if robot.model.fingers]
    return [Finding("warning", f"gripper of {robot.name}", wrong) for robot in fingers if wrong]


def _declared(signal: Signal) -> Finding:
    stem = signal.names[0].rpartition(".")[0]
    ends = [name.removeprefix(f"{stem}.") for name in signal.names]
    columns = signal.names[0] if len(ends) == 1 else f"{stem}.{ends[0]} … {ends[-1]}"
    return Finding("note", f"signals of {signal.part}", f"{columns} [{', '.join(dict.fromkeys(signal.units))}]")


def holding_torque(plant: StationPlant, robot: StationRobot, position: Vector) -> Vector:
    """Return the torques (n,) [N·m or N] that hold a robot still at a posture (n,) [rad or m]."""
    context = plant.plant.CreateDefaultContext()
    robot.axis_map.set_positions(plant.plant, context, position)
    return -robot.axis_map.efforts(plant.plant.CalcGravityGeneralizedForces(context))


def _import_findings(config: StationConfig, robot: StationRobot) -> list[Finding]:
    urdf = config.robots[robot.name].urdf
    if urdf is None or robot.model.folder == urdf.parent.resolve():
        return []
    from simrob_drake.importer.importing import import_summary

    text = f"{import_summary(robot.model)}; `simrob check {urdf}` tells all"
    return [Finding("note", f"import of {urdf.name}", text)]


def _piece_findings(ports: StationPorts) -> list[Finding]:
    findings = []
    for name, piece in ports.station.pieces.items():
        text = "hangs on nothing: gravity and contact move it"
        if not piece.free:
            where = " ".join(f"{value:.4g}" for value in piece.pose.translation() + 0.0)
            frame = f", at {piece.mount.removeprefix(f'{piece.parent}_')}" if piece.mount else ""
            by = f"; {piece.carrier} carries it" if piece.carrier not in (piece.parent, WORLD) else ""
            text = f"hangs on {piece.parent}{frame}, its origin at {where} m{by}"
        findings.append(Finding("note", f"pieces.{name}", text))
    return findings


def _reference_findings(robot: StationRobot, reference: Reference | None, duration: float) -> list[Finding]:
    """Tell of a reference within limits, and axes asked for too much speed; raises InvalidParameter: beyond them."""
    subject = f"reference of {robot.name}"
    if reference is None:
        return [Finding("note", subject, "not looked at: a controller says where the robot goes")]
    check_reference(robot, reference, duration)
    times, positions = reference_samples(reference, duration)
    speeds, limits = np.abs(np.diff(positions, axis=0)).max(axis=0) / times[1], robot.speed_limits
    looked = f"within the joints' limits at {len(times)} times from 0 to {duration:g} s"
    if np.isfinite(limits).any():
        looked += f", at most {np.nanmax(speeds / limits):.0%} of their speed"
    findings = []
    for axis in np.flatnonzero(speeds > _FASTER * limits):
        unit, name = robot.model.user_units[axis], f"{robot.model.unit_names[axis]}/s"
        text = f"{robot.prefix}{robot.axes[axis]} is asked for {speeds[axis] / unit:.4g} {name}"
        text += f", its limit is {limits[axis] / unit:.4g} {name}; give it more time"
        findings.append(Finding("warning", subject, text))
    return findings or [Finding("ok", subject, looked)]


def _effort_findings(config: StationConfig, robot: StationRobot) -> list[Finding]:
    if config.servo_of(robot.name).torque_limit is not None or any(robot.motors):
        return []
    doubtful = doubtful_efforts(robot.model.element)
    axes = [f"{name} ({effort:g} N·m, {mass:.3g} kg)" for name, (effort, mass) in doubtful.items()]
    if not axes:
        return []
    text = f"more than their links' motors may have: {listed(axes)}; set servo.torque_limit"
    return [Finding("warning", f"efforts of {robot.name}", text)]


def _motor_findings(robot: StationRobot) -> list[Finding]:
    kinds = dict[str, list[str]]()
    for axis, unit, motor in zip(robot.axes, robot.model.units, robot.motors, strict=True):
        if motor is not None:
            stall, speed = motor.line
            text = f"{stall:.3g} {unit.effort} at rest, {speed:.3g} {unit.si}/s without load"
            text += f", {motor.peak_torque:g} {unit.effort} by its current" if motor.peak_torque else ""
            text += f", {motor.rated_torque:g} {unit.effort} continuously" if motor.rated_torque else ""
            kinds.setdefault(f"{text} ({motor.source or 'figures of the station'})", []).append(axis)
    return [Finding("note", f"motors of {robot.name}", f"{listed(axes)}: {text}") for text, axes in kinds.items()]


def _for_ever(robot: StationRobot, axis: int, torque: float) -> str:
    """Return a warning where a torque is more than a motor may give for ever; empty otherwise."""
    rated, unit = rated_torques(robot.motors)[axis], robot.model.units[axis].effort
    return f"; its motor gets too warm: it may give {rated:g} {unit} continuously" if abs(torque) > rated else ""


def _holding_findings(ports: StationPorts, robot: StationRobot, reference: Reference | None) -> list[Finding]:
    if reference is None:
        text = "not looked at: a controller says where the robot goes"
        return [Finding("note", f"torques of {robot.name}", text)]
    positions = reference_samples(reference, ports.config.duration)[1]
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
        text = f"holding takes {torque[0]:z.2f} {effort} at the start and {torque[-1]:z.2f} {effort} at the end"
        text += " of the reference"
        worst = torque[np.argmax(np.abs(torque))]
        if abs(worst) > limit:
            text += f", at most {worst:.2f} {effort}, and the limit is {limit:g} {effort}: the joint will not hold; "
            findings.append(Finding("warning", subject, f"{text}raise servo.torque_limit or lighten the load"))
            continue
        if ports.config.mode == "kinematic":
            findings.append(Finding("note", subject, text))
            continue
        modelled = servo.feedforward != "none" or servo.law == "computed_torque"
        sag = f"; it sags by {abs(torque[-1]) / kp / unit.size:.3g} {unit.name} there" if kp > 0 else ""
        sag = "; the servo's model holds it without sagging" if modelled else sag
        warm = _for_ever(robot, axis, worst)
        findings.append(
            Finding("warning" if warm else "ok", subject, f"{text}; the limit is {limit:g} {effort}{sag}{warm}")
        )
    masses = dynamics.payload(positions).min(axis=0) if robot.tcp else np.array([np.inf])
    if np.isfinite(masses.min()):
        weakest = robot.axes[int(np.argmin(masses))]
        text = (
            f"at rest along the reference it holds {masses.min():.3g} kg more at {robot.tcp}, by the motor of {weakest}"
        )
        findings.append(Finding("note", f"payload of {robot.name}", text))
    if robot.model.payload is not None and robot.load > robot.model.payload:
        text = f"it carries {robot.load:.3g} kg, and is rated for {robot.model.payload:g} kg: lighten its load"
        findings.append(Finding("warning", f"payload of {robot.name}", text))
    return findings


def _standing_findings(ports: StationPorts, robot: StationRobot) -> list[Finding]:
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
    links = f" of {', '.join(found.ends)}" if len(found.ends) <= _LISTED else ""
    area = f"{found.mass:.3f} kg on {found.contacts} points{links}, "
    area += f"the centre of mass {abs(found.margin) * 1e3:.0f} mm {inside}"
    steady, lean = found.margin > _STEADY * found.height, np.rad2deg(np.arctan2(found.margin, found.height))
    tips = (
        ", unless it moves" if found.margin <= 0 else f" if it leans by {lean:.1f} deg, unless a controller balances it"
    )
    tips = "" if steady else f": it tips over{tips}"
    findings.append(Finding("ok" if steady else "warning", subject, f"{area} of the support area{tips}"))
    knees = {link: end for link, end in found.ends.items() if end < KNEELING} if not robot.feet else {}
    if knees:
        text = f"it stands on the near end of {', '.join(knees)}, by the joint, as on knees: bend the joints above"
        findings.append(Finding("warning", subject, text))
    if robot.feet and robot.feet.boxes and config.contact.model == "point":
        text = "box soles rock in point contact, which pushes at one point a box; set contact.model to "
        findings.append(Finding("warning", f"{robot.prefix}feet", f"{text}hydroelastic_with_fallback"))
    held = zip(found.torque, robot.gains.torque_limit, robot.gains.kp, strict=True)
    for axis, (name, unit, (torque, limit, kp)) in enumerate(zip(robot.axes, robot.model.units, held, strict=True)):
        text = f"standing takes {torque:z.2f} {unit.effort} and the limit is {limit:g} {unit.effort}"
        sag = f"; it sags by {abs(torque) / kp / unit.size:.2f} {unit.name}" if kp > 0 else ""
        weak = abs(torque) > limit
        warm = "" if weak else _for_ever(robot, axis, torque)
        end = ": the joint will not hold" if weak else sag + warm
        findings.append(Finding("warning" if weak or warm else "ok", f"torque of {robot.prefix}{name}", text + end))
    return findings


def contact_findings(diagram: Diagram, ports: StationPorts) -> list[Finding]:
    """Look at the surfaces of a station, and at what lies in what at the start."""
    config, plant = ports.config, ports.plant
    if config.contact is None:
        return [Finding("note", "contact", "the station has none: whatever meets passes through each other")]
    dissipates = [config.contact, *(piece.contact for piece in config.pieces.values() if piece.contact is not None)]
    findings = []
    if config.solver.scheme == "sap" and any(material.dissipation for material in dissipates):
        text = "the solver scheme sap does not know contact.dissipation; take lagged or similar"
        findings.append(Finding("warning", "contact", text))
    flat = _flat_pieces(ports) if config.contact.model == "point" and config.solver.scheme != "mujoco" else []
    if len(flat) > 1 and {*flat} & {*plant.free_pieces}:
        text = f"{' and '.join(flat[:2])} meet in one point: a piece that rests on another sinks and slides"
        findings.append(Finding("warning", "contact", f"{text}; take contact.model hydroelastic"))
    context = diagram.CreateDefaultContext()
    query = plant.scene_graph.get_query_output_port().Eval(plant.scene_graph.GetMyContextFromRoot(context))
    inspector = query.inspector()
    fallen_back = pairs_without_surface(plant.plant, plant.scene_graph.model_inspector())
    if fallen_back and config.contact.model != "point":
        text = f"both are rigid, so {', '.join(fallen_back)} meet in points; make one of them compliant"
        findings.append(Finding("warning", "contact", text))
    pairs = [pair for pair in query.ComputePointPairPenetration() if pair.depth > _PRESSED]
    if not pairs:
        return [*findings, Finding("ok", "contact", "of what can touch nothing penetrates at the start")]
    deepest = max(pairs, key=lambda pair: pair.depth)
    names = " and ".join(inspector.GetName(geometry) for geometry in (deepest.id_A, deepest.id_B))
    text = f"{names} penetrate by {deepest.depth * 1e3:.1f} mm at the start"
    text += "; move one of them" if deepest.depth > _DEEP else ""
    return [*findings, Finding("warning" if deepest.depth > _DEEP else "ok", "contact", text)]


def _flat_pieces(ports: StationPorts) -> list[str]:
    pieces = ports.station.pieces.items()
    return [name for name, piece in pieces if any(shape.collides and not shape.sphere for shape in piece.model.shapes)]
