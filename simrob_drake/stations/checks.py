"""Check of a station before it runs: references, torques, motors, the stance of legged robots, contacts and solver.

The result is a list of findings. A finding is a text for the user about one subject: a warning, a note, or that
something is in order. The ports of a station (`StationPorts`) hold its plant with the robots, and its configuration.

A *reference* gives the desired positions of a robot's axes over time. A *servo* moves each axis to its reference. Under
a load, an axis *sags*: it rests a little off its reference. A *passive* axis has no motor, and so no servo. In a
*kinematic* station (``engine.moves_by_forces`` is False) the robots follow their references exactly, without servos.
The *verdict* is the section of a station with the bounds by which a run is judged.
"""

import numpy as np
from pydrake.systems.framework import Diagram

from simrob_drake.base.errors import list_names
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.base.signals import Signal
from simrob_drake.blocks.references import Reference
from simrob_drake.blocks.servo import NO_TORQUE
from simrob_drake.parts.resolved import WORLD, ResolvedPiece
from simrob_drake.parts.station_plant import StationPlant, StationRobot
from simrob_drake.robots.axis_map import AxisUnit
from simrob_drake.robots.motors import Motor
from simrob_drake.robots.urdf import doubtful_efforts
from simrob_drake.stations.clearance import KNEELING, Standing, standing
from simrob_drake.stations.clearance_checks import clearance_findings
from simrob_drake.stations.closed import check_reference, closed_station, reference_samples
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.findings import Finding, Level
from simrob_drake.stations.holding import error_bound, holding_findings, too_warm, torque_share
from simrob_drake.stations.ignored_settings import rounded_delays
from simrob_drake.stations.physics_findings import CONTACT, physics_findings
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.solver_config import bound_value
from simrob_drake.stations.start_jump import axes_off_reference, jump_text
from simrob_drake.stations.start_overlap import TOUCHING, allowed_overlap, deepest_overlap

_LISTED = 6  # largest count of links that carry a robot and are listed by name
_DROP = 2e-3  # a robot that starts higher over the floor than this drops on it [m]

_STEADY = np.tan(np.deg2rad(1.0))
"""Part of its height by which the centre of mass has to be inside of the support area: a robot whose servos sag leans
by about one degree."""


def check_station(config: StationConfig) -> list[Finding]:
    """Check a station before it runs: its pieces, its robots, couplings, controllers, contacts, solver and signals.

    The station is built for this, but not simulated.

    Returns:
        the findings, in the order in which ``simrob check`` prints them.

    Raises:
        SimrobError: the station cannot run; the message names the reason, such as a reference beyond a limit.
    """
    # The built diagram has the plant and the references that a run would have.
    closed = closed_station(resolve(config))
    ports = closed.ports
    robots = ports.plant.robots.values()
    findings = _piece_findings(ports)
    # `closed.references` has no entry for a robot whose reference a controller computes.
    for robot in robots:
        findings += _reference_findings(config, robot, closed.references.get(robot.name))
        findings += _jump_findings(config, robot, closed.references.get(robot.name))
    for robot in robots:
        findings += _effort_findings(config, robot)
        findings += _motor_findings(robot)
        # A robot that floats has no fixed base to hold it: its torques depend on how it stands.
        stands = config.engine.moves_by_forces and robot.model.base == "floating"
        if stands:
            findings += _standing_findings(ports, robot)
        else:
            findings += _holding_findings(ports, robot, closed.references.get(robot.name))
    for name, coupling in ports.config.couplings.items():
        findings.append(Finding("note", f"couplings.{name}", coupling.caption()))
    for name in config.controllers:
        text = message(
            "stations.controller_not_examined",
            "not examined: only a run shows what the controller adds to the reference",
        )
        findings.append(Finding("note", f"controllers.{name}", text))
    findings += physics_findings(config, ports, closed.references)
    findings += rounded_delays(config)
    if config.engine.moves_by_forces:
        findings += contact_findings(closed.diagram, ports)
        findings += _contact_model_findings(ports)
    # Geometry alone, without forces: this check holds for kinematic stations, too.
    findings += clearance_findings(config, closed.references)
    # Signals without a part are those of the robots themselves, which every station has.
    return findings + [_signal_finding(signal) for signal in ports.outputs.signals if signal.part]


