"""What robots that are fixed to the world need to hold still, predicted before a run: torques, sag and payload.

Predictions are judged by the bounds of the station's verdict, as the run will be.
"""

import numpy as np

from simrob_drake.dynamics import Dynamics
from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationRobot
from simrob_drake.robots.motors import rated_torques
from simrob_drake.robots.plausibility import moving_mass, payload_doubt
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.findings import Finding, Level
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.solver_config import VerdictConfig, bound_value

POSTURES = 50
"""Postures along the reference at which torques are computed, about."""


def holding_findings(ports: StationPorts, robot: StationRobot, positions: Vector) -> list[Finding]:
    """Predict the torques that hold a robot at postures along its reference, and how far its joints sag.

    Args:
        ports: of the station.
        robot: the robot.
        positions: samples of its reference, shape (m, n) [rad or m].
    """
    config = ports.config
    postures = positions[:: max(len(positions) // POSTURES, 1)]
    dynamics = Dynamics(
        robot.model,
        ports.plant.plant,
        robot.joints,
        tool=robot.tools.get(robot.tcp),
        torque_limit=robot.gains.torque_limit,
    )
    torques = dynamics.gravity(postures)
    sag = _sag(config, robot, dynamics, postures[-1])
    findings = [_axis_finding(config, robot, axis, torques[:, axis], sag) for axis in range(len(robot.axes))]
    findings += _tool_findings(ports, robot, postures[-1], sag)
    findings += _payload_findings(config, robot, dynamics, postures)
    return findings


def _axis_finding(config: StationConfig, robot: StationRobot, axis: int, torque: Vector, sag: Vector | None) -> Finding:
    """Judge the torque (m,) [N·m or N] that holds an axis along the reference, and its sag at the end."""
    subject = f"torque of {robot.prefix}{robot.axes[axis]}"
    limit = robot.gains.torque_limit[axis]
    unit = robot.model.units[axis]
    worst = torque[np.argmax(np.abs(torque))]
    effort = unit.effort
    text = f"holding takes {torque[0]:z.2f} {effort} at the start and {torque[-1]:z.2f} {effort} at the end"
    text += " of the reference"
    if abs(worst) > limit:
        text += f", at most {worst:.2f} {effort}, and the limit is {limit:g} {effort}: the joint will not hold"
        return Finding("warning", subject, f"{text}; raise servo.torque_limit or lighten the load")
    if config.mode == "kinematic":
        return Finding("note", subject, text)
    level: Level = "ok"
    text += f"; the limit is {limit:g} {effort}"
    if holds_by_model(config, robot):
        text += "; the servo's model holds it without sagging"
    elif sag is not None:
        text += f"; it sags by {abs(sag[axis]) / unit.size:.3g} {unit.name} there"
        bound = error_bound(config.verdict, slides=bool(robot.model.prismatic[axis]))
        if abs(sag[axis]) > bound:
            level = "warning"
            text += f" (bound {bound / unit.size:.3g} {unit.name}); raise servo.kp, or set servo.feedforward to gravity"
    if warmth := too_warm(robot, axis, worst):
        return Finding("warning", subject, text + warmth)
    return Finding(level, subject, text)


def too_warm(robot: StationRobot, axis: int, torque: float) -> str:
    """Warn, in words, of a torque that is more than a motor may give for ever. Empty if it is not."""
    rated = rated_torques(robot.motors)[axis]
    unit = robot.model.units[axis].effort
    if abs(torque) <= rated:
        return ""
    return f"; its motor gets too warm: it may give {rated:g} {unit} continuously"


def holds_by_model(config: StationConfig, robot: StationRobot) -> bool:
    """Whether a robot's servos compute the torque against gravity, so that its joints do not sag."""
    servo = config.servo_of(robot.name)
    return servo.feedforward != "none" or servo.law == "computed_torque"


def error_bound(verdict: VerdictConfig, *, slides: bool) -> float:
    """Bound of the final error of an axis [rad, or m if it slides]; infinite if there is none."""
    if slides:
        return bound_value(verdict.final_error_m)
    return float(np.deg2rad(bound_value(verdict.final_error_deg)))


def _sag(config: StationConfig, robot: StationRobot, dynamics: Dynamics, reference: Vector) -> Vector | None:
    """Find how far a robot's joints sag below a posture (n,), shape (n,) [rad or m].

    At rest the proportional part of each servo carries the weight, kp (q_r - q) = g(q). An integral part leaves no sag.
    Returns None if a joint has no gain, if the servo knows the weight, or if no posture is found.
    """
    from scipy.optimize import root  # loaded where it is needed: commands that do not check start without SciPy

    gains = robot.gains
    if config.mode == "kinematic" or holds_by_model(config, robot) or not (gains.kp > 0).all():
        return None
    if (gains.ki > 0).all():
        return np.zeros(len(robot.axes))

    def unbalanced(position: Vector) -> Vector:
        return np.asarray(reference - position - dynamics.gravity(position[np.newaxis])[0] / gains.kp)

    found = root(unbalanced, reference)
    if not found.success:
        return None
    return np.where(gains.ki > 0, 0.0, found.x - reference)


def _tool_findings(ports: StationPorts, robot: StationRobot, reference: Vector, sag: Vector | None) -> list[Finding]:
    """Warn of a tool that hangs below the floor once the joints have sagged."""
    config = ports.config
    bound = bound_value(config.verdict.below_floor)
    if sag is None or not robot.tcp or config.floor is None:
        return []
    plant = ports.plant.plant
    context = plant.CreateDefaultContext()
    robot.axis_map.set_positions(plant, context, reference + sag)
    place = robot.tools[robot.tcp].CalcPoseInWorld(context).translation()
    depth = float(ports.plant.ground.beneath(place[np.newaxis])[0] - place[2])
    if depth <= bound:
        return []
    text = f"once its joints sag, {robot.tcp} is {depth * 1e3:.0f} mm below the floor (bound {bound * 1e3:g} mm)"
    remedy = "raise servo.kp, or set servo.feedforward to gravity"
    return [Finding("warning", f"tool of {robot.name}", f"{text}; {remedy}")]


def _payload_findings(
    config: StationConfig, robot: StationRobot, dynamics: Dynamics, postures: Vector
) -> list[Finding]:
    """Report what a robot could carry besides its load, and judge the load by the robot's rating."""
    findings = []
    subject = f"payload of {robot.name}"
    masses = dynamics.payload(postures).min(axis=0) if robot.tcp else np.array([np.inf])
    if np.isfinite(masses.min()):
        weakest = robot.axes[int(np.argmin(masses))]
        text = f"at rest along the reference it holds {masses.min():.3g} kg more at {robot.tcp}"
        text += f", by the motor of {weakest}"
        # Motors too weak for their own robot have a warning each already.
        doubt = payload_doubt(float(masses.min()), moving_mass(robot.model.element)) if masses.min() > 0 else ""
        level: Level = "warning" if doubt else "note"
        findings.append(Finding(level, subject, f"{text}; {doubt}" if doubt else text))
    rated = robot.model.payload
    bound = bound_value(config.verdict.payload)
    if rated is not None and robot.load > bound * rated:
        text = f"it carries {robot.load:.3g} kg, and is rated for {rated:g} kg: lighten its load"
        findings.append(Finding("warning", subject, text))
    return findings
