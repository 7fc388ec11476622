"""A servo that stays at its torque limit."""

from typing import Literal

import numpy as np

from simrob_drake.blocks.monitor import Condition
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import MonitorSection, of_axes, worst
from simrob_drake.parts.site import ResolvedRobot, Surroundings
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.sections import NotNegative

_AT_LIMIT = 1e-6
"""Part of a torque limit that may be missing where a servo counts as saturated."""


class TorqueLimit(MonitorSection):
    """End the run when a servo stays at its torque limit, or beyond one of the monitor's own."""

    kind: Literal["torque_limit"]
    hold: NotNegative = 0.5
    """How long it must stay there [s]."""
    limit: AxisValues | None = None
    """What counts as the limit, per axis [N·m or N]: of the servo unless given. Axes that a mapping leaves out keep
    that of their servo."""

    def check(self, name: str, station: Surroundings) -> None:
        """Check that the limits are positive."""
        super().check(name, station)
        limit = self._limits(station.robot(self.robot, f"monitors.{name}"))
        if not (limit > 0).all():
            raise InvalidParameter(f"monitors.{name}.limit", float(limit.min()), "positive [N·m or N]")

    def _limits(self, robot: ResolvedRobot) -> Vector:
        own = robot.gains.torque_limit
        return own if self.limit is None else robot.model.axis_vector(self.limit, "limit", own)

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the largest part of a limit that is used, minus one."""
        robot = station.robot(self.robot, f"monitors.{name}")
        limit = self._limits(robot)

        def uses(torque: Vector) -> Vector:
            return np.asarray(np.abs(torque) / limit - 1 + _AT_LIMIT)

        def why(index: int, _: float) -> str:
            bound = f"{limit[index]:g} {robot.model.units[index].effort}"
            what = "its torque limit" if self.limit is None else "the limit"
            return f"{robot.axes[index]} stayed at {what} of {bound} for {self.hold:g} s"

        return worst(of_axes(robot, "torque"), uses, why)
