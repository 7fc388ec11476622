"""The coupled axes of a station: which axes are coupled, and initial positions that obey the couplings.

A gear is an entry under ``couplings`` of a station: a constant sum of the positions of some axes times ratios. A mimic
joint follows another joint, its leader, as the file of its robot says; here each mimic joint becomes such a gear.
Not every solver can hold a gear during a run, but the initial positions obey all of them. The full name of an axis is
its name with a prefix of its robot, if the station has several robots.

The user gives initial positions under ``initial_deg``, in the *user's units*: degrees, or metres for a prismatic axis.
Axes whose positions are given least *firmly* are moved first, so that the couplings hold.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from simrob_drake.base.errors import InvalidParameter, list_names
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import plain_name
from simrob_drake.parts.couplings import Gear
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.coupled_axes import (
    AxisCondition,
    ConditionViolation,
    CoupledAxes,
    Firmness,
)
from simrob_drake.stations.config import RobotConfig, StationConfig

# Deviations from a coupling that count as rounding, of revolute axes [deg] and of prismatic axes [m]: stations hold
# degrees with four decimals, and the grippers of robot.yaml have six digits.
ROUNDING_DEG = 0.01
ROUNDING_METRES = 1e-5
# Smaller ratios of a condition count as zero: they are rounding errors.
_ZERO_RATIO = 1e-9


def gear_name(config: StationConfig, robot: str, axis: str) -> str:
    """Key under ``couplings`` of the gear that makes an axis of a robot follow its leader."""
    return follower_key(axis) if config.only_robot else follower_key(f"{robot}_{axis}")


def follower_key(axis: str) -> str:
    """Key under ``couplings`` of the gear of an axis that follows another one; other characters become underscores."""
    return plain_name(f"{axis}_follows")


def mimic_gears(config: StationConfig, models: Mapping[str, RobotModel]) -> dict[str, Gear]:
    """Make a gear for each joint that mimics another joint in the file of its robot.

    A gear of the station that names both axes takes the place of the mimic joint, even if it names others, too.
    ``mimic: false`` in the robot's section leaves out all mimic joints of that robot.

    Args:
        config: configuration of the station.
        models: the station's robots, by name.

    Returns:
        the gears, by their keys under ``couplings``.
    """
    # For each gear of the station, the full names of its axes.
    axes_of_own_gears = [
        gear.ratios.keys() for gear in config.couplings.values() if isinstance(gear, Gear)
    ]
    gears = {}
    for name, model in models.items():
        if not config.robots[name].mimic:
            continue
        prefix = config.prefix(name)
        for axis, follower in model.followers.items():
            # The ratios of the mimic joint and of its leader, by their full names.
            ratios = {
                f"{prefix}{own_name}": ratio for own_name, ratio in follower.ratios(axis).items()
            }
            is_replaced = any(ratios.keys() <= axes for axes in axes_of_own_gears)
            if not is_replaced:
                gears[gear_name(config, name, axis)] = Gear(
                    kind="gear", ratios=ratios, total=follower.offset
                )
    return gears


class MimicPair(NamedTuple):
    """A mimic joint and its leader, by the full names of their axes."""

    follower: str
    leader: str


def unheld_mimics(config: StationConfig, robot: str, model: RobotModel) -> list[MimicPair]:
    """Find the mimic joints of a robot that the solver of a station cannot hold during a run.

    Those that :func:`mimic_gears` leaves out, since the station replaces or drops them, are not among them.
    """
    pairs = []
    for gear in mimic_gears(config, {robot: model}).values():
        if not gear.is_held(config.engine):
            # The gear of a mimic joint has the ratios of two axes, the follower first.
            follower, leader = gear.ratios
            pairs.append(MimicPair(follower, leader))
    return pairs


def coupled_axes(
    config: StationConfig,
    unheld_gears: Mapping[str, Gear],
    axes: Sequence[str],
) -> CoupledAxes:
    """Collect the equations of all gears between axes. Other couplings, such as a weld, tie bodies, not axes.

    Args:
        config: configuration of the station; its gears are included.
        unheld_gears: further gears, of mimic joints that are not part of the configuration.
        axes: full names of the axes of all robots, in order.
    """
    own_gears = {name: gear for name, gear in config.couplings.items() if isinstance(gear, Gear)}
    gears = {**own_gears, **unheld_gears}
    return CoupledAxes(axes, [gear.equation(f"couplings.{name}") for name, gear in gears.items()])


class AxisUnits(NamedTuple):
    """Units of the n axes of all robots of a station, one robot after the other.

    Attributes:
        sizes: size of the user's unit of each axis in SI, shape (n,): pi/180 for degrees, 1 for metres.
        names: name of the user's unit of each axis, ``deg`` or ``m``.
        rounding: deviation of each axis that counts as rounding, shape (n,) [rad or m].
    """

    sizes: Vector
    names: Sequence[str]
    rounding: Vector


def axis_units(models: Iterable[RobotModel]) -> AxisUnits:
    """Collect the units of all axes of some robots, in the order of the robots."""
    robots = list(models)
    return AxisUnits(
        sizes=np.concatenate([model.user_units for model in robots]),
        names=[unit for model in robots for unit in model.unit_names],
        rounding=np.concatenate([model.bounds(ROUNDING_DEG, ROUNDING_METRES) for model in robots]),
    )


def expected_position(
    coupled: CoupledAxes,
    condition: AxisCondition,
    violation: ConditionViolation,
    position: Vector,
    units: AxisUnits,
) -> str:
    """Write, for an error message, the position that an axis would need and the couplings that demand this position.

    The position follows from those of the other axes of the condition, which the text names, too.

    Args:
        coupled: the n axes of all robots, with their equations.
        condition: the condition that the positions break: an equation between axes of which none may be moved.
        violation: the axis that has the wrong position, and the position that it would need.
        position: positions of the n axes at the sample of the violation, shape (n,) [rad or m].
        units: units of the axes.
    """
    wrong = violation.axis
    in_condition = np.flatnonzero(np.abs(condition.ratios) > _ZERO_RATIO).tolist()
    # Positions are shown in the units in which the user gave them.
    in_units = position / units.sizes
    others = [axis for axis in in_condition if axis != wrong]
    state = [
        message(
            "stations.axis_at",
            "{axis} at {position} {unit}",
            axis=coupled.names[axis],
            position=position_text(in_units[axis]),
            unit=units.names[axis],
        )
        for axis in others
    ]
    needed = compound(
        "{position_text} {names}",
        position_text=position_text(violation.position / units.sizes[wrong]),
        names=units.names[wrong],
    )
    return message(
        "stations.taken_by_couplings",
        "{needed} to satisfy {labels} with {state}",
        needed=needed,
        labels=list_names(condition.labels),
        state=list_names(state),
    )


def position_text(value: float) -> str:
    """Format a position in the user's unit with five significant digits, for error messages."""
    # Rounding turns a remainder such as 1e-17 into zero, and adding 0.0 turns -0.0 into 0.0.
    return f"{round(value, 9) + 0.0:.5g}"


