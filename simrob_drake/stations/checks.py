"""What can be said of a station before it runs: torques, what touches and comes near, what its solver makes of it."""

import numpy as np
from pydrake.systems.framework import Diagram

from simrob_drake.blocks.references import Reference
from simrob_drake.errors import listed
from simrob_drake.frames import Vector
from simrob_drake.parts.site import WORLD, StationPlant, StationRobot
from simrob_drake.robots.urdf import doubtful_efforts
from simrob_drake.signals import Signal
from simrob_drake.stations.clearance import KNEELING, standing
from simrob_drake.stations.clearance_checks import clearance_findings
from simrob_drake.stations.closed import check_reference, closed_station, reference_samples
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.findings import Finding, Level
from simrob_drake.stations.holding import error_bound, holding_findings, too_warm
from simrob_drake.stations.ignored_settings import rounded_delays
from simrob_drake.stations.physics_findings import physics_findings
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.solver_config import bound_value
from simrob_drake.stations.start_overlap import TOUCHING, allowed_overlap, deepest_overlap

_LISTED = 6  # links that carry
_DROP = 2e-3  # a robot that starts higher over the floor than this drops on it [m]

_STEADY = np.tan(np.deg2rad(1.0))
"""Part of its height by which the centre of mass has to be inside of the support area: servos sag."""


def check_station(config: StationConfig) -> list[Finding]:
    """Look at a station before it runs; raises SimrobError: what keeps it from that, such as a reference or inertia."""
    closed = closed_station(resolve(config))
    ports, diagram = closed.ports, closed.diagram
    findings = _piece_findings(ports)
    for robot in ports.plant.robots.values():
        findings += _reference_findings(config, robot, closed.references.get(robot.name))
    for robot in ports.plant.robots.values():
        findings += _effort_findings(config, robot) + _motor_findings(robot)
        if config.mode == "kinematic" or robot.model.base == "fixed":
            findings += _holding_findings(ports, robot, closed.references.get(robot.name))
        else:
            findings += _standing_findings(ports, robot)
    for name, coupling in ports.config.couplings.items():
        findings.append(Finding("note", f"couplings.{name}", coupling.caption()))
    for name in config.controllers:
        text = "what it asks of the robot beyond the reference is not looked at: a run shows it"
        findings.append(Finding("note", f"controllers.{name}", text))
    findings += physics_findings(config, ports, closed.references)
    findings += rounded_delays(config)
    if config.mode == "dynamic":
        findings += contact_findings(diagram, ports)
        findings += _contact_model_findings(ports)
    findings += clearance_findings(config, closed.references)
    return findings + [_declared(signal) for signal in ports.signals if signal.part]


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


def _reference_findings(config: StationConfig, robot: StationRobot, reference: Reference | None) -> list[Finding]:
    """Judge a reference: its positions by the limits of the axes, its speeds by the share that the verdict allows.

    Raises:
        InvalidParameter: the reference leaves the range of an axis.
    """
    subject = f"reference of {robot.name}"
    if reference is None:
        return [Finding("note", subject, "not looked at: a controller says where the robot goes")]
    check_reference(robot, reference, config.duration)
    times, positions = reference_samples(reference, config.duration)
    step = times[1]  # the samples are evenly spaced and begin at 0
    speeds = np.abs(np.diff(positions, axis=0)).max(axis=0) / step
    limits = robot.speed_limits
    allowed_share = bound_value(config.verdict.speed_share)
    findings = []
    for axis in np.flatnonzero(speeds > allowed_share * limits):
        unit = robot.model.user_units[axis]
        unit_name = f"{robot.model.unit_names[axis]}/s"
        text = f"{robot.prefix}{robot.axes[axis]} is asked for {speeds[axis] / unit:.4g} {unit_name}"
        text += f", its limit is {limits[axis] / unit:.4g} {unit_name}; give it more time"
        findings.append(Finding("warning", subject, text))
    if findings:
        return findings
    text = f"within the joints' limits at {len(times)} times from 0 to {config.duration:g} s"
    if np.isfinite(limits).any():
        # An axis without a limit of speed has a share of 0 or, at rest, none at all.
        text += f", at most {np.nanmax(speeds / limits):.0%} of their speed"
    return [Finding("ok", subject, text)]


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


def _holding_findings(ports: StationPorts, robot: StationRobot, reference: Reference | None) -> list[Finding]:
    """Predict torques and sag of a robot along its reference, if it has one."""
    if reference is None:
        text = "not looked at: a controller says where the robot goes"
        return [Finding("note", f"torques of {robot.name}", text)]
    positions = reference_samples(reference, ports.config.duration)[1]
    return holding_findings(ports, robot, positions)


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
    findings.append(Finding("ok" if -TOUCHING <= found.gap <= _DROP else "warning", subject, place))
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
    for axis, torque in enumerate(found.torque):
        findings.append(_standing_torque(config, robot, axis, float(torque)))
    return findings


def _standing_torque(config: StationConfig, robot: StationRobot, axis: int, torque: float) -> Finding:
    """Judge the torque [N·m or N] with which an axis carries a robot that stands, and its sag."""
    unit = robot.model.units[axis]
    limit = robot.gains.torque_limit[axis]
    kp = robot.gains.kp[axis]
    subject = f"torque of {robot.prefix}{robot.axes[axis]}"
    text = f"standing takes {torque:z.2f} {unit.effort} and the limit is {limit:g} {unit.effort}"
    if abs(torque) > limit:
        return Finding("warning", subject, f"{text}: the joint will not hold")
    level: Level = "ok"
    if kp > 0:
        sag = abs(torque) / kp
        text += f"; it sags by {sag / unit.size:.2f} {unit.name}"
        bound = error_bound(config.verdict, slides=bool(robot.model.prismatic[axis]))
        if sag > bound:
            level = "warning"
            text += f" (bound {bound / unit.size:.3g} {unit.name}); raise servo.kp"
    if warmth := too_warm(robot, axis, torque):
        return Finding("warning", subject, text + warmth)
    return Finding(level, subject, text)


def _contact_model_findings(ports: StationPorts) -> list[Finding]:
    """Say by which contact model the shapes of a station meet."""
    config = ports.config
    if config.contact is None:
        return []
    if ports.plant.contact_points:
        text = "shapes meet at points; flat bodies that stand free, also at their corners and along their edges"
    elif config.contact.model == "point":
        text = "shapes meet at points"
    else:
        text = f"shapes meet over surfaces ({config.contact.model})"
    return [Finding("ok", "contact.model", text)]


def contact_findings(diagram: Diagram, ports: StationPorts) -> list[Finding]:
    """Find bodies that are in each other at the start."""
    if ports.config.contact is None:
        return [Finding("note", "contact", "the station has none: whatever meets passes through each other")]
    overlap = deepest_overlap(ports, diagram.CreateDefaultContext())
    if overlap is None:
        return [Finding("ok", "contact", "of what can touch nothing penetrates at the start")]
    if overlap.depth <= TOUCHING:
        return [Finding("ok", "contact", str(overlap))]
    is_of_piece = overlap.first in ports.config.pieces or overlap.second in ports.config.pieces
    refused = ", and a run does not begin" if is_of_piece and overlap.depth > allowed_overlap(ports.config) else ""
    return [Finding("warning", "contact", f"{overlap}{refused}; move one of them")]
