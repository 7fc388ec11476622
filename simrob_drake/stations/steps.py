"""What the solver of a station makes of its servos and stops: what is unstable, and what it can only creep through."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydrake.systems.framework import Context

from simrob_drake.blocks.references import Reference
from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationPlant, StationRobot
from simrob_drake.stations.closed import reference_samples
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.solver_config import FIXED_STEP_SCHEMES, ContinuousSolver, DiscreteSolver

_EXPLICIT_SCHEMES = ("runge_kutta3", "runge_kutta5", "bogacki_shampine3", *FIXED_STEP_SCHEMES)
_STABLE = 2.0
"""An explicit damper on a mass is stable while kd·h / M stays below this (forward Euler on v' = -(kd/M) v)."""

_STIFF_STOPS = 2e10
"""An implicit scheme gets through stops up to this stiffness by a joint's inertia [1/s²]: tried on 100 robots."""
_STIFF_SERVO = 1e12
"""And through servos up to this [1/s²]: beyond, the inertia is lost in the rounding of the mass matrix."""
_NEAR = np.deg2rad(1.0), 1e-3
"""How near to a stop a joint may come that leans on it, and one that slides [rad, m]."""
DISCRETE = "take solver.kind discrete and servo.realization implicit"
"""What helps where a continuous scheme creeps."""

Level = Literal["ok", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One thing that a check found: in order, not in order, or a fact that it did not judge, or did not look at."""

    level: Level
    subject: str
    text: str


def step_findings(
    config: StationConfig, plant: StationPlant, references: Mapping[str, Reference] | None = None
) -> list[Finding]:
    """Compare servos and stops with the steps of the solver, as they start and along ``references``, by robot."""
    findings = _creeping(config, plant, references or {})
    solver = config.solver
    for robot in plant.robots.values():
        if config.servo_of(robot.name).realization == "implicit":
            continue
        steps = largest_explicit_steps(config, robot)
        worst = int(np.argmin(steps))
        joint, largest, unit = f"{robot.prefix}{robot.axes[worst]}", steps[worst], robot.model.units[worst]
        damping = f"the damping of {joint} (kd {robot.gains.kd[worst]:g} {unit.effort}·s/{unit.si})"
        if isinstance(solver, DiscreteSolver):
            if solver.time_step > largest:
                remedy = "set servo.realization to implicit, lower servo.kd or solver.time_step"
                text = f"{damping} is unstable above steps of {largest:.2g} s, but solver.time_step is "
                findings.append(Finding("warning", "steps", f"{text}{solver.time_step:g} s; {remedy}"))
            else:
                findings.append(Finding("ok", "steps", f"{damping} allows steps up to {largest:.2g} s"))
        elif isinstance(solver, ContinuousSolver) and solver.scheme in _EXPLICIT_SCHEMES:
            unstable = solver.fixed_steps and bool(solver.max_step > largest)
            text = f"{damping} keeps the explicit scheme {solver.scheme} below steps of {largest:.2g} s"
            remedy = f", but solver.max_step is {solver.max_step:g} s; take an implicit scheme such as radau3"
            level: Level = "warning" if unstable else "ok" if solver.fixed_steps else "note"
            findings.append(Finding(level, "steps", text + remedy * unstable))
    return findings


def largest_explicit_steps(config: StationConfig, robot: StationRobot) -> Vector:
    """Return the largest step (n,) [s] at which each joint's damping is stable when it is stepped explicitly."""
    with np.errstate(divide="ignore"):
        return np.asarray(_STABLE * _servo_inertias(config, robot) / robot.gains.kd)


def likely_cause(config: StationConfig, plant: StationPlant) -> str:
    """Return the likely cause of a run that diverged, in words."""
    warnings = [finding for finding in step_findings(config, plant) if finding.level == "warning"]
    if warnings:
        return f"likely cause: {warnings[0].text}"
    if any((robot.gains.ki > 0).any() for robot in plant.robots.values()):
        return "likely cause: integral gains (servo.ki) too large for the solver's steps; lower them or solver.max_step"
    key = "solver.time_step" if isinstance(config.solver, DiscreteSolver) else "solver.max_step or solver.accuracy"
    return f"likely cause: forces too stiff for the solver's steps; try a smaller {key}"


def _servo_inertias(config: StationConfig, robot: StationRobot, context: Context | None = None) -> Vector:
    """Return what the gains of a robot's servos are to be compared with, (n,): 1 where they are by inertia already."""
    by_inertia = config.servo_of(robot.name).law == "computed_torque"
    return np.ones(len(robot.axes)) if by_inertia else robot.free_inertias(context)


def _stiff_parts(
    config: StationConfig, robot: StationRobot, postures: Vector, context: Context | None = None
) -> Iterator[tuple[float, float, str]]:
    """Yield what springs of a robot are stiffest for what they move, of stops that it leans on and of its servos.

    Each is its rate squared [1/s²], up to which rate a scheme gets through it, and what it is in words. The robot comes
    through postures (m, n); inertias are those at a context of the plant, or at the start.
    """
    inertia = np.abs(robot.free_inertias(context))
    limits = np.array(robot.model.axis_limits)
    room = np.minimum(postures - limits[0], limits[1] - postures).min(axis=0)
    leans = room < np.where(robot.model.prismatic, _NEAR[1], _NEAR[0])
    for what, stiffness, felt, most in (
        ("its stop (joint_stops.stiffness)", np.where(leans, robot.stops[0], 0.0), inertia, _STIFF_STOPS),
        ("its servo (kp)", robot.gains.kp, _servo_inertias(config, robot, context), _STIFF_SERVO),
    ):
        worst = int(np.argmax(stiffness / felt))
        joint, unit = f"{robot.prefix}{robot.axes[worst]}", robot.model.units[worst]
        mass = "kg" if robot.model.prismatic[worst] else "kg m²"
        text = f"{joint} moves {inertia[worst]:.2g} {mass}, for which {what} of {stiffness[worst]:.2g} "
        yield stiffness[worst] / felt[worst], most, f"{text}{unit.effort}/{unit.si}"


def stiffest(config: StationConfig, plant: StationPlant, context: Context) -> str:
    """Return which spring of which joint is the stiffest for what it moves, at a context of the plant, in words."""
    found = [
        (rate, text)
        for robot in plant.robots.values()
        for rate, _, text in _stiff_parts(
            config, robot, robot.axis_map.positions(plant.plant.GetPositions(context))[np.newaxis], context
        )
    ]
    return max(found)[1] if found else ""


def _creeping(config: StationConfig, plant: StationPlant, references: Mapping[str, Reference]) -> list[Finding]:
    """Name the joints whose forces are so stiff for their inertia that a scheme of variable steps creeps."""
    solver = config.solver
    if not isinstance(solver, ContinuousSolver) or solver.fixed_steps or solver.holds_joint_limits:
        return []
    findings = []
    for robot in plant.robots.values():
        reference = references.get(robot.name)
        postures = robot.initial[np.newaxis] if reference is None else reference_samples(reference, config.duration)[1]
        for rate, most, text in _stiff_parts(config, robot, postures):
            if rate > most:
                message = f"{text} is so stiff that {solver.scheme} may creep; {DISCRETE}"
                findings.append(Finding("warning", "steps", message))
    return findings
