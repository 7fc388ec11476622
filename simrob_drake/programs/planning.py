"""What planning a move of an arm starts from: its targets, as users give them, and what all moves share."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol, TypeAlias, get_args, runtime_checkable

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
from simrob_drake.base.interpolation import stacked
from simrob_drake.base.messages import message
from simrob_drake.base.sections import FARTHEST, MOST_TURN
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.registry import SolverLike, solver_for
from simrob_drake.kinematics.solver import Solver
from simrob_drake.programs.free_path import FreeSpace
from simrob_drake.programs.plan import CHECKED, Check, Plan, check_limits, check_rates, check_tool_speed, target_name
from simrob_drake.programs.segments import PathPoint, Segment, Way, pose_segment, through_zones, zone_size
from simrob_drake.programs.time_optimal import Motors
from simrob_drake.programs.timing import How, Limits, is_free, remedy, through_all, timed
from simrob_drake.programs.torques import check_torques, slowed_for_motors
from simrob_drake.robots.catalog import RobotModel


@runtime_checkable
class HasTool(Protocol):
    """A robot in whose tool's frame targets may be, such as an :class:`~simrob_drake.Arm`."""

    def tool_pose(self) -> RigidTransform:
        """Return where its tool centre point is now, in the world."""


WorkObject: TypeAlias = str | PoseLike | HasTool | None
"""In whose frame targets are: a piece's name (its tool centre point) or one of its frames as ``piece.frame``, a robot's
name or an arm (its tool centre point), a pose in any form, or None for the world."""
PoseTargets: TypeAlias = Targets
"""One pose or many, in any form, or places (3,) or (k, 3) that keep the tool's orientation."""


def world_poses(targets: PoseTargets, wobj: RigidTransform, turn: Vector, name: str = "targets") -> Vector:
    """Return targets in a work object's frame, poses or places (3,) or (k, 3), as poses in the world, shape (k, 4, 4).

    Places take the orientation ``turn`` (3, 3) in the world. Raises InvalidParameter, with ``name``: another shape, or
    not finite.
    """
    check_units(targets, name)
    if is_place(targets):
        points = places(targets, wobj, name)
        return stacked(points, np.broadcast_to(turn, (len(points), 3, 3)))
    matrices: Vector = wobj.GetAsMatrix4() @ pose_matrices(targets, name)
    return matrices


def places(points: npt.ArrayLike | PoseTargets, wobj: RigidTransform, name: str) -> Vector:
    """Return places (3,) or (k, 3), or of poses, of a frame in the world (k, 3) [m]; raises InvalidParameter."""
    if not is_place(points):
        return np.asarray((wobj.GetAsMatrix4() @ pose_matrices(points, name))[:, :3, 3])
    rows = np.atleast_2d(finite(points))
    if not rows.size:
        raise InvalidParameter(name, points, message("programs.places_of_three", "places of three finite numbers [m]"))
    return np.asarray(rows @ wobj.rotation().matrix().T + wobj.translation())


def numbers_or_nothing(targets: Any) -> Vector:
    """Return pose vectors or places as they are; an empty array of poses in other forms, and of what is no pose."""
    try:
        rows: Vector = np.asarray(targets, dtype=float)
    except (TypeError, ValueError, OverflowError):  # transforms, or rows of different lengths
        return np.zeros((0, 3))
    return rows if rows.ndim in (1, 2) and rows.shape[-1] in (3, POSE_SIZE) else np.zeros((0, 3))


def check_units(targets: Any, name: str) -> None:
    """Refuse poses and places whose numbers can only be millimetres or degrees; raises InvalidParameter: which."""
    rows = np.atleast_2d(numbers_or_nothing(targets))
    for values, most, unit, other, hint in (
        (
            rows[:, :3],
            FARTHEST,
            "m",
            message("programs.millimetres", "millimetres"),
            message("programs.lengths_in_metres", "lengths are in metres"),
        ),
        (
            rows[:, 3:],
            MOST_TURN,
            "rad",
            message("programs.degrees_word", "degrees"),
            message("programs.angles_in_radians", "angles are in radians, as np.deg2rad() or targets_deg give them"),
        ),
    ):
        beyond = values[np.abs(values) > most]
        if beyond.size:
            raise InvalidParameter(
                name,
                message("programs.one_with_value", "one with {beyond:g} {unit}", beyond=beyond[0], unit=unit),
                message("programs.in_si_units", "in SI units; were these {other}? {hint}", other=other, hint=hint),
            )


