"""Moves of an arm's tool along straight lines and along arcs of circles (RAPID's MoveL and MoveC).

A *way* is the path to one target: a function that gives the poses of the tool at fractions of the path, and the length
of the path. Poses are matrices (4, 4).
"""

from functools import partial
from itertools import pairwise
from typing import ClassVar, Unpack

import numpy as np

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.interpolation import Arc, stack_poses, turn
from simrob_drake.base.interpolation import poses as poses_between
from simrob_drake.base.messages import message
from simrob_drake.kinematics.registry import SolverLike
from simrob_drake.programs.moves.motion import ArmMotion, Rows, ToolMotion
from simrob_drake.programs.plan import Plan, target_name
from simrob_drake.programs.planning import (
    ARC_POINTS,
    POINTS,
    Planning,
    PoseTargets,
    WorkObject,
    places,
    points_of,
)
from simrob_drake.programs.segments import Way
from simrob_drake.programs.tape import with_entry
from simrob_drake.programs.timing import How


class MoveL(ToolMotion, ArmMotion):
    """A move of the tool along straight lines; see :meth:`Arm.move_l`."""

    key: ClassVar[str] = "move_l"

    def plan(self, planning: Planning) -> Plan:
        """Plan the move; see :func:`plan_move_l`."""
        return plan_move_l(
            planning, self.rows(planning), wobj=self.wobj, solver=self.solver, **self.how
        )


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
        planning: the start of the move.
        targets: poses of the tool in the work object's frame, or places (3,) or (k, 3) [m] that keep its orientation.
        wobj: the work object. If it is None, the world.
        solver: solver of the inverse kinematics. If it is None, that of the arm.
        how: see :class:`How`.

    Raises:
        Unreachable: no posture reaches a point. The message names it, why, and how near the best posture comes.
        BrokenPath: no continuous motion joins two points.
        InvalidParameter: the targets have a wrong shape, or an option is invalid.
        JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: the move exceeds a limit or
            has a collision. The message names the first such point.
    """
    # A line of the tool is no line of the joints: the postures along it are solved point by point.
    inverse = planning.inverse(solver)
    points = points_of(how, POINTS)
    poses = planning.poses(targets, wobj)
    ways = []
    # The first line begins at the tool's present pose. Each following one begins at the target before.
    for begin, end in pairwise([planning.pose, *poses]):
        length = float(np.linalg.norm(end[:3, 3] - begin[:3, 3]))
        ways.append(Way(partial(poses_between, begin, end), length))
    # The copy has the entry for a program's file, which repeats the move from what the user gave.
    plan = planning.plan_along(ways, inverse, how, points)
    return with_entry(plan, MoveL.key, planning, targets, how, wobj=wobj, solver=solver)


class MoveC(ToolMotion, ArmMotion):
    """A move of the tool along arcs of circles; see :meth:`Arm.move_c`."""

    key: ClassVar[str] = "move_c"

    via: Rows
    """Position [x y z] on the arc, or one for each of several arcs [m]."""

    def plan(self, planning: Planning) -> Plan:
        """Plan the move; see :func:`plan_move_c`."""
        return plan_move_c(
            planning, self.via, self.rows(planning), wobj=self.wobj, solver=self.solver, **self.how
        )


def plan_move_c(
    planning: Planning,
    via: PoseTargets,
    targets: PoseTargets,
    *,
    wobj: WorkObject = None,
    solver: SolverLike | None = None,
    **how: Unpack[How],
) -> Plan:
    """Plan a move that leads the tool centre point along arcs of circles, by default with 20 points on each.

    Args:
        planning: the start of the move.
        via: position (3,) on the arc, or one for each of several arcs (k, 3) [m]. Of poses only the position counts.
        targets: ends of the arcs: places (3,) or (k, 3) [m] that keep the orientation, or poses that turn the tool.
        wobj: the work object in whose frame they are. If it is None, the world.
        solver: solver of the inverse kinematics. If it is None, that of the arm.
        how: see :class:`How`.

    Raises:
        InvalidParameter: the points of an arc are on one line, `via` has another count than the targets, the points
            have a wrong shape, or an option is invalid.
        Unreachable: no posture reaches a point. The message names it, why, and how near the best posture comes.
        BrokenPath: no continuous motion joins two points.
        JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: the move exceeds a limit or
            has a collision. The message names the first such point.
    """
    inverse = planning.inverse(solver)
    points = points_of(how, ARC_POINTS)
    # Three points determine a circle: the begin, the middle point on the way, and the end. Of the middle point only the
    # position counts: the orientation turns evenly from the begin to the end.
    middles = places(via, planning.frame(wobj), "via")
    poses = planning.poses(targets, wobj)
    if len(middles) != len(poses):
        raise InvalidParameter(
            "via",
            message("programs.count_of_points", "{count} points", count=len(middles)),
            message(
                "programs.one_a_target",
                "one point for each of the {count} targets",
                count=len(poses),
            ),
        )
    ways = list[Way]()
    begin = planning.pose
    for index, (middle, end) in enumerate(zip(middles, poses, strict=True)):
        name = message(
            "programs.arc_to", "the arc to {target}", target=target_name(index, len(poses))
        )
        arc = Arc.through(begin[:3, 3], middle, end[:3, 3], name)
        ways.append(Way(partial(_poses_on_arc, arc, begin, end), arc.length))
        # The next arc begins where this one ends.
        begin = end
    plan = planning.plan_along(ways, inverse, how, points)
    return with_entry(plan, MoveC.key, planning, targets, how, wobj=wobj, solver=solver, via=via)


def _poses_on_arc(arc: Arc, begin: Vector, end: Vector, parts: Vector) -> Vector:
    """Poses (k, 4, 4) of a tool on an arc. Its orientation turns evenly from one pose to another.

    Args:
        arc: the arc, for the positions.
        begin: pose at the begin of the arc, shape (4, 4), for the orientation.
        end: pose at the end of the arc, shape (4, 4), for the orientation.
        parts: parts of the arc, from 0 at its begin to 1 at its end, shape (k,).
    """
    return stack_poses(arc.points(parts), turn(begin[:3, :3], end[:3, :3], parts))
