"""Planning of a move of an arm: its targets as users give them, and the steps that all moves share.

A target is a *pose* of the tool, a *place* (a position that keeps the tool's orientation), or a posture of the axes.
The frame of poses and places is the *work object*, see :data:`WorkObject`. A *way* is the path to one target, a
*segment* is a path from rest to rest on which the postures are known. With a *zone* the tool turns to the next target
before it reaches one: the ways are then joined to a single one. An *arrival* is the time at which a target is reached.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple, Protocol, TypeAlias, get_args, runtime_checkable

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from simrob_drake.base.arguments import whole
from simrob_drake.base.errors import InvalidParameter, Unsuitable, one_of
from simrob_drake.base.frames import (
    POSE_SIZE,
    PoseLike,
    Targets,
    Vector,
    as_transform,
    finite,
    numbers,
    pose_from_transform,
    pose_matrices,
    poses_from_matrices,
)
from simrob_drake.base.interpolation import stack_poses
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import keep_former_attributes
from simrob_drake.base.sections import FARTHEST, MOST_TURN
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.registry import SolverLike, solver_for
from simrob_drake.kinematics.solver import Solver
from simrob_drake.programs.free_path import FreeSpace
from simrob_drake.programs.plan import (
    CHECKED,
    Check,
    Plan,
    check_limits,
    check_rates,
    check_tool_speed,
    target_name,
)
from simrob_drake.programs.segments import (
    PathPoint,
    Segment,
    Way,
    pose_segment,
    through_zones,
    zone_size,
)
from simrob_drake.programs.smooth_path import RateLimits
from simrob_drake.programs.time_optimal import Motors
from simrob_drake.programs.timing import How, is_free, plan_timed, remedy, through_all
from simrob_drake.programs.torques import check_torques, slowed_for_motors
from simrob_drake.robots.catalog import RobotModel


@runtime_checkable
class HasTool(Protocol):
    """A robot in whose tool's frame targets may be, such as an :class:`~simrob_drake.Arm`."""

    def tool_pose(self) -> RigidTransform:
        """Current pose of its tool centre point in the world."""


WorkObject: TypeAlias = str | PoseLike | HasTool | None
"""Frame of targets.

It is the name of a piece or a robot, or an arm, each for its tool centre point; a frame of a piece as ``piece.frame``;
a pose in any form; or None for the world.
"""
PoseTargets: TypeAlias = Targets
"""One pose or several in any form, or places (3,) or (k, 3) [m] that keep the tool's orientation."""


def world_poses(
    targets: PoseTargets, wobj: RigidTransform, turn: Vector, name: str = "targets"
) -> Vector:
    """Convert targets in the frame of a work object to poses in the world, shape (k, 4, 4).

    Args:
        targets: one or several poses in any form, or places (3,) or (k, 3) [m].
        wobj: pose of the work object in the world.
        turn: rotation matrix of the orientation that the tool gets at places, shape (3, 3).
        name: name of the targets for error messages.

    Raises:
        InvalidParameter: the targets have another shape, are not finite, or seem to be in other units.
    """
    check_units(targets, name)
    # A place has no orientation: the tool keeps the one that it has in the world.
    if is_place(targets):
        points = places(targets, wobj, name)
        return stack_poses(points, np.broadcast_to(turn, (len(points), 3, 3)))
    matrices: Vector = wobj.GetAsMatrix4() @ pose_matrices(targets, name)
    return matrices


def places(points: npt.ArrayLike | PoseTargets, wobj: RigidTransform, name: str) -> Vector:
    """Convert places in the frame of a work object to positions in the world, shape (k, 3) [m].

    Args:
        points: places (3,) or (k, 3) [m], or poses, of which only the positions count.
        wobj: pose of the work object in the world.
        name: name of the places for error messages.

    Raises:
        InvalidParameter: there is no place, or a place or pose has a wrong shape or is not finite.
    """
    if not is_place(points):
        return np.asarray((wobj.GetAsMatrix4() @ pose_matrices(points, name))[:, :3, 3])
    rows = np.atleast_2d(finite(points))
    if not rows.size:
        raise InvalidParameter(
            name, points, message("programs.places_of_three", "places of three finite numbers [m]")
        )
    return np.asarray(rows @ wobj.rotation().matrix().T + wobj.translation())


