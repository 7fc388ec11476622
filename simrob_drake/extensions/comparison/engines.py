r"""What engines tell of a station's run, and how sure: two schemes of Drake, MuJoCo, inverse dynamics where it exists.

Each engine runs twice: as it would, and r = 4 times finer. The error of the finer run is estimated as Roache's grid
convergence index does it for two runs and a method of first order, with his factor of safety 3:

.. math:: e = 3 \, \frac{\max_t |y_{fine} - y_{coarse}|}{r - 1} = \max_t |y_{fine} - y_{coarse}|.

It is one figure for a quantity and a run: of its largest component at its worst time. (P. J. Roache, Perspective: a
method for uniform reporting of grid refinement studies, J. Fluids Eng. 116 (1994).)
"""

import csv
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.extension import needed_extension
from simrob_drake.base.extras import require
from simrob_drake.base.folders import filled_at_once
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.dynamics import Dynamics
from simrob_drake.programs.whole_program import run_whole
from simrob_drake.results.colours import COLOURS
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.solver_config import ContinuousSolver, DiscreteSolver, SolverConfig

if TYPE_CHECKING:
    from matplotlib.axes import Axes


FINER = 4  # how many times finer the second run is
_QUATERNION = 4
_NEXT_TO_NOTHING = 1e-3  # SI units; rounding does not end with what is zero
_IMPOSED = ("reference", "applied")  # what went in


@dataclass(frozen=True)
class Quantity:
    """Columns of a result that are told together: their name and their unit."""

    name: str
    unit: str


Values = Mapping[Quantity, Vector]  # quantities at times (m,), shape (m, k) each


@dataclass(frozen=True)
class Account:
    """What an engine tells of a run."""

    name: str  # of the engine
    times: Vector  # of the samples, shape (m,) [s]
    values: Values  # of the finer run
    # how far off they may be, by quantity
    errors: Mapping[Quantity, float] = field(default_factory=dict)
    ended: str = ""  # how the finer run ended, in words

    @classmethod
    def of(cls, name: str, fine: SimulationResult, coarse: SimulationResult) -> "Account":
        """Return the account of two runs."""
        exact, rough = quantities(fine), quantities(coarse)
        common = together(fine.times, coarse.times)
        errors = {
            what: float(apart(exact[what][:common], rough[what][:common]).max()) for what in exact
        }
        return cls(name, fine.times, exact, errors, fine.message)


@dataclass(frozen=True)
class Difference:
    """How far two accounts are apart in a quantity."""

    quantity: Quantity  # which
    account: str  # whose, against the first account
    largest: float  # difference of any component at any time
    at: float  # when it is largest [s]
    error: float  # the sum of both errors

    @property
    def within(self) -> bool:
        """Whether the errors explain the difference."""
        return self.largest <= self.error


def quantities(result: SimulationResult) -> dict[Quantity, Vector]:
    """Return what a run tells: columns of one name before the last dot and one unit.

    What it was given is left out, and poses that never change, as of bases that are held.
    """
    columns: dict[Quantity, list[Vector]] = {}
    for signal in result.signals:
        held = signal.role == "pose" and not any(np.ptp(result[name]) for name in signal.names)
        for name, unit in zip(signal.names, signal.units, strict=True):
            if signal.role not in _IMPOSED and not held:
                kind = name.rpartition(".")[0]
                columns.setdefault(
                    Quantity(name if kind in ("", "distance") else kind, unit), []
                ).append(result[name])
    return {what: np.column_stack(own) for what, own in columns.items()}


def differences(first: Account, others: list[Account], rounding: float = 1e-9) -> list[Difference]:
    """Return how far others are from the first account, in all that both tell, to the shorter one's end.

    Figures that differ by less than ``rounding`` of the quantity's size are equal; what is zero in both is left out.
    """
    found = []
    for other in others:
        common = together(first.times, other.times)
        for what in [what for what in first.values if what in other.values]:
            ours, theirs = first.values[what][:common], other.values[what][:common]
            if not (ours.any() or theirs.any()):
                continue
            distances = apart(ours, theirs)
            least = rounding * max(float(np.abs(ours).max()), _NEXT_TO_NOTHING)
            error = first.errors.get(what, 0.0) + other.errors.get(what, 0.0) + least
            worst = int(np.argmax(distances))
            found.append(
                Difference(
                    what, other.name, float(distances[worst]), float(first.times[worst]), error
                )
            )
    return found


