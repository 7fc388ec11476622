"""Moves straight in the joints: of an arm's axes to postures, of its tool to poses (RAPID's MoveAbsJ and MoveJ)."""

from itertools import pairwise
from typing import ClassVar, Unpack

import numpy.typing as npt

from simrob_drake.base.arguments import truth
from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Boolean
from simrob_drake.kinematics.registry import SolverLike
from simrob_drake.programs.moves.motion import ArmMotion, Rows, ToolMotion
from simrob_drake.programs.plan import Plan, target_name
from simrob_drake.programs.planning import (
    POINTS,
    Planning,
    PoseTargets,
    WorkObject,
    degrees_hint,
    grouped,
    points_of,
    zone_of,
)
from simrob_drake.programs.segments import joint_segment, joint_way
from simrob_drake.programs.tape import recorded
from simrob_drake.programs.timing import How


class MoveAbsJ(ArmMotion):
    """Axes that go to a posture, or through many; see :meth:`Arm.move_abs_j`."""

    key: ClassVar[str] = "move_abs_j"
    of_axes: ClassVar[bool] = True

    targets: Rows | str | None = None  # type: ignore[assignment]  # wider, of what nobody writes
    """Where to, one posture or many [rad or m], or one of the robot's by name, such as `home`."""
    stop: Boolean = False
    """Rest at each target."""

    def plan(self, planning: Planning) -> Plan:
        """Return the move, planned."""
        return plan_move_abs_j(planning, self.rows(planning), stop=self.stop, **self.how)


def plan_move_abs_j(
    planning: Planning, targets: npt.ArrayLike | str, *, stop: bool = False, **how: Unpack[How]
) -> Plan:
    """Plan a move to one posture (n,) or through many (k, n) [rad or m]; without those of fingers they stay.

    A name stands for a posture of the robot's, such as ``home``.

    Raises:
        UnknownName: no such posture.
        InvalidParameter: targets of a wrong shape, or a duration that cannot be.
        JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: names the first bad point.
    """
    rows = planning.postures(targets)
    if planning.chain.limits.are_within(rows):
        rows = planning.chain.limits.clamp(rows, message("programs.the_targets", "the targets"))
    points, zone = points_of(how, POINTS), zone_of(how, len(rows))
    if truth(stop, "stop") and zone:
        raise Unsuitable(
            "stop",
            message("programs.zone_rounds_targets", "a zone rounds the targets, so that the joints do not stop there"),
            message("programs.give_one_of_two", "give one of the two"),
        )
    through = not stop and len(rows) > 1 and "zone" not in how
    if through and {"profile", "acceleration"} & {*how}:
        raise InvalidParameter(
            "profile",
            "given",
            message("programs.with_stop_or_zone", "given with stop=True or a zone: else the joints do not cruise"),
        )
    ways = [joint_way(planning.chain, start, row) for start, row in pairwise([planning.start, *rows])]
    segments = [joint_segment(way, points=count) for way, count in grouped(ways, zone, points)]
    plan = planning.checked(segments, how, points, rows, through=through, hint=degrees_hint(planning.chain, rows))
    return recorded(plan, MoveAbsJ.key, planning, targets, how, solver="auto", stop=stop)


class MoveJ(ToolMotion, ArmMotion):
    """A tool that goes to poses the easiest way; see :meth:`Arm.move_j`."""

    key: ClassVar[str] = "move_j"

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
