"""The solver of a station: its settings for a simulator, and findings about servos and stops that are too stiff.

A *servo* and a *stop* (the spring at the limit of an axis) act on the inertia of their axis. If they are too stiff for
it, an explicit scheme becomes unstable, and a scheme with variable steps takes very small steps: it *creeps*. The
findings compare stiffness and damping with the steps before a run.

A *scheme* is an integrator of Drake, by its name. It has variable steps if *error control* chooses their lengths. A
discrete solver has fixed steps. ``cenic`` is a scheme that sees the outputs of blocks only at the start of a step.
"""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from pydrake.multibody.cenic import CenicIntegrator
from pydrake.multibody.contact_solvers import IcfSolverParameters
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, Diagram, System

from simrob_drake.base.errors import UnsupportedSolver
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.renaming import former_argument
from simrob_drake.blocks.references import Reference
from simrob_drake.parts.station_plant import StationPlant, StationRobot
from simrob_drake.stations.closed import reference_samples
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.dynamic import largest_explicit_steps, servo_inertias
from simrob_drake.stations.findings import Finding
from simrob_drake.stations.open_inputs import check_inputs
from simrob_drake.stations.prescribed import constraining_couplings, is_discrete_with_contact
from simrob_drake.stations.solver_config import ContinuousSolver
from simrob_drake.stations.station import StationLike, config_of

_STIFF_STOPS = 2e10
"""Largest stiffness of a stop, divided by the inertia of its axis, at which an implicit scheme does not creep [1/s²].
Found by trials with 100 robots."""

_STIFF_SERVO = 1e12
"""The same for a servo [1/s²]. Beyond, the inertia is lost in the rounding of the mass matrix."""

# An axis may press against its stop if it comes so near to it.
_NEAR_ANGLE = np.deg2rad(1.0)  # of a revolute axis [rad]
_NEAR_DISTANCE = 1e-3  # of a prismatic axis [m]

_SUBJECT = message("stations.steps", "steps")
"""Subject of the findings about steps of the solver."""

DISCRETE = message(
    "stations.take_discrete", "use solver.kind discrete and servo.realization implicit"
)
"""Remedy for a run in which a continuous scheme creeps."""

_SLACK = 1e-9
"""Share by which the longest step of ``cenic`` is increased if controllers sample. Otherwise rounding ends some steps
1e-17 s before a sample, and an extra step of that length follows, which costs as much as any other."""


def step_findings(
    config: StationConfig,
    plant: StationPlant,
    references: Mapping[str, Reference] | None = None,
) -> list[Finding]:
    """Compare the servos and stops of all robots with the steps of the solver.

    A finding also warns if the torques of prescribed joints, which follow a given motion, may be wrong under this
    solver.

    Args:
        config: configuration of the station.
        plant: the station's plant with its robots.
        references: desired trajectories by the name of the robot. Stops are examined along them; for a robot without a
            reference only in the initial posture.
    """
    findings = _creeping_findings(config, plant, references or {})
    findings += _uncertain_torques(config)
    for robot in plant.robots.values():
        # Implicit servos are stable with any step.
        if config.servo_of(robot.name).realization != "implicit":
            findings += _damping_findings(config, robot)
    return findings