def together(first: Vector, other: Vector) -> int:
    """Return how many samples two runs have at the same times: one that a monitor ended has its last one elsewhere."""
    common = min(len(first), len(other))
    return int(np.isclose(first[:common], other[:common], rtol=0, atol=1e-9).sum())


def apart(first: Vector, other: Vector) -> Vector:
    """Return how much rows of arrays (m, k) differ at most, (m,); four columns of unit length are quaternions."""
    distances = np.abs(first - other).max(axis=1)
    if first.shape[1] == _QUATERNION and np.allclose(np.linalg.norm(first, axis=1), 1.0):
        distances = np.minimum(distances, np.abs(first + other).max(axis=1))
    return np.asarray(distances)


NUMBERS = "engines.csv"  # the file that every folder of a comparison of engines holds
_SMALLEST = 1e-4  # what a picture shows, as a part of the largest
_WORDS = {
    ("q", ""): "joint positions",
    ("v", ""): "joint speeds",
    ("tau", ""): "joint torques",
    ("tcp", "m"): "place of the tool",
    ("tcp", "1"): "orientation of the tool, quaternion",
}  # what a referee calls quantities, by the ends of their names and their units; any unit where it is empty
_HEADINGS = ("engine", "quantity", "unit", "largest", "at", "error", "within")


def save_comparison(
    accounts: list[Account],
    found: list[Difference],
    folder: Path | str,
    *,
    station: str = "",
    force: bool = False,
) -> None:
    """Write ``engines.csv`` and ``engines.png``, titled by the station; raises OutputError: not written."""
    with filled_at_once(as_path(folder, "folder"), marker=NUMBERS, force=force) as work:
        with (work / NUMBERS).open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(_HEADINGS)
            for one in found:
                numbers = (
                    f"{one.largest:.6g}",
                    f"{one.at:.6g}",
                    f"{one.error:.6g}",
                    "yes" if one.within else "no",
                )
                rows.writerow([one.account, one.quantity.name, one.quantity.unit, *numbers])
        if found:
            _save_picture(accounts, found, work / "engines.png", station)


def _save_picture(
    accounts: list[Account], found: list[Difference], file: Path, station: str
) -> None:
    """Draw a panel for each quantity: over time how far each engine is from the first, and both errors as a line."""
    from simrob_drake.results.plots.own import panels, save_figure  # which load matplotlib

    first, *others = accounts
    shown = list(dict.fromkeys(one.quantity for one in found))
    titles = [_title(what) for what in shown]
    columns = min(2, len(shown))
    rows = -(-len(shown) // columns)
    head = (
        f"{f'{station}: ' if station else ''}difference from {first.name}, the largest of all axes"
    )
    figure, frames = panels(
        head, rows, columns, size=(5 * columns, 2.2 * rows + 0.8), titles=titles, sharex=True
    )
    errors = {(one.quantity, one.account): one.error for one in found}
    for axes, what in zip(frames.flat, shown, strict=False):
        axes.set_yscale("log")
        for other, colour in zip(others, cycle(COLOURS), strict=False):
            if what in other.values:
                _draw(axes, first, other, what, errors[what, other.name], colour)
    for axes in frames.flat[len(shown) :]:
        axes.set_visible(False)
    for axes in frames[-1]:
        axes.set_xlabel("time [s]")
    frames[0, 0].plot(
        [], [], "--", color="0.35", linewidth=1, label="numerical errors of both: below they agree"
    )
    save_figure(figure, file)


def _title(what: Quantity) -> str:
    """Return a quantity in words, with the robot's name where it has one."""
    whose, _, name = what.name.rpartition(".")
    words = _WORDS.get((name, what.unit)) or _WORDS.get((name, ""))
    if words is None:
        return f"{what.name} [{what.unit}]"
    return f"{f'{whose}: ' if whose else ''}{words} [{what.unit}]"


def _draw(
    axes: "Axes", first: Account, other: Account, what: Quantity, error: float, colour: str
) -> None:
    common = together(first.times, other.times)
    distances = apart(first.values[what][:common], other.values[what][:common])
    least = max(error, float(distances.max())) * _SMALLEST  # a logarithm knows no zero
    axes.plot(
        first.times[:common],
        np.maximum(distances, least),
        color=colour,
        label=other.name,
        linewidth=1,
    )
    axes.axhline(max(error, least), color=colour, linestyle="--", linewidth=1)


MUJOCO_STEP = 1e-3  # of MuJoCo's coarser run [s]
_RATE = 1000.0  # samples a second for accelerations out of speeds [Hz]


@dataclass
class EngineAccounts:
    """What the engines told."""

    # Drake's with the station's own scheme first
    accounts: list[Account] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)  # why others tell nothing, by engine


