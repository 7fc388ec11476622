"""A robot that stands still."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from simrob_drake.blocks.monitor import Monitor
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import Made, MonitorSection, of_robot
from simrob_drake.parts.site import Site
from simrob_drake.quantities import NotNegative, Positive
from simrob_drake.robots.units import REVOLUTE, AxisUnit


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

    def made(self, name: str, site: Site) -> Made:
        """Return the block."""
        robot = self.watched_robot(name, site)
        model, errors = robot.model, (self.error_deg, self.error_m)
        bounds = [np.inf if bound is None else bound for bound in errors]
        error = None if errors == (None, None) else model.bounds(*bounds)
        speed = model.bounds(self.speed_deg, self.speed_m)
        monitor = SettledMonitor(size=len(robot.axes), speed=speed, error=error, units=model.units, **self.times)
        return of_robot(monitor, robot)


class SettledMonitor(Monitor):
    """End the run when the robot stands still, and near its reference if that is asked.

    Ports:
        in  ``velocity`` (n): joint velocities [rad/s or m/s].
        in  ``position`` (n), ``reference`` (n): where a largest error is given [rad or m].
        out ``excess`` (1): how far below the bounds the worst joint is, as a part of them.
    """

    def __init__(
        self,
        *,
        size: int,
        speed: float | Vector,
        error: float | Vector | None = None,
        units: Sequence[AxisUnit] = (),
        hold: float = 0.2,
        after: float = 0.0,
    ) -> None:
        """Watch ``size`` joints, all of which turn unless ``units`` says so.

        Args:
            size: n.
            speed: below which a joint stands, for all or each of them [rad/s or m/s].
            error: largest distance from the reference, for all or each of them [rad or m].
            units: of the joints.
            hold: how long the condition must last [s].
            after: when watching begins [s].
        """
        super().__init__(hold=hold, after=after)
        for name, value in (("speed", speed), ("error", error)):
            if value is not None and not np.all(np.greater(value, 0)):
                raise InvalidParameter(name, value, "positive")
        self._speed, self._error = np.broadcast_to(speed, size), error
        self._units = list(units) or [REVOLUTE] * size
        self.watch(velocity=size)
        if error is not None:
            self.watch(position=size, reference=size)

    def excess(self, *values: Vector) -> float:
        """Return one minus the worst use of a bound."""
        velocity, *places = values
        use = float((np.abs(velocity) / self._speed).max())
        if self._error is not None:
            position, reference = places
            use = max(use, float((np.abs(reference - position) / self._error).max()))
        return 1 - use

    def why(self, *values: Vector) -> str:
        """Say since when the robot stands."""
        bounds = zip(self._speed, self._units, strict=True)
        told = dict.fromkeys(f"{speed / unit.size:g} {unit.name}/s" for speed, unit in bounds)
        return f"the robot has stood still (below {' and '.join(told)}) for {self.hold:g} s"
