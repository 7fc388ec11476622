"""A move of an arm's tool along straight lines (RAPID's MoveL)."""

from functools import partial
from itertools import pairwise
from typing import ClassVar, Unpack

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.interpolation import poses as poses_between
from simrob_drake.kinematics.analytic import SolverLike
from simrob_drake.programs.moves.motion import ArmMotion, ToolMotion
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.planning import POINTS, Planning, PoseTargets, WorkObject, points_of
from simrob_drake.programs.segments import Way
from simrob_drake.programs.tape import recorded
from simrob_drake.programs.timing import How


class MoveL(ToolMotion, ArmMotion):
    """A tool that goes straight; see :meth:`Arm.move_l`."""

    key: ClassVar[str] = "move_l"
    title: ClassVar[str] = "MoveL"

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
        JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: names the first offending
            point.
    """
    inverse, points = planning.inverse(solver), points_of(how, POINTS)
    poses = planning.poses(targets, wobj)
    ways = [_line(begin, end) for begin, end in pairwise([planning.pose, *poses])]
    plan = planning.along(ways, inverse, how, points)
    return recorded(plan, MoveL.key, planning, targets, how, wobj=wobj, solver=solver)


def _line(begin: Vector, end: Vector) -> Way:
    """Return the straight way between two poses (4, 4)."""
    length = float(np.linalg.norm(end[:3, 3] - begin[:3, 3]))
    return Way(partial(poses_between, begin, end), length)
