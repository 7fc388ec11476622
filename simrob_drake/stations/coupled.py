"""The coupled axes of a station: gears, joints that mimic others in a robot's file, and postures that obey both."""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from simrob_drake.errors import InvalidParameter, listed
from simrob_drake.frames import Vector
from simrob_drake.parts.couplings import Gear
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.coupled_axes import Condition, CoupledAxes
from simrob_drake.stations.config import RobotConfig, StationConfig
from simrob_drake.stations.solver_config import FixedSteps

# Deviations from a coupling that count as rounding: stations hold degrees with four decimals, and the grippers of
# robot.yaml have six digits.
ROUNDING_DEG = 0.01
ROUNDING_METRES = 1e-5


def gear_name(config: StationConfig, robot: str, axis: str) -> str:
    """Key under ``couplings`` of the gear that makes an axis of a robot follow its leader."""
    return f"{axis}_follows" if config.only_robot else f"{robot}_{axis}_follows"


def mimic_gears(config: StationConfig, models: Mapping[str, RobotModel]) -> dict[str, Gear]:
    """Gears of the axes that follow others in the files of their robots, by their keys under ``couplings``.

    A gear of the station between the same two axes takes the place of what the robot's file says, and ``mimic: false``
    in the robot's section leaves the file's gears out.
    """
    own = [gear.ratios.keys() for gear in config.couplings.values() if isinstance(gear, Gear)]
    gears = {}
    for name, model in models.items():
        prefix = config.prefix(name)
        for axis, follower in model.followers.items() if config.robots[name].mimic else ():
            ratios = {f"{prefix}{one}": ratio for one, ratio in follower.ratios(axis).items()}
            if not any(ratios.keys() <= others for others in own):
                gears[gear_name(config, name, axis)] = Gear(kind="gear", ratios=ratios, total=follower.offset)
    return gears


class SolverTraits(NamedTuple):
    """The solver of a station, as far as couplings must know it."""

    mode: Literal["dynamic", "kinematic"]
    scheme: str  # empty in a kinematic station
    time_step: float  # of a discrete solver [s]; 0 for others


def solver_traits(config: StationConfig) -> SolverTraits:
    """The mode of a station, its scheme and its steps."""
    scheme = config.solver.scheme if config.mode == "dynamic" else ""
    time_step = config.solver.time_step if isinstance(config.solver, FixedSteps) else 0.0
    return SolverTraits(config.mode, scheme, time_step)


def unheld_mimics(config: StationConfig, robot: str, model: RobotModel) -> list[tuple[str, str]]:
    """The axes of a robot that the solver of a station does not tie to their leaders, each with its leader."""
    traits, pairs = solver_traits(config), []
    for gear in mimic_gears(config, {robot: model}).values():
        if not gear.is_held(traits):
            axis, leader = gear.ratios
            pairs.append((axis, leader))
    return pairs


def coupled_axes(config: StationConfig, mimics: Mapping[str, Gear], axes: Sequence[str]) -> CoupledAxes:
    """The equations of a station's gears, and of further ``mimics``, between axes by their full names."""
    gears = {name: gear for name, gear in config.couplings.items() if isinstance(gear, Gear)} | dict(mimics)
    return CoupledAxes(axes, [gear.equation(f"couplings.{name}") for name, gear in gears.items()])


def expected_position(
    coupled: CoupledAxes, condition: Condition, found: tuple[int, int, float], values: Vector, units: Sequence[str]
) -> str:
    """Text for error messages: the right position of an axis, and the couplings that demand it.

    Args:
        coupled: the axes.
        condition: that is broken.
        found: sample, axis and its right position, in the user's units.
        values: positions of the n axes at that sample, in the user's units.
        units: of the n axes.
    """
    _, wrong, right = found
    others = [axis for axis in np.flatnonzero(np.abs(condition.ratios) > 1e-9).tolist() if axis != wrong]
    state = listed([f"{coupled.names[axis]} at {position_text(values[axis])} {units[axis]}" for axis in others])
    return f"{position_text(right)} {units[wrong]}, to which {listed(condition.labels)} takes it with {state}"


def position_text(value: float) -> str:
    """A position in the user's unit with five digits, without what rounding leaves of zero."""
    return f"{round(value, 9) + 0.0:.5g}"