def _damping_findings(config: StationConfig, robot: StationRobot) -> list[Finding]:
    """Compare the damping of a robot's servos, which are evaluated explicitly, with the steps of the solver.

    Only the axis that needs the shortest steps is reported, in one finding. The list is empty for a continuous scheme
    that is not explicit, such as ``radau3`` and ``cenic``.
    """
    solver = config.solver
    steps = largest_explicit_steps(config, robot)  # for each axis [s]
    # A step that suits the axis with the shortest one suits all axes.
    worst = int(np.argmin(steps))
    largest = steps[worst]
    unit = robot.model.units[worst]
    joint = f"{robot.prefix}{robot.axes[worst]}"
    damping = message(
        "stations.damping_of",
        "the damping of {joint} (kd {kd:g} {effort}·s/{si})",
        joint=joint,
        kd=robot.gains.kd[worst],
        effort=unit.effort,
        si=unit.si,
    )
    # Discrete solvers are compared, too: they evaluate such servos explicitly.
    engine = config.engine
    if engine.has_discrete_states:
        if engine.time_step <= largest:
            text = message(
                "stations.allows_steps",
                "{damping} allows steps up to {largest:.2g} s",
                damping=damping,
                largest=largest,
            )
            return [Finding("ok", _SUBJECT, text)]
        text = message(
            "stations.unstable_above",
            "{damping} is unstable with steps above {largest:.2g} s, but solver.time_step is ",
            damping=damping,
            largest=largest,
        )
        remedy = message(
            "stations.implicit_or_lower",
            "set servo.realization to implicit, or reduce servo.kd or solver.time_step",
        )
        text = message(
            "stations.time_step_and_remedy",
            "{text}{time_step:g} s; {remedy}",
            text=text,
            time_step=engine.time_step,
            remedy=remedy,
        )
        return [Finding("warning", _SUBJECT, text)]
    if engine.is_explicit:
        text = message(
            "stations.keeps_steps_below",
            "{damping} limits the explicit scheme {engine} to steps below {largest:.2g} s",
            damping=damping,
            engine=engine.name,
            largest=largest,
        )
        if not engine.has_fixed_steps:  # error control shortens the steps by itself
            return [Finding("note", _SUBJECT, text)]
        if solver.step <= largest:
            return [Finding("ok", _SUBJECT, text)]
        text += message(
            "stations.step_is_longer",
            ", but solver.{step_key} is {step:g} s; use an implicit scheme such as radau3",
            step_key=solver.step_key,
            step=solver.step,
        )
        return [Finding("warning", _SUBJECT, text)]
    return []


def _uncertain_torques(config: StationConfig) -> list[Finding]:
    """Warn if the computed torques of prescribed joints may be wrong while bodies touch.

    A prescribed joint follows a given motion, and the torque that this takes is computed, see
    :mod:`simrob_drake.stations.prescribed`. Some solvers do not report all forces that this computation needs.
    """
    if not config.prescribed or config.contact is None or not config.engine.moves_by_forces:
        return []
    scheme = config.engine.name
    couplings = constraining_couplings(config)
    text = message(
        "stations.torques_of_prescribed",
        "the torques of the prescribed joints {joints} ",
        joints=", ".join(config.prescribed),
    )
    # The torque of a prescribed joint is what all other reported forces leave over.
    if is_discrete_with_contact(config) and couplings:
        text += message(
            "stations.wrong_while_touching",
            "may be wrong by thousands of N or N·m while bodies touch: Drake's solver ",
        )
        text += message(
            "stations.couplings_not_reported",
            "{scheme} does not report the forces of couplings ({couplings})",
            scheme=scheme,
            couplings=", ".join(couplings),
        )
    elif not config.engine.reports_friction_of_contacts:
        text += message(
            "stations.lack_half_of_force",
            "lack up to half of the force that accelerates loads held by friction under {scheme}",
            scheme=scheme,
        )
    else:
        return []
    text = message(
        "stations.set_radau",
        "{text}; set solver to {{kind: continuous, scheme: radau3}}",
        text=text,
    )
    return [Finding("warning", _SUBJECT, text)]


def likely_cause(config: StationConfig, plant: StationPlant) -> str:
    """Find the likely cause of a run that diverged, and return it as a sentence.

    It is the first warning of :func:`step_findings` for the initial postures. Without any, it is a guess: integral
    gains if there are some, otherwise forces that are too stiff for the solver.
    """
    # A warning before the run is the best guess at why the run failed.
    warnings = [finding for finding in step_findings(config, plant) if finding.level == "warning"]
    if warnings:
        return message("stations.likely_cause", "likely cause: {cause}", cause=warnings[0].text)
    is_discrete = config.engine.has_discrete_states
    if any((robot.gains.ki > 0).any() for robot in plant.robots.values()):
        return message(
            "stations.likely_integral_gains",
            "likely cause: integral gains (servo.ki) too large for the solver's steps; reduce them or {key}",
            key="solver.time_step" if is_discrete else "solver.max_step",
        )
    key = "solver.time_step"
    if not is_discrete:
        key = message("stations.max_step_or_accuracy", "solver.max_step or solver.accuracy")
    return message(
        "stations.likely_stiff_forces",
        "likely cause: forces too stiff for the solver's steps; try a smaller {key}",
        key=key,
    )