def coupled_start(
    config: StationConfig,
    coupled: CoupledAxes,
    models: Mapping[str, RobotModel],
    positions: Mapping[str, Vector],
) -> dict[str, Vector]:
    """Compute initial positions that obey the gears with a total, by moving axes.

    Axes that ``initial_deg`` names in a mapping or a list stay. If it is one number or left out, any coupled axis may
    move.

    Args:
        config: configuration of the station.
        coupled: the axes of all robots, one robot after the other, and their equations.
        models: the station's robots, by name.
        positions: initial positions of each robot's axes before couplings are considered, shape (n,) each [rad or m].

    Returns:
        initial positions by robot, shape (n,) each [rad or m]. If no axis has to move, they are those of
        ``positions``.

    Raises:
        InvalidParameter: ``initial_deg`` contradicts a coupling, or couplings contradict each other.
    """
    # A coupling without a total keeps the sum of the initial posture, so any initial posture obeys it.
    with_totals = CoupledAxes(
        coupled.names, [equation for equation in coupled.equations if equation.total is not None]
    )
    if not with_totals:
        return dict(positions)
    # The axes of all robots in one vector: a coupling may tie axes of two robots.
    initial = np.concatenate([positions[name] for name in models])
    # How firmly the user gives the position of each axis: the axes with the lowest firmness move first.
    firmness = list[Firmness]()
    for name, model in models.items():
        firmness += model.firmness(config.robots[name].initial_deg)
    units = axis_units(models.values())

    # Positions that obey the couplings are `matrix @ initial + offset`; `moved` are the axes that give way.
    dependence = with_totals.solve(firmness, with_totals.totals(initial))
    # A condition is an equation that is left for axes whose positions are all given in ``initial_deg``.
    for condition in dependence.conditions:
        _check_solvable(condition)
        violation = with_totals.find_violation(condition, initial[np.newaxis], units.rounding)
        if violation is not None:
            axis = violation.axis
            expected = expected_position(with_totals, condition, violation, initial, units)
            value = compound(
                "{position_text} {names}",
                position_text=position_text(initial[axis] / units.sizes[axis]),
                names=units.names[axis],
            )
            raise InvalidParameter(
                message(
                    "stations.initial_of", "initial_deg of {axis}", axis=with_totals.names[axis]
                ),
                value,
                expected,
            )

    # Axes that obey their couplings up to rounding keep the very numbers of the station file.
    solved = dependence.matrix @ initial + dependence.offset
    moved = [
        axis
        for axis in dependence.moved
        if abs(solved[axis] - initial[axis]) > units.rounding[axis]
    ]
    if not moved:
        return dict(positions)
    starts = initial.copy()
    starts[moved] = solved[moved]
    # Split the vector again into those of the robots: at the first axis of each robot, except for the first robot.
    counts = [len(model.axes) for model in models.values()]
    by_robot = np.split(starts, np.cumsum(counts)[:-1])
    return dict(zip(models, by_robot, strict=True))


