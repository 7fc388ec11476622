"""A joint that runs away."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from simrob_drake.blocks.monitor import Monitor, largest
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import Made, MonitorSection, of_robot
from simrob_drake.parts.site import Site
from simrob_drake.quantities import Positive
from simrob_drake.robots.units import REVOLUTE, AxisUnit


class Divergence(MonitorSection):
    """End the run when a joint runs away."""

    kind: Literal["divergence"]
    speed_limit: Positive = 100.0
    """Speed that counts as running away [rad/s, or m/s of axes that slide]."""

    def made(self, name: str, site: Site) -> Made:
        """Return the block."""
        robot = self.watched_robot(name, site)
        units = robot.model.units
        monitor = DivergenceMonitor(axes=robot.axes, speed_limit=self.speed_limit, units=units, **self.times)
        return of_robot(monitor, robot)


class DivergenceMonitor(Monitor):
    """End the run when a joint runs away, or when a value is no number any more.

    Ports:
        in  ``velocity`` (n): joint velocities [rad/s or m/s].
        out ``excess`` (1): the largest speed over the bound.
    """

    def __init__(
        self,
        *,
        axes: Sequence[str],
        speed_limit: float,
        units: Sequence[AxisUnit] = (),
        hold: float = 0.0,
        after: float = 0.0,
    ) -> None:
        """Watch ``axes``, all of which turn unless ``units`` says so, for speeds above a limit [rad/s or m/s]."""
        super().__init__(hold=hold, after=after)
        if not speed_limit > 0:
            raise InvalidParameter("speed_limit", speed_limit, "positive [rad/s or m/s]")
        self._axes, self._limit, self._units = list(axes), speed_limit, list(units) or [REVOLUTE] * len(axes)
        self.watch(velocity=len(axes))

    def excess(self, *values: Vector) -> float:
        """Return the largest speed over the bound [rad/s or m/s]."""
        (velocity,) = values
        return largest(np.abs(velocity))[1] - self._limit

    def why(self, *values: Vector) -> str:
        """Name the joint and its speed."""
        (velocity,) = values
        index, speed = largest(np.abs(velocity))
        unit = f"{self._units[index].si}/s"
        return f"{self._axes[index]} ran away: {speed:.4g} {unit}, above {self._limit:g} {unit}"