def _signal_finding(signal: Signal) -> Finding:
    """Describe the columns that a signal of a sensor, piece or block adds to the results, with their units.

    Several columns are described by the first and the last one, such as ``imu.x … z``. Each unit is named once, so
    their count is not that of the columns.
    """
    columns = signal.names[0]
    if len(signal.names) > 1:
        # The names of several columns differ in their last word only, such as `x`, `y` and `z`.
        stem = columns.rpartition(".")[0]
        words = [name.removeprefix(f"{stem}.") for name in signal.names]
        columns = f"{stem}.{words[0]} … {words[-1]}"
    units = ", ".join(dict.fromkeys(signal.units))  # each unit once
    return Finding(
        "note",
        message("stations.signals_of", "signals of {part}", part=signal.part),
        compound("{columns} [{units}]", columns=columns, units=units),
    )


def holding_torque(plant: StationPlant, robot: StationRobot, position: Vector) -> Vector:
    """Compute the torques (n,) [N·m or N] that hold a robot still against gravity at a posture (n,) [rad or m].

    Forces of contacts and of couplings are left out, so the result is right only for a robot that its root holds.
    """
    context = plant.plant.CreateDefaultContext()
    robot.axis_map.set_positions(plant.plant, context, position)
    # At rest tau + g(q) = 0 with gravity's generalized forces g, so the torques are -g.
    gravity = plant.plant.CalcGravityGeneralizedForces(context)
    return -robot.axis_map.efforts(gravity)


def _piece_findings(ports: StationPorts) -> list[Finding]:
    """Describe for each piece what it is fixed to."""
    findings = []
    for name, piece in ports.station.pieces.items():
        text = (
            message("stations.hangs_on_nothing", "free: only gravity and contact move it")
            if piece.free
            else _mount_text(piece)
        )
        findings.append(Finding("note", f"pieces.{name}", text))
    return findings


def _mount_text(piece: ResolvedPiece) -> str:
    """Describe where a piece is fixed: to the world, to a robot or to another piece, which a robot may carry.

    The text has the position of the piece's origin in the frame on which the piece is mounted [m].
    """
    # Adding 0.0 turns -0.0 into 0.0.
    coordinates = [compound("{value:.4g}", value=value) for value in piece.pose.translation() + 0.0]
    text = message("stations.hangs_on", "mounted on {parent}", parent=piece.parent)
    # `mount` is the frame on which the piece hangs; empty for the world. If the parent is a piece, the name of the
    # frame begins with that of the parent; a frame of a robot has no such prefix.
    if piece.mount:
        frame = piece.mount.removeprefix(f"{piece.parent}_")
        text += message("stations.at_frame", ", at frame {frame}", frame=frame)
    text += message(
        "stations.its_origin_at",
        ", with its origin at {origin} m",
        origin=join_texts(coordinates, " "),
    )
    # The carrier is the robot that moves it, perhaps through other pieces.
    if piece.carrier not in (piece.parent, WORLD):
        text += message("stations.carried_by", "; {carrier} carries it", carrier=piece.carrier)
    return text