class StiffPart(NamedTuple):
    """The stops or the servos of a robot, with the axis at which they are stiffest for its inertia."""

    ratio: float  # stiffness divided by inertia [1/s²]
    limit: float  # largest ratio at which an implicit scheme does not creep [1/s²]
    text: str  # description: the beginning of a sentence, which goes on with "is so stiff that" or the like


def _stiff_parts(
    config: StationConfig,
    robot: StationRobot,
    postures: Vector,
    context: Context | None = None,
) -> list[StiffPart]:
    """Compare the stops and the servos of a robot with the inertias that they move.

    Stops are compared with the inertias of their axes, and servos with :func:`servo_inertias`. The descriptions give
    the inertias of the axes in both cases.

    Args:
        config: configuration of the station.
        robot: the robot.
        postures: postures of the motion, shape (m, n) [rad or m]. Only stops that an axis comes near to count.
        context: context of the plant at which inertias are computed; None for the start.

    Returns:
        one entry for the stops, and one for the servos, each for the axis with the largest ratio of stiffness to
        inertia. An entry is too stiff if its ratio is above its limit; see the docstring of the module.
    """
    # Rounding may make a tiny inertia negative.
    inertias = np.abs(robot.free_inertias(context))
    lower, upper = np.array(robot.model.axis_limits)
    # How near each axis comes to one of its limits [rad or m].
    distances = np.minimum(postures - lower, upper - postures).min(axis=0)
    is_near = distances < np.where(robot.model.prismatic, _NEAR_DISTANCE, _NEAR_ANGLE)
    # A stop that no axis comes near to never pushes, however stiff it is.
    stop_stiffness = np.where(is_near, robot.stops[0], 0.0)
    # The two are described by the inertias of their axes, and judged by the inertias that they move.
    stops = _stiff_part(
        robot,
        message("stations.its_stop", "its stop (joint_stops.stiffness)"),
        stop_stiffness,
        inertias,
        moved=inertias,
        limit=_STIFF_STOPS,
    )
    servos = _stiff_part(
        robot,
        message("stations.its_servo", "its servo (kp)"),
        robot.gains.kp,
        inertias,
        moved=servo_inertias(config, robot, context),
        limit=_STIFF_SERVO,
    )
    return [stops, servos]


def _stiff_part(
    robot: StationRobot,
    name: str,
    stiffness: Vector,
    inertias: Vector,
    *,
    moved: Vector,
    limit: float,
) -> StiffPart:
    """Find the axis at which springs are stiffest for the inertia that they move.

    Args:
        robot: the robot.
        name: what the springs are, for the description.
        stiffness: stiffness at each axis, shape (n,) [N·m/rad or N/m].
        inertias: inertia of each axis, for the description, shape (n,) [kg m² or kg].
        moved: inertia that each spring moves, shape (n,) [kg m² or kg].
        limit: largest ratio at which an implicit scheme does not creep [1/s²].
    """
    # A spring on an inertia oscillates at omega = sqrt(k / I), so k / I decides over the steps.
    worst = int(np.argmax(stiffness / moved))
    unit = robot.model.units[worst]
    mass_unit = "kg" if robot.model.prismatic[worst] else "kg m²"
    text = message(
        "stations.moves_inertia",
        "{prefix}{axis} moves {inertia:.2g} {unit}, for which {name} of ",
        prefix=robot.prefix,
        axis=robot.axes[worst],
        inertia=inertias[worst],
        unit=mass_unit,
        name=name,
    )
    text += compound(
        "{stiffness:.2g} {effort}/{si}", stiffness=stiffness[worst], effort=unit.effort, si=unit.si
    )
    return StiffPart(ratio=stiffness[worst] / moved[worst], limit=limit, text=text)


def stiffest(config: StationConfig, plant: StationPlant, context: Context) -> str:
    """Describe the stop or servo that is stiffest for the inertia that it moves.

    Args:
        config: configuration of the station.
        plant: the station's plant with its robots.
        context: context of the plant.

    Returns:
        the description, which is the beginning of a sentence, such as "joint_2 moves 0.1 kg m², for which its servo
        (kp) of 1e+04 N·m/rad". It is empty if the station has no robot.
    """
    parts = []
    plant_positions = plant.plant.GetPositions(context)
    for robot in plant.robots.values():
        posture = robot.axis_map.positions(plant_positions)
        parts += _stiff_parts(config, robot, posture[np.newaxis], context)
    if not parts:
        return ""
    # Equal ratios are decided by their texts, so that the result is the same in every run.
    return max(parts, key=lambda part: (part.ratio, part.text)).text


