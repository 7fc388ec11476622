"""What can be said of a station before it runs: torques, what touches and comes near, what its solver makes of it."""

from collections.abc import Mapping

import numpy as np
from pydrake.systems.framework import Diagram

from simrob_drake.blocks.references import Reference
from simrob_drake.dynamics import Dynamics
from simrob_drake.errors import listed
from simrob_drake.frames import Vector
from simrob_drake.parts.controllers import loops_of
from simrob_drake.parts.site import WORLD, StationPlant, StationRobot
from simrob_drake.robots.motors import rated_torques
from simrob_drake.robots.plausibility import moving_mass, payload_doubt
from simrob_drake.robots.urdf import doubtful_efforts
from simrob_drake.signals import Signal
from simrob_drake.stations.clearance import KNEELING, Clearance, Overlap, standing
from simrob_drake.stations.closed import check_reference, closed_station, reference_samples
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.contact import pairs_without_surface
from simrob_drake.stations.import_findings import import_findings
from simrob_drake.stations.plausibility import plausibility_findings
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.steps import Finding, Level, step_findings

_EVERY = 20  # of the 501 samples of a reference
_BURIED = 5e-3  # what stands on the floor may reach below it by as much [m]
_DEEP = 1e-3  # things that rest on each other are less deep in each other [m]
_PRESSED = 1e-4  # bodies that lie deeper in each other than this at the start are pushed apart [m]


def clearance_findings(config: StationConfig, references: Mapping[str, Reference]) -> list[Finding]:
    """Look how near robots come to ground, themselves and others, along references, or as controllers begin."""
    if not config.robots:
        return []
    clearance = Clearance(config)
    sampled = {name: reference_samples(reference, config.duration) for name, reference in references.items()}
    ways = {name: positions[::_EVERY] for name, (_, positions) in sampled.items()}
    times = next((times[::_EVERY] for times, _ in sampled.values()), np.zeros(1))
    heights: dict[str, list[Mapping[str, float]]] = {name: [] for name in config.robots}
    overlaps: list[tuple[float, Overlap]] = []
    for row, time in enumerate(times.tolist()):
        clearance.place_robots({name: way[row] for name, way in ways.items()})
        overlaps += [(time, overlap) for overlap in clearance.overlaps()]
        for name, robot in clearance.station.robots.items():
            heights[name].append(clearance.lowest(robot))
    findings = []
    for name, robot in clearance.station.robots.items():
        looked = f"at {len(times)} times along its reference" if name in references else "where it starts"
        if not heights[name][0]:
            text = "not looked at: the robot has no shapes that collide"
            findings.append(Finding("note", f"clearance of {name}", text))
            continue
        if not robot.floats:
            findings += _floor_findings(clearance, robot, times, heights[name], looked)
        findings += _self_findings(clearance, robot, overlaps, len(heights[name][0]), looked)
    return findings + _other_findings(clearance, overlaps)


def _floor_findings(
    clearance: Clearance, robot: StationRobot, times: Vector, heights: list[Mapping[str, float]], looked: str
) -> list[Finding]:
    ground, subject = clearance.station.ground, f"floor and {robot.name}"
    if not (ground.has_floor or ground.boxes):
        return [Finding("note", subject, "not looked at: there is no floor")]
    held = {
        body.name()
        for body in map(clearance.plant.get_body, clearance.plant.GetBodyIndices(robot.instance))
        if clearance.plant.IsAnchored(body)
    }
    foot = min((height for link, height in heights[0].items() if link in held), default=0.0)
    findings = []
    if foot < -_BURIED:
        text = f"what is fixed of it reaches {-foot * 1e3:.0f} mm below the ground; raise its base"
        findings.append(Finding("warning", subject, text))
    moving = [
        (height, time, link)
        for time, row in zip(times.tolist(), heights, strict=True)
        for link, height in row.items()
        if link not in held
    ]
    if not moving:
        return [*findings, Finding("note", subject, "not looked at: no link that moves has a shape to touch with")]
    lowest, time, link = min(moving)
    if lowest >= -_BURIED:
        text = f"{looked} {link} comes nearest to the ground: {max(lowest, 0.0) * 1e3:.0f} mm at {time:.2f} s"
        return [*findings, Finding("ok", subject, text)]
    text = f"{link} is {-lowest * 1e3:.0f} mm below the ground at {time:.2f} s"
    return [*findings, _met(clearance, subject, text, "raise its base, or change initial_deg and reference")]


def _self_findings(
    clearance: Clearance, robot: StationRobot, overlaps: list[tuple[float, Overlap]], shapes: int, looked: str
) -> list[Finding]:
    subject = f"links of {robot.name}"
    left_out = sorted(" and ".join(bodies) for bodies, owner in clearance.made_so.items() if owner == robot.name)
    spared = f"; left out: {listed(left_out)}, whose shapes always overlap" if left_out else ""
    own = [(time, overlap) for time, overlap in overlaps if overlap.robot == robot.name]
    if not own:
        return [Finding("ok", subject, f"{looked} none of {shapes} bodies with shapes lies in another{spared}")]
    return [_met(clearance, subject, _deepest(own) + spared, "change initial_deg or reference", own=True)]


def _other_findings(clearance: Clearance, overlaps: list[tuple[float, Overlap]]) -> list[Finding]:
    if len(clearance.resolved.robots) + len(clearance.resolved.pieces) < 2:
        return []
    others = [(time, overlap) for time, overlap in overlaps if not overlap.robot]
    if others:
        return [_met(clearance, "robots and pieces", _deepest(others), "move one of them")]
    return [Finding("ok", "robots and pieces", "none lies in one that it does not hang on, where references lead")]


def _met(clearance: Clearance, subject: str, text: str, remedy: str, *, own: bool = False) -> Finding:
    """Return what is to be said of things that meet: a run with contact shows it, any other lets them pass."""
    config = clearance.config
    if config.mode == "dynamic" and config.contact is not None and (config.contact.self_collision or not own):
        return Finding("note", subject, f"{text}, if nothing held them back; the run shows what comes of it")
    why = "contact.self_collision is off" if own and config.contact is not None else "the station has no contact"
    return Finding("warning", subject, f"{text}, and nothing holds them back: {why}; {remedy}")


def _deepest(overlaps: list[tuple[float, Overlap]]) -> str:
    time, worst = max(overlaps, key=lambda one: one[1].depth)
    more = len({overlap.bodies for _, overlap in overlaps}) - 1
    text = f"{' and '.join(worst.bodies)} lie {worst.depth * 1e3:.0f} mm in each other at {time:.2f} s"
    return text + (f", and {more} more pairs" if more else "")


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
    findings += plausibility_findings(config, ports.station)
    for robot in ports.plant.robots.values():
        findings += _reference_findings(robot, closed.references.get(robot.name), config.duration)
    for robot in ports.plant.robots.values():
        findings += import_findings(config, robot) + _effort_findings(config, robot) + _motor_findings(robot)
        if config.mode == "kinematic" or robot.model.base == "fixed":
            findings += _holding_findings(ports, robot, closed.references.get(robot.name))
        else:
            findings += _standing_findings(ports, robot)
    for name, coupling in ports.config.couplings.items():
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
        doubt = payload_doubt(float(masses.min()), moving_mass(robot.model.element))
        level: Level = "warning" if doubt and masses.min() > 0 else "note"  # weak motors have a warning each already
        findings.append(Finding(level, f"payload of {robot.name}", f"{text}; {doubt}" if doubt else text))
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