def _reference_findings(
    config: StationConfig,
    robot: StationRobot,
    reference: Reference | None,
) -> list[Finding]:
    """Check a reference: its positions by the limits of the axes, its speeds by the share that the verdict allows.

    Args:
        config: the station, with the bounds of its verdict.
        robot: the robot.
        reference: the robot's reference, or None if a controller leads the robot.

    Returns:
        a warning for each axis that is too fast. If there is none, one finding that all is in order, or that nothing
        was examined, since the robot has no reference.

    Raises:
        InvalidParameter: the reference leaves the range of an axis.
    """
    subject = message("stations.reference_of", "reference of {robot}", robot=robot.name)
    if reference is None:
        return [
            Finding(
                "note",
                subject,
                message(
                    "stations.controller_decides",
                    "not examined: a controller computes the reference of the robot",
                ),
            )
        ]
    # First the limits: a reference beyond them is an error, and its speeds do not matter.
    check_reference(robot, reference, config.duration)
    times, positions = reference_samples(reference, config.duration)
    step = times[1]  # the samples are evenly spaced and begin at 0
    # Mean speeds between samples: |q_k+1 - q_k| / h, the largest one of each axis.
    speeds = np.abs(np.diff(positions, axis=0)).max(axis=0) / step
    limits = robot.speed_limits  # [rad/s or m/s]; infinite for an axis without a limit
    # Share of these limits that an axis may reach, such as 1.05; infinite if the verdict has no bound.
    allowed_share = bound_value(config.verdict.speed_share)
    findings = []
    for axis in np.flatnonzero(speeds > allowed_share * limits):
        unit = robot.model.user_units[axis]
        unit_name = f"{robot.model.unit_names[axis]}/s"
        text = message(
            "stations.asked_for_speed",
            "the reference of {prefix}{axis} reaches {speed:.4g} {unit}",
            prefix=robot.prefix,
            axis=robot.axes[axis],
            speed=speeds[axis] / unit,
            unit=unit_name,
        )
        text += message(
            "stations.its_speed_limit",
            ", but the limit is {limit:.4g} {unit}; give the motion more time",
            limit=limits[axis] / unit,
            unit=unit_name,
        )
        findings.append(Finding("warning", subject, text))
    if findings:
        return findings
    text = message(
        "stations.within_joint_limits",
        "within the joint limits at {count} samples from 0 to {duration:g} s",
        count=len(times),
        duration=config.duration,
    )
    if np.isfinite(limits).any():
        # An axis without a speed limit (inf) has a share of 0. An axis at rest with the limit 0 has none (NaN).
        largest_share = np.nanmax(speeds / limits)
        text += message(
            "stations.share_of_speed",
            ", at most {share:.0%} of their speed limits",
            share=largest_share,
        )
    return [Finding("ok", subject, text)]


def _jump_findings(
    config: StationConfig,
    robot: StationRobot,
    reference: Reference | None,
) -> list[Finding]:
    """Warn of a reference that begins away from the robot, so that its servos jump at the start.

    Args:
        config: the station. If it begins in a recorded state, or moves its robots exactly along their references,
            there is nothing to warn of.
        robot: the robot.
        reference: the robot's reference, or None if a controller leads the robot.
    """
    if reference is None or config.start is not None or not config.engine.moves_by_forces:
        return []
    _, positions = reference_samples(reference, config.duration)
    first_positions = positions[0]
    # Indices of the axes that begin away from their references, the farthest first.
    axes = axes_off_reference(robot, robot.initial, first_positions)
    if not axes.size:
        return []
    farthest = int(axes[0])
    others = ""
    if axes.size > 1:
        others = message(
            "stations.other_axes_jump",
            ", and {count} other {count:axis jumps|axes jump} too",
            count=axes.size - 1,
        )
    remedy = message(
        "stations.start_at_reference",
        "set {key}, or let the reference begin at the robot's initial position",
        key=f"{config.robot_key(robot.name)}.initial_deg",
    )
    text = compound(
        "{jump}{others}; {remedy}",
        jump=jump_text(robot, farthest, robot.initial[farthest], first_positions[farthest]),
        others=others,
        remedy=remedy,
    )
    return [
        Finding("warning", message("stations.start_of", "start of {robot}", robot=robot.name), text)
    ]


def _effort_findings(config: StationConfig, robot: StationRobot) -> list[Finding]:
    """Warn of torque limits of revolute joints in the robot's file that are too large for the link that each moves.

    Nothing is checked if the station sets torque limits for the robot's servos, or if any axis has a motor model.
    """
    # A limit of the station, or of an axis' motor, takes the place of the limit in the file.
    if config.servo_of(robot.name).torque_limit is not None or any(robot.motors):
        return []
    # Some files have an effort of 1000 N·m for a light wrist, which only says that there is no limit.
    doubtful = doubtful_efforts(robot.model.element)
    axes = [
        message(
            "stations.axis_and_effort",
            "{name} ({effort:g} N·m, {mass:.3g} kg)",
            name=name,
            effort=effort,
            mass=mass,
        )
        for name, (effort, mass) in doubtful.items()
    ]
    if not axes:
        return []
    text = message(
        "stations.implausible_efforts",
        "effort limits that are too large for the masses of their links: {axes}; set servo.torque_limit",
        axes=list_names(axes),
    )
    return [
        Finding(
            "warning", message("stations.efforts_of", "efforts of {robot}", robot=robot.name), text
        )
    ]