def _creeping_findings(
    config: StationConfig, plant: StationPlant, references: Mapping[str, Reference]
) -> list[Finding]:
    """Warn of stops and servos that are so stiff that a scheme with variable steps may creep.

    Stops are examined along the references, which are given by the name of the robot; for a robot without a reference
    in the initial posture. The list is empty for other solvers, and for a scheme that holds joint limits by itself.
    """
    engine = config.engine
    # Only error control can make steps tiny, and an engine that holds joint limits needs no stiff stops.
    if not engine.moves_by_forces or engine.has_fixed_steps or engine.holds_joint_limits:
        return []
    findings = []
    for robot in plant.robots.values():
        reference = references.get(robot.name)
        postures = robot.initial[np.newaxis]
        if reference is not None:
            _, postures = reference_samples(reference, config.duration)
        for part in _stiff_parts(config, robot, postures):
            if part.ratio > part.limit:
                text = message(
                    "stations.so_stiff",
                    "{part} is so stiff that {engine} may need very small steps; {remedy}",
                    part=part.text,
                    engine=engine.name,
                    remedy=DISCRETE,
                )
                findings.append(Finding("warning", _SUBJECT, text))
    return findings


def controlled_by(config: StationConfig) -> ContinuousSolver | None:
    """Settings of a station's solver if it chooses the length of its steps by error control; otherwise None.

    The result is None for a kinematic station, a discrete solver, another engine, and a scheme of fixed steps.
    """
    solver = config.solver
    engine = config.engine
    if (
        not engine.moves_by_forces
        or not isinstance(solver, ContinuousSolver)
        or engine.has_fixed_steps
    ):
        return None
    return solver


def stepped_by(config: StationConfig) -> ContinuousSolver | None:
    """Settings of a scheme that sees inputs only at the start of a step, such as ``cenic``. None for other schemes.

    If the station has controllers, the longest step is increased slightly, see _SLACK.
    """
    solver = config.solver
    if not isinstance(solver, ContinuousSolver) or not config.engine.holds_inputs_over_steps:
        return None
    # Without samples of controllers no step has to end at a given time.
    if not config.controllers:
        return solver
    return solver.model_copy(update={"max_step": solver.max_step * (1 + _SLACK)})


@former_argument("config", "station")
def apply_solver(
    simulator: Simulator,
    station: StationLike,
    *,
    overrides: Mapping[str, Any] | None = None,
) -> None:
    """Set the solver of a simulator of your own, as a station's file demands.

    Args:
        simulator: the simulator, whose integrator is replaced. Its diagram contains the station, at any depth.
        station: the station: its name, its file, its configuration, or a built one. Nothing is changed if it is
            kinematic or has no continuous solver.
        overrides: new values of the station, as :func:`simrob_drake.load_station` takes them.

    Raises:
        UnsupportedSolver: the scheme ``cenic`` with a station whose plant is not a direct part of the root diagram, or
            not the only plant in it.
        SimrobError: there is no such station, or an input in the diagram is neither connected nor exported.
    """
    config = config_of(station, overrides)
    system = simulator.get_system()
    if isinstance(system, Diagram):
        # An open input of the root diagram may be fixed in the simulator's context.
        check_inputs(system, {}, may_be_exported=True)
    set_solver(simulator, config)


def set_solver(simulator: Simulator, config: StationConfig) -> None:
    """Set the solver of a simulator as a station's file demands. Open inputs of its diagram are not looked for.

    Nothing is changed for a kinematic station, or if the section ``solver`` is no continuous solver.

    Raises:
        UnsupportedSolver: the scheme ``cenic`` with a plant that is not a direct part of the root diagram, or not the
            only plant in it.
    """
    if not config.engine.moves_by_forces or not isinstance(config.solver, ContinuousSolver):
        return
    solver = config.solver
    # Drake would abort with an error that does not name the station.
    if solver.engine.needs_plant_as_direct_child:
        _check_only_plant(simulator.get_system(), solver.scheme)
    settings = SimulatorConfig(
        integration_scheme=solver.scheme,
        max_step_size=solver.max_step,
        accuracy=solver.accuracy,
        # Off for the key `error_control: false`, and for schemes without an estimate of the error.
        use_error_control=not solver.engine.has_fixed_steps,
    )
    ApplySimulatorConfig(settings, simulator)
    # The scheme `cenic` has settings of its own, which a `SimulatorConfig` does not contain.
    cenic = stepped_by(config)
    if cenic is not None:
        bound_steps(simulator, cenic)


