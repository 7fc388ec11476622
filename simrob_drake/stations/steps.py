"""Give a simulator the solver of a station, and say before a run what it cannot take: steps, servos, stops."""

from collections.abc import Iterator, Mapping

import numpy as np
from pydrake.multibody.cenic import CenicIntegrator
from pydrake.multibody.contact_solvers import IcfSolverParameters
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, Diagram

from simrob_drake.blocks.references import Reference
from simrob_drake.errors import UnsupportedSolver
from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationPlant, StationRobot
from simrob_drake.stations.closed import reference_samples
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.dynamic import largest_explicit_steps, servo_inertias
from simrob_drake.stations.findings import Finding, Level
from simrob_drake.stations.prescribed import constraining_couplings, is_discrete_with_contact
from simrob_drake.stations.solver_config import FIXED_STEP_SCHEMES, ContinuousSolver, FixedSteps

_EXPLICIT_SCHEMES = ("runge_kutta3", "runge_kutta5", "bogacki_shampine3", *FIXED_STEP_SCHEMES)
_STIFF_STOPS = 2e10
"""An implicit scheme gets through stops up to this stiffness by a joint's inertia [1/s²]: tried on 100 robots."""
_STIFF_SERVO = 1e12
"""And through servos up to this [1/s²]: beyond, the inertia is lost in the rounding of the mass matrix."""
_NEAR = np.deg2rad(1.0), 1e-3  # how near to a stop a joint may come that leans on it, and one that slides [rad, m]
DISCRETE = "take solver.kind discrete and servo.realization implicit"  # what helps where a continuous scheme creeps


def step_findings(
    config: StationConfig, plant: StationPlant, references: Mapping[str, Reference] | None = None
) -> list[Finding]:
    """Compare servos and stops with the steps of the solver, as they start and along ``references``, by robot."""
    findings = _creeping(config, plant, references or {})
    findings += _uncertain_torques(config)
    solver = config.solver
    for robot in plant.robots.values():
        if config.servo_of(robot.name).realization == "implicit":
            continue
        steps = largest_explicit_steps(config, robot)
        worst = int(np.argmin(steps))
        joint, largest, unit = f"{robot.prefix}{robot.axes[worst]}", steps[worst], robot.model.units[worst]
        damping = f"the damping of {joint} (kd {robot.gains.kd[worst]:g} {unit.effort}·s/{unit.si})"
        if isinstance(solver, FixedSteps):
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


def _uncertain_torques(config: StationConfig) -> list[Finding]:
    """Warn if the computed torques of prescribed joints may be wrong while bodies touch.

    A prescribed joint follows a given motion, and the torque that this takes is computed, see
    :mod:`simrob_drake.stations.prescribed`. Some solvers do not report all forces that this computation needs.
    """
    if not config.prescribed or config.contact is None or config.mode == "kinematic":
        return []
    scheme = config.solver.scheme
    couplings = constraining_couplings(config)
    text = f"the torques of the prescribed joints {', '.join(config.prescribed)} "
    if is_discrete_with_contact(config) and couplings:
        text += "may be wrong by thousands of N or N·m while bodies touch: Drake's solver "
        text += f"{scheme} does not report the forces of couplings ({', '.join(couplings)})"
    elif scheme == "cenic":
        text += "miss up to a half of what accelerates loads that stick to them by friction under cenic"
    else:
        return []
    return [Finding("warning", "steps", f"{text}; set solver to {{kind: continuous, scheme: radau3}}")]


def likely_cause(config: StationConfig, plant: StationPlant) -> str:
    """Return the likely cause of a run that diverged, in words."""
    warnings = [finding for finding in step_findings(config, plant) if finding.level == "warning"]
    if warnings:
        return f"likely cause: {warnings[0].text}"
    if any((robot.gains.ki > 0).any() for robot in plant.robots.values()):
        return "likely cause: integral gains (servo.ki) too large for the solver's steps; lower them or solver.max_step"
    key = "solver.time_step" if isinstance(config.solver, FixedSteps) else "solver.max_step or solver.accuracy"
    return f"likely cause: forces too stiff for the solver's steps; try a smaller {key}"


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
        ("its servo (kp)", robot.gains.kp, servo_inertias(config, robot, context), _STIFF_SERVO),
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


_SLACK = 1e-9
"""Part by which steps may be longer than they should where loops sample: else some end 1e-17 s before a sample, and one
of that length follows, at the price of a whole one."""


def controlled_by(config: StationConfig) -> ContinuousSolver | None:
    """Return the solver of a station if it chooses how long its steps are; else None."""
    solver = config.solver
    if config.mode == "kinematic" or not isinstance(solver, ContinuousSolver) or solver.fixed_steps:
        return None
    return solver


def stepped_by(config: StationConfig) -> ContinuousSolver | None:
    """Return the settings by which ``cenic`` steps a station; None where it does not."""
    solver = config.solver
    if config.mode == "kinematic" or not isinstance(solver, ContinuousSolver) or solver.scheme != "cenic":
        return None
    return solver.model_copy(update={"max_step": solver.max_step * (1 + _SLACK)}) if config.controllers else solver


def apply_solver(simulator: Simulator, config: StationConfig) -> None:
    """Give a simulator the solver settings of a station that is part of its diagram, in any depth.

    Raises:
        UnsupportedSolver: the scheme ``cenic`` with a station that is not a direct part of the root diagram.
    """
    if config.mode == "kinematic" or not isinstance(config.solver, ContinuousSolver):
        return
    system, solver = simulator.get_system(), config.solver
    if solver.scheme == "cenic" and not (isinstance(system, Diagram) and system.HasSubsystemNamed("plant")):
        raise UnsupportedSolver(
            "solver.scheme is 'cenic', which needs the plant as a direct part of the simulated diagram: add the "
            "station with add_station() to the root's builder, or choose another scheme such as 'radau3'"
        )
    settings = SimulatorConfig(
        integration_scheme=solver.scheme,
        max_step_size=solver.max_step,
        accuracy=solver.accuracy,
        use_error_control=not solver.fixed_steps,
    )
    ApplySimulatorConfig(settings, simulator)
    if (cenic := stepped_by(config)) is not None:
        bound_steps(simulator, cenic)


def bound_steps(
    simulator: Simulator, solver: ContinuousSolver, longest: float = np.inf, accuracy: float = np.inf
) -> None:
    """Let ``cenic`` take steps of at most ``longest`` [s] and ``accuracy`` from now on, and of at most the solver's."""
    integrator, step = simulator.get_mutable_integrator(), min(longest, solver.max_step)
    integrator.set_maximum_step_size(step)
    if integrator.get_initial_step_size_target() > step:  # Drake would refuse to go on with another diagram
        integrator.request_initial_step_size_target(step)
    integrator.set_target_accuracy(min(accuracy, solver.accuracy))
    _set_iteration(integrator, solver.accuracy, step)


def _set_iteration(integrator: CenicIntegrator, accuracy: float, step: float) -> None:
    """Let ``cenic`` factorize anew in each iteration, and stop that a little earlier.

    A factorization of a joint at its limit, used again, holds the joint there for long: so ``cenic`` must not. What the
    iteration leaves must stay a small part of a step's own error, which is of second order in its length, as is the
    accuracy; else momentum seeps away the faster, the finer the steps are.
    """
    parameters = integrator.get_solver_parameters()
    parameters.enable_hessian_reuse = False
    share = min(1.0, accuracy / 1e-3, (step / 0.02) ** 2)
    parameters.min_tolerance = max(IcfSolverParameters().min_tolerance, 1e-5 * share)
    integrator.SetSolverParameters(parameters)
