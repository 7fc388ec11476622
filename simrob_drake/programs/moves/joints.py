"""Moves of axes to targets, all at the same time (SimRob's TestMove and AddMove).

Arms *perform* a move at once. For a robot with legs the whole program is first cut into *stages*, functions that run
later; the *outlook* is the station as it will be before a move. An *alias* is another name of an axis. A *passive* axis
has no motor. The *reference* of a robot is where its axes should be.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import Duration, Number
from simrob_drake.programs.errors import JointLimitExceeded
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.moves.move import MOVE_TIME, Move, Outlook, Run, Stage, make_move
from simrob_drake.programs.moves.move_j import plan_move_abs_j
from simrob_drake.programs.plan import CHECKED, Check
from simrob_drake.programs.stateful_station import StatefulStation
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.coupled_references import with_partners
from simrob_drake.stations.servos import passive_axis

Targets = Annotated[dict[str, Number], Field(min_length=1)]
"""Targets of axes by name or alias [deg, or m for a prismatic axis]. Axes that are left out stay."""


class JointMove(Move):
    """Axes go to their targets at the same time. As a reference of an automatic program, until they are there."""

    key: ClassVar[str] = "target_deg"
    # Without a caption, because moves of joints that follow each other are one run.
    says: ClassVar[str] = ""

    target_deg: Targets
    """Absolute positions at the end."""
    duration: Duration = MOVE_TIME
    """Duration of the move [s]."""
    check: Check | None = CHECKED
    """What an arm checks before the move in addition to its targets; `limits` leaves collisions out, and null does the
    same. Robots with legs check the targets alone."""

    def entry(self) -> dict[str, Any]:
        """Keys and values of the move in a program's file. The default of `check` is left out.

        The duration is always written, so that a program keeps it if the default changes.
        """
        left_out = {"check"} if self.check == CHECKED else None
        return self.model_dump(mode="json", exclude=left_out)

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> Any:
        """Move an arm to the targets, straight in the joints. Axes that are coupled to them move as well.

        Args:
            cell: the station.
            robot: name of the robot whose program it is. If it is None, the only robot.
            run: function that runs the plan of the move.

        Returns:
            The value that `run` returns.

        Raises:
            Unsuitable: an axis of the move has no motor on a dynamic station.
            SimrobError: a target is wrong, or the move exceeds a limit or has a collision.
        """
        planning = cell.planning(robot)
        posture = planning.start.copy()
        targets = targets_on(
            planning.model, self.target_deg, message("programs.the_target", "the target")
        )
        check_motors_of(cell, planning.robot, targets)
        # Axes without a target stay where the arm's reference is, unless they are coupled to one that has a target.
        for index, position in targets.items():
            posture[index] = position
        posture = with_partners(cell.model.resolved, planning.robot, posture, targets)
        plan = plan_move_abs_j(planning, posture, duration=self.duration, check=self.check)
        # The plan is recorded in a program as this move, in degrees by axis name, not as `move_abs_j`.
        return run([replace(plan, written_as=self.key)], None)

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Check the targets. The returned stage does nothing.

        Moves of joints that follow each other are run as one stage, which ``stages_of`` in
        :mod:`simrob_drake.programs.stages` makes in place of theirs.

        Args:
            robot: the robot.
            outlook: not used, because the move does not change the station.
            name: name of the move for messages.

        Raises:
            Unsuitable: the move has a `check` other than the default, which only arms do; or the station is dynamic,
                and an axis of the move has no motor.
            SimrobError: a target is wrong, see :func:`targets_on`.
        """
        # Everything that can be wrong is found now, before any move of the program runs.
        self.refuse_check(name)
        targets = targets_on(robot.model, self.target_deg, name, self.duration)
        check_motors_of(robot.cell, robot.name, targets)
        return lambda robot: None

    def refuse_check(self, name: str) -> None:
        """Refuse a `check` other than the default, for robots that check targets alone.

        Args:
            name: name of the move, for the message.

        Raises:
            Unsuitable: the move has another `check`.
        """
        if self.check != CHECKED:
            raise Unsuitable(
                compound("{where}: {key}", where=name, key="check"),
                message(
                    "programs.check_of_arms",
                    "only moves of arms check speed limits and collisions",
                ),
            )


def check_motors_of(cell: StatefulStation, robot: str, targets: Collection[int]) -> None:
    """Check that the axes of a move have motors, if the station is dynamic. On a kinematic one they need none.

    Args:
        cell: the station.
        robot: name of the robot.
        targets: indices of the axes that have targets.

    Raises:
        Unsuitable: an axis is passive.
    """
    station_robot = cell.robot(robot)
    # In a kinematic station positions are set, not reached by torques.
    if not cell.config.engine.moves_by_forces:
        return
    for index in targets:
        if station_robot.gains.passive[index]:
            raise passive_axis(f"target_deg.{station_robot.axes[index]}", station_robot.axes[index])


def move_of(target_deg: Mapping[str, Any], duration: Any = MOVE_TIME) -> JointMove:
    """Make a move of joints from arguments of a user. Whether a robot has such axes is not checked here.

    Args:
        target_deg: target of each axis by name or alias [deg, or m for a prismatic axis].
        duration: duration of the move [s].

    Raises:
        InvalidParameter: no target is given, a target is not a finite number, or the duration is not positive.
    """
    return make_move(JointMove, target_deg=target_deg, duration=duration)


def targets_on(
    model: RobotModel, target_deg: Mapping[str, float], where: str, time: float = 0.0
) -> dict[int, float]:
    """Convert the targets of a move to SI units, and check them.

    Args:
        model: the robot.
        target_deg: target of each axis by name or alias [deg, or m for a prismatic axis].
        where: name of the move for messages.
        time: time of the target for messages [s].

    Returns:
        Target position by the index of the axis [rad or m].

    Raises:
        UnknownName: there is no such axis. The message proposes the nearest name.
        InvalidParameter: an axis has two targets, under two of its names.
        JointLimitExceeded: a target is beyond a limit of its axis by more than rounding.
    """
    names = list(model.axes)
    units = model.user_units
    targets: dict[int, float] = {}
    # An axis may be named by an alias: two keys may mean the same axis.
    for axis, value in target_deg.items():
        index = model.axis_index(axis, where)
        if index in targets:
            raise Unsuitable(
                compound("{where}: {axis}", where=where, axis=axis),
                message(
                    "programs.other_name_of_axis",
                    "its axis has a target under another name already",
                ),
            )
        targets[index] = float(value * units[index])

    # Limits are checked for the axes with targets only: other axes of the robot stay where they are.
    indices = list(targets)
    positions = np.array(list(targets.values()))
    limits = model.limits.of_axes(indices)
    violation = limits.find_violation(positions[np.newaxis])
    if violation is not None:
        unit = violation.unit
        shown = message(
            "programs.beyond_limit",
            "{position} {unit}, {excess} {unit} beyond its limit of {limit} {unit}",
            position=violation.value,
            unit=unit,
            excess=violation.excess,
            limit=violation.limit,
        )
        # `violation.axis` counts the axes with targets only.
        name = names[indices[violation.axis]]
        position = float(positions[violation.axis])
        # A move of joints has a single target, its point 1.
        raise JointLimitExceeded(where, name, point=1, time=time, value=position, shown=shown)
    # A target beyond a limit only by rounding is moved to the limit.
    return dict(zip(indices, limits.clamp(positions, where).tolist(), strict=True))
