"""The engines that tell of a station's run: two schemes of Drake, MuJoCo, and inverse dynamics where it exists."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from simrob_drake.comparison.account import FINER, Account, Quantity
from simrob_drake.dynamics import Dynamics
from simrob_drake.errors import SimrobError
from simrob_drake.extras import require
from simrob_drake.frames import Vector
from simrob_drake.programs.whole_program import run_whole
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.solver_config import ContinuousSolver, DiscreteSolver, MujocoSolver, SolverConfig

MUJOCO_STEP = 1e-3  # of MuJoCo's coarser run [s]
_RATE = 1000.0  # samples a second for accelerations out of speeds [Hz]
_EXPLICIT = ("runge_kutta3", "runge_kutta5", "bogacki_shampine3")


@dataclass
class EngineAccounts:
    """What the engines told."""

    accounts: list[Account] = field(default_factory=list)  # Drake's with the station's own scheme first
    missing: dict[str, str] = field(default_factory=dict)  # why others tell nothing, by engine


def other_scheme(solver: SolverConfig) -> SolverConfig:
    """Return a scheme of Drake that works otherwise than a given one: discrete for convex, implicit for explicit."""
    if isinstance(solver, ContinuousSolver) and solver.scheme == "cenic":
        return DiscreteSolver(kind="discrete", scheme="lagged", time_step=1e-3)
    if isinstance(solver, ContinuousSolver) and solver.scheme in _EXPLICIT:
        return solver.model_copy(update={"scheme": "radau3"})
    return ContinuousSolver(kind="continuous", scheme="cenic", accuracy=1e-4, max_step=2e-3)


def compare_engines(config: StationConfig, *, progress: Callable[[str], None] = lambda name: None) -> EngineAccounts:
    """Run a station in every engine that can, telling ``progress`` their names; raises SimrobError: Drake cannot."""
    found = EngineAccounts()
    for name, engine in _engines(config):
        progress(name)
        try:
            found.accounts.append(engine(name))
        except SimrobError as problem:
            if not found.accounts:
                raise
            found.missing[name] = str(problem)
    return found


def _engines(config: StationConfig) -> Iterator[tuple[str, Callable[[str], Account]]]:
    if config.mode == "kinematic":
        yield "Drake, inverse dynamics", lambda name: _of_motion(name, config)
    else:
        solver = config.solver
        yield f"Drake, {solver.scheme}", lambda name: _stepped(name, config)
        other = config.model_copy(update={"solver": other_scheme(solver)})
        yield f"Drake, {other.solver.scheme}", lambda name: _stepped(name, other)
        yield "inverse dynamics", lambda name: _inverse_dynamics(name, config)
    yield "MuJoCo", lambda name: _in_mujoco(name, config)


def _stepped(name: str, config: StationConfig) -> Account:
    finer = config.model_copy(update={"solver": config.solver.tighter(FINER)})
    coarse, fine = (_whole(run_whole(own)) for own in (config, finer))
    return Account.of(name, fine, coarse)


def _of_motion(name: str, config: StationConfig) -> Account:
    result = run_whole(config)
    return Account.of(name, result, result)  # nothing is integrated


def _in_mujoco(name: str, config: StationConfig) -> Account:
    require("it", "mujoco", "mujoco")
    from simrob_drake.mujoco.runner import MujocoRunner, inverse_run

    if config.mode == "kinematic":
        if config.program is not None:
            raise SimrobError("it does no programs of kinematic stations; --set program=null leaves the station's out")
        result = inverse_run(config)
        return Account.of(name, result, result)
    if config.program is not None or config.controllers:  # which decide as they go
        return _stepped(name, config.model_copy(update={"solver": MujocoSolver(kind="mujoco", time_step=MUJOCO_STEP)}))
    coarse, fine = (_whole(MujocoRunner(config, step=step).run()) for step in (MUJOCO_STEP, MUJOCO_STEP / FINER))
    return Account.of(name, fine, coarse)


def _inverse_dynamics(name: str, config: StationConfig) -> Account:
    """Return the torques that the motion takes which Drake's scheme tells, of arms that touch nothing.

    Accelerations are those of a spline through the speeds; of the coarser run, through every fourth of them.
    """
    if config.contact is not None or config.forces or not config.robots:
        raise SimrobError("it knows the torques of arms alone that nothing touches")
    every = max(round(_RATE / config.sample_rate), 1)
    sampled = config.model_copy(update={"sample_rate": every * config.sample_rate})
    finer = sampled.model_copy(update={"solver": config.solver.tighter(FINER)})
    coarse, fine = (_whole(run_whole(own)) for own in (sampled, finer))
    values, errors = {}, {}
    for robot in fine.plant.robots.values():
        if robot.floats:
            raise SimrobError(f"{robot.name} floats: what it pushes itself off from is not known")
        dynamics, what = Dynamics(robot.model, fine.plant.plant, robot.joints), Quantity(f"{robot.prefix}tau", "N·m")
        sparse, dense = (_torques(dynamics, run, robot.name, n) for run, n in ((coarse, FINER), (fine, 1)))
        values[what] = dense[::every]
        common = min(len(dense[::every]), len(sparse[::every]))
        errors[what] = float(np.abs(dense[::every][:common] - sparse[::every][:common]).max())
    return Account(name, fine.times[::every], values, errors, "of the motion in Drake")


def _torques(dynamics: Dynamics, run: SimulationResult, robot: str, every: int) -> Vector:
    """Return the torques (m, n) that a run's motion takes, its accelerations made of every so many speeds."""
    q, v, times = run.axes("q", robot), run.axes("v", robot), run.times
    return dynamics.inverse_dynamics(q, v, CubicSpline(times[::every], v[::every])(times, 1))


def _whole(result: SimulationResult) -> SimulationResult:
    """Return a run that did not diverge; raises SimrobError: it did."""
    if result.ending in ("completed", "monitor"):
        return result
    raise SimrobError(result.message)
