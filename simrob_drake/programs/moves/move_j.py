"""A move of an arm's tool to poses, straight in the joints: the easiest way there (RAPID's MoveJ)."""

from __future__ import annotations

from typing import ClassVar

from simrob_drake.kinematics.analytic import SolverLike
from simrob_drake.programs.moves.motion import ArmMotion, ToolMotion, recorded
from simrob_drake.programs.moves.move_abs_j import plan_move_abs_j
from simrob_drake.programs.plan import Plan, target_name
from simrob_drake.programs.planning import Planning
from simrob_drake.programs.targets import PoseTargets, WorkObject
from simrob_drake.programs.timing import How
from simrob_drake.sections import Boolean


class MoveJ(ToolMotion, ArmMotion):
    """A tool that goes to poses the easiest way; see :meth:`Arm.move_j`."""

    key: ClassVar[str] = "move_j"
    title: ClassVar[str] = "MoveJ"

    stop: Boolean = False
    """Rest at each target."""

    def plan(self, planning: Planning) -> Plan:
        """Return the move, planned."""
        return plan_move_j(planning, self.rows(planning), self.how, wobj=self.wobj, solver=self.solver, stop=self.stop)


def plan_move_j(
    planning: Planning,
    targets: PoseTargets,
    how: How,
    *,
    wobj: WorkObject = None,
    solver: SolverLike | None = None,
    stop: bool = False,
) -> Plan:
    """Plan it from Python; see :meth:`simrob_drake.programs.planner.Planner.move_j`."""
    inverse = planning.inverse(solver)
    poses = planning.poses(targets, wobj)
    solutions = inverse.solve(poses, planning.start)
    if not solutions.reached.all():
        row = solutions.first_missed
        raise solutions.unreachable(row, target_name(row, len(poses)))
    plan = plan_move_abs_j(planning, solutions.positions, how, stop=stop)
    return recorded(plan, MoveJ.key, planning, targets, how, wobj=wobj, solver=solver, stop=stop)