def other_scheme(solver: SolverConfig) -> SolverConfig:
    """Return a scheme of Drake that works otherwise than a given one: discrete for convex, implicit for explicit."""
    if solver.engine.holds_inputs_over_steps:
        return DiscreteSolver(kind="discrete", scheme="lagged", time_step=1e-3)
    if solver.engine.is_explicit:
        return solver.model_copy(update={"scheme": "radau3"})
    return ContinuousSolver(kind="continuous", scheme="cenic", accuracy=1e-4, max_step=2e-3)


def compare_engines(
    config: StationConfig, *, progress: Callable[[str], None] = lambda name: None
) -> EngineAccounts:
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
    if not config.engine.moves_by_forces:
        yield "Drake, inverse dynamics", lambda name: _of_motion(name, config)
    else:
        solver = config.solver
        yield f"Drake, {solver.engine.name}", lambda name: _stepped(name, config)
        other = config.model_copy(update={"solver": other_scheme(solver)})
        yield f"Drake, {other.engine.name}", lambda name: _stepped(name, other)
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
    with needed_extension("mujoco", "it"):
        from simrob_drake.extensions.mujoco.engine import MujocoEngine
        from simrob_drake.extensions.mujoco.runner import MujocoRunner, inverse_run

    if not config.engine.moves_by_forces:
        if config.program is not None:
            raise SimrobError(
                message(
                    "comparison.no_kinematic_programs",
                    "it does no programs of kinematic stations; --set program=null leaves the station's out",
                )
            )
        result = inverse_run(config)
        return Account.of(name, result, result)
    if config.program is not None or config.controllers:  # which decide as they go
        solver = MujocoEngine(kind="mujoco", time_step=MUJOCO_STEP)
        return _stepped(name, config.model_copy(update={"solver": solver}))
    coarse, fine = (
        _whole(MujocoRunner(config, step=step).run()) for step in (MUJOCO_STEP, MUJOCO_STEP / FINER)
    )
    return Account.of(name, fine, coarse)


def _inverse_dynamics(name: str, config: StationConfig) -> Account:
    """Return the torques that the motion takes which Drake's scheme tells, of arms that touch nothing.

    Accelerations are those of a spline through the speeds; of the coarser run, through every fourth of them.
    """
    if config.contact is not None or config.forces or not config.robots:
        raise SimrobError(
            message(
                "comparison.arms_alone", "it knows the torques of arms alone that nothing touches"
            )
        )
    every = max(round(_RATE / config.sample_rate), 1)
    sampled = config.model_copy(update={"sample_rate": every * config.sample_rate})
    finer = sampled.model_copy(update={"solver": config.solver.tighter(FINER)})
    coarse, fine = (_whole(run_whole(own)) for own in (sampled, finer))
    values, errors = {}, {}
    for robot in fine.plant.robots.values():
        if robot.floats:
            raise SimrobError(
                message(
                    "comparison.robot_floats",
                    "{robot} floats: what it pushes itself off from is not known",
                    robot=robot.name,
                )
            )
        dynamics, units = (
            Dynamics(robot.model, fine.plant.plant, robot.joints),
            np.array(robot.model.effort_units),
        )
        runs = (coarse, FINER), (fine, 1)
        sparse, dense = (_torques(dynamics, run, robot.name, n)[::every] for run, n in runs)
        common = min(len(dense), len(sparse))
        for unit in dict.fromkeys(units.tolist()):  # sliding axes take forces
            what, own = Quantity(f"{robot.prefix}tau", unit), units == unit
            values[what] = dense[:, own]
            errors[what] = float(np.abs((dense[:common] - sparse[:common])[:, own]).max())
    return Account(
        name,
        fine.times[::every],
        values,
        errors,
        message("comparison.motion_in_drake", "of the motion in Drake"),
    )


def _torques(dynamics: Dynamics, run: SimulationResult, robot: str, every: int) -> Vector:
    """Return the torques (m, n) that a run's motion takes, its accelerations made of every so many speeds."""
    q, v, times = run.axes("q", robot), run.axes("v", robot), run.times
    return dynamics.inverse_dynamics(q, v, CubicSpline(times[::every], v[::every])(times, 1))


def _whole(result: SimulationResult) -> SimulationResult:
    """Return a run that did not diverge; raises SimrobError: it did."""
    if result.ending in ("completed", "monitor"):
        return result
    raise SimrobError(result.message)