def numbers_or_nothing(targets: Any) -> Vector:
    """Pose vectors (6,) or (k, 6), or places (3,) or (k, 3), as an array.

    The array is empty, with the shape (0, 3), for poses in other forms and for values that are no pose.
    """
    nothing = np.zeros((0, 3))
    try:
        rows: Vector = np.asarray(targets, dtype=float)
    except (TypeError, ValueError, OverflowError):  # transforms, or rows of different lengths
        return nothing
    has_pose_shape = rows.ndim in (1, 2) and rows.shape[-1] in (3, POSE_SIZE)
    return rows if has_pose_shape else nothing


def check_units(targets: Any, name: str) -> None:
    """Refuse poses and places whose numbers can only be millimetres or degrees.

    Only vectors are checked: poses as matrices or transforms, and values that are no pose, are accepted here.

    Args:
        targets: poses or places as the user gave them.
        name: name of the targets for the error message.

    Raises:
        InvalidParameter: a length or an angle is too large.
    """
    # People write vectors by hand. Matrices and transforms are computed.
    rows = np.atleast_2d(numbers_or_nothing(targets))
    _check_unit(
        rows[:, :3],
        name,
        largest=FARTHEST,
        unit="m",
        other=message("programs.millimetres", "millimetres"),
        remedy=message("programs.lengths_in_metres", "give lengths in metres"),
    )
    _check_unit(
        rows[:, 3:],
        name,
        largest=MOST_TURN,
        unit="rad",
        other=message("programs.degrees_word", "degrees"),
        remedy=message(
            "programs.angles_in_radians",
            "give angles in radians, by np.deg2rad() or targets_deg",
        ),
    )


def _check_unit(
    values: Vector, name: str, *, largest: float, unit: str, other: str, remedy: str
) -> None:
    """Refuse values that are too large to be in their unit.

    Args:
        values: the values, of any shape.
        name: name of the targets that they belong to.
        largest: largest value that is accepted.
        unit: unit of the values.
        other: name of the unit in which they may be by mistake.
        remedy: what to do, as a command.

    Raises:
        InvalidParameter: a value is larger.
    """
    beyond = values[np.abs(values) > largest]
    if beyond.size:
        problem = message(
            "programs.in_other_unit",
            "a value of {beyond:g} {unit} seems to be in {other}",
            beyond=beyond[0],
            unit=unit,
            other=other,
        )
        raise Unsuitable(name, problem, remedy)


def _has_transforms(targets: Any) -> bool:
    """Whether a sequence contains a RigidTransform. NumPy takes transforms for objects, as if they were numbers."""
    return isinstance(targets, Sequence) and any(
        isinstance(target, RigidTransform) for target in targets
    )


def is_place(targets: npt.ArrayLike | PoseTargets) -> bool:
    """Whether targets are places [x y z], one or several, not poses. It is False for values that are neither."""
    # For NumPy, a list of three transforms has the shape of a place.
    if isinstance(targets, RigidTransform) or _has_transforms(targets):
        return False
    try:
        shape = np.shape(targets)
    except ValueError:  # rows of different lengths
        return False
    return len(shape) in (1, 2) and shape[-1] == 3


def is_single(targets: PoseTargets) -> bool:
    """Whether targets are a single pose (transform, vector or matrix) or place, not several."""
    if isinstance(targets, RigidTransform):
        return True
    # For NumPy, a list of three transforms has the shape of a place, one of six that of a pose vector.
    return not _has_transforms(targets) and np.shape(targets) in ((3,), (6,), (4, 4))


def pose_numbers(pose: PoseLike) -> list[float]:
    """Pose as a file has it: [x y z Rz Ry Rx] [m, rad].

    Numbers of a pose vector are kept to the last bit: converting them to a transform and back would change them. Poses
    in other forms are converted.
    """
    if not isinstance(pose, RigidTransform) and np.shape(pose) == (POSE_SIZE,):
        return [float(value) for value in np.asarray(pose)]
    return [float(value) for value in pose_from_transform(as_transform(pose))]