def is_place(targets: npt.ArrayLike | PoseTargets) -> bool:
    """Tell whether targets are places [x y z], not poses."""
    if isinstance(targets, RigidTransform):
        return False
    if isinstance(targets, Sequence) and any(isinstance(target, RigidTransform) for target in targets):
        return False
    try:
        shape = np.shape(targets)
    except ValueError:  # ragged
        return False
    return len(shape) in (1, 2) and shape[-1] == 3


def is_single(targets: PoseTargets) -> bool:
    """Tell whether targets are one pose or place, not rows of them."""
    return isinstance(targets, RigidTransform) or np.shape(targets) in ((3,), (6,), (4, 4))


def pose_numbers(pose: PoseLike) -> list[float]:
    """Return a pose as a file has it, [x y z Rz Ry Rx]; numbers that it was given by are kept to the last bit."""
    if not isinstance(pose, RigidTransform) and np.shape(pose) == (POSE_SIZE,):
        return [float(value) for value in np.asarray(pose)]
    return [float(value) for value in pose_from_transform(as_transform(pose))]


def row_numbers(targets: Any) -> Any:
    """Return targets as numbers, pose vectors in place of matrices and transforms; a name stays one."""
    if isinstance(targets, str):
        return targets
    if is_place(targets):
        return np.asarray(targets, dtype=float).tolist()
    try:
        values: Vector = np.asarray(targets, dtype=float)
    except (TypeError, ValueError):  # transforms
        values = np.zeros((4, 4))
    return values.tolist() if values.shape[-2:] != (4, 4) else poses_from_matrices(pose_matrices(targets, "")).tolist()


POINTS, ARC_POINTS = 10, 20  # points on the way to a target unless others are asked for, as in SimRob; of arcs

_MOST_POINTS = 10_000
_POINTS_A_ZONE, _ENOUGH = 4, 2000


