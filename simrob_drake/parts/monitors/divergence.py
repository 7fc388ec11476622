"""A joint that runs away."""

from typing import Literal

import numpy as np

from simrob_drake.blocks.monitor import Condition
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import MonitorSection, of_axes, worst
from simrob_drake.parts.site import Surroundings
from simrob_drake.sections import Positive


class Divergence(MonitorSection):
    """End the run when a joint runs away."""

    kind: Literal["divergence"]
    speed_limit: Positive = 100.0
    """Speed that counts as running away [rad/s, or m/s of axes that slide]."""

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the largest speed over the bound [rad/s or m/s]."""
        robot = station.robot(self.robot, f"monitors.{name}")

        def speeds(velocity: Vector) -> Vector:
            return np.abs(velocity) - self.speed_limit

        def why(index: int, excess: float) -> str:
            unit, speed = f"{robot.model.units[index].si}/s", excess + self.speed_limit
            return f"{robot.axes[index]} ran away: {speed:.4g} {unit}, above {self.speed_limit:g} {unit}"

        return worst(of_axes(robot, "velocity"), speeds, why)