def _motor_findings(robot: StationRobot) -> list[Finding]:
    """Describe the motors of a robot; axes with equal motors share one finding.

    Axes without a model of a motor are left out: passive axes, and axes of which only a torque limit is known.
    """
    axes_by_text = dict[str, list[str]]()
    for axis, unit, motor in zip(robot.axes, robot.model.units, robot.motors, strict=True):
        if motor is not None:
            # Equal motors have equal texts, so the text serves as the key.
            axes_by_text.setdefault(_motor_text(motor, unit), []).append(axis)
    subject = message("stations.motors_of", "motors of {robot}", robot=robot.name)
    return [
        Finding("note", subject, compound("{axes}: {text}", axes=list_names(axes), text=text))
        for text, axes in axes_by_text.items()
    ]


def _motor_text(motor: Motor, unit: AxisUnit) -> str:
    """Describe a motor: its torques, its speed and the source of these numbers.

    The torque falls along a line from standstill to the speed without load. The current may limit it further.

    Args:
        motor: the motor, with its values at the joint.
        unit: units of the axis, for the text.
    """
    stall_torque, no_load_speed = motor.line
    text = message(
        "stations.stall_and_speed",
        "{torque:.3g} {effort} at rest, {speed:.3g} {si}/s without load",
        torque=stall_torque,
        effort=unit.effort,
        speed=no_load_speed,
        si=unit.si,
    )
    if motor.peak_torque:
        text += message(
            "stations.peak_by_current",
            ", at most {torque:g} {effort} by its current limit",
            torque=motor.peak_torque,
            effort=unit.effort,
        )
    if motor.rated_torque:
        text += message(
            "stations.continuously",
            ", {torque:g} {effort} continuously",
            torque=motor.rated_torque,
            effort=unit.effort,
        )
    return compound(
        "{text} ({source})",
        text=text,
        source=motor.source or message("stations.values_of_station", "values of the station"),
    )


def _holding_findings(
    ports: StationPorts,
    robot: StationRobot,
    reference: Reference | None,
) -> list[Finding]:
    """Predict torques of a robot along its reference, its sag at the end, and its payload.

    Returns only a note if the robot has no reference.
    """
    if reference is None:
        text = message(
            "stations.controller_decides",
            "not examined: a controller computes the reference of the robot",
        )
        return [
            Finding(
                "note", message("stations.torques_of", "torques of {robot}", robot=robot.name), text
            )
        ]
    _, positions = reference_samples(reference, ports.config.duration)
    return holding_findings(ports, robot, positions)


def _standing_findings(ports: StationPorts, robot: StationRobot) -> list[Finding]:
    """Check how a robot with a floating base stands at the start, and the torques that this takes.

    If the station has no ground or no section ``contact``, or the robot has neither feet nor collision shapes, the only
    finding is the warning that the robot falls.
    """
    config = ports.config
    ground = ports.plant.ground
    found = standing(ports.plant, robot)
    has_ground = ground.has_floor or ground.boxes
    if not has_ground or config.contact is None or found is None:
        if not has_ground:
            missing = message("stations.floor", "floor")
        elif config.contact is None:
            missing = CONTACT
        else:
            missing = message("stations.collision_shapes", "collision shapes")
        text = message(
            "stations.falls_without",
            "the base is free: without {missing}, the robot falls",
            missing=missing,
        )
        return [Finding("warning", f"{robot.prefix}base", text)]
    findings = [_gap_finding(robot, found), _balance_finding(robot, found)]
    # A link that carries near its joint kneels. Feet that the robot's description names may carry anywhere.
    kneeling = [link for link, distance in found.carrying_links.items() if distance < KNEELING]
    if kneeling and not robot.feet:
        text = message(
            "stations.kneeling",
            "the robot kneels: the contact points of {links} are near the joint; change initial_deg so "
            "that the feet carry the robot",
            links=", ".join(kneeling),
        )
        findings.append(Finding("warning", f"{robot.prefix}base", text))
    # Drake's point contact pushes two shapes apart at one point, so that a box on the floor jumps between its
    # corners.
    if robot.feet and robot.feet.boxes and config.contact.model == "point":
        text = message(
            "stations.box_soles_rock",
            "soles made of boxes rock in point contact, which has one contact point for each box; set "
            "contact.model to {model}",
            model="hydroelastic_with_fallback",
        )
        findings.append(Finding("warning", f"{robot.prefix}feet", text))
    for axis, torque in enumerate(found.torque):
        findings.append(_standing_torque(config, robot, axis, float(torque)))
    return findings