@dataclass(frozen=True)
class Planning:
    """What planning a move of one robot starts from."""

    robot: str  # its name in the station
    model: RobotModel
    chain: Chain  # from the world to the tool
    start: Vector  # the posture from which the move begins, shape (n,) [rad or m]
    solver: SolverLike  # of moves that name none
    rate_limits: Limits  # of the axes
    frame: Callable[[WorkObject], RigidTransform]  # gives the pose of a work object in the world
    collide: Callable[[Plan], None]  # raises where a plan leads into something
    motors: Callable[[Sequence[str]], Motors]  # gives what those of robots that move together can do
    space: Callable[[Sequence[str]], FreeSpace]  # gives what robots that move together must not touch

    @property
    def pose(self) -> Vector:
        """The pose of the tool at the start, shape (4, 4)."""
        return np.asarray(self.chain.forward(self.start)[0])

    def inverse(self, solver: SolverLike | None) -> Solver:
        """Return the solver of the inverse kinematics, the usual one if None."""
        return solver_for(self.chain, self.solver if solver is None else solver)

    def postures(self, targets: npt.ArrayLike | str, name: str = "targets") -> Vector:
        """Return postures (k, n) [rad or m], also of one by name; where those of fingers are left out, they stay."""
        if isinstance(targets, str):
            targets = self.model.posture(targets, self.start)
        rows, fingers = numbers(targets), list(self.model.fingers)
        if fingers and rows.ndim in (1, 2) and rows.shape[-1] == len(self.start) - len(fingers):
            whole = np.tile(self.start, (*rows.shape[:-1], 1)) if rows.ndim > 1 else self.start.copy()
            whole[..., [place for place in range(len(self.start)) if place not in fingers]] = rows
            rows = whole
        return self.chain.postures(rows if fingers else targets, name)

    def poses(self, targets: PoseTargets, wobj: WorkObject) -> Vector:
        """Return targets in a work object's frame as poses in the world, shape (k, 4, 4)."""
        return world_poses(targets, self.frame(wobj), self.pose[:3, :3])

    def along(self, ways: Sequence[Way], inverse: Solver, how: How, points: int) -> Plan:
        """Plan a move whose tool goes one way after the other."""
        zone = zone_of(how, len(ways))
        start, segments = self.start, list[Segment]()
        for index, (way, count) in enumerate(grouped(ways, zone, points)):
            name = target_name(index, len(ways))
            segments.append(pose_segment(inverse, way, start, points=count, target=name))
            start = segments[-1].end
        return self.checked(segments, how, points)

    def checked(
        self,
        segments: list[Segment],
        how: How,
        points: int,
        rows: Vector | None = None,
        *,
        through: bool = False,
        hint: str = "",
    ) -> Plan:
        """Give segments their times, and look at the move: first at the targets, for which messages may have a hint."""
        if through:
            plan = through_all(self.robot, segments, how, points, self.rate_limits)
        else:
            plan = timed(self.robot, segments, how, points, self.rate_limits, lambda: self.motors([self.robot]))
        ends = np.array([segment.end for segment in segments]) if rows is None else rows
        check = how.get("check", CHECKED)  # not looked at yet: it may be anything
        is_unchecked = isinstance(check, str) and check == "nothing"
        if is_free(how) and not is_unchecked:
            plan = slowed_for_motors(self.motors([self.robot]), plan)
        plan = self.looked_at(plan, how, ends, hint)
        if plan.check == "collision":
            self.collide(plan)
        return plan

    def looked_at(self, plan: Plan, how: How, ends: Vector, hint: str = "") -> Plan:
        """Look at the limits of a plan, first of its ends (k, n), for which messages may have a hint."""
        asked = how.get("check", CHECKED)
        check: Check = "limits" if asked is None else asked
        one_of(message("programs.check", "check"), check, get_args(Check))
        if check != "nothing":
            count = len(plan.arrivals)
            names = [PathPoint(plan.points, target_name(index, count)) for index in range(count)]
            looks, times = plan.looks, plan.arrivals[-len(ends) :]
            check_limits(self.chain, times, ends, lambda at: names[int(np.searchsorted(plan.arrivals, at))], hint)
            check_limits(self.chain, looks, plan.postures(looks), plan.point_at)
            for order, limits in enumerate(self.rate_limits, 1):
                advice = partial(remedy, how, order)
                check_rates(self.chain, plan.trajectory, looks, limits, order, plan.point_at, advice)
            if self.model.tcp_speed is not None:
                check_tool_speed(self.chain, plan, self.model.tcp_speed, partial(remedy, how, 1))
            check_torques(self.motors([self.robot]), self.robot, plan, partial(remedy, how, 2))
        return replace(plan, check=check)


def zone_of(how: How, count: int) -> float:
    """Return the zone of a move to so many targets [m]; 0 to rest at each."""
    zone = zone_size(how.get("zone", "fine"))
    if zone and count < 2:
        expected = message(
            "programs.several_targets",
            "with several targets in one call, such as move_l([first, second]): a move rests at its last",
        )
        raise InvalidParameter("zone", how["zone"], expected)
    if zone and "times" in how:
        raise Unsuitable(
            "times",
            message("programs.zone_without_times", "targets with a zone are passed, and have no times of their own"),
        )
    return zone


def grouped(ways: Sequence[Way], zone: float, points: int) -> list[tuple[Way, int]]:
    """Return what is gone without a rest, and of how many points: each way, or with a zone [m] all as one."""
    if not zone:
        return [(way, points) for way in ways]
    whole = through_zones(ways, zone)
    enough = min(int(_POINTS_A_ZONE * whole.length / zone), _ENOUGH)  # for a spline that bends in the zones alone
    return [(whole, max(points * len(ways), enough))]


def points_of(how: How, default: int) -> int:
    """Return how many points are on the way to a target; other keys than those of :class:`How` are refused."""
    for key in how:
        one_of(message("programs.option_of_move", "option of a move"), key, How.__annotations__)
    return whole(how.get("points", default), "points", 1, _MOST_POINTS)


def degrees_hint(chain: Chain, rows: npt.NDArray[np.float64]) -> str:
    """Return what to ask of postures (k, n) that would do if they were in degrees; empty if they would not."""
    turned = np.where(chain.revolute, np.deg2rad(rows), rows)
    fit = chain.limits.are_within(turned)
    whole_turns = (np.abs(rows) > 2 * np.pi) & chain.revolute
    return (
        message(
            "programs.were_these_degrees", "; angles are in radians: were these degrees? np.deg2rad(...) turns them"
        )
        if fit and whole_turns.any()
        else ""
    )
