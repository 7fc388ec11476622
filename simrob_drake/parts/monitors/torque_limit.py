"""A servo that stays at its torque limit."""

from typing import Literal

import numpy as np

from simrob_drake.blocks.monitor import Condition
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import MonitorSection, of_axes, worst
from simrob_drake.parts.site import Surroundings
from simrob_drake.quantities import NotNegative

_AT_LIMIT = 1e-6
"""Part of a torque limit that may be missing where a servo counts as saturated."""


class TorqueLimit(MonitorSection):
    """End the run when a servo stays at its torque limit."""

    kind: Literal["torque_limit"]
    hold: NotNegative = 0.5
    """How long it must stay there [s]."""

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the largest part of a limit that is used, minus one."""
        robot = station.robot(self.robot, f"monitors.{name}")
        limit = robot.gains.torque_limit

        def uses(torque: Vector) -> Vector:
            return np.asarray(np.abs(torque) / limit - 1 + _AT_LIMIT)

        def why(index: int, _: float) -> str:
            told = f"{limit[index]:g} {robot.model.units[index].effort}"
            return f"{robot.axes[index]} stayed at its torque limit of {told} for {self.hold:g} s"

        return worst(of_axes(robot, "torque"), uses, why)
