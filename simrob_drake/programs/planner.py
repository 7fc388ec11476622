"""Plan the moves of one arm from where it is: RAPID's words, with everything checked before anything moves."""

from typing import Unpack

import numpy.typing as npt

from simrob_drake.kinematics.analytic import SolverLike
from simrob_drake.programs.moves.move_abs_j import plan_move_abs_j
from simrob_drake.programs.moves.move_c import plan_move_c
from simrob_drake.programs.moves.move_j import plan_move_j
from simrob_drake.programs.moves.move_l import plan_move_l
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.planning import Planning
from simrob_drake.programs.targets import PoseTargets, WorkObject
from simrob_drake.programs.timing import How


class Planner(Planning):
    """Plans moves of one robot; nothing moves.

    All moves begin at rest where the robot's reference is, and rest at their end; of several targets they rest at each
    unless they have a ``zone``, but for those of :meth:`move_abs_j` and :meth:`move_j`, which pass through smoothly
    unless ``stop`` is set.
    """

    def __repr__(self) -> str:
        """Say in one line whose moves it plans."""
        return f"<Planner of {self.robot}: {self.chain!r}>"

    def move_abs_j(self, targets: npt.ArrayLike, *, stop: bool = False, **how: Unpack[How]) -> Plan:
        """Plan a move to one posture (n,) or through many (k, n) [rad or m].

        Raises:
            InvalidParameter: targets of a wrong shape, or a duration that cannot be.
            JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: names the first offending
                point.
        """
        return plan_move_abs_j(self, targets, how, stop=stop)

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
            JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: names the first offending
                point.
        """
        return plan_move_j(self, targets, how, wobj=wobj, solver=solver, stop=stop)

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
            JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: names the first offending
                point.
        """
        return plan_move_l(self, targets, how, wobj=wobj, solver=solver)

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
            JointLimitExceeded, SpeedLimitExceeded, AccelerationLimitExceeded, PathCollision: names the first offending
                point.
        """
        return plan_move_c(self, via, targets, how, wobj=wobj, solver=solver)