def _gap_finding(robot: StationRobot, found: Standing) -> Finding:
    """Check the height of a robot's lowest point: the robot must not drop on the ground, and not begin inside of it."""
    parts = (
        message("stations.of_feet", "feet")
        if robot.feet
        else message("stations.of_shapes", "collision shapes")
    )
    side = (
        message("stations.over", "above") if found.gap >= 0 else message("stations.below", "below")
    )
    text = message(
        "stations.lowest_point",
        "the lowest point of the {parts} is {gap:.2f} mm {side} the floor at the start",
        parts=parts,
        gap=abs(found.gap) * 1e3,
        side=side,
    )
    # If the lowest point begins deeper in the ground, contact pushes it out; a robot that begins higher drops.
    is_on_ground = -TOUCHING <= found.gap <= _DROP
    return Finding("ok" if is_on_ground else "warning", f"{robot.prefix}base", text)


def _balance_finding(robot: StationRobot, found: Standing) -> Finding:
    """Check that the centre of mass of a robot that stands is well inside of the support area.

    The support area is the convex hull of the points that carry the robot. The centre of mass must be so far inside
    that the robot may lean by one degree.
    """
    side = (
        message("stations.inside", "inside")
        if found.margin >= 0
        else message("stations.outside", "outside")
    )
    links = (
        message("stations.of_ends", " of {ends}", ends=", ".join(found.carrying_links))
        if len(found.carrying_links) <= _LISTED
        else ""
    )
    text = message(
        "stations.mass_on_points",
        "{mass:.3f} kg on {contacts} points{links}, ",
        mass=found.mass,
        contacts=found.contacts,
        links=links,
    )
    text += message(
        "stations.margin_of_support",
        "with the centre of mass {margin:.0f} mm {side} the support area",
        margin=abs(found.margin) * 1e3,
        side=side,
    )
    # At the tilt angle alpha the centre of mass shifts by height * tan(alpha).
    is_steady = found.margin > _STEADY * found.height
    if is_steady:
        return Finding("ok", f"{robot.prefix}base", text)
    if found.margin <= 0:
        text += message("stations.tips_over", ": the robot tips over if it stands still")
    else:
        # The robot tips when its centre of mass is over the edge: tan(angle) = margin / height.
        angle = np.rad2deg(np.arctan2(found.margin, found.height))
        text += message(
            "stations.tips_over_leaning",
            ": the robot tips over if it leans by {angle:.1f} deg, unless a controller balances it",
            angle=angle,
        )
    return Finding("warning", f"{robot.prefix}base", text)


def _standing_torque(
    config: StationConfig,
    robot: StationRobot,
    axis: int,
    torque: float,
) -> Finding:
    """Check the torque with which an axis carries a robot that stands, and by how much its servo gives way.

    Args:
        config: the station, with the bounds of its verdict.
        robot: the robot.
        axis: index of the axis.
        torque: torque of the axis [N·m or N].

    Returns:
        a warning if the axis does not hold, sags by more than the verdict allows, or gets too warm; otherwise that it
        is in order, or a note about a passive axis that needs no torque.
    """
    unit = robot.model.units[axis]
    # A passive axis has neither a torque limit nor a servo that gives way.
    if robot.gains.passive[axis]:
        return _standing_on_passive(robot, axis, torque)
    # A motor gives less torque at speed. A robot that stands does not move, so its torque is compared with the limit at
    # rest.
    limit = robot.gains.limit_at_rest[axis]
    kp = robot.gains.kp[axis]
    subject = message(
        "stations.torque_of", "torque of {prefix}{axis}", prefix=robot.prefix, axis=robot.axes[axis]
    )
    text = message(
        "stations.standing_takes",
        "standing requires {torque:z.2f} {effort} and the limit is {limit:g} {effort}",
        torque=torque,
        effort=unit.effort,
        limit=limit,
    )
    # A joint that does not hold has no equilibrium, so no sag is computed for it.
    if abs(torque) > limit:
        text = message("stations.will_not_hold", "{text}: the joint does not hold", text=text)
        return Finding("warning", subject, text)
    level: Level = "ok"
    # The servo's spring balances the torque: torque = kp * sag. Without kp there is no spring to sag, and an integral
    # part removes the sag.
    if kp > 0 and robot.gains.ki[axis] == 0:
        sag = abs(torque) / kp
        text += message(
            "stations.sags_by",
            "; the joint sags by {sag:.2f} {unit}",
            sag=sag / unit.size,
            unit=unit.name,
        )
        bound = error_bound(config.verdict, slides=bool(robot.model.prismatic[axis]))
        if sag > bound:
            level = "warning"
            text += message(
                "stations.bound_raise_kp",
                " (bound {bound:.3g} {unit}); raise servo.kp",
                bound=bound / unit.size,
                unit=unit.name,
            )
    warmth = too_warm(robot, axis, torque)  # empty if the motor does not get too warm
    if warmth:
        return Finding("warning", subject, text + warmth)
    return Finding(level, subject, text, torque_share(torque, limit))


