"""Moves straight in the joints: of an arm's axes to postures, of its tool to poses (RAPID's MoveAbsJ and MoveJ)."""

from itertools import pairwise
from typing import ClassVar, Unpack

import numpy.typing as npt

from simrob_drake.base.arguments import truth
from simrob_drake.base.errors import Unsuitable
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
    join_ways,
    points_of,
    zone_of,
)
from simrob_drake.programs.segments import joint_segment, joint_way
from simrob_drake.programs.tape import with_entry
from simrob_drake.programs.timing import How


class MoveAbsJ(ArmMotion):
    """A move of the axes to a posture, or through several; see :meth:`Arm.move_abs_j`."""

    key: ClassVar[str] = "move_abs_j"
    of_axes: ClassVar[bool] = True

    targets: Rows | str | None = None  # type: ignore[assignment]  # wider than in the base class, whose field is only read
    """One posture or several [rad or m], or the name of one of the robot's postures, such as `home`."""
    stop: Boolean = False
    """Whether the move rests at each target."""

    def plan(self, planning: Planning) -> Plan:
        """Plan the move; see :func:`plan_move_abs_j`."""
        return plan_move_abs_j(planning, self.rows(planning), stop=self.stop, **self.how)


def plan_move_abs_j(
    planning: Planning,
    targets: npt.ArrayLike | str,
    *,
    stop: bool = False,
    **how: Unpack[How],
) -> Plan:
    """Plan a move of the axes to one posture, or through several.

    Args:
        planning: the start of the move.
        targets: a posture (n,), several (k, n) [rad or m], or the name of one of the robot's postures, such as
            ``home``. The positions of fingers may be left out: then the fingers stay.
        stop: whether the move rests at each target.
        how: see :class:`How`.

    Raises:
        UnknownName: the robot has no such posture.
        InvalidParameter: the targets have a wrong shape, or an option is invalid.
        Unsuitable: `stop` and a zone other than ``fine`` are set; or an acceleration or a profile is set for a move
            that passes its targets smoothly.
        JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: the move exceeds a limit or
            has a collision. The message names the first such point.
    """
    rows = planning.postures(targets)  # one target posture in each row, shape (k, n)
    # Targets beyond a limit only by rounding are moved to the limit. All others are refused later, with their point.
    if planning.chain.limits.are_within(rows):
        rows = planning.chain.limits.clamp(rows, message("programs.the_targets", "the targets"))
    points = points_of(how, POINTS)
    zone = zone_of(how, len(rows))  # distance from a target [m]; 0 without zones
    # With a zone the joints pass by the targets, so that they cannot stop there.
    if truth(stop, "stop") and zone:
        raise Unsuitable(
            "stop",
            message(
                "programs.zone_rounds_targets",
                "with a zone the joints do not stop at the targets",
            ),
            message("programs.give_one_of_two", "give one of the two"),
        )
    # Without stops and zones a spline leads through all targets. It has no constant speed that a profile could reach.
    passes_smoothly = not stop and len(rows) > 1 and "zone" not in how
    if passes_smoothly and ("profile" in how or "acceleration" in how):
        raise Unsuitable(
            "profile" if "profile" in how else "acceleration",
            message(
                "programs.without_cruise",
                "a move that passes its targets smoothly has no cruising speed",
            ),
            message("programs.with_stop_or_zone", "set stop=True or a zone"),
        )
    # A way is the path to one target. With a zone, the ways are joined to a single one with more points.
    ways = [
        joint_way(planning.chain, start, row) for start, row in pairwise([planning.start, *rows])
    ]
    segments = [joint_segment(way, points=count) for way, count in join_ways(ways, zone, points)]
    hint = degrees_hint(planning.chain, rows)
    plan = planning.plan_segments(segments, how, points, rows, through=passes_smoothly, hint=hint)
    return with_entry(
        plan, MoveAbsJ.key, planning, targets, how, solver="auto", are_postures=True, stop=stop
    )


class MoveJ(ToolMotion, ArmMotion):
    """A move of the tool to poses, straight in the joints; see :meth:`Arm.move_j`."""

    key: ClassVar[str] = "move_j"

    stop: Boolean = False
    """Whether the move rests at each target."""

    def plan(self, planning: Planning) -> Plan:
        """Plan the move; see :func:`plan_move_j`."""
        return plan_move_j(
            planning,
            self.rows(planning),
            wobj=self.wobj,
            solver=self.solver,
            stop=self.stop,
            **self.how,
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
    """Plan a move to poses of the tool, straight in the joints: the path that is easiest for the axes.

    Args:
        planning: the start of the move.
        targets: poses of the tool in the work object's frame, or places (3,) or (k, 3) [m] that keep its orientation.
        wobj: the work object. If it is None, the world.
        solver: solver of the inverse kinematics. If it is None, that of the arm. Of several postures the nearest one is
            used.
        stop: whether the move rests at each target.
        how: see :class:`How`.

    Raises:
        Unreachable: no posture reaches a target. The message names it, why, and how near the best posture comes.
        InvalidParameter, Unsuitable: see :func:`plan_move_abs_j`.
        JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: the move exceeds a limit or
            has a collision. The message names the first such point.
    """
    # Only the targets are solved. Between them the joints go straight, so that singular postures do no harm.
    inverse = planning.inverse(solver)
    poses = planning.poses(targets, wobj)
    solutions = inverse.solve(poses, planning.start)
    if not solutions.reached.all():
        missed = solutions.first_missed
        raise solutions.unreachable(missed, target_name(missed, len(poses)))
    plan = plan_move_abs_j(planning, solutions.positions, stop=stop, **how)
    # The plan has an entry of `move_abs_j` so far. The file gets the poses that the user gave instead.
    return with_entry(plan, MoveJ.key, planning, targets, how, wobj=wobj, solver=solver, stop=stop)