def _check_only_plant(system: System, scheme: str) -> None:
    """Check that a diagram has one plant, as a direct part that is named ``plant``.

    Args:
        system: the diagram that is simulated.
        scheme: name of the scheme that needs this.

    Raises:
        UnsupportedSolver: the diagram has no such plant, or further ones; the message lists its plants.
    """
    plants = list(_plants_in(system, ""))
    if plants == ["plant"]:
        return
    raise UnsupportedSolver(
        message(
            "stations.only_plant",
            "solver.scheme is {scheme}, which needs a single plant in the simulated diagram, named plant, as a direct "
            "part of it; the diagram has: {plants}. Add a single station, without a name, to the builder of the root "
            "diagram with add_station(), or choose another scheme such as 'radau3'",
            scheme=repr(scheme),
            plants=", ".join(plants) or message("stations.no_plant", "none"),
        )
    )


def _plants_in(system: System, path: str) -> Iterator[str]:
    """Yield the names of the plants in a diagram, at any depth, with the names of the diagrams around them.

    Args:
        system: the diagram, or a system that is none.
        path: names of the diagrams around its parts, each with a ``/`` after it.
    """
    for part in system.GetSystems() if isinstance(system, Diagram) else ():
        name = f"{path}{part.get_name()}"
        if isinstance(part, MultibodyPlant):
            yield name
        yield from _plants_in(part, f"{name}/")


def bound_steps(
    simulator: Simulator,
    solver: ContinuousSolver,
    longest: float = np.inf,
    accuracy: float = np.inf,
) -> None:
    """Limit the length and the error of the steps of ``cenic`` from now on.

    Args:
        simulator: a simulator with the scheme ``cenic``.
        solver: settings of the scheme.
        longest: longest step, if it is less than that of the settings [s].
        accuracy: accuracy, if it is finer (a smaller number) than that of the settings.
    """
    integrator = simulator.get_mutable_integrator()
    # A phase of a run, such as a flight, may need shorter steps, but never longer ones than the user allows.
    step = min(longest, solver.max_step)
    integrator.set_maximum_step_size(step)
    if integrator.get_initial_step_size_target() > step:
        # Drake refuses a first step above the longest one when it initializes the simulator for the run's next diagram.
        integrator.request_initial_step_size_target(step)
    step_accuracy = min(accuracy, solver.accuracy)
    integrator.set_target_accuracy(step_accuracy)
    _set_iteration(integrator, step_accuracy, step)


def _set_iteration(integrator: CenicIntegrator, accuracy: float, step: float) -> None:
    """Set the iteration by which ``cenic`` solves each step.

    A new factorization is computed in each iteration. If an old one is used again, a joint stays at its limit too long.

    The iteration may end a little earlier than with Drake's default, since ``min_tolerance``, the lower bound of its
    tolerance, is raised. The error that remains must be a small share of the error of the step itself, otherwise
    momentum is lost, and the faster the shorter the steps are. The bound is therefore the smallest of three values: one
    in proportion to the accuracy, one in proportion to the square of the step's length, and a constant. It is never
    below Drake's default.

    With error control, Drake's own tolerance is 1e-3 times the accuracy, and the larger one of it and the bound counts.
    Without error control, the bound is the tolerance.

    Args:
        integrator: the integrator.
        accuracy: accuracy of a step.
        step: longest step [s].
    """
    parameters = integrator.get_solver_parameters()
    parameters.enable_hessian_reuse = False
    # 1e-5 is small enough at an accuracy of 1e-3 and steps of 20 ms, and is the constant.
    share = min(1.0, accuracy / 1e-3, (step / 0.02) ** 2)
    parameters.min_tolerance = max(IcfSolverParameters().min_tolerance, 1e-5 * share)
    integrator.SetSolverParameters(parameters)
