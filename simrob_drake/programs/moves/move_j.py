"""A move of an arm's tool to poses, straight in the joints: the easiest way there (RAPID's MoveJ)."""

from typing import ClassVar, Unpack

from simrob_drake.kinematics.analytic import SolverLike
from simrob_drake.programs.moves.motion import ArmMotion, ToolMotion
from simrob_drake.programs.moves.move_abs_j import plan_move_abs_j
from simrob_drake.programs.plan import Plan, target_name
from simrob_drake.programs.planning import Planning, PoseTargets, WorkObject
from simrob_drake.programs.tape import recorded
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
        return plan_move_j(
            planning, self.rows(planning), wobj=self.wobj, solver=self.solver, stop=self.stop, **self.how
        )


def plan_move_j(
    planning: Planning,
    targets: PoseTargets,
    *,
    wobj: WorkObject = None,
    solver: SolverLike | None = None,
    stop: bool = False,
    **how: Unpack[How],
) -> Plan:
    """Plan a move to poses of the tool, straight in the space of the joints: the easiest way there.

    Args:
        planning: what the move starts from.
        targets: poses of the tool in the work object's frame, or places (3,) or (k, 3) that keep its orientation.
        wobj: the work object.
        solver: of the inverse kinematics; the nearest posture is taken.
        stop: rest at each target.
        how: see :class:`How`.

    Raises:
        Unreachable: names the target, why, and how near the best posture comes.
        JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: names the first bad point.
    """
    inverse = planning.inverse(solver)
    poses = planning.poses(targets, wobj)
    solutions = inverse.solve(poses, planning.start)
    if not solutions.reached.all():
        row = solutions.first_missed
        raise solutions.unreachable(row, target_name(row, len(poses)))
    plan = plan_move_abs_j(planning, solutions.positions, stop=stop, **how)
    return recorded(plan, MoveJ.key, planning, targets, how, wobj=wobj, solver=solver, stop=stop)