def _standing_on_passive(robot: StationRobot, axis: int, torque: float) -> Finding:
    """Check that a robot can stand although an axis is passive: the axis must not need a torque [N·m or N]."""
    subject = message(
        "stations.torque_of", "torque of {prefix}{axis}", prefix=robot.prefix, axis=robot.axes[axis]
    )
    text = message(
        "stations.moves_freely", "the axis is passive: no motor drives it, and it moves freely"
    )
    if abs(torque) <= NO_TORQUE:
        return Finding("note", subject, text)
    needed = message(
        "stations.standing_needs",
        "; standing requires {torque:.2f} {effort} there, so the joint does not hold",
        torque=torque,
        effort=robot.model.units[axis].effort,
    )
    return Finding("warning", subject, text + needed)


def _contact_model_findings(ports: StationPorts) -> list[Finding]:
    """Describe the contact model of a station in one finding. Returns no finding if the station has no contact.

    Contact points are small balls at the corners and edges of flat bodies, which the station adds in point contact.
    """
    config = ports.config
    if config.contact is None:
        return []
    # Stations get contact points only in point contact, if a body with flat sides is free.
    if ports.plant.contact_points:
        text = message(
            "stations.points_at_corners",
            "shapes touch at points; free bodies with flat sides also touch at their corners and along "
            "their edges",
        )
    elif config.contact.model == "point":
        text = message("stations.meet_at_points", "shapes touch at points")
    else:
        text = message(
            "stations.meet_over_surfaces",
            "shapes touch over surfaces ({model})",
            model=config.contact.model,
        )
    return [Finding("ok", "contact.model", text)]


def contact_findings(diagram: Diagram, ports: StationPorts) -> list[Finding]:
    """Report the two bodies that overlap most at the start, in the default context of the station's diagram.

    Pairs that a collision filter excludes, such as neighbouring links, are not measured.

    Returns:
        one finding: a warning if they overlap by more than TOUCHING, otherwise that this is in order. For a station
        without contact it is a note, and nothing is measured.
    """
    if ports.config.contact is None:
        text = message(
            "stations.has_no_contact",
            "the station has no section contact: bodies pass through each other",
        )
        return [Finding("note", CONTACT, text)]
    # The default context has the positions at the start; it is not stepped.
    overlap = deepest_overlap(ports, diagram.CreateDefaultContext())
    if overlap is None:
        text = message(
            "stations.nothing_penetrates",
            "no bodies that can touch overlap at the start",
        )
        return [Finding("ok", CONTACT, text)]
    if overlap.depth <= TOUCHING:
        return [Finding("ok", CONTACT, str(overlap))]
    # A run does not begin if a piece is too deep in another body, also in the floor. Other overlaps do not prevent it.
    has_piece = overlap.first in ports.config.pieces or overlap.second in ports.config.pieces
    is_refused = has_piece and overlap.depth > allowed_overlap(ports.config)
    consequence = ""
    if is_refused:
        consequence = message("stations.run_does_not_begin", ", so a run does not begin")
    text = message(
        "stations.overlap_move_one",
        "{overlap}{consequence}; move one of the two",
        overlap=overlap,
        consequence=consequence,
    )
    return [Finding("warning", CONTACT, text)]
