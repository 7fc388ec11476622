"""A robot that stands still."""

from typing import Literal

import numpy as np

from simrob_drake.blocks.monitor import Condition
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import MonitorSection, of_axes
from simrob_drake.parts.site import Surroundings
from simrob_drake.sections import NotNegative, Positive


class Settled(MonitorSection):
    """End the run when the robot stands still."""

    kind: Literal["settled"]
    hold: NotNegative = 0.2
    """How long it must stand [s]."""
    speed_deg: Positive = 0.1
    """Speed below which an axis that turns stands still [deg/s]."""
    speed_m: Positive = 1e-3
    """Speed below which an axis that slides stands still [m/s]."""
    error_deg: Positive | None = None
    """Largest position error of axes that turn; unless given any error counts as settled."""
    error_m: Positive | None = None
    """Largest position error of axes that slide [m]; unless given any error counts as settled."""

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is how far below the bounds the worst joint is, as a part of them."""
        robot = station.robot(self.robot, f"monitors.{name}")
        speed = robot.model.bounds(self.speed_deg, self.speed_m)
        errors = [np.inf if bound is None else bound for bound in (self.error_deg, self.error_m)]
        error, more = robot.model.bounds(*errors), () if np.isinf(errors).all() else ("position", "reference")

        def excess(velocity: Vector, *places: Vector) -> float:
            use = float((np.abs(velocity) / speed).max())
            if places:
                position, reference = places
                use = max(use, float((np.abs(reference - position) / error).max()))
            return 1 - use

        def why(*_: Vector) -> str:
            bounds = zip(speed, robot.model.units, strict=True)
            speeds = dict.fromkeys(f"{bound / unit.size:g} {unit.name}/s" for bound, unit in bounds)
            return f"the robot has stood still (below {' and '.join(speeds)}) for {self.hold:g} s"

        return Condition(of_axes(robot, "velocity", *more), excess, why)
