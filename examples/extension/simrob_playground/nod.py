"""Move of an arm: one axis nods, which means that it turns by an angle and back, several times."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from simrob_drake.base.sections import Duration, Integer, Number
from simrob_drake.programs.moves.move import Move, Run
from simrob_drake.programs.moves.move_j import plan_move_abs_j
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.planning import Planning
from simrob_drake.programs.stateful_station import StatefulStation


class NodMove(Move):
    """One axis of an arm turns by an angle and back."""

    key: ClassVar[str] = "nod"
    title: ClassVar[str] = "Nod"
    says: ClassVar[str] = "nod {it.times} times"
    of_legs: ClassVar[bool] = False
    # fields on the pendant
    form: ClassVar[Mapping[str, str | float | None]] = {
        "angle_deg": 20.0,
        "duration": 2.0,
    }

    axis: str | None = None
    """Name of the axis; the last but one unless given, which bends the wrist of many arms."""
    angle_deg: Number = 20.0
    """Angle by which the axis turns [deg]."""
    times: Integer = Field(default=2, ge=1, le=100)
    """Number of nods."""
    duration: Duration = 2.0
    """Time of all nods [s]."""
    robot: str | None = None
    """Robot that nods; the robot of the program unless given."""

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> Any:
        """Plan the nods from where the arm is, and run them."""
        plan = self.plan(cell.planning(self.robot or robot))
        return run([plan], None)

    def plan(self, planning: Planning) -> Plan:
        """Plan the nods: to the turned posture and back, at rest in each.

        Raises:
            UnknownName: the robot has no such axis.
            JointLimitExceeded: the turned posture is beyond a limit of the axis.
        """
        model = planning.model
        index = len(model.axes) - 2 if self.axis is None else model.axis_index(self.axis, "axis")
        turned = np.array(planning.start)
        turned[index] += np.deg2rad(self.angle_deg)
        postures = [turned, planning.start] * self.times
        return plan_move_abs_j(planning, postures, stop=True, duration=self.duration)