def row_numbers(targets: Any, *, are_postures: bool = False) -> Any:
    """Targets as lists of numbers for a file: places, postures and pose vectors as they are.

    Matrices and transforms become pose vectors, one in each row. The name of a posture is returned unchanged.

    Args:
        targets: the targets.
        are_postures: whether they are postures of the axes: four of four axes have the shape of a matrix.
    """
    if isinstance(targets, str):
        return targets
    # A place stays a place: as a pose it would have an orientation of its own.
    if are_postures or is_place(targets):
        return np.asarray(targets, dtype=float).tolist()
    try:
        values: Vector = np.asarray(targets, dtype=float)
        are_matrices = values.shape[-2:] == (4, 4)
    except (TypeError, ValueError):  # transforms, which `pose_matrices` below reads as well
        are_matrices = True
    if are_matrices:
        return poses_from_matrices(pose_matrices(targets, "")).tolist()
    return values.tolist()


POINTS = 10
"""Default count of points on the way to a target, as in SimRob."""
ARC_POINTS = 20
"""Default count of points on an arc."""

_MOST_POINTS = 10_000  # largest count of points that a user may set
# A joined path bends within zones only. It is sampled so densely that a piece as long as the size of a zone has so many
# points, but not with more points than the largest count, however small the zones are.
_POINTS_PER_ZONE = 4
_MOST_POINTS_FOR_ZONES = 2000


