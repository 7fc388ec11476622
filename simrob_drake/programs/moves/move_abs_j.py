"""A move of an arm's axes to a posture, or through many (RAPID's MoveAbsJ)."""

from itertools import pairwise
from typing import ClassVar, Unpack

import numpy.typing as npt

from simrob_drake.arguments import truth
from simrob_drake.errors import InvalidParameter
from simrob_drake.programs.moves.motion import ArmMotion, Rows
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.planning import POINTS, Planning, degrees_hint, grouped, points_of, zone_of
from simrob_drake.programs.segments import joint_segment, joint_way
from simrob_drake.programs.tape import recorded
from simrob_drake.programs.timing import How
from simrob_drake.sections import Boolean


class MoveAbsJ(ArmMotion):
    """Axes that go to a posture, or through many; see :meth:`Arm.move_abs_j`."""

    key: ClassVar[str] = "move_abs_j"
    title: ClassVar[str] = "MoveAbsJ"
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
    points, zone = points_of(how, POINTS), zone_of(how, len(rows))
    if truth(stop, "stop") and zone:
        raise InvalidParameter("stop", stop, "left out with a zone")
    through = not stop and len(rows) > 1 and "zone" not in how
    if through and {"profile", "acceleration"} & {*how}:
        raise InvalidParameter("profile", "given", "given with stop=True or a zone: else the joints do not cruise")
    ways = [joint_way(planning.chain, start, row) for start, row in pairwise([planning.start, *rows])]
    segments = [joint_segment(way, points=count) for way, count in grouped(ways, zone, points)]
    plan = planning.checked(segments, how, points, rows, through=through, hint=degrees_hint(planning.chain, rows))
    return recorded(plan, MoveAbsJ.key, planning, targets, how, solver="auto", stop=stop)
