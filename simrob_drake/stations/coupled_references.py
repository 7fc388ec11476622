"""References of coupled axes: asking for one axis moves its partners, and what contradicts a coupling is an error."""

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

_LOOKS = 500  # times at which references are compared with couplings


class _Axes(NamedTuple):
    """The n axes of all robots of a station, one robot after the other."""

    names: Sequence[str]
    asked: Sequence[Asked]
    sizes: Vector  # one of the user's units in SI, shape (n,)
    units: Sequence[str]  # the user's units
    bounds: Vector  # deviations that count as rounding, shape (n,) [rad or m]


def obey_couplings(
    station: ResolvedStation,
    references: Mapping[str, Reference],
    requested: Mapping[str, object],
    starts: Mapping[str, Vector],
) -> dict[str, Reference]:
    """Return references in which coupled axes that nobody asks for follow those that are asked.

    Args:
        station: with the couplings.
        references: of each robot, by name.
        requested: by robot, those of them that do not come from the station: they ask all axes.
        starts: where each robot begins, shape (n,) [rad or m]; at its initial posture unless given.

    Returns:
        the references; those of robots without such axes are the same objects.

    Raises:
        InvalidParameter: references contradict a coupling, or leave open which axis gives way.
    """
    coupled = station.coupled
    if not coupled:
        return dict(references)
    axes = _axes_of(station, requested)
    played = {name: _with_prescribed(robot, references[name]) for name, robot in station.robots.items()}
    times = _looks(played, station.config.duration)
    positions = np.hstack([reference_values(played[name], times) for name in station.robots])
    begin = np.concatenate([starts.get(name, robot.initial) for name, robot in station.robots.items()])
    # A resumed run begins with what its solver left of a gap, which is no contradiction: only changes have to agree.
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
    """Return a posture in which the axes of a robot that are coupled to named ones are where these take them.

    Args:
        station: with the couplings.
        robot: the robot's name; the other robots stay where they are.
        posture: of its axes, shape (n,) [rad or m].
        named: indices of the axes whose positions are asked for.
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
    first = 0
    for name, one in station.robots.items():
        if name == robot:
            break
        first += len(one.axes)
    found = whole[first : first + len(posture)]
    bounds = station.robots[robot].model.bounds(ROUNDING_DEG, ROUNDING_METRES)
    return np.where(np.abs(found - posture) > bounds, found, posture)


def _axes_of(station: ResolvedStation, requested: Mapping[str, object]) -> _Axes:
    """Collect the axes of all robots, with how firmly their references ask for them."""
    robots = station.robots.values()
    return _Axes(
        names=station.coupled.names,
        asked=[one for robot in robots for one in _firmness(station, robot, is_requested=robot.name in requested)],
        sizes=np.concatenate([robot.model.user_units for robot in robots]),
        units=[unit for robot in robots for unit in robot.model.unit_names],
        bounds=np.concatenate([robot.model.bounds(ROUNDING_DEG, ROUNDING_METRES) for robot in robots]),
    )


def _firmness(station: ResolvedStation, robot: ResolvedRobot, *, is_requested: bool) -> list[Asked]:
    """How firmly each of the n axes of a robot is asked for its motion."""
    config = station.config
    asked = config.reference_of(robot.name).asked(robot.model)
    if is_requested:
        asked = [Asked.NAMED] * len(robot.axes)
        # Programs press fingers on what they hold, as deep as their force takes.
        for finger in robot.model.fingers:
            asked[finger] = Asked.PASSIVE
    servo = config.servo_of(robot.name)
    knows_model = servo.law == "computed_torque" or servo.feedforward == "inverse_dynamics"
    if config.mode == "dynamic" and not knows_model:
        for axis in np.flatnonzero((robot.gains.kp == 0) & (robot.gains.ki == 0)).tolist():
            asked[axis] = Asked.PASSIVE
    for axis in robot.prescribed:
        asked[axis] = Asked.NAMED
    return asked


def _with_prescribed(robot: ResolvedRobot, reference: Reference) -> Reference:
    """Return the reference of a robot with the motions of its prescribed axes in their places."""
    if not robot.prescribed:
        return reference
    count = len(robot.axes)
    sources = [reference, *robot.prescribed.values()]
    matrix = np.hstack([np.eye(count), np.zeros((count, len(robot.prescribed)))])
    for number, axis in enumerate(robot.prescribed):
        matrix[axis] = 0.0
        matrix[axis, count + number] = 1.0
    return combine_references(sources, matrix, np.zeros(count))


def _looks(references: Mapping[str, Reference], duration: float) -> Vector:
    """Times at which references are compared with couplings, shape (m,) [s]."""
    ends = [reference.end_time() for reference in references.values() if not isinstance(reference, SineReference)]
    finite = [end for end in ends if np.isfinite(end)]
    return np.linspace(0.0, max([duration, *finite]), _LOOKS + 1)


def _ambiguity(coupled: CoupledAxes, axes: _Axes, candidates: Sequence[int]) -> InvalidParameter:
    """The error for references that leave open which of several axes gives way."""
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
    """Return references in which some axes follow others.

    Args:
        station: of the robots.
        references: of each robot, by name.
        played: the same with the motions of prescribed axes.
        moved: indices of the axes that follow, among those of all robots.
        dependence: how they follow, a matrix (n, n) and an offset (n,) [rad or m].
    """
    matrix, offset = dependence
    whole, first = dict(references), 0
    begins = {}
    for name, robot in station.robots.items():
        begins[name] = first
        first += len(robot.axes)
    for name, robot in station.robots.items():
        own = range(begins[name], begins[name] + len(robot.axes))
        followers = [axis for axis in own if axis in moved]
        if not followers:
            continue
        rows, shift = np.eye(first)[list(own)], np.zeros(len(own))
        for axis in followers:
            rows[axis - begins[name]] = matrix[axis]
            shift[axis - begins[name]] = offset[axis]
        used = [other for other in station.robots if _reads(rows, begins[other], station.robots[other])]
        columns = [begins[other] + axis for other in used for axis in range(len(station.robots[other].axes))]
        whole[name] = combine_references([played[other] for other in used], rows[:, columns], shift)
    return whole


def _reads(rows: Vector, begin: int, robot: ResolvedRobot) -> bool:
    """Whether rows of a combination read an axis of a robot, whose axes begin at an index."""
    return bool(rows[:, begin : begin + len(robot.axes)].any())