def _check_solvable(condition: AxisCondition) -> None:
    """Check that the couplings behind a condition do not contradict each other.

    Raises:
        InvalidParameter: no posture fulfils all of these couplings.
    """
    # Couplings that contradict each other leave an equation without any axis: 0 = total, with a total that is not 0.
    # Totals may be of revolute axes as well; the bound of prismatic axes is the stricter one.
    has_no_axis = np.abs(condition.ratios).max(initial=0.0) < _ZERO_RATIO
    if has_no_axis and abs(condition.total) > ROUNDING_METRES:
        *others, last = condition.labels
        expected = message(
            "stations.such_that_one_posture",
            "left out, or changed so that one posture satisfies all of these couplings",
        )
        raise InvalidParameter(
            last,
            message(
                "stations.in_contradiction",
                "in contradiction with {others}",
                others=list_names(others),
            ),
            expected,
        )


def starting_positions(
    config: StationConfig,
    models: Mapping[str, RobotModel],
    unheld_gears: Mapping[str, Gear],
) -> dict[str, Vector]:
    """Compute the initial positions of all robots from ``initial_deg`` and the couplings.

    Args:
        config: configuration of the station, with its own gears and the gears of mimic joints that the solver holds.
        models: the station's robots, by name.
        unheld_gears: gears of mimic joints that the solver does not hold, by key; the start obeys them, too.

    Returns:
        initial positions by robot, shape (n,) each [rad or m]. They obey the couplings and are within the limits, but
        the axis of a mimic joint may be beyond a limit by its leader's rounding.

    Raises:
        InvalidParameter: the initial position of an axis is beyond its limits by more than rounding, ``initial_deg``
            contradicts a coupling or is a list of the wrong length, or couplings contradict each other.
        UnknownName: ``initial_deg`` names an axis that the robot does not have.
    """
    positions = {
        name: _initial_position(config.robots[name], name, model) for name, model in models.items()
    }
    axes = [f"{config.prefix(name)}{axis}" for name, model in models.items() for axis in model.axes]
    coupled = coupled_axes(config, unheld_gears, axes)
    starts = coupled_start(config, coupled, models, positions)
    for name, model in models.items():
        starts[name] = _within_limits(model, starts[name], f"robots.{name}.initial_deg")
    return starts


def _initial_position(entry: RobotConfig, robot: str, model: RobotModel) -> Vector:
    """Compute the initial positions (n,) [rad or m] of a robot from ``initial_deg``, before couplings are considered.

    Without ``initial_deg`` the robot begins at home. One number or a list gives the position of every axis. Axes that a
    mapping leaves out begin at zero, or at home if zero is outside their ranges.

    Raises:
        InvalidParameter: ``initial_deg`` is a list of the wrong length.
        UnknownName: ``initial_deg`` names an axis that the robot does not have.
    """
    if entry.initial_deg is None:
        return model.home
    default = np.where(model.excludes_zero, model.home, 0.0)
    key = f"robots.{robot}.initial_deg"
    in_units = model.axis_vector(entry.initial_deg, key, default / model.user_units)
    return np.asarray(model.user_units * in_units)


def _within_limits(model: RobotModel, position: Vector, key: str) -> Vector:
    """Clamp initial positions that are beyond a limit by rounding, except those of followers.

    A follower is an axis of a mimic joint. If it is beyond its limit only by its leader's rounding, it keeps its
    position, so that it still obeys its coupling.

    Args:
        model: the robot.
        position: initial positions of its axes, shape (n,) [rad or m].
        key: key of the positions in the station, for warnings, such as ``robots.arm.initial_deg``.

    Returns:
        the positions, shape (n,) [rad or m]. A warning names the axes that were clamped by a noticeable amount.

    Raises:
        InvalidParameter: an axis is beyond a limit by more than rounding.
    """
    # Followers inherit the rounding of their leaders' positions, which station files hold with four decimals. A
    # follower within this slack beyond its limits is neither checked nor clamped.
    lower, upper = model.axis_limits
    slack = model.bounds(ROUNDING_DEG, ROUNDING_METRES)
    follows = np.array([axis in model.followers for axis in model.axes])
    is_beyond = (position < lower) | (position > upper)
    is_within_slack = (position >= lower - slack) & (position <= upper + slack)
    is_excepted = follows & is_beyond & is_within_slack
    checked = np.flatnonzero(~is_excepted).tolist()

    limits = model.limits.of_axes(checked)
    violation = limits.find_violation(position[np.newaxis, checked])
    if violation is not None:
        axis = limits.names[violation.axis]
        expected = message("stations.within", "within {limits}", limits=violation.limits)
        if axis in model.followers:
            leader = model.followers[axis].leader
            expected += message(
                "stations.follows_leader",
                "; the axis follows {leader}, so change initial_deg of {leader}",
                leader=leader,
            )
        raise InvalidParameter(
            message("stations.initial_of", "initial_deg of {axis}", axis=axis),
            violation.value,
            expected,
        )
    clamped = position.copy()
    clamped[checked] = limits.clamp(position[checked], key)
    return clamped
