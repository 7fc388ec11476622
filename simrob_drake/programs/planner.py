"""Plan the moves of one robot from where it is: RAPID's words, with everything checked before anything moves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Unpack, get_args

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
from simrob_drake.programs.checks import check_limits, check_speeds, look_times, speed_ratio
from simrob_drake.programs.plan import Check, How, Plan, arrivals, joined, target_name
from simrob_drake.programs.segments import Segment, joint_segment, pose_segment
from simrob_drake.programs.targets import PoseTargets, WorkObject, places, world_poses

POINTS, ARC_POINTS = 10, 20
"""Points on the way to a target unless given, as in SimRob; of arcs."""

_MOST_POINTS = 10_000
_LESS_THAN_FULL = 0.98  # of the joints' speeds, where durations are left to us

_Way = tuple[Callable[[Vector], Vector], float]  # the poses (k, 4, 4) at its parts (k,), and its length [m]


@dataclass(frozen=True)
class Planner:
    """Plans moves of one robot; nothing moves.

    All moves begin at rest where the robot's reference is, and rest at their end; of several targets they rest at each,
    but for those of :meth:`move_abs_j` and :meth:`move_j`, which pass through smoothly unless ``stop`` is set.
    """

    robot: str  # its name
    chain: Chain  # from the world to the tool
    start: Vector  # the posture from which the move begins, shape (n,) [rad or m]
    solver: SolverLike  # of moves that name none
    speed_limits: Vector  # of the axes, shape (n,) [rad/s or m/s]
    frame: Callable[[WorkObject], RigidTransform]  # gives the pose of a work object in the world
    collide: Callable[[Plan], None]  # raises where a plan leads into something

    def __repr__(self) -> str:
        """Say in one line whose moves it plans."""
        return f"<Planner of {self.robot}: {self.chain!r}>"

    def move_abs_j(self, targets: npt.ArrayLike, *, stop: bool = False, **how: Unpack[How]) -> Plan:
        """Plan a move to one posture (n,) or through many (k, n) [rad or m].

        Raises:
            InvalidParameter: targets of a wrong shape, or a duration that cannot be.
            JointLimitExceeded, SpeedLimitExceeded, PathCollision: names the first offending point.
        """
        rows = self.chain.postures(targets, "targets")
        points, through = _points(how, POINTS), not truth(stop, "stop") and len(rows) > 1
        names = [target_name(index, len(rows)) for index in range(len(rows))]
        starts = [self.start, *rows[:-1]]
        segments = [
            joint_segment(self.chain, start, row, points=points, target=name)
            for start, row, name in zip(starts, rows, names, strict=True)
        ]
        return self._checked(segments, how, points, through=through, hint=_hint(self.chain, rows))

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
            JointLimitExceeded, SpeedLimitExceeded, PathCollision: names the first offending point.
        """
        inverse = self._inverse(solver)
        poses = world_poses(targets, self.frame(wobj), self._pose()[:3, :3])
        solutions = inverse.solve(poses, self.start)
        if not solutions.reached.all():
            row = solutions.first_missed
            raise solutions.unreachable(row, target_name(row, len(poses)))
        return self.move_abs_j(solutions.positions, stop=stop, **how)

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
            JointLimitExceeded, SpeedLimitExceeded, PathCollision: names the first offending point.
        """
        inverse, points = self._inverse(solver), _points(how, POINTS)
        poses = world_poses(targets, self.frame(wobj), self._pose()[:3, :3])
        ways: list[_Way] = [
            (partial(poses_between, begin, end), float(np.linalg.norm(end[:3, 3] - begin[:3, 3])))
            for begin, end in pairwise([self._pose(), *poses])
        ]
        return self._along(ways, inverse, how, points)

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
            JointLimitExceeded, SpeedLimitExceeded, PathCollision: names the first offending point.
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
        return self._along(ways, inverse, how, points)

    def _along(self, ways: Sequence[_Way], inverse: Solver, how: How, points: int) -> Plan:
        """Plan a move whose tool goes one way after the other."""
        segments: list[Segment] = []
        for index, (poses, length) in enumerate(ways):
            start, name = segments[-1].end if segments else self.start, target_name(index, len(ways))
            segments.append(pose_segment(inverse, poses, start, points=points, length=length, target=name))
        return self._checked(segments, how, points)

    def _inverse(self, solver: SolverLike | None) -> Solver:
        return solver_for(self.chain, self.solver if solver is None else solver)

    def _pose(self) -> Vector:
        """Return the pose of the tool at the start, shape (4, 4)."""
        return np.asarray(self.chain.forward(self.start)[0])

    def _checked(
        self, segments: list[Segment], how: How, points: int, *, through: bool = False, hint: str = ""
    ) -> Plan:
        """Give segments their times, and look at the move: first at the targets, for which messages may have a hint."""
        check: Check = how.get("check", "limits")
        one_of("check", check, get_args(Check))
        times, free = arrivals(segments, how, points)
        plan = self._plan(segments, times, points, through)
        if free:
            ratio = speed_ratio(plan.trajectory, look_times(plan.duration, points * len(times)), self.speed_limits)
            if ratio > _LESS_THAN_FULL:
                plan = self._plan(segments, times * ratio / _LESS_THAN_FULL, points, through)
        looks = look_times(plan.duration, points * len(times))
        if check != "nothing":
            names = [(points, target_name(index, len(times))) for index in range(len(times))]
            ends = np.array([segment.end for segment in segments])
            check_limits(
                self.chain, plan.arrivals, ends, lambda at: names[int(np.searchsorted(plan.arrivals, at))], hint
            )
            check_limits(self.chain, looks, plan.postures(looks), plan.named)
            check_speeds(self.chain, plan.trajectory, looks, self.speed_limits, plan.named)
        if check == "collision":
            self.collide(plan)
        return plan

    def _plan(self, segments: list[Segment], times: Vector, points: int, through: bool) -> Plan:
        if through:
            rows = np.array([self.start, *(segment.end for segment in segments)])
            whole = Segment(np.concatenate([[0.0], times / times[-1]]), rows, 0.0, "")
            return Plan(self.robot, joined([whole], times[-1:]), times, points)
        return Plan(self.robot, joined(segments, times), times, points)


def _arc_through(begin: Vector, middle: Vector, end: Vector, name: str) -> _Way:
    """Return the way on an arc from a pose (4, 4) through a place (3,) to a pose."""
    arc = Arc.through(begin[:3, 3], middle, end[:3, 3], name)
    return lambda parts: stacked(arc.points(parts), turn(begin[:3, :3], end[:3, :3], parts)), arc.length


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
