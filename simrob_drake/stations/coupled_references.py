"""References of coupled axes: a reference for one axis moves its partners, and a contradiction raises an error.

A reference is the desired motion of one robot: a function of time with the positions of its axes. Couplings tie axes of
one or several robots by linear equations, for example a gear; the partners of an axis are the other axes of the same
equation. So the functions here treat the axes of all robots as one vector of n positions, one robot after the other.
Where the references of coupled axes do not agree, the axis whose reference is given least firmly follows the others.

The *firmness* of an axis, from the lowest to the highest, is PASSIVE (no servo follows the reference), UNNAMED (the
user gives no value for the axis), LEADING (one value for all axes) or NAMED (a value for this axis). NAMED axes never
follow: an equation between such axes is a *condition*, which their references must fulfil. A *prescribed* axis moves
exactly along a motion that the station gives.
"""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from simrob_drake.base.errors import InvalidParameter, list_names
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import join_texts, message
from simrob_drake.blocks.combined_references import combine_references
from simrob_drake.blocks.references import Reference, as_reference, reference_values
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.robots.coupled_axes import CoupledAxes, Dependence, Firmness
from simrob_drake.stations.coupled import (
    ROUNDING_DEG,
    ROUNDING_METRES,
    AxisUnits,
    axis_units,
    expected_position,
    position_text,
)
from simrob_drake.stations.resolve import ResolvedStation

# Intervals between the times at which references are compared with couplings.
_COMPARISONS = 500


def obey_couplings(
    station: ResolvedStation,
    references: Mapping[str, Reference],
    requested: Collection[str],
    starts: Mapping[str, Vector],
) -> dict[str, Reference]:
    """Change references so that coupled axes follow their partners, if the user gives no value for the axis itself.

    Args:
        station: the station with the robots and couplings.
        references: reference of each robot, by name.
        requested: names of the robots whose reference comes from the caller of the run, not from the station. All
            axes of such a robot count as `NAMED`, except fingers and axes that no servo holds.
        starts: positions at which robots begin, shape (n,) each [rad or m]; empty if all robots begin at their initial
            positions. A run that is resumed gives its starts.

    Returns:
        the references by robot; robots without axes that have to follow keep the same objects.

    Raises:
        InvalidParameter: references contradict a coupling, or an axis has to change whose partner could change in its
            place, since the user gives no value for either.
    """
    coupled = station.couplings_of_axes
    if not coupled:
        return dict(references)
    robots = station.robots
    firmness = list[Firmness]()
    for name, robot in robots.items():
        firmness += _firmness(station, robot, is_requested=name in requested)
    units = axis_units(robot.model for robot in robots.values())

    # The motions that the robots would make without couplings, and their positions at m times, shape (m, n).
    motions = {name: _with_prescribed(robot, references[name]) for name, robot in robots.items()}
    times = _comparison_times(motions, station.config.duration)
    positions = np.hstack([reference_values(motions[name], times) for name in robots])

    # The totals are the right sides of the equations: ratios times positions = total. A resumed run begins with a small
    # gap in its couplings, which the solver left. This gap is no contradiction of the references, so the totals come
    # from the start, and only changes of the positions have to agree.
    begin = np.concatenate([starts.get(name, robot.initial) for name, robot in robots.items()])
    totals = coupled.ratios @ begin if starts else coupled.totals(begin)

    dependence = coupled.solve(firmness, totals)
    _check_conditions(coupled, dependence, times, positions, units)
    followers = _axes_to_change(dependence, positions, firmness, units)
    for axis in followers:
        # Axes that could give way in place of this one, since the user gives no value for either.
        alternatives = dependence.undecided.get(axis)
        if alternatives:
            raise _ambiguity(coupled, (axis, *alternatives))
    return _let_follow(station, references, motions, followers, dependence)


def _check_conditions(
    coupled: CoupledAxes,
    dependence: Dependence,
    times: Vector,
    positions: Vector,
    units: AxisUnits,
) -> None:
    """Check that references fulfil the couplings between axes of which none gives way.

    Args:
        coupled: the n axes of all robots and their equations.
        dependence: the solution of the equations, with the conditions to check.
        times: times of the samples, shape (m,) [s].
        positions: positions that the references demand, shape (m, n) [rad or m].
        units: units of the axes.

    Raises:
        InvalidParameter: a condition is broken; the message names the axis, its position and the time.
    """
    # A condition is an equation that is left for axes whose references are all NAMED.
    for condition in dependence.conditions:
        violation = coupled.find_violation(condition, positions, units.rounding)
        if violation is None:
            continue
        axis = violation.axis
        position = positions[violation.sample]
        # In the user's unit, whose size in SI is `sizes`.
        text = position_text(position[axis] / units.sizes[axis])
        value = message(
            "stations.value_with_unit_at_time",
            "{value} {unit} at {time:.2f} s",
            value=text,
            unit=units.names[axis],
            time=times[violation.sample],
        )
        expected = expected_position(coupled, condition, violation, position, units)
        raise InvalidParameter(
            message("stations.reference_of_joint", "reference of {axis}", axis=coupled.names[axis]),
            value,
            expected,
        )


