"""Moves of an arm's tool along straight lines and along arcs of circles (RAPID's MoveL and MoveC)."""

from functools import partial
from itertools import pairwise
from typing import ClassVar, Unpack

import numpy as np

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.interpolation import Arc, stacked, turn
from simrob_drake.base.interpolation import poses as poses_between
from simrob_drake.base.messages import message
from simrob_drake.kinematics.registry import SolverLike
from simrob_drake.programs.moves.motion import ArmMotion, Rows, ToolMotion
from simrob_drake.programs.plan import Plan, target_name
from simrob_drake.programs.planning import ARC_POINTS, POINTS, Planning, PoseTargets, WorkObject, places, points_of
from simrob_drake.programs.segments import Way
from simrob_drake.programs.tape import recorded
from simrob_drake.programs.timing import How


class MoveL(ToolMotion, ArmMotion):
    """A tool that goes straight; see :meth:`Arm.move_l`."""

    key: ClassVar[str] = "move_l"

    def plan(self, planning: Planning) -> Plan:
        """Return the move, planned."""
        return plan_move_l(planning, self.rows(planning), wobj=self.wobj, solver=self.solver, **self.how)


def plan_move_l(
    planning: Planning,
    targets: PoseTargets,
    *,
    wobj: WorkObject = None,
    solver: SolverLike | None = None,
    **how: Unpack[How],
) -> Plan:
    """Plan a move that leads the tool centre point along straight lines, turning about one axis on each.

    Args:
        planning: what the move starts from.
        targets: poses of the tool in the work object's frame, or places (3,) or (k, 3) that keep its orientation.
        wobj: the work object.
        solver: of the inverse kinematics.
        how: see :class:`How`.

    Raises:
        Unreachable, BrokenPath: names the point, why, and how near the best posture comes.
        JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: names the first bad point.
    """
    inverse, points = planning.inverse(solver), points_of(how, POINTS)
    poses = planning.poses(targets, wobj)
    ways = [
        Way(partial(poses_between, begin, end), float(np.linalg.norm(end[:3, 3] - begin[:3, 3])))
        for begin, end in pairwise([planning.pose, *poses])
    ]
    plan = planning.along(ways, inverse, how, points)
    return recorded(plan, MoveL.key, planning, targets, how, wobj=wobj, solver=solver)


class MoveC(ToolMotion, ArmMotion):
    """A tool that goes along arcs; see :meth:`Arm.move_c`."""

    key: ClassVar[str] = "move_c"

    via: Rows
    """A place [x y z] on the arc, or one for each of several [m]."""

    def plan(self, planning: Planning) -> Plan:
        """Return the move, planned."""
        return plan_move_c(planning, self.via, self.rows(planning), wobj=self.wobj, solver=self.solver, **self.how)


def plan_move_c(
    planning: Planning,
    via: PoseTargets,
    targets: PoseTargets,
    *,
    wobj: WorkObject = None,
    solver: SolverLike | None = None,
    **how: Unpack[How],
) -> Plan:
    """Plan a move that leads the tool centre point along arcs of circles.

    Args:
        planning: what the move starts from.
        via: a place (3,) on the arc, or one for each of several arcs (k, 3); of poses only the place counts.
        targets: where each arc ends: places (3,) or (k, 3) that keep the orientation, or poses that turn the tool.
        wobj: the work object in whose frame they are.
        solver: of the inverse kinematics.
        how: see :class:`How`; ``points`` are 20 unless given.

    Raises:
        InvalidParameter: points that lie on one line, or another number of them than of targets.
        Unreachable, BrokenPath: names the point, why, and how near the best posture comes.
        JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: names the first bad point.
    """
    inverse, points = planning.inverse(solver), points_of(how, ARC_POINTS)
    middles = places(via, planning.frame(wobj), "via")
    poses = planning.poses(targets, wobj)
    if len(middles) != len(poses):
        raise InvalidParameter(
            "via",
            message("programs.count_of_points", "{count} points", count=len(middles)),
            message("programs.one_a_target", "one a target, of which there are {count}", count=len(poses)),
        )
    ways = list[Way]()
    for index, (begin, middle, end) in enumerate(zip([planning.pose, *poses], middles, poses, strict=False)):
        arc = Arc.through(
            begin[:3, 3],
            middle,
            end[:3, 3],
            message("programs.arc_to", "the arc to {target}", target=target_name(index, len(poses))),
        )
        ways.append(Way(partial(_on_arc, arc, begin, end), arc.length))
    plan = planning.along(ways, inverse, how, points)
    return recorded(plan, MoveC.key, planning, targets, how, wobj=wobj, solver=solver, via=via)


def _on_arc(arc: Arc, begin: Vector, end: Vector, parts: Vector) -> Vector:
    return stacked(arc.points(parts), turn(begin[:3, :3], end[:3, :3], parts))
