"""Predictions of how robots that are fixed to the world hold still: torques, sag and payload.

Each servo of a robot holds its axis against gravity. A servo without an integral part does so only
with a position error, since its torque is the gain kp times that error. This error at rest is the
*sag* of the axis. The functions of this module predict torques and sag before a run, and return
findings for ``simrob check``. A prediction becomes a warning if it exceeds a bound of the section
``verdict`` of the station's file, by which the run itself will be judged.

The *reference* of a robot is the desired trajectory of its axes. Axes are revolute [rad, N·m] or
prismatic [m, N].
"""

from collections.abc import Sequence

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.blocks.servo import NO_TORQUE
from simrob_drake.dynamics import Dynamics
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.robots.motors import rated_torques
from simrob_drake.robots.plausibility import moving_mass, payload_doubt
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.findings import Finding, Level
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.solver_config import VerdictConfig, bound_value

POSTURES = 50
"""Approximate count of postures along the reference at which torques are computed."""


def holding_findings(
    ports: StationPorts,
    robot: StationRobot,
    positions: Vector,
) -> list[Finding]:
    """Predict the torques that hold a robot at postures along its reference, its sag, and its payload.

    Args:
        ports: the built station, with its plant and its configuration.
        robot: the robot.
        positions: samples of its reference, shape (m, n) [rad or m].

    Returns:
        a finding for each axis, then findings about the tool and the payload as far as there is something to report. If
        links have no inertia and no posture needs a torque, there is only a note that nothing was predicted.
    """
    config = ports.config
    # Torques change slowly along a reference, and each posture takes a solution of the dynamics.
    step = max(len(positions) // POSTURES, 1)
    postures = positions[::step]
    dynamics = Dynamics(
        robot.model,
        ports.plant.plant,
        robot.joints,
        tool=robot.tools.get(robot.tcp),
        torque_limit=robot.gains.limit_at_rest,
    )
    # Against gravity: a row for each posture, a column for each axis [N·m or N].
    torques = dynamics.gravity(postures)
    # Without any mass all torques are 0, which would look like a robot that holds easily.
    lacking = robot.model.links_without_inertia
    if lacking and np.abs(torques).max() <= NO_TORQUE:
        return [_no_inertia_finding(config, robot, lacking)]
    # At the end of its reference the robot is taken to come to rest. None if no sag can be predicted.
    sags = _sags(config, robot, dynamics, postures[-1])
    findings = []
    for axis in range(len(robot.axes)):
        if robot.gains.passive[axis]:
            findings.append(_passive_finding(robot, axis, torques[:, axis]))
            continue
        sag = None if sags is None else float(sags[axis])
        findings.append(_axis_finding(config, robot, axis, torques[:, axis], sag))
    # The tool is judged where the robot comes to rest after all axes have sagged.
    if sags is not None:
        findings += _tool_findings(ports, robot, postures[-1] + sags)
    findings += _payload_findings(config, robot, dynamics, postures)
    return findings


def _no_inertia_finding(
    config: StationConfig, robot: StationRobot, lacking: Sequence[str]
) -> Finding:
    """Make the note that torques and payload of a robot are not predicted, since its links have no inertia.

    Args:
        config: configuration of the station.
        robot: the robot.
        lacking: names of the moving links without inertia.
    """
    text = message(
        "stations.torques_need_inertia",
        "not predicted: {count} moving {count:link has|links have} no inertia, such as {link}; set "
        "{key}.import_options.estimate_inertia to true",
        count=len(lacking),
        link=lacking[0],
        key=config.robot_key(robot.name),
    )
    subject = message(
        "stations.torques_and_payload", "torques and payload of {robot}", robot=robot.name
    )
    return Finding("note", subject, text)


def _passive_finding(robot: StationRobot, axis: int, torques: Vector) -> Finding:
    """Describe an axis without a motor, and the torque that it would need to rest along the reference.

    Args:
        robot: the robot.
        axis: index of the axis.
        torques: torques that would hold the axis at postures along the reference, shape (m,) [N·m or N].
    """
    subject = message(
        "stations.torque_of", "torque of {prefix}{axis}", prefix=robot.prefix, axis=robot.axes[axis]
    )
    text = message(
        "stations.moves_freely", "the axis is passive: no motor drives it, and it moves freely"
    )
    largest = float(np.abs(torques).max())
    if largest > NO_TORQUE:
        text += message(
            "stations.would_take",
            "; holding it along the reference would require {largest:.2f} {effort}",
            largest=largest,
            effort=robot.model.units[axis].effort,
        )
    return Finding("note", subject, text)


def _axis_finding(
    config: StationConfig,
    robot: StationRobot,
    axis: int,
    torques: Vector,
    sag: float | None,
) -> Finding:
    """Judge the torques that hold one axis along the reference, and its sag at the end of the reference.

    Args:
        config: configuration of the station.
        robot: the robot.
        axis: index of the axis.
        torques: torques that hold the axis at postures along the reference, shape (m,) [N·m or N].
        sag: position error at rest at the last sample of the reference [rad or m], or None if it was not predicted.

    Returns:
        a warning if the axis does not hold, sags by more than the verdict allows, or gets too warm. Otherwise that it
        is in order. In a kinematic station, which has no servos, a note unless the limit is exceeded.
    """
    subject = message(
        "stations.torque_of", "torque of {prefix}{axis}", prefix=robot.prefix, axis=robot.axes[axis]
    )
    limit = robot.gains.limit_at_rest[axis]
    effort_unit = robot.model.units[axis].effort
    largest = torques[np.argmax(np.abs(torques))]  # the largest by magnitude, with its sign

    text = message(
        "stations.holding_takes",
        "holding requires {start:z.2f} {effort} at the start and {end:z.2f} {effort} at the end",
        start=torques[0],
        effort=effort_unit,
        end=torques[-1],
    )
    text += message("stations.of_the_reference", " of the reference")
    # A joint that does not hold has no equilibrium, so its sag and its heat do not matter.
    if abs(largest) > limit:
        text += message(
            "stations.at_most_and_limit",
            ", at most {largest:.2f} {effort}, but the limit is {limit:g} {effort}: ",
            largest=largest,
            effort=effort_unit,
            limit=limit,
        )
        text += message(
            "stations.joint_will_not_hold",
            "the joint does not hold; raise servo.torque_limit or reduce the load",
        )
        return Finding("warning", subject, text)
    if not config.engine.moves_by_forces:
        # A kinematic station has no servos, so there is nothing more to judge than the limit above.
        return Finding("note", subject, text, torque_share(largest, limit))

    text += message(
        "stations.the_limit_is",
        "; the limit is {limit:g} {effort}",
        limit=limit,
        effort=effort_unit,
    )
    level: Level = "ok"
    if holds_by_model(config, robot):
        text += message(
            "stations.holds_without_sagging",
            "; the servo's model compensates gravity, so the joint does not sag",
        )
    elif sag is not None:
        unit = robot.model.units[axis]
        text += message(
            "stations.sags_there",
            "; there the joint sags by {sag:.3g} {unit}",
            sag=abs(sag) / unit.size,
            unit=unit.name,
        )
        bound = error_bound(config.verdict, slides=bool(robot.model.prismatic[axis]))
        if abs(sag) > bound:
            level = "warning"
            text += message(
                "stations.bound_or_feedforward",
                " (bound {bound:.3g} {unit}); raise servo.kp, or set servo.feedforward to gravity",
                bound=bound / unit.size,
                unit=unit.name,
            )
    heat_warning = too_warm(robot, axis, largest)
    if heat_warning:
        level = "warning"
    return Finding(level, subject, text + heat_warning, torque_share(largest, limit))


def torque_share(torque: float, limit: float) -> float:
    """Compute the magnitude of a torque as a share of its limit, both in N·m or N. No torque is a share of 0."""
    # An axis without torque may have the limit 0, by which nothing can be divided.
    return abs(float(torque)) / float(limit) if torque else 0.0


def too_warm(robot: StationRobot, axis: int, torque: float) -> str:
    """Write a warning that a motor gets too warm, if it holds a torque for a long time.

    Args:
        robot: the robot.
        axis: index of the axis that the motor drives.
        torque: the torque that it holds [N·m or N].

    Returns:
        the warning, to be appended to another text, or an empty text if the torque does not exceed the motor's
        continuous torque, or if that is unknown.
    """
    continuous = rated_torques(robot.motors)[axis]  # infinite if it is unknown
    if abs(torque) <= continuous:
        return ""
    unit = robot.model.units[axis].effort
    return message(
        "stations.motor_too_warm",
        "; the motor overheats, since its continuous torque is {continuous:g} {unit}",
        continuous=continuous,
        unit=unit,
    )


def holds_by_model(config: StationConfig, robot: StationRobot) -> bool:
    """Whether a robot's servos compute the torque against gravity from its model, so that its joints do not sag."""
    servo = config.servo_of(robot.name)
    return servo.feedforward != "none" or servo.law == "computed_torque"


def error_bound(verdict: VerdictConfig, *, slides: bool) -> float:
    """Bound on the position error of an axis at the end of a run, in rad, or in m for a prismatic axis.

    Args:
        verdict: bounds of the station's verdict.
        slides: whether the axis is prismatic.

    Returns:
        the bound; infinite if the verdict has none.
    """
    if slides:
        return bound_value(verdict.final_error_m)
    return float(np.deg2rad(bound_value(verdict.final_error_deg)))


def _sags(
    config: StationConfig,
    robot: StationRobot,
    dynamics: Dynamics,
    reference: Vector,
) -> Vector | None:
    """Predict how far a robot's axes sag from a posture that they are to hold.

    At rest, the proportional part of each servo is in equilibrium with gravity: kp (q_r - q) = g(q), with the desired
    posture q_r and the actual posture q. An integral part removes the sag of its own axis.

    Args:
        config: configuration of the station.
        robot: the robot.
        dynamics: model of the robot, which gives g(q).
        reference: the desired posture q_r, shape (n,) [rad or m].

    Returns:
        the position errors q - q_r, shape (n,) [rad or m]. None if the station is kinematic, if the servos compensate
        gravity by their model, if an axis has no gain kp (such as a passive one), or if no equilibrium is found.
    """
    # Loaded where it is needed: commands that do not check start without SciPy.
    from scipy.optimize import root

    gains = robot.gains
    if (
        not config.engine.moves_by_forces
        or holds_by_model(config, robot)
        or not (gains.kp > 0).all()
    ):
        return None
    has_integral = gains.ki > 0
    if has_integral.all():
        return np.zeros(len(robot.axes))

    def imbalance(posture: Vector) -> Vector:
        """Left side minus right side of the equilibrium, divided by kp: q_r - q - g(q) / kp."""
        gravity = dynamics.gravity(posture[np.newaxis])[0]
        return np.asarray(reference - posture - gravity / gains.kp)

    # The sag changes the posture, and with it the torques: n equations that are solved together.
    # The reference is near, since sags are small.
    solution = root(imbalance, reference)
    if not solution.success:
        return None
    # Axes with an integral part were solved for like the others: their small sag hardly changes that of the others.
    return np.where(has_integral, 0.0, solution.x - reference)


def _tool_findings(
    ports: StationPorts,
    robot: StationRobot,
    posture: Vector,
) -> list[Finding]:
    """Warn of a tool centre point that is below the floor in a posture (n,) [rad or m], after the axes have sagged.

    Without a tool or a floor there is nothing to warn of.
    """
    config = ports.config
    if not robot.tcp or config.floor is None:
        return []
    plant = ports.plant.plant
    context = plant.CreateDefaultContext()
    robot.axis_map.set_positions(plant, context, posture)
    position = robot.tools[robot.tcp].CalcPoseInWorld(context).translation()
    # The ground may be inclined or a terrain, so its height is taken below the tool.
    ground_height = ports.plant.ground.beneath(position[np.newaxis])[0]
    depth = float(ground_height - position[2])
    bound = bound_value(config.verdict.below_floor)
    if depth <= bound:
        return []
    text = message(
        "stations.tool_below_floor",
        "after the joints have sagged, {tool} is {depth:.0f} mm below the floor (bound {bound:g} mm)",
        tool=robot.tcp,
        depth=depth * 1e3,
        bound=bound * 1e3,
    )
    remedy = message(
        "stations.raise_kp_or_feedforward", "raise servo.kp, or set servo.feedforward to gravity"
    )
    subject = message("stations.tool_of", "tool of {robot}", robot=robot.name)
    return [Finding("warning", subject, compound("{text}; {remedy}", text=text, remedy=remedy))]


def _payload_findings(
    config: StationConfig, robot: StationRobot, dynamics: Dynamics, postures: Vector
) -> list[Finding]:
    """Report how much more a robot could carry, and warn if it carries more than it is rated for.

    Args:
        config: configuration of the station.
        robot: the robot.
        dynamics: model of the robot with its torque limits.
        postures: postures along the reference, shape (m, n) [rad or m].

    Returns:
        at most two findings. How much more the robot could carry is left out for a robot without a tool or with a
        passive axis, and if a load has no effect on any motor. The warning needs a rated payload in the robot's file.
    """
    subject = message("stations.payload_of", "payload of {robot}", robot=robot.name)
    findings = []
    # What a robot with passive axes can carry depends on its motion.
    if robot.tcp and not robot.gains.passive.any():
        # For each motor, the mass that it can hold in all postures, in addition to the present load [kg]. It is
        # infinite for an axis on which a load has no effect.
        masses = dynamics.payload(postures).min(axis=0)
        payload = float(masses.min())
        if np.isfinite(payload):
            weakest = robot.axes[int(np.argmin(masses))]
            text = message(
                "stations.holds_more",
                "at rest along the reference the robot can hold {payload:.3g} kg more at {tool}",
                payload=payload,
                tool=robot.tcp,
            )
            text += message(
                "stations.by_motor_of", ", limited by the motor of {axis}", axis=weakest
            )
            findings.append(_payload_finding(subject, text, payload, robot))
    rated = robot.model.payload
    bound = bound_value(config.verdict.payload)  # as a multiple of the rated payload
    if rated is not None and robot.load > bound * rated:
        text = message(
            "stations.load_over_rating",
            "the robot carries {load:.3g} kg ({pieces}), but its rated payload is {rated:g} kg; reduce the load",
            load=robot.load,
            pieces=robot.load_in_words,
            rated=rated,
        )
        findings.append(Finding("warning", subject, text))
    return findings


def _payload_finding(
    subject: str,
    text: str,
    payload: float,
    robot: StationRobot,
) -> Finding:
    """Make the finding about the mass [kg] that a robot could carry in addition: a warning if it is implausible.

    Args:
        subject: title of the finding.
        text: the finding in words.
        payload: the mass [kg]; 0 if the motors do not hold the robot itself.
        robot: the robot.
    """
    # A robot whose motors do not hold even the robot itself (payload 0) has a warning for each of these motors already,
    # so the doubt that `payload_doubt` has about this case is not asked for.
    if payload > 0:
        doubt = payload_doubt(payload, moving_mass(robot.model.element))
        if doubt:
            return Finding("warning", subject, compound("{text}; {doubt}", text=text, doubt=doubt))
    return Finding("note", subject, text)
