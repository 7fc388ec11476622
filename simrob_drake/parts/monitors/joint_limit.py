"""A joint that reaches a limit of its range."""

from typing import Literal

import numpy as np

from simrob_drake.blocks.monitor import Condition
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import MonitorSection, of_axes, worst
from simrob_drake.parts.site import Surroundings
from simrob_drake.sections import Number


class JointLimit(MonitorSection):
    """End the run when a joint reaches a limit of its range."""

    kind: Literal["joint_limit"]
    margin_deg: Number = 0.0
    """How far before the limit the run ends, for axes that turn; negative: beyond it."""
    margin_m: Number = 0.0
    """The same for axes that slide [m]."""

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the largest overshoot of a limit [rad or m]."""
        robot = station.robot(self.robot, f"monitors.{name}")
        count, margin = len(robot.axes), robot.model.bounds(self.margin_deg, self.margin_m)
        lower, upper = robot.model.axis_limits
        lower, upper = lower + margin, upper - margin

        def overshoots(position: Vector) -> Vector:
            return np.concatenate([position - upper, lower - position])

        def why(index: int, _: float) -> str:
            side, limits, axis = ("upper", upper, index) if index < count else ("lower", lower, index - count)
            return f"{robot.axes[axis]} reached its {side} limit of {robot.model.units[axis].shown(limits[axis])}"

        return worst(of_axes(robot, "position"), overshoots, why)
