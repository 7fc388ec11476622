"""References of coupled axes: a reference for one axis moves its partners, and a contradiction raises an error."""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from simrob_drake.blocks.combined_references import combine_references
from simrob_drake.blocks.references import Reference, SineReference, reference_values
from simrob_drake.errors import InvalidParameter, listed
from simrob_drake.frames import Vector
from simrob_drake.parts.site import ResolvedRobot
from simrob_drake.robots.coupled_axes import Asked, CoupledAxes
from simrob_drake.stations.coupled import ROUNDING_DEG, ROUNDING_METRES, expected_position, position_text
from simrob_drake.stations.resolve import ResolvedStation

_COMPARISONS = 500  # intervals between the times at which references are compared with couplings


class _Axes(NamedTuple):
    """The n axes of all robots of a station, one robot after the other."""

    names: Sequence[str]
    asked: Sequence[Asked]  # how firmly the reference of each axis counts
    sizes: Vector  # size of one of the user's units in SI, shape (n,): pi/180 for degrees, 1 for metres
    units: Sequence[str]  # names of the user's units, such as "deg"
    bounds: Vector  # deviations that count as rounding, shape (n,) [rad or m]


def obey_couplings(
    station: ResolvedStation,
    references: Mapping[str, Reference],
    requested: Mapping[str, object],
    starts: Mapping[str, Vector],
) -> dict[str, Reference]:
    """Change references so that coupled axes without a target of their own follow their partners.

    Args:
        station: the station with the couplings.
        references: reference of each robot, by name.
        requested: robots whose reference comes from the caller of the run, not from the station: their references
            count for every axis. Only the keys, names of robots, are read.
        starts: positions at which robots begin, shape (n,) each [rad or m]; empty if all robots begin at their initial
            positions. A run that is resumed gives its starts.

    Returns:
        the references by robot; robots without axes that have to follow keep the same objects.

    Raises:
        InvalidParameter: references contradict a coupling, or leave open which axis gives way.
    """
    coupled = station.coupled
    if not coupled:
        return dict(references)
    axes = _axes_of(station, requested)
    played = {name: _with_prescribed(robot, references[name]) for name, robot in station.robots.items()}
    times = _comparison_times(played, station.config.duration)
    positions = np.hstack([reference_values(played[name], times) for name in station.robots])
    begin = np.concatenate([starts.get(name, robot.initial) for name, robot in station.robots.items()])
    # A resumed run begins with a small gap in its couplings, which the solver left. This gap is no contradiction of the
    # references, so the totals come from the start, and only changes of the positions have to agree.
    totals = coupled.ratios @ begin if starts else coupled.totals(begin)

    dependence = coupled.solve(axes.asked, totals)
    for condition in dependence.conditions:
        found = coupled.find_violation(condition, positions, axes.bounds)
        if found is not None:
            sample, axis, right = found
            asked = position_text(positions[sample, axis] / axes.sizes[axis])
            value = f"{asked} {axes.units[axis]} at {times[sample]:.2f} s"
            in_units = sample, axis, right / axes.sizes[axis]
            expected = expected_position(coupled, condition, in_units, positions[sample] / axes.sizes, axes.units)
            raise InvalidParameter(f"reference of {axes.names[axis]}", value, expected)

    # Axes whose references have to change. The reference of a passive axis does not matter, since no servo follows it,
    # and a shift within the bounds is rounding.
    solved = positions @ dependence.matrix.T + dependence.offset
    shifts = np.abs(solved - positions).max(axis=0)
    moved = [
        axis for axis in dependence.moved if axes.asked[axis] != Asked.PASSIVE and shifts[axis] > axes.bounds[axis]
    ]
    for axis in moved:
        if dependence.undecided.get(axis):
            raise _ambiguity(coupled, axes, (axis, *dependence.undecided[axis]))
    return _let_follow(station, references, played, moved, (dependence.matrix, dependence.offset))


def with_partners(station: ResolvedStation, robot: str, posture: Vector, named: Collection[int]) -> Vector:
    """Move the partners of some axes of a robot to positions that obey the couplings.

    Args:
        station: the station with the couplings.
        robot: name of the robot; the other robots stay at their initial positions.
        posture: positions of the robot's axes, shape (n,) [rad or m].
        named: indices of the axes that keep their positions in ``posture``.

    Returns:
        the posture with coupled axes moved, shape (n,) [rad or m].
    """
    coupled = station.coupled
    if not coupled:
        return posture
    postures = {name: posture if name == robot else one.initial for name, one in station.robots.items()}
    asked = [
        Asked.PASSIVE if name != robot else Asked.NAMED if axis in named else Asked.UNNAMED
        for name, one in station.robots.items()
        for axis in range(len(one.axes))
    ]
    initial = np.concatenate([one.initial for one in station.robots.values()])
    dependence = coupled.solve(asked, coupled.totals(initial))
    whole = dependence.matrix @ np.concatenate([*postures.values()]) + dependence.offset
    # Index of the robot's first axis among the axes of all robots.
    first = 0
    for name, one in station.robots.items():
        if name == robot:
            break
        first += len(one.axes)
    found = whole[first : first + len(posture)]
    # Axes that obey their couplings up to rounding keep the very numbers that were given.
    bounds = station.robots[robot].model.bounds(ROUNDING_DEG, ROUNDING_METRES)
    return np.where(np.abs(found - posture) > bounds, found, posture)


