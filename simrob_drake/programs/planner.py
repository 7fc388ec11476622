"""Plan the moves of one robot from where it is: RAPID's words, with everything checked before anything moves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, Unpack, get_args

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from simrob_drake.errors import InvalidParameter, one_of
from simrob_drake.frames import Vector
from simrob_drake.given import truth, whole
from simrob_drake.interpolation import Arc, stacked, turn
from simrob_drake.interpolation import poses as poses_between
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.registry import SolverLike, solver_for
from simrob_drake.kinematics.solver import Solver
from simrob_drake.programs.checks import check_limits, check_rates
from simrob_drake.programs.plan import Check, Plan, target_name
from simrob_drake.programs.segments import Segment, joint_segment, joint_way, pose_segment
from simrob_drake.programs.targets import PoseTargets, WorkObject, places, world_poses
from simrob_drake.programs.telling import told
from simrob_drake.programs.timing import How, Limits, remedy, through_all, timed
from simrob_drake.programs.zones import Way, through_zones, zone_size

POINTS, ARC_POINTS = 10, 20
"""Points on the way to a target unless given, as in SimRob; of arcs."""

_MOST_POINTS = 10_000
_POINTS_A_ZONE, _ENOUGH = 4, 2000


@dataclass(frozen=True)
class Planner:
    """Plans moves of one robot; nothing moves.

    All moves begin at rest where the robot's reference is, and rest at their end; of several targets they rest at each
    unless they have a ``zone``, but for those of :meth:`move_abs_j` and :meth:`move_j`, which pass through smoothly
    unless ``stop`` is set.
    """

    robot: str  # its name
    chain: Chain  # from the world to the tool
    start: Vector  # the posture from which the move begins, shape (n,) [rad or m]
    solver: SolverLike  # of moves that name none
    rate_limits: Limits  # of the axes
    frame: Callable[[WorkObject], RigidTransform]  # gives the pose of a work object in the world
    collide: Callable[[Plan], None]  # raises where a plan leads into something

    def __repr__(self) -> str:
        """Say in one line whose moves it plans."""
        return f"<Planner of {self.robot}: {self.chain!r}>"

    def move_abs_j(self, targets: npt.ArrayLike, *, stop: bool = False, **how: Unpack[How]) -> Plan:
        """Plan a move to one posture (n,) or through many (k, n) [rad or m].

        Raises:
            InvalidParameter: targets of a wrong shape, or a duration that cannot be.
            JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: names the first offending
                point.
        """
        rows = self.chain.postures(targets, "targets")
        points, zone = _points(how, POINTS), _zone(how, len(rows))
        if truth(stop, "stop") and zone:
            raise InvalidParameter("stop", stop, "left out with a zone")
        through = not stop and len(rows) > 1 and "zone" not in how
        if through and {"profile", "acceleration"} & {*how}:
            raise InvalidParameter("profile", "given", "given with stop=True or a zone: else the joints do not cruise")
        ways = [joint_way(self.chain, start, row) for start, row in pairwise([self.start, *rows])]
        segments = [joint_segment(way, points=count) for way, count in _grouped(ways, zone, points)]
        plan = self._checked(segments, how, points, rows, through=through, hint=_hint(self.chain, rows))
        return replace(plan, told=told("move_abs_j", self.robot, targets, how, stop=stop))

    def move_j(
        self,
        targets: PoseTargets,
        *,
        wobj: WorkObject = None,
        solver: SolverLike | None = None,
        stop: bool = False,
        **how: Unpack[How],
    ) -> Plan:
        """Plan a move to poses of the tool, straight in the space of the joints: the easiest way there.

        Args:
            targets: poses of the tool in the work object's frame, or places (3,) or (k, 3) that keep its orientation.
            wobj: the work object.
            solver: of the inverse kinematics; the nearest posture is taken.
            stop: rest at each target.
            how: see :class:`How`.

        Raises:
            Unreachable: names the target, why, and how near the best posture comes.
            JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: names the first offending
                point.
        """
        inverse = self._inverse(solver)
        poses = world_poses(targets, self.frame(wobj), self._pose()[:3, :3])
        solutions = inverse.solve(poses, self.start)
        if not solutions.reached.all():
            row = solutions.first_missed
            raise solutions.unreachable(row, target_name(row, len(poses)))
        plan = self.move_abs_j(solutions.positions, stop=stop, **how)
        return self._told(plan, "move_j", targets, how, wobj, solver, stop=stop)

    def move_l(
        self, targets: PoseTargets, *, wobj: WorkObject = None, solver: SolverLike | None = None, **how: Unpack[How]
    ) -> Plan:
        """Plan a move that leads the tool centre point along straight lines, turning about one axis on each.

        Args:
            targets: poses of the tool in the work object's frame, or places (3,) or (k, 3) that keep its orientation.
            wobj: the work object.
            solver: of the inverse kinematics.
            how: see :class:`How`.

        Raises:
            Unreachable, BrokenPath: names the point, why, and how near the best posture comes.
            JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: names the first offending
                point.
        """
        inverse, points = self._inverse(solver), _points(how, POINTS)
        poses = world_poses(targets, self.frame(wobj), self._pose()[:3, :3])
        ways = [_line(begin, end) for begin, end in pairwise([self._pose(), *poses])]
        return self._told(self._along(ways, inverse, how, points), "move_l", targets, how, wobj, solver)

    def move_c(
        self,
        via: PoseTargets,
        targets: PoseTargets,
        *,
        wobj: WorkObject = None,
        solver: SolverLike | None = None,
        **how: Unpack[How],
    ) -> Plan:
        """Plan a move that leads the tool centre point along arcs of circles.

        Args:
            via: a place (3,) on the arc, or one for each of several arcs (k, 3); of poses only the place counts.
            targets: where each arc ends: places (3,) or (k, 3) that keep the orientation, or poses that turn the tool.
            wobj: the work object in whose frame they are.
            solver: of the inverse kinematics.
            how: see :class:`How`; ``points`` are 20 unless given.

        Raises:
            InvalidParameter: points that lie on one line, or another number of them than of targets.
            Unreachable, BrokenPath: names the point, why, and how near the best posture comes.
            JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: names the first offending
                point.
        """
        inverse, points, frame = self._inverse(solver), _points(how, ARC_POINTS), self.frame(wobj)
        middles = places(via, frame, "via")
        poses = world_poses(targets, frame, self._pose()[:3, :3])
        if len(middles) != len(poses):
            raise InvalidParameter("via", f"{len(middles)} points", f"one a target, of which there are {len(poses)}")
        ways = [
            _arc_through(begin, middle, end, f"the arc to {target_name(index, len(poses))}")
            for index, (begin, middle, end) in enumerate(zip([self._pose(), *poses], middles, poses, strict=False))
        ]
        return self._told(self._along(ways, inverse, how, points), "move_c", targets, how, wobj, solver, via=via)

    def _told(
        self,
        plan: Plan,
        name: str,
        targets: PoseTargets,
        how: How,
        wobj: WorkObject,
        solver: SolverLike | None,
        **more: Any,
    ) -> Plan:
        """Return a plan with what a program's file would say in place of the call that made it."""
        used = self.solver if solver is None else solver
        move = told(name, self.robot, targets, how, wobj=wobj, solver=used, **more)
        return replace(plan, told=move, frame=None if wobj is None else self.frame(wobj))

    def _along(self, ways: Sequence[Way], inverse: Solver, how: How, points: int) -> Plan:
        """Plan a move whose tool goes one way after the other."""
        zone = _zone(how, len(ways))
        start, segments = self.start, list[Segment]()
        for index, (way, count) in enumerate(_grouped(ways, zone, points)):
            name = target_name(index, len(ways))
            segments.append(pose_segment(inverse, way, start, points=count, target=name))
            start = segments[-1].end
        return self._checked(segments, how, points)

    def _inverse(self, solver: SolverLike | None) -> Solver:
        return solver_for(self.chain, self.solver if solver is None else solver)

    def _pose(self) -> Vector:
        """Return the pose of the tool at the start, shape (4, 4)."""
        return np.asarray(self.chain.forward(self.start)[0])

    def _checked(
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
        check: Check = how.get("check", "limits")
        one_of("check", check, get_args(Check))
        plan = (through_all if through else timed)(self.robot, segments, how, points, self.rate_limits)
        if check != "nothing":
            names = [(points, target_name(index, len(plan.arrivals))) for index in range(len(plan.arrivals))]
            ends = np.array([segment.end for segment in segments]) if rows is None else rows
            looks, times = plan.looks, plan.arrivals[-len(ends) :]
            check_limits(self.chain, times, ends, lambda at: names[int(np.searchsorted(plan.arrivals, at))], hint)
            check_limits(self.chain, looks, plan.postures(looks), plan.named)
            for order, limits in enumerate(self.rate_limits, 1):
                check_rates(self.chain, plan.trajectory, looks, limits, order, plan.named, partial(remedy, how, order))
        if check == "collision":
            self.collide(plan)
        return replace(plan, check=check)


def _zone(how: How, count: int) -> float:
    """Return the zone of a move to so many targets [m]; 0 to rest at each."""
    zone = zone_size(how.get("zone", "fine"))
    if zone and count < 2:
        told = "with several targets in one call, such as move_l([first, second]): a move rests at its last"
        raise InvalidParameter("zone", how["zone"], told)
    if zone and "times" in how:
        raise InvalidParameter("times", how["times"], "left out with a zone: what is passed has no time of its own")
    return zone


def _grouped(ways: Sequence[Way], zone: float, points: int) -> list[tuple[Way, int]]:
    """Return what is gone without a rest, and of how many points: each way, or with a zone [m] all as one."""
    if not zone:
        return [(way, points) for way in ways]
    whole = through_zones(ways, zone)
    enough = min(int(_POINTS_A_ZONE * whole.length / zone), _ENOUGH)  # for a spline that bends in the zones alone
    return [(whole, max(points * len(ways), enough))]


def _line(begin: Vector, end: Vector) -> Way:
    """Return the straight way between two poses (4, 4)."""
    length = float(np.linalg.norm(end[:3, 3] - begin[:3, 3]))
    return Way(partial(poses_between, begin, end), length)


def _arc_through(begin: Vector, middle: Vector, end: Vector, name: str) -> Way:
    """Return the way on an arc from a pose (4, 4) through a place (3,) to a pose."""
    arc = Arc.through(begin[:3, 3], middle, end[:3, 3], name)
    return Way(lambda parts: stacked(arc.points(parts), turn(begin[:3, :3], end[:3, :3], parts)), arc.length)


def _hint(chain: Chain, rows: Vector) -> str:
    """Return what to ask of postures (k, n) that would do if they were in degrees; empty if they would not."""
    turned = np.where(chain.revolute, np.deg2rad(rows), rows)
    fit = ((turned >= chain.lower) & (turned <= chain.upper)).all()
    whole_turns = (np.abs(rows) > 2 * np.pi) & chain.revolute
    return (
        "; angles are in radians: were these degrees? np.deg2rad(...) turns them" if fit and whole_turns.any() else ""
    )


def _points(how: How, default: int) -> int:
    for key in how:
        one_of("option of a move", key, How.__annotations__)
    return whole(how.get("points", default), "points", 1, _MOST_POINTS)
