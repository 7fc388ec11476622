"""A joint that reaches a limit of its range."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from simrob_drake.blocks.monitor import Monitor, largest
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import Made, MonitorSection, of_robot
from simrob_drake.parts.site import Site
from simrob_drake.robots.units import REVOLUTE, AxisUnit
from simrob_drake.yaml_files import Number


class JointLimit(MonitorSection):
    """End the run when a joint reaches a limit of its range."""

    kind: Literal["joint_limit"]
    margin_deg: Number = 0.0
    """How far before the limit the run ends, for axes that turn; negative: beyond it."""
    margin_m: Number = 0.0
    """The same for axes that slide [m]."""

    def made(self, name: str, site: Site) -> Made:
        """Return the block."""
        robot = self.watched_robot(name, site)
        lower, upper = robot.model.axis_limits
        margin, units = robot.model.bounds(self.margin_deg, self.margin_m), robot.model.units
        monitor = JointLimitMonitor(axes=robot.axes, lower=lower, upper=upper, margin=margin, units=units, **self.times)
        return of_robot(monitor, robot)


class JointLimitMonitor(Monitor):
    """End the run when a joint reaches a limit of its range.

    Ports:
        in  ``position`` (n): measured joint positions [rad or m].
        out ``excess`` (1): largest overshoot of a limit [rad or m].
    """

    def __init__(
        self,
        *,
        axes: Sequence[str],
        lower: Vector,
        upper: Vector,
        margin: float | Vector = 0.0,
        units: Sequence[AxisUnit] = (),
        hold: float = 0.0,
        after: float = 0.0,
    ) -> None:
        """Watch ``axes``, all of which turn unless ``units`` says so, from ``margin`` before their limits (n,)."""
        super().__init__(hold=hold, after=after)
        self._units = list(units) or [REVOLUTE] * len(axes)
        self._axes, self._lower, self._upper = list(axes), lower + margin, upper - margin
        self.watch(position=len(axes))

    def excess(self, *values: Vector) -> float:
        """Return the largest overshoot [rad or m]."""
        return largest(self._overshoot(*values))[1]

    def why(self, *values: Vector) -> str:
        """Name the joint and its limit."""
        index, _ = largest(self._overshoot(*values))
        axis, side = self._axes[index % len(self._axes)], "upper" if index < len(self._axes) else "lower"
        limit = (self._upper if side == "upper" else self._lower)[index % len(self._axes)]
        return f"{axis} reached its {side} limit of {self._units[index % len(self._axes)].told(limit)}"

    def _overshoot(self, position: Vector) -> Vector:
        return np.concatenate([position - self._upper, self._lower - position])