@dataclass(frozen=True)
class Planning:
    """Start of a move of one robot, and its surroundings.

    Attributes:
        robot: name of the robot in the station.
        model: model of the robot.
        chain: its axes from the world to the tool.
        start: posture from which the move begins, shape (n,) [rad or m].
        solver: solver of the inverse kinematics for moves that name none.
        rate_limits: limits of speed and acceleration of the axes.
        frame: function that gives the pose of a work object in the world.
        collide: function that raises an error if a plan has a collision.
        motors: function that prepares the motors of robots, by their names, that move at the same time.
        space: function that prepares the space in which robots, by their names, have to move without collisions.
    """

    robot: str
    model: RobotModel
    chain: Chain
    start: Vector
    solver: SolverLike
    rate_limits: RateLimits
    frame: Callable[[WorkObject], RigidTransform]
    collide: Callable[[Plan], None]
    motors: Callable[[Sequence[str]], Motors]
    space: Callable[[Sequence[str]], FreeSpace]

    @property
    def pose(self) -> Vector:
        """Pose of the tool at the start, shape (4, 4)."""
        return np.asarray(self.chain.forward(self.start)[0])

    def inverse(self, solver: SolverLike | None) -> Solver:
        """Solver of the inverse kinematics for a move.

        Args:
            solver: name of a solver, or a solver. If it is None, that of the robot.

        Raises:
            UnknownName: there is no such solver.
            SimrobError: the solver does not suit the arm and its tool, or cannot be imported; see :func:`solver_for`.
        """
        # A move may name its own solver, such as one that allows the tool to turn.
        return solver_for(self.chain, self.solver if solver is None else solver)

    def postures(self, targets: npt.ArrayLike | str, name: str = "targets") -> Vector:
        """Read target postures of a user, shape (k, n) [rad or m].

        Args:
            targets: a posture (n,), several (k, n), or the name of one of the robot's postures. The positions of
                fingers may be left out: then the fingers stay.
            name: name of the targets for error messages.

        Raises:
            UnknownName: the robot has no posture of this name.
            InvalidParameter: the postures have a wrong shape, or numbers that are not finite.
        """
        if isinstance(targets, str):
            targets = self.model.posture(targets, self.start)
        fingers = list(self.model.fingers)  # indices of axes
        if not fingers:
            return self.chain.postures(targets, name)
        rows = numbers(targets)
        # A posture without fingers moves the arm and leaves the grip as it is.
        others = [axis for axis in range(len(self.start)) if axis not in fingers]
        if rows.ndim in (1, 2) and rows.shape[-1] == len(others):
            all_axes = np.broadcast_to(self.start, (*rows.shape[:-1], len(self.start))).copy()
            all_axes[..., others] = rows
            rows = all_axes
        return self.chain.postures(rows, name)

    def units_of(self, count: int) -> Vector | None:
        """Size of the user's unit of each number of a posture that has `count` numbers, in SI, shape (count,).

        It is pi/180 for degrees, 1 for metres. A posture has a number for each axis, or for each axis that is no
        finger, as :meth:`postures` takes it. Returns None for another count.
        """
        units = self.model.user_units
        others = [axis for axis in range(len(units)) if axis not in self.model.fingers]
        if count == len(units):
            return units
        return np.asarray(units[others]) if count == len(others) else None

    def poses(self, targets: PoseTargets, wobj: WorkObject) -> Vector:
        """Convert targets in the frame of a work object to poses in the world, shape (k, 4, 4).

        For the errors see :func:`world_poses`.
        """
        # Places keep the orientation that the tool has at the start.
        return world_poses(targets, self.frame(wobj), self.pose[:3, :3])

    def plan_along(self, ways: Sequence[Way], inverse: Solver, how: How, points: int) -> Plan:
        """Plan a move of the tool along paths: find the postures on them, plan the timing, and check the move.

        Args:
            ways: path of poses to each target.
            inverse: solver of the inverse kinematics.
            how: options of the move.
            points: count of points on the way to each target.

        Raises:
            SimrobError: a point cannot be reached, or the move exceeds a limit or has a collision.
        """
        zone = zone_of(how, len(ways))
        start = self.start
        segments = list[Segment]()
        for index, (way, count) in enumerate(join_ways(ways, zone, points)):
            name = target_name(index, len(ways))
            segment = pose_segment(inverse, way, start, points=count, target=name)
            segments.append(segment)
            # Each segment begins where the solver ended, so that the same branch of postures is followed.
            start = segment.end
        return self.plan_segments(segments, how, points)

    def plan_segments(
        self,
        segments: list[Segment],
        how: How,
        points: int,
        rows: Vector | None = None,
        *,
        through: bool = False,
        hint: str = "",
    ) -> Plan:
        """Plan the timing of segments, and check the move.

        Args:
            segments: segments of the move.
            how: options of the move. `check` decides what is checked.
            points: count of points on the way to each target.
            rows: target postures, which are checked first, shape (k, n) [rad or m]. If it is None, the ends of the
                segments.
            through: whether the axes pass the targets without rest.
            hint: text that is added to messages about the targets; empty if there is none.

        Raises:
            UnknownName: the option `check` has an unknown value.
            SimrobError: the move exceeds a limit or has a collision.

        Warns:
            TorqueShortage: the move in its given time needs more torque than a motor gives.
        """
        if through:
            plan = through_all(self.robot, segments, how, points, self.rate_limits)
        else:
            plan = plan_timed(
                self.robot,
                segments,
                how,
                points,
                self.rate_limits,
                lambda: self.motors([self.robot]),
            )
        # Targets are checked before the way to them: their message is the clearest.
        ends = np.array([segment.end for segment in segments]) if rows is None else rows
        # Not validated yet: the user may have given a value of any type, for which `in` and `==` may fail.
        check = how.get("check", CHECKED)
        is_unchecked = isinstance(check, str) and check == "nothing"
        # If the user left the timing to the planner, the move may take as long as the motors need.
        if is_free(how) and not is_unchecked:
            plan = slowed_for_motors(self.motors([self.robot]), plan)
        plan = self.check_limits_of(plan, how, ends, hint)
        if plan.check == "collision":
            self.collide(plan)
        return plan

    def check_limits_of(self, plan: Plan, how: How, ends: Vector, hint: str = "") -> Plan:
        """Check the limits of a plan as its options demand. Collisions are not checked here.

        Args:
            plan: the plan.
            how: options of the move, of which `check` decides what is checked.
            ends: target postures, which are checked first, shape (k, n) [rad or m]. With zones there may be fewer than
                targets: the last ones.
            hint: text that is added to messages about the targets; empty if there is none.

        Returns:
            A copy of the plan with the value of the option `check`.

        Raises:
            UnknownName: the option `check` has an unknown value.
            SimrobError: the plan exceeds a limit. The message names the first such point.

        Warns:
            TorqueShortage: the move in its given time needs more torque than a motor gives.
        """
        # None in a program's file, `check:` without a value, means limits without collisions.
        requested = how.get("check", CHECKED)
        check: Check = "limits" if requested is None else requested
        one_of(message("programs.check", "check"), check, get_args(Check))
        if check == "nothing":
            return replace(plan, check=check)
        count = len(plan.arrivals)
        # A target is the last one of the points on its way.
        targets = [PathPoint(plan.points, target_name(index, count)) for index in range(count)]

        def target_at(time: float) -> PathPoint:
            """Target that is reached at a time [s], as the point that messages name."""
            return targets[int(np.searchsorted(plan.arrivals, time))]

        end_times = plan.arrivals[-len(ends) :]  # of the last targets, if there are fewer ends
        check_limits(self.chain, end_times, ends, target_at, hint)
        times = plan.looks
        # Between targets a spline may swing out beyond a limit that both ends respect.
        check_limits(self.chain, times, plan.postures(times), plan.point_at)
        # The order of the derivative: 1 for the limits of speed, 2 for those of acceleration.
        for order, limits in enumerate(self.rate_limits, start=1):
            advice = partial(remedy, how, order)
            check_rates(self.chain, plan.trajectory, times, limits, order, plan.point_at, advice)
        # Some arms have a rated speed of the tool in addition to the limits of their joints.
        if self.model.tcp_speed is not None:
            check_tool_speed(self.chain, plan, self.model.tcp_speed, partial(remedy, how, 1))
        check_torques(self.motors([self.robot]), self.robot, plan, partial(remedy, how, 2))
        return replace(plan, check=check)