def coupled_start(
    config: StationConfig,
    coupled: CoupledAxes,
    models: Mapping[str, RobotModel],
    positions: Mapping[str, Vector],
) -> dict[str, Vector]:
    """Initial positions of robots, in which coupled axes that ``initial_deg`` does not name obey their couplings.

    Args:
        config: of the station.
        coupled: the axes of its robots, one robot after the other.
        models: of its robots, by name.
        positions: of their axes by ``initial_deg``, shape (n,) each [rad or m].

    Returns:
        the positions by robot; those of robots without such couplings are the same arrays.

    Raises:
        InvalidParameter: ``initial_deg`` contradicts a coupling.
    """
    fixed = CoupledAxes(coupled.names, [one for one in coupled.equations if one.total is not None])
    if not fixed:
        return dict(positions)
    whole = np.concatenate([positions[name] for name in models])
    asked = [one for name, model in models.items() for one in model.asked(config.robots[name].initial_deg)]
    bounds = np.concatenate([model.bounds(ROUNDING_DEG, ROUNDING_METRES) for model in models.values()])
    sizes = np.concatenate([model.user_units for model in models.values()])
    units = [unit for model in models.values() for unit in model.unit_names]

    dependence = fixed.solve(asked, fixed.totals(whole))
    for condition in dependence.conditions:
        _check_solvable(condition)
        broken = fixed.find_violation(condition, whole[np.newaxis], bounds)
        if broken is not None:
            _, axis, right = broken
            found = (0, axis, right / sizes[axis])
            expected = expected_position(fixed, condition, found, whole / sizes, units)
            value = f"{position_text(whole[axis] / sizes[axis])} {units[axis]}"
            raise InvalidParameter(f"initial_deg of {fixed.names[axis]}", value, expected)

    solved = dependence.matrix @ whole + dependence.offset
    moved = [axis for axis in dependence.moved if abs(solved[axis] - whole[axis]) > bounds[axis]]
    if not moved:
        return dict(positions)
    whole[moved] = solved[moved]
    ends = np.cumsum([len(model.axes) for model in models.values()])[:-1]
    return dict(zip(models, np.split(whole, ends), strict=True))


def _check_solvable(condition: Condition) -> None:
    """Check that couplings do not contradict each other.

    Raises:
        InvalidParameter: no posture fulfils all of them.
    """
    if np.abs(condition.ratios).max(initial=0.0) < 1e-9 and abs(condition.total) > ROUNDING_METRES:
        *others, last = condition.labels
        expected = "left out, or such that one posture fulfils all of them"
        raise InvalidParameter(last, f"in contradiction to {listed(others)}", expected)


def starting_positions(
    config: StationConfig, models: Mapping[str, RobotModel], unheld: Mapping[str, Gear]
) -> dict[str, Vector]:
    """Initial positions of the robots' axes by name, shape (n,) each [rad or m], which obey the couplings.

    Raises:
        InvalidParameter: ``initial_deg`` is beyond the limits of an axis, or contradicts a coupling.
    """
    positions = {name: _initial_position(config.robots[name], name, model) for name, model in models.items()}
    axes = [f"{config.prefix(name)}{axis}" for name, model in models.items() for axis in model.axes]
    starts = coupled_start(config, coupled_axes(config, unheld, axes), models, positions)
    for name, model in models.items():
        starts[name] = _within_limits(model, starts[name], f"robots.{name}.initial_deg")
    return starts


def _initial_position(entry: RobotConfig, robot: str, model: RobotModel) -> Vector:
    """Positions (n,) [rad or m] that ``initial_deg`` gives the axes of a robot, before couplings are looked at.

    Without ``initial_deg`` the robot begins at home. Axes that a mapping leaves out begin at zero, or at home if zero
    is outside their ranges.
    """
    if entry.initial_deg is None:
        return model.home
    otherwise = np.where(model.excludes_zero, model.home, 0.0)
    values = model.axis_vector(entry.initial_deg, f"robots.{robot}.initial_deg", otherwise / model.user_units)
    return np.asarray(model.user_units * values)


def _within_limits(model: RobotModel, position: Vector, key: str) -> Vector:
    """Initial positions (n,) [rad or m] of a robot, clamped where they are beyond a limit by rounding.

    Raises:
        InvalidParameter: an axis is beyond a limit.
    """
    # Followers inherit the rounding of their leaders' positions, which station files hold with four decimals.
    follows = np.array([axis in model.followers for axis in model.axes])
    slack = np.where(follows, model.bounds(ROUNDING_DEG, ROUNDING_METRES), 0.0)
    lower, upper = model.axis_limits
    eased = np.where(follows, np.clip(position, lower - slack, upper + slack), position)
    is_eased = follows & (np.clip(position, lower, upper) != position) & (eased == position)
    leading = np.flatnonzero(~is_eased).tolist()

    limits = model.limits.of_axes(leading)
    violation = limits.find_violation(position[np.newaxis, leading])
    if violation is not None:
        axis = limits.names[violation.axis]
        expected = f"within {violation.limits}"
        if axis in model.followers:
            expected += f"; it follows {model.followers[axis].leader}, so choose another initial_deg of that"
        raise InvalidParameter(f"initial_deg of {axis}", violation.value, expected)
    clamped = position.copy()
    clamped[leading] = limits.clamp(position[leading], key)
    return clamped