def _axes_to_change(
    dependence: Dependence,
    positions: Vector,
    firmness: Sequence[Firmness],
    units: AxisUnits,
) -> list[int]:
    """Find the axes whose references have to change so that the couplings hold.

    Args:
        dependence: the solution of the couplings.
        positions: positions that the references demand, shape (m, n) [rad or m].
        firmness: how firmly the reference of each axis is given.
        units: units of the axes.

    Returns:
        indices of the axes among the axes of all robots: those that give way, have a servo, and do not obey the
        couplings already.
    """
    # Positions that obey the couplings, and how far each axis is from them at most [rad or m].
    solved = positions @ dependence.matrix.T + dependence.offset
    shifts = np.abs(solved - positions).max(axis=0)
    changed = []
    for axis in dependence.moved:
        # The reference of a passive axis does not matter, since no servo follows it.
        has_servo = firmness[axis] != Firmness.PASSIVE
        is_shifted = shifts[axis] > units.rounding[axis]
        if has_servo and is_shifted:
            changed.append(axis)
    return changed


def with_partners(
    station: ResolvedStation,
    robot: str,
    posture: Vector,
    named: Collection[int],
) -> Vector:
    """Complete a posture to which a move goes: move the partners of its named axes to where the couplings take them.

    Whether the named axes themselves contradict a coupling is not checked.

    Args:
        station: the station with the robots and couplings.
        robot: name of the robot; the other robots stay at their initial positions.
        posture: positions of the robot's axes, shape (n,) [rad or m].
        named: indices of the axes that keep their positions in ``posture``.

    Returns:
        the posture with coupled axes moved, shape (n,) [rad or m].
    """
    coupled = station.couplings_of_axes
    if not coupled:
        return posture
    initial = np.concatenate([resolved.initial for resolved in station.robots.values()])
    own_axes = list(_axis_ranges(station)[robot])
    positions = initial.copy()
    positions[own_axes] = posture
    # PASSIVE axes give way first, then UNNAMED ones, NAMED ones never. The partners on other robots count as PASSIVE,
    # since the posture is of this robot alone.
    firmness = [Firmness.PASSIVE] * len(positions)
    for axis, index in enumerate(own_axes):
        firmness[index] = Firmness.NAMED if axis in named else Firmness.UNNAMED

    dependence = coupled.solve(firmness, coupled.totals(initial))
    solved = dependence.matrix @ positions + dependence.offset
    completed = solved[own_axes]
    # Axes that obey their couplings up to rounding keep the very numbers that were given.
    rounding = station.robots[robot].model.bounds(ROUNDING_DEG, ROUNDING_METRES)
    is_moved = np.abs(completed - posture) > rounding
    return np.where(is_moved, completed, posture)


def _axis_ranges(station: ResolvedStation) -> dict[str, range]:
    """Find, for each robot by name, the indices of its axes among the axes of all robots."""
    ranges = {}
    first = 0
    for name, robot in station.robots.items():
        ranges[name] = range(first, first + len(robot.axes))
        first += len(robot.axes)
    return ranges


def _firmness(
    station: ResolvedStation,
    robot: ResolvedRobot,
    *,
    is_requested: bool,
) -> list[Firmness]:
    """Find how firmly the reference of each of a robot's axes is given.

    An axis that is NAMED never gives way to a coupling; one that is PASSIVE gives way first, whatever its reference.

    Args:
        station: the station with the robot.
        robot: the robot.
        is_requested: whether the reference comes from the caller of the run. It then gives a position for every axis.

    Returns:
        the firmness of each axis, in the order of the robot's axes.
    """
    config = station.config
    # The firmness by the section `reference` of the station's file, unless another reference replaces that one.
    firmness = config.reference_of(robot.name).firmness(robot.model)
    if is_requested:
        firmness = [Firmness.NAMED] * len(robot.axes)
        # Programs command fingers to positions inside the part that they hold, so that the servos press. Fingers do not
        # reach these positions, so their references are no contradiction of a coupling.
        for finger in robot.model.fingers:
            firmness[finger] = Firmness.PASSIVE
    for axis in np.flatnonzero(robot.gains.passive).tolist():
        firmness[axis] = Firmness.PASSIVE
    if config.engine.moves_by_forces and not config.servo_of(robot.name).follows_motion:
        # Without a proportional and an integral gain no servo pulls the axis to its reference. Servos with a model of
        # the robot (follows_motion) are excepted: they apply torques for the reference's acceleration at any gain.
        is_loose = (robot.gains.kp == 0) & (robot.gains.ki == 0)
        for axis in np.flatnonzero(is_loose).tolist():
            firmness[axis] = Firmness.PASSIVE
    # Imposed motion never gives way.
    for axis in robot.prescribed:
        firmness[axis] = Firmness.NAMED
    return firmness