def _axes_of(station: ResolvedStation, requested: Mapping[str, object]) -> _Axes:
    """Collect the axes of all robots. ``requested`` is as in :func:`obey_couplings`."""
    robots = station.robots.values()
    return _Axes(
        names=station.coupled.names,
        asked=[one for robot in robots for one in _firmness(station, robot, is_requested=robot.name in requested)],
        sizes=np.concatenate([robot.model.user_units for robot in robots]),
        units=[unit for robot in robots for unit in robot.model.unit_names],
        bounds=np.concatenate([robot.model.bounds(ROUNDING_DEG, ROUNDING_METRES) for robot in robots]),
    )


def _firmness(station: ResolvedStation, robot: ResolvedRobot, *, is_requested: bool) -> list[Asked]:
    """Return for each of the n axes how firmly its reference counts (see `Asked`).

    The axes whose references count least give way where couplings contradict references.

    Args:
        station: the station with the robot.
        robot: the robot.
        is_requested: whether the reference comes from the caller of the run. It then gives a position for every axis.
    """
    config = station.config
    asked = config.reference_of(robot.name).asked(robot.model)
    if is_requested:
        asked = [Asked.NAMED] * len(robot.axes)
        # Programs command fingers to positions inside the part that they hold, so that the servos press. Fingers do not
        # reach these positions, so their references are no contradiction of a coupling.
        for finger in robot.model.fingers:
            asked[finger] = Asked.PASSIVE
    if config.mode == "dynamic" and not config.servo_of(robot.name).follows_motion:
        # Without a proportional and an integral gain no servo pulls the axis to its reference. Servos that know the
        # robot's model (follows_motion) are excepted: they apply torques for the reference's acceleration at any gain.
        for axis in np.flatnonzero((robot.gains.kp == 0) & (robot.gains.ki == 0)).tolist():
            asked[axis] = Asked.PASSIVE
    # Imposed motion never gives way.
    for axis in robot.prescribed:
        asked[axis] = Asked.NAMED
    return asked


def _with_prescribed(robot: ResolvedRobot, reference: Reference) -> Reference:
    """Replace the reference of each prescribed axis by the axis' imposed motion. Returns the reference of the robot."""
    if not robot.prescribed:
        return reference
    # Each row of the matrix selects one of the sources: the robot's n positions, then the imposed motions.
    count = len(robot.axes)
    sources = [reference, *robot.prescribed.values()]
    matrix = np.hstack([np.eye(count), np.zeros((count, len(robot.prescribed)))])
    for number, axis in enumerate(robot.prescribed):
        matrix[axis] = 0.0
        matrix[axis, count + number] = 1.0
    return combine_references(sources, matrix, np.zeros(count))


def _comparison_times(references: Mapping[str, Reference], duration: float) -> Vector:
    """Choose the times at which references are compared with couplings, shape (m,) [s].

    The times reach from zero to the end of the run, or of the longest reference if that is later.

    Args:
        references: references by robot.
        duration: duration of the run [s].
    """
    # Sines have no end, and the end of a trajectory that stands still may be infinite.
    ends = [reference.end_time() for reference in references.values() if not isinstance(reference, SineReference)]
    finite = [end for end in ends if np.isfinite(end)]
    return np.linspace(0.0, max([duration, *finite]), _COMPARISONS + 1)


def _ambiguity(coupled: CoupledAxes, axes: _Axes, candidates: Sequence[int]) -> InvalidParameter:
    """Make the error for references that leave open which of several axes gives way.

    Args:
        coupled: the axes and their equations.
        axes: the axes of all robots.
        candidates: indices of the axes that could give way.
    """
    names = [axes.names[axis] for axis in candidates]
    labels = [one.label for one in coupled.equations if len(set(names) & one.ratios.keys()) > 1]
    problem = f"no value for {' and '.join(names)}"
    return InvalidParameter("reference", problem, f"a value for one of them, since {listed(labels)} moves either")


def _let_follow(
    station: ResolvedStation,
    references: Mapping[str, Reference],
    played: Mapping[str, Reference],
    moved: Sequence[int],
    dependence: tuple[Vector, Vector],
) -> dict[str, Reference]:
    """Replace the references of axes that follow by combinations of the other axes' references.

    Args:
        station: the station with the robots; n is the number of their axes in all.
        references: reference of each robot, by name.
        played: the same references with the motions of prescribed axes.
        moved: indices of the axes that follow, among the axes of all robots.
        dependence: matrix (n, n) and offset (n,) [rad or m] that give the positions of the axes that follow.

    Returns:
        the references by robot; robots without axes that follow keep the same objects.
    """
    matrix, offset = dependence
    results = dict(references)
    # Indices of the robots' first axes among the axes of all robots.
    begins = {}
    count = 0
    for name, robot in station.robots.items():
        begins[name] = count
        count += len(robot.axes)
    for name, robot in station.robots.items():
        own = range(begins[name], begins[name] + len(robot.axes))
        followers = [axis for axis in own if axis in moved]
        if not followers:
            continue
        # The combination starts as the robot's own references, and the rows of the followers are replaced.
        rows = np.eye(count)[list(own)]
        shift = np.zeros(len(own))
        for axis in followers:
            rows[axis - begins[name]] = matrix[axis]
            shift[axis - begins[name]] = offset[axis]
        # References that are not read are left out: a sine cannot be combined with other motions.
        used = [other for other in station.robots if _reads(rows, begins[other], station.robots[other])]
        columns = [begins[other] + axis for other in used for axis in range(len(station.robots[other].axes))]
        results[name] = combine_references([played[other] for other in used], rows[:, columns], shift)
    return results


def _reads(rows: Vector, begin: int, robot: ResolvedRobot) -> bool:
    """Whether any row of a combination reads an axis of a robot; ``begin`` is the index of the robot's first axis."""
    return bool(rows[:, begin : begin + len(robot.axes)].any())
