"""A move of an arm's tool along straight lines (RAPID's MoveL)."""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import ClassVar

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.interpolation import poses as poses_between
from simrob_drake.kinematics.analytic import SolverLike
from simrob_drake.programs.moves.motion import ArmMotion, ToolMotion, recorded
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.planning import POINTS, Planning, points_of
from simrob_drake.programs.targets import PoseTargets, WorkObject
from simrob_drake.programs.timing import How
from simrob_drake.programs.zones import Way


class MoveL(ToolMotion, ArmMotion):
    """A tool that goes straight; see :meth:`Arm.move_l`."""

    key: ClassVar[str] = "move_l"
    title: ClassVar[str] = "MoveL"

    def plan(self, planning: Planning) -> Plan:
        """Return the move, planned."""
        return plan_move_l(planning, self.rows(planning), self.how, wobj=self.wobj, solver=self.solver)


def plan_move_l(
    planning: Planning,
    targets: PoseTargets,
    how: How,
    *,
    wobj: WorkObject = None,
    solver: SolverLike | None = None,
) -> Plan:
    """Plan it from Python; see :meth:`simrob_drake.programs.planner.Planner.move_l`."""
    inverse, points = planning.inverse(solver), points_of(how, POINTS)
    poses = planning.poses(targets, wobj)
    ways = [_line(begin, end) for begin, end in pairwise([planning.pose, *poses])]
    plan = planning.along(ways, inverse, how, points)
    return recorded(plan, MoveL.key, planning, targets, how, wobj=wobj, solver=solver)


def _line(begin: Vector, end: Vector) -> Way:
    """Return the straight way between two poses (4, 4)."""
    length = float(np.linalg.norm(end[:3, 3] - begin[:3, 3]))
    return Way(partial(poses_between, begin, end), length)