def _with_prescribed(robot: ResolvedRobot, reference: Reference) -> Reference:
    """Replace the reference of each prescribed axis, whose motion the station imposes, by that motion.

    Returns:
        the reference of the whole robot; the same object if the robot has no prescribed axis.
    """
    if not robot.prescribed:
        return reference
    # Each row of the matrix selects one of the sources: the robot's n positions, then the imposed motions.
    count = len(robot.axes)
    sources = [reference, *robot.prescribed.values()]
    # At first the positions of the reference, without the imposed motions.
    matrix = np.hstack([np.eye(count), np.zeros((count, len(robot.prescribed)))])
    for number, axis in enumerate(robot.prescribed):
        matrix[axis] = 0.0
        matrix[axis, count + number] = 1.0
    return combine_references(sources, matrix, np.zeros(count))


def _comparison_times(references: Mapping[str, Reference], duration: float) -> Vector:
    """Choose the times at which references are compared with couplings, shape (m,) [s].

    The times reach from zero to the end of the run, or of the longest reference that ends if that is later.

    Args:
        references: references by robot.
        duration: duration of the run [s].
    """
    # Sines, and trajectories that stand still, have an infinite end.
    ends = [as_reference(reference).span[1] for reference in references.values()]
    finite = [end for end in ends if np.isfinite(end)]
    return np.linspace(0.0, max([duration, *finite]), _COMPARISONS + 1)


def _ambiguity(coupled: CoupledAxes, candidates: Sequence[int]) -> InvalidParameter:
    """Make the error for references that leave open which of several axes gives way.

    Args:
        coupled: the axes and their equations.
        candidates: indices of the axes that could give way.
    """
    names = [coupled.names[axis] for axis in candidates]
    # The couplings that tie at least two of these axes.
    labels = [
        equation.label
        for equation in coupled.equations
        if len(set(names) & equation.ratios.keys()) > 1
    ]
    problem = message(
        "stations.no_value_for",
        "no value for {names}",
        names=join_texts(names, message("base.and", " and ")),
    )
    return InvalidParameter(
        "reference",
        problem,
        message(
            "stations.value_for_one",
            "a value for one of these axes, which are coupled by {labels}",
            labels=list_names(labels),
        ),
    )


def _let_follow(
    station: ResolvedStation,
    references: Mapping[str, Reference],
    motions: Mapping[str, Reference],
    followers: Collection[int],
    dependence: Dependence,
) -> dict[str, Reference]:
    """Replace the references of axes that follow by combinations of the other axes' motions.

    Args:
        station: the station with the robots.
        references: reference of each robot, by name.
        motions: the same references with the motions of prescribed axes.
        followers: indices of the axes that follow, among the axes of all robots.
        dependence: the solution of the couplings, which gives the positions of the axes that follow.

    Returns:
        the references by robot; robots without axes that follow keep the same objects.
    """
    results = dict(references)
    ranges = _axis_ranges(station)
    count = sum(len(axes) for axes in ranges.values())
    for name, own_axes in ranges.items():
        own_followers = [axis for axis in own_axes if axis in followers]
        if not own_followers:
            continue
        # The combination starts as the robot's own motion, and the rows of the followers are replaced. The matrix has
        # a row for each axis of this robot, and a column for each axis of all robots.
        matrix = np.eye(count)[list(own_axes)]
        offset = np.zeros(len(own_axes))
        for axis in own_followers:
            matrix[axis - own_axes.start] = dependence.matrix[axis]
            offset[axis - own_axes.start] = dependence.offset[axis]
        # Robots on which the combination does not depend are left out: a sine cannot be combined with other motions.
        used = [other for other, axes in ranges.items() if matrix[:, list(axes)].any()]
        columns = [index for other in used for index in ranges[other]]
        results[name] = combine_references(
            [motions[other] for other in used], matrix[:, columns], offset
        )
    return results