def zone_of(how: How, count: int) -> float:
    """Size of the zones of a move [m]: the distance from a target at which the tool begins to turn to the next one.

    It is 0 if the option is not set or `fine`: then the zones do not change the move.

    Args:
        how: options of the move.
        count: count of targets.

    Raises:
        InvalidParameter: the zone is invalid.
        Unsuitable: a move with zones has a single target, or times of its targets.
    """
    zone = zone_size(how.get("zone", "fine"))
    # A zone rounds the corner between two paths: a single path has none.
    if zone and count < 2:
        raise Unsuitable(
            "zone",
            message("programs.rests_at_last", "a move rests at its last target"),
            message(
                "programs.several_targets",
                "give several targets in one call, such as move_l([first, second])",
            ),
        )
    if zone and "times" in how:
        raise Unsuitable(
            "times",
            message(
                "programs.zone_without_times",
                "the tool passes targets with a zone without stopping, so that they have no times",
            ),
        )
    return zone


class SampledWay(NamedTuple):
    """A path from rest to rest, and the count of points at which it is sampled."""

    way: Way
    points: int


def join_ways(ways: Sequence[Way], zone: float, points: int) -> list[SampledWay]:
    """Join paths between which the tool does not stop.

    Args:
        ways: path to each target. Lengths are those of the tool's path, for paths of joints, too.
        zone: size of the zones [m]. If it is 0, the move rests at each target, and no paths are joined.
        points: count of points on the way to each target.

    Returns:
        each path with its count of points, if the zone is 0. Otherwise a single path, with as many points as all paths
        have together, or more if the zones are small.

    Raises:
        InvalidParameter: the zone is larger than half of a path that leads into or out of one.
    """
    if not zone:
        return [SampledWay(way, points) for way in ways]
    joined = through_zones(ways, zone)
    # Small zones bend the path sharply: the points have to be close enough to follow them.
    needed = min(int(_POINTS_PER_ZONE * joined.length / zone), _MOST_POINTS_FOR_ZONES)
    return [SampledWay(joined, max(points * len(ways), needed))]


def points_of(how: How, default: int) -> int:
    """Count of points on the way to each target. The names of all options are checked, too.

    Args:
        how: options of the move.
        default: count if the options have none.

    Raises:
        UnknownName: an option is none of :class:`How`.
        InvalidParameter: the count is no integer, or out of range.
    """
    for key in how:
        one_of(message("programs.option_of_move", "option of a move"), key, How.__annotations__)
    return whole(how.get("points", default), "points", 1, _MOST_POINTS)


def degrees_hint(chain: Chain, rows: npt.NDArray[np.float64]) -> str:
    """Hint, for an error message, for postures that are likely in degrees by mistake.

    They would be within the limits if they were in degrees, and an angle is larger than a whole turn in radians.

    Args:
        chain: the axes.
        rows: the postures as the user gave them, shape (k, n) [rad or m].

    Returns:
        The hint, or an empty text if the postures are not likely to be in degrees.
    """
    # Sliding axes are in metres in both cases.
    in_radians = np.where(chain.revolute, np.deg2rad(rows), rows)
    would_fit = chain.limits.are_within(in_radians)
    # An angle of more than a whole turn is not likely to be meant in radians.
    exceeds_turn = (np.abs(rows) > 2 * np.pi) & chain.revolute
    if would_fit and exceeds_turn.any():
        return message(
            "programs.were_these_degrees",
            "; angles are in radians: if these are degrees, convert them by np.deg2rad(...)",
        )
    return ""


keep_former_attributes(Planning, along="plan_along")
