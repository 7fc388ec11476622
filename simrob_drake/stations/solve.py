"""Give a simulator the solver of a station, and say before a run what the solver cannot take."""

import numpy as np
from pydrake.multibody.cenic import CenicIntegrator
from pydrake.multibody.contact_solvers import IcfSolverParameters
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Diagram

from simrob_drake.errors import UnsupportedSolver
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.solver_config import ContinuousSolver

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
